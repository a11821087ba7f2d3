//! One pass over a file: what it holds, where, and what is damaged.
//!
//! Everything is read and every checksum compared once, before the first frame is used: a flipped
//! byte shows at the start of a run, not in its results. The file's own index is not believed,
//! because a file without an end has none.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

use ::mcap::records::{self, Record, op};
use crc32fast::Hasher;
use orime_geometry::CameraModel;
use orime_geometry::nalgebra::Isometry3;

use super::Loss;
use super::chunk::{ChunkReader, Damage, MessageHead, Next, RECORD_HEAD};
use super::message;
use super::topic::{self, Role};

/// Bytes of a footer record and the magic behind it.
const END_BYTES: u64 = RECORD_HEAD as u64 + 20 + ::mcap::MAGIC.len() as u64;
/// Longest calibration or transform; longer ones are damage.
const CONSTANT_BYTES_MAX: u64 = 64 * 1024;

/// Where a chunk's record lies in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    /// Of the record's body, bytes from the file's start.
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

/// What a channel record says.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Channel {
    pub(super) role: Role,
    /// Index, name and depth unit; absent where the channel belongs to no camera.
    pub(super) camera: Option<(usize, String, f64)>,
}

/// One message that replay may ask for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    pub(super) channel: u16,
    pub(super) step: u32,
    pub(super) time_ns: u64,
    pub(super) place: Place,
}

/// A part of a camera's calibration.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Constant {
    Lens(CameraModel),
    Transform(Isometry3<f64>),
    /// What is wrong with it.
    Malformed(&'static str),
}

/// What a file holds.
#[derive(Debug, Default)]
pub(super) struct Scan {
    pub(super) channels: BTreeMap<u16, Channel>,
    pub(super) entries: Vec<Entry>,
    /// The first of each channel.
    pub(super) constants: BTreeMap<u16, Constant>,
    /// A channel whose later constants differ, and at which step.
    pub(super) changed: Option<(u16, u32)>,
    /// Format of channels that another version wrote.
    pub(super) foreign_format: Option<String>,
    pub(super) set: Option<String>,
    pub(super) loss: Loss,
    /// The first chunk's complaint.
    pub(super) damage: Option<Damage>,
    messages: u64,
}

/// What one chunk holds, not believed before its checksum was compared.
#[derive(Debug, Default)]
struct ChunkContent {
    channels: Vec<records::Channel>,
    entries: Vec<Entry>,
    constants: Vec<(u16, u32, Constant)>,
    messages: u64,
}

impl Scan {
    /// Reads the whole file, whose magic was checked.
    pub(super) fn of(file: &mut File) -> io::Result<Self> {
        let mut scan = Self::default();
        let length = file.metadata()?.len();
        let promised = scan.end(file, length)?;
        scan.data(file, length)?;
        scan.loss.messages = promised.map(|promised| promised.saturating_sub(scan.messages));
        Ok(scan)
    }

    /// Reads the summary at the file's end, for channels whose own chunk may be damaged. The
    /// number of messages in the file, if the end is whole.
    fn end(&mut self, file: &mut File, length: u64) -> io::Result<Option<u64>> {
        let Some(footer_at) = length.checked_sub(END_BYTES) else {
            self.loss.end_missing = true;
            return Ok(None);
        };
        file.seek(SeekFrom::Start(footer_at))?;
        let mut end = [0; END_BYTES as usize];
        file.read_exact(&mut end)?;
        let (footer, magic) = end.split_at(RECORD_HEAD + 20);
        let parsed = ::mcap::parse_record(footer[0], &footer[RECORD_HEAD..]);
        let (true, Ok(Record::Footer(footer_record))) = (magic == ::mcap::MAGIC, parsed) else {
            self.loss.end_missing = true;
            return Ok(None);
        };
        let start = footer_record.summary_start;
        if start == 0 || start > footer_at {
            self.loss.outside_chunks = true;
            return Ok(None);
        }
        let mut summary = vec![0; (footer_at - start) as usize];
        file.seek(SeekFrom::Start(start))?;
        file.read_exact(&mut summary)?;
        let mut crc = Hasher::new();
        crc.update(&summary);
        // The footer counts too, up to the checksum itself.
        crc.update(&footer[..RECORD_HEAD + 16]);
        if crc.finalize() != footer_record.summary_crc {
            self.loss.outside_chunks = true;
            return Ok(None);
        }
        let mut promised = None;
        let mut rest = &summary[..];
        while let Some((opcode, body)) = split_record(&mut rest) {
            match ::mcap::parse_record(opcode, body) {
                Ok(Record::Channel(channel)) => self.add_channel(channel),
                Ok(Record::Statistics(statistics)) => promised = Some(statistics.message_count),
                _ => {}
            }
        }
        Ok(promised)
    }

