//! Writing a recording.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use ::mcap::records::Metadata;
use ::mcap::{Compression, WriteOptions, Writer};
use orime_geometry::{ObservedPoint, RgbdCamera, RgbdFrame, SheetGrid};

use super::camera_out::{Channel, Out, RecordedCamera, add_channel};
use super::message;
use super::schemas::{self, Schema};
use super::sink::Sink;
use super::topic::{self, Role};
use super::{RecordError, SheetState};

// Pixels, points and triangles are stored as they lie in memory.
const _: () = assert!(cfg!(target_endian = "little"));

/// Bytes that gather before the system is asked to write; whole chunks pass by.
const BUFFER_BYTES: usize = 64 * 1024;

/// What a finished recording holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Recorded {
    /// Messages of all kinds.
    pub messages: u64,
    /// Size of the file, bytes.
    pub bytes: u64,
}

/// Writes a recording, one call per frame, cloud or sheet state.
///
/// Each call ends a chunk of the file, so that whatever ends the process loses no earlier call. A
/// frame's chunk holds its calibration and transforms too, so that every chunk stands alone. After
/// an error nothing more is written; what was written before reads back.
///
/// Steps and exposure times must strictly increase for each camera and each kind of message; they
/// need not be consecutive.
pub struct Recorder {
    path: PathBuf,
    writer: Writer<Sink>,
    cameras: Vec<RecordedCamera>,
    cloud: Option<Channel>,
    sheets: [Option<Channel>; 2],
    messages: u64,
    /// Room for one message, kept between calls.
    message: Vec<u8>,
    /// The grid that `triangles` belong to.
    grid: Option<SheetGrid>,
    triangles: Vec<[u32; 3]>,
}

impl Recorder {
    /// Creates the file, which must not exist, for frames of these cameras. `set` is the name of
    /// the set that is recorded.
    pub fn create(path: &Path, set: &str, cameras: &[RgbdCamera]) -> Result<Self, RecordError> {
        let file = File::create_new(path)
            .map_err(|source| RecordError::Create { path: path.to_owned(), source })?;
        let sink = BufWriter::with_capacity(BUFFER_BYTES, file);
        Self::to_writer(path, Box::new(sink), set, cameras)
    }

    /// Writes to anything; `path` is what errors call it.
    pub fn to_writer(
        path: &Path,
        sink: Box<dyn Write + Send>,
        set: &str,
        cameras: &[RgbdCamera],
    ) -> Result<Self, RecordError> {
        let failed = |source| RecordError::Write { path: path.to_owned(), source };
        // Chunks are ended by hand, and written only when they are whole.
        let options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(None)
            .disable_seeking(true)
            .library(format!("orime-recording/{}", env!("CARGO_PKG_VERSION")));
        let mut writer = options.create(Sink::new(sink)).map_err(failed)?;
        writer.write_metadata(&description(set, cameras)).map_err(failed)?;
        let cameras = (0..)
            .zip(topic::camera_parts(cameras))
            .zip(cameras)
            .map(|((index, part), camera)| RecordedCamera::add(&mut writer, index, &part, camera))
            .collect::<Result<_, _>>()
            .map_err(failed)?;
        Ok(Self {
            path: path.to_owned(),
            writer,
            cameras,
            cloud: None,
            sheets: [None; 2],
            messages: 0,
            message: Vec::new(),
            grid: None,
            triangles: Vec::new(),
        })
    }

    /// Writes one frame of camera number `camera`.
    pub fn frame(
        &mut self,
        step: u64,
        camera: usize,
        exposure_ns: u64,
        frame: RgbdFrame<'_>,
    ) -> Result<(), RecordError> {
        let first = self.cameras.iter().all(|camera| camera.color.last.is_none());
        let about = &mut self.cameras[camera];
        if !frame.fits(&about.camera) {
            return Err(RecordError::Size {
                path: self.path.clone(),
                camera: about.camera.name.clone(),
            });
        }
        let sequence = in_order(&self.path, &mut about.color, step, exposure_ns)?;
        let mut out = Out {
            writer: &mut self.writer,
            message: &mut self.message,
            messages: &mut self.messages,
            sequence,
            time_ns: exposure_ns,
        };
        let mut others = self.cameras.iter().enumerate().filter(|(k, _)| first && *k != camera);
        // A camera that never delivers has its place in the recording all the same.
        others
            .try_for_each(|(_, other)| other.write_calibration(&mut out))
            .and_then(|()| self.cameras[camera].write(&mut out, frame))
            .map_err(|source| self.failed(source))
    }

