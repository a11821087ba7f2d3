//! What the stages say to each other, message by message as it lies in memory: for replaying a
//! recorded stream into a later stage alone.
//!
//! An MCAP file of its own beside the recording. Its schemas are the messages' names on the wire,
//! which hold a hash of their layouts: a tape of another version is refused, not misread.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use orime_messages::{FoldPlan, Grippers, Message, ObservedCloud, SheetState, Targets};
use orime_runtime::channel;

/// Why a tape cannot be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TapeError {
    /// The file itself.
    #[error("tape `{path}`")]
    File {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        #[source]
        source: std::io::Error,
    },
    /// What is in it.
    #[error("tape `{path}`: not an MCAP file that was written to its end")]
    Format {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        #[source]
        source: mcap::McapError,
    },
    /// Another version's messages.
    #[error(
        "tape `{path}`: `{topic}` holds `{found}`, this program reads `{wanted}`: replay it with \
         the version that recorded it, or record it again"
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// The channel.
        topic: String,
        /// What was recorded.
        found: String,
        /// What this program speaks.
        wanted: &'static str,
    },
}

/// A tape that is being written.
pub struct Tape {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    channels: BTreeMap<&'static str, u16>,
}

impl std::fmt::Debug for Tape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tape").field("path", &self.path).finish_non_exhaustive()
    }
}

/// Where the tape of a recording lies: `fold.mcap` has `fold.stages.mcap`.
pub fn tape_path(recording: &Path) -> PathBuf {
    recording.with_extension("stages.mcap")
}

impl Tape {
    /// Begins a tape; the file must not exist.
    pub fn create(path: &Path) -> Result<Self, TapeError> {
        let failed = |source| TapeError::File { path: path.to_owned(), source };
        let file = BufWriter::new(File::create_new(path).map_err(failed)?);
        let options = WriteOptions::new().compression(Some(Compression::Lz4)).profile("orime");
        let writer = options
            .create(file)
            .map_err(|source| TapeError::Format { path: path.to_owned(), source })?;
        let mut tape = Self { path: path.to_owned(), writer, channels: BTreeMap::new() };
        tape.add_channel::<ObservedCloud>(channel::CLOUD.name)?;
        tape.add_channel::<Targets>(channel::TARGETS.name)?;
        tape.add_channel::<SheetState>(channel::STATE.name)?;
        tape.add_channel::<Grippers>(channel::GRIPPER.name)?;
        tape.add_channel::<FoldPlan>(channel::PLAN.name)?;
        Ok(tape)
    }

    fn add_channel<M: Message>(&mut self, topic: &'static str) -> Result<(), TapeError> {
        let added = self
            .writer
            .add_schema(M::TYPE_NAME, "orime-layout", &[])
            .and_then(|schema| self.writer.add_channel(schema, topic, "orime", &BTreeMap::new()));
        let id = added.map_err(|source| TapeError::Format { path: self.path.clone(), source })?;
        self.channels.insert(topic, id);
        Ok(())
    }

    /// Adds one message of a channel.
    pub fn add<M: Message>(&mut self, topic: &str, message: &M) -> Result<(), TapeError> {
        let Some(channel_id) = self.channels.get(topic).copied() else { return Ok(()) };
        let header = message.header();
        let header = MessageHeader {
            channel_id,
            sequence: header.sequence as u32,
            log_time: header.step,
            publish_time: header.publish_ns,
        };
        self.writer
            .write_to_known_channel(&header, bytemuck::bytes_of(message))
            .map_err(|source| TapeError::Format { path: self.path.clone(), source })
    }

    /// Ends the tape.
    pub fn finish(mut self) -> Result<(), TapeError> {
        let finished = self.writer.finish();
        finished.map(drop).map_err(|source| TapeError::Format { path: self.path.clone(), source })
    }
}

/// A tape that was read: messages by channel, in order.
#[derive(Debug, Default)]
pub struct TapeContent {
    messages: BTreeMap<String, Vec<Vec<u8>>>,
}

impl TapeContent {
    /// Reads a whole tape.
    pub fn load(path: &Path) -> Result<Self, TapeError> {
        let file = std::fs::read(path)
            .map_err(|source| TapeError::File { path: path.to_owned(), source })?;
        let format = |source| TapeError::Format { path: path.to_owned(), source };
        let mut content = Self::default();
        for message in mcap::MessageStream::new(&file).map_err(format)? {
            let message = message.map_err(format)?;
            let topic = message.channel.topic.clone();
            let found = message.channel.schema.as_ref().map_or("", |schema| &schema.name);
            let wanted = match topic.as_str() {
                name if name == channel::CLOUD.name => ObservedCloud::TYPE_NAME,
                name if name == channel::TARGETS.name => Targets::TYPE_NAME,
                name if name == channel::GRIPPER.name => Grippers::TYPE_NAME,
                name if name == channel::PLAN.name => FoldPlan::TYPE_NAME,
                _ => SheetState::TYPE_NAME,
            };
            if found != wanted {
                let (path, found) = (path.to_owned(), found.to_owned());
                return Err(TapeError::Version { path, topic, found, wanted });
            }
            content.messages.entry(topic).or_default().push(message.data.into_owned());
        }
        Ok(content)
    }

    /// The messages of a channel, as they lay in memory.
    pub fn of(&self, topic: &str) -> &[Vec<u8>] {
        self.messages.get(topic).map_or(&[], Vec::as_slice)
    }
}