    /// Reads the data section.
    fn data(&mut self, file: &mut File, length: u64) -> io::Result<()> {
        let mut at = ::mcap::MAGIC.len() as u64;
        file.seek(SeekFrom::Start(at))?;
        let mut crc = Hasher::new();
        crc.update(::mcap::MAGIC);
        let mut body = Vec::new();
        let mut scratch = Vec::new();
        loop {
            let mut head = [0; RECORD_HEAD];
            let whole_head = at + RECORD_HEAD as u64 <= length;
            if whole_head {
                file.read_exact(&mut head)?;
            }
            let [opcode, size @ ..] = head;
            let size = u64::from_le_bytes(size);
            let known = (op::HEADER..=op::DATA_END).contains(&opcode) || opcode >= 0x80;
            let fits = size <= length.saturating_sub(at + RECORD_HEAD as u64);
            if !whole_head || !known || !fits {
                // Where the next record begins is not known from here on.
                self.loss.bytes += length - at;
                self.loss.end_missing |= at == length;
                return Ok(());
            }
            body.resize(size as usize, 0);
            file.read_exact(&mut body)?;
            if opcode == op::DATA_END {
                self.data_end(&body, crc.finalize());
                return Ok(());
            }
            crc.update(&head);
            crc.update(&body);
            let place = Place { offset: at + RECORD_HEAD as u64, bytes: size };
            self.record(opcode, &body, place, &mut scratch);
            at = place.offset + size;
        }
    }

    fn data_end(&mut self, body: &[u8], crc: u32) {
        // Damage inside a chunk shows here as well, but is counted there.
        if body != crc.to_le_bytes() && self.loss.chunks == 0 {
            self.loss.outside_chunks = true;
        }
    }

    fn record(&mut self, opcode: u8, body: &[u8], place: Place, scratch: &mut Vec<u8>) {
        match opcode {
            op::CHUNK => match self.chunk(body, place, scratch) {
                Ok(content) => self.add_chunk(content),
                Err(damage) => {
                    self.loss.chunks += 1;
                    self.loss.bytes += RECORD_HEAD as u64 + place.bytes;
                    self.damage.get_or_insert(damage);
                }
            },
            op::METADATA => {
                if let Ok(Record::Metadata(mut record)) = ::mcap::parse_record(opcode, body)
                    && record.name == topic::DESCRIPTION
                {
                    self.set = record.metadata.remove("set");
                }
            }
            _ => {}
        }
    }