    /// Writes one observed cloud, world frame.
    pub fn cloud(
        &mut self,
        step: u64,
        exposure_ns: u64,
        points: &[ObservedPoint],
    ) -> Result<(), RecordError> {
        let mut channel = match self.cloud {
            Some(channel) => channel,
            None => self.add_channel(&schemas::POINT_CLOUD, Role::Cloud)?,
        };
        let sequence = in_order(&self.path, &mut channel, step, exposure_ns)?;
        self.cloud = Some(channel);
        self.message.clear();
        message::cloud(&mut self.message, exposure_ns, points);
        self.write_alone(channel.id, sequence, exposure_ns)
    }

    /// Writes where the sheet's nodes are, world frame, metres, index order of `grid`.
    pub fn sheet(
        &mut self,
        step: u64,
        exposure_ns: u64,
        state: SheetState,
        grid: &SheetGrid,
        nodes_m: &[[f32; 3]],
    ) -> Result<(), RecordError> {
        if nodes_m.len() != grid.len() {
            return Err(RecordError::Nodes {
                path: self.path.clone(),
                found: nodes_m.len(),
                expected: grid.len(),
            });
        }
        let role = state.role();
        let mut channel = match self.sheets[state as usize] {
            Some(channel) => channel,
            None => self.add_channel(&schemas::SCENE_UPDATE, role)?,
        };
        let sequence = in_order(&self.path, &mut channel, step, exposure_ns)?;
        self.sheets[state as usize] = Some(channel);
        if self.grid.as_ref() != Some(grid) {
            self.triangles = grid.triangles();
            self.grid = Some(grid.clone());
        }
        self.message.clear();
        message::sheet(&mut self.message, exposure_ns, role, grid, &self.triangles, nodes_m);
        self.write_alone(channel.id, sequence, exposure_ns)
    }

    /// Writes the file's index and end. Without it the recording reads back too, but slower in
    /// other tools, and readers report that its end is missing.
    pub fn finish(mut self) -> Result<Recorded, RecordError> {
        let failed = |source| RecordError::Write { path: self.path.clone(), source };
        self.writer.finish().map_err(failed)?;
        let mut sink = self.writer.into_inner();
        sink.flush().map_err(|source| failed(source.into()))?;
        Ok(Recorded { messages: self.messages, bytes: sink.position() })
    }

    fn failed(&self, source: ::mcap::McapError) -> RecordError {
        RecordError::Write { path: self.path.clone(), source }
    }

    fn add_channel(&mut self, schema: &Schema, role: Role) -> Result<Channel, RecordError> {
        let metadata = BTreeMap::from([
            (topic::FORMAT_KEY.into(), topic::FORMAT.into()),
            (topic::ROLE_KEY.into(), role.name().into()),
        ]);
        add_channel(&mut self.writer, schema, &role.topic(""), &metadata)
            .map(|id| Channel { id, last: None })
            .map_err(|source| self.failed(source))
    }

    /// Writes the message at hand as a chunk of its own.
    fn write_alone(
        &mut self,
        channel_id: u16,
        sequence: u32,
        time_ns: u64,
    ) -> Result<(), RecordError> {
        let mut out = Out {
            writer: &mut self.writer,
            message: &mut self.message,
            messages: &mut self.messages,
            sequence,
            time_ns,
        };
        out.send(channel_id)
            .and_then(|()| self.writer.flush())
            .map_err(|source| self.failed(source))
    }
}

/// Notes a step of a channel; its sequence number in the file.
fn in_order(
    path: &Path,
    channel: &mut Channel,
    step: u64,
    exposure_ns: u64,
) -> Result<u32, RecordError> {
    let now = [step, exposure_ns];
    let later = channel.last.is_none_or(|last| last[0] < now[0] && last[1] < now[1]);
    match u32::try_from(step) {
        Ok(sequence) if later => {
            channel.last = Some(now);
            Ok(sequence)
        }
        _ => Err(RecordError::Order {
            path: path.to_owned(),
            step,
            exposure_ns,
            last: channel.last.unwrap_or_default(),
        }),
    }
}

/// What people and tools want to know of the whole recording.
fn description(set: &str, cameras: &[RgbdCamera]) -> Metadata {
    let mut metadata: BTreeMap<String, String> = [
        ("set", set),
        ("format", topic::FORMAT),
        ("orime_version", env!("CARGO_PKG_VERSION")),
        ("length_unit", "m"),
        ("time", "exposure, nanoseconds of the source's own clock"),
        ("step", "a message's sequence number"),
        ("frames", "right-handed; optical frames x right, y down, z forward"),
        ("pixels", "integer coordinates are pixel centres"),
    ]
    .map(|(key, value)| (key.into(), value.into()))
    .into();
    for (index, camera) in cameras.iter().enumerate() {
        metadata.insert(format!("camera.{index}.name"), camera.name.clone());
        metadata.insert(
            format!("camera.{index}.depth_m_per_unit"),
            format!("{:?}", camera.depth_m_per_unit),
        );
    }
    Metadata { name: topic::DESCRIPTION.into(), metadata }
}
