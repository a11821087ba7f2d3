//! Writing a recording.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::{Compression, WriteOptions, Writer};
use orime_geometry::{ObservedPoint, RgbdCamera, RgbdFrame, SheetGrid};

use super::message::{self, PixelKind};
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

/// A channel and the last thing that was written to it.
#[derive(Debug, Clone, Copy)]
struct Channel {
    id: u16,
    /// Step and exposure time, ns.
    last: Option<[u64; 2]>,
}

struct RecordedCamera {
    camera: RgbdCamera,
    color_frame: String,
    depth_frame: String,
    color: Channel,
    depth: u16,
    color_calibration: u16,
    depth_calibration: u16,
    world_from_color: u16,
    color_from_depth: u16,
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

/// One call's way into the file.
struct Out<'a> {
    writer: &'a mut Writer<Sink>,
    message: &'a mut Vec<u8>,
    messages: &'a mut u64,
    sequence: u32,
    time_ns: u64,
}

impl Out<'_> {
    /// The room for a message, empty.
    fn fresh(&mut self) -> &mut Vec<u8> {
        self.message.clear();
        self.message
    }

    /// Appends the message at hand to the chunk.
    fn send(&mut self, channel_id: u16) -> Result<(), ::mcap::McapError> {
        let header = MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time: self.time_ns,
            publish_time: self.time_ns,
        };
        self.writer.write_to_known_channel(&header, self.message)?;
        *self.messages += 1;
        Ok(())
    }
}

impl RecordedCamera {
    /// Adds the camera's channels to the file.
    fn add(
        writer: &mut Writer<Sink>,
        index: usize,
        part: &str,
        camera: &RgbdCamera,
    ) -> Result<Self, ::mcap::McapError> {
        let mut channel = |schema: &Schema, role: Role| {
            let metadata = BTreeMap::from([
                (topic::FORMAT_KEY.into(), topic::FORMAT.into()),
                (topic::ROLE_KEY.into(), role.name().into()),
                (topic::CAMERA_KEY.into(), index.to_string()),
                (topic::NAME_KEY.into(), camera.name.clone()),
                (topic::DEPTH_UNIT_KEY.into(), format!("{:?}", camera.depth_m_per_unit)),
            ]);
            add_channel(writer, schema, &role.topic(part), &metadata)
        };
        Ok(Self {
            color_calibration: channel(&schemas::CAMERA_CALIBRATION, Role::ColorCalibration)?,
            depth_calibration: channel(&schemas::CAMERA_CALIBRATION, Role::DepthCalibration)?,
            world_from_color: channel(&schemas::FRAME_TRANSFORM, Role::WorldFromColor)?,
            color_from_depth: channel(&schemas::FRAME_TRANSFORM, Role::ColorFromDepth)?,
            color: Channel { id: channel(&schemas::RAW_IMAGE, Role::ColorImage)?, last: None },
            depth: channel(&schemas::RAW_IMAGE, Role::DepthImage)?,
            color_frame: format!("{part}_color"),
            depth_frame: format!("{part}_depth"),
            camera: camera.clone(),
        })
    }

    /// Writes what is needed to understand a frame.
    fn write_calibration(&self, out: &mut Out<'_>) -> Result<(), ::mcap::McapError> {
        let time_ns = out.time_ns;
        let RgbdCamera { color, depth, .. } = &self.camera;
        let [color_frame, depth_frame] = [&self.color_frame, &self.depth_frame].map(String::as_str);
        message::calibration(out.fresh(), time_ns, color_frame, color);
        out.send(self.color_calibration)?;
        message::calibration(out.fresh(), time_ns, depth_frame, depth);
        out.send(self.depth_calibration)?;
        let frames = [topic::WORLD, color_frame];
        message::transform(out.fresh(), time_ns, frames, &self.camera.world_from_color);
        out.send(self.world_from_color)?;
        let frames = [color_frame, depth_frame];
        message::transform(out.fresh(), time_ns, frames, &self.camera.color_from_depth);
        out.send(self.color_from_depth)
    }

    /// Writes one frame, its calibration before it, as one chunk.
    fn write(&self, out: &mut Out<'_>, frame: RgbdFrame<'_>) -> Result<(), ::mcap::McapError> {
        self.write_calibration(out)?;
        let time_ns = out.time_ns;
        let RgbdCamera { color, depth, .. } = &self.camera;
        let size_px = [color.width, color.height];
        message::image_head(out.fresh(), time_ns, &self.color_frame, size_px, PixelKind::Rgb8);
        message::image_pixels(out.message, frame.color_rgb);
        out.send(self.color.id)?;
        let size_px = [depth.width, depth.height];
        message::image_head(out.fresh(), time_ns, &self.depth_frame, size_px, PixelKind::Depth16);
        message::image_pixels(out.message, bytemuck::cast_slice(frame.depth_units));
        out.send(self.depth)?;
        out.writer.flush()
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

fn add_channel(
    writer: &mut Writer<Sink>,
    schema: &Schema,
    topic: &str,
    metadata: &BTreeMap<String, String>,
) -> Result<u16, ::mcap::McapError> {
    let schema = writer.add_schema(schema.name, "protobuf", schema.descriptor)?;
    writer.add_channel(schema, topic, "protobuf", metadata)
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