    fn chunk(
        &self,
        body: &[u8],
        place: Place,
        scratch: &mut Vec<u8>,
    ) -> Result<ChunkContent, Damage> {
        let mut reader = ChunkReader::new(body)?;
        let mut content = ChunkContent::default();
        // Channels of this very chunk are not in `self` yet.
        let mut roles: Vec<(u16, Option<Role>)> = Vec::new();
        while let Some(next) = reader.next()? {
            match next {
                Next::Other(op::CHANNEL, bytes) => {
                    reader.fill_vec(bytes, scratch)?;
                    let record = ::mcap::parse_record(op::CHANNEL, scratch);
                    let Ok(Record::Channel(channel)) = record else {
                        return Err("a channel's record is damaged".into());
                    };
                    roles.push((channel.id, role(&channel)));
                    content.channels.push(channel);
                }
                Next::Other(_, bytes) => reader.skip(bytes)?,
                Next::Message(head) => {
                    content.messages += 1;
                    let known = roles.iter().find(|(id, _)| *id == head.channel);
                    let role = known.map_or_else(
                        || self.channels.get(&head.channel).map(|channel| channel.role),
                        |(_, role)| *role,
                    );
                    read_message(&mut reader, head, role, place, scratch, &mut content)?;
                }
            }
        }
        reader.finish()?;
        Ok(content)
    }

    fn add_chunk(&mut self, content: ChunkContent) {
        let ChunkContent { channels, entries, constants, messages } = content;
        self.messages += messages;
        channels.into_iter().for_each(|channel| self.add_channel(channel));
        self.entries.extend(entries);
        for (channel, step, constant) in constants {
            let first = self.constants.entry(channel).or_insert_with(|| constant.clone());
            if *first != constant && self.changed.is_none() {
                self.changed = Some((channel, step));
            }
        }
    }

    fn add_channel(&mut self, record: records::Channel) {
        let Some(role) = role(&record) else {
            return;
        };
        let metadata = &record.metadata;
        let format = metadata.get(topic::FORMAT_KEY).map_or("none", String::as_str);
        if format != topic::FORMAT {
            self.foreign_format = Some(format.to_owned());
            return;
        }
        let number = |key: &str| metadata.get(key).cloned().unwrap_or_default();
        let camera = number(topic::CAMERA_KEY).parse::<usize>().ok().map(|index| {
            let unit_m = number(topic::DEPTH_UNIT_KEY).parse().unwrap_or(f64::NAN);
            (index, number(topic::NAME_KEY), unit_m)
        });
        self.channels.insert(record.id, Channel { role, camera });
    }
}

fn read_message(
    reader: &mut ChunkReader<'_>,
    head: MessageHead,
    role: Option<Role>,
    place: Place,
    scratch: &mut Vec<u8>,
    content: &mut ChunkContent,
) -> Result<(), Damage> {
    let MessageHead { channel, sequence: step, time_ns, bytes } = head;
    match role {
        Some(
            role @ (Role::ColorCalibration
            | Role::DepthCalibration
            | Role::WorldFromColor
            | Role::ColorFromDepth),
        ) => {
            if bytes > CONSTANT_BYTES_MAX {
                return Err("a calibration is too long".into());
            }
            reader.fill_vec(bytes, scratch)?;
            let constant = match role {
                Role::WorldFromColor | Role::ColorFromDepth => {
                    message::read_transform(scratch).map(Constant::Transform)
                }
                _ => message::read_calibration(scratch).map(Constant::Lens),
            };
            let constant = constant.unwrap_or_else(|wrong| Constant::Malformed(wrong.0));
            content.constants.push((channel, step, constant));
            Ok(())
        }
        Some(_) => {
            content.entries.push(Entry { channel, step, time_ns, place });
            reader.skip(bytes)
        }
        // Somebody else's channel.
        None => reader.skip(bytes),
    }
}

fn role(channel: &records::Channel) -> Option<Role> {
    Role::from_name(channel.metadata.get(topic::ROLE_KEY)?)
}

/// Splits a record off the front of `bytes`.
fn split_record<'a>(bytes: &mut &'a [u8]) -> Option<(u8, &'a [u8])> {
    let (head, rest) = bytes.split_at_checked(RECORD_HEAD)?;
    let length = u64::from_le_bytes(head[1..].try_into().ok()?);
    let (body, rest) = rest.split_at_checked(usize::try_from(length).ok()?)?;
    *bytes = rest;
    Some((head[0], body))
}
