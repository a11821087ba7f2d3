//! One camera's channels, and how its frames get into the file.

use std::collections::BTreeMap;

use ::mcap::Writer;
use ::mcap::records::MessageHeader;
use orime_geometry::{RgbdCamera, RgbdFrame};

use super::message::{self, PixelKind};
use super::schemas::{self, Schema};
use super::sink::Sink;
use super::topic::{self, Role};

/// A channel and the last thing that was written to it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Channel {
    pub(super) id: u16,
    /// Step and exposure time, ns.
    pub(super) last: Option<[u64; 2]>,
}

/// A camera's channels in the file.
pub(super) struct RecordedCamera {
    pub(super) camera: RgbdCamera,
    color_frame: String,
    depth_frame: String,
    pub(super) color: Channel,
    depth: u16,
    color_calibration: u16,
    depth_calibration: u16,
    world_from_color: u16,
    color_from_depth: u16,
}

/// One call's way into the file.
pub(super) struct Out<'a> {
    pub(super) writer: &'a mut Writer<Sink>,
    pub(super) message: &'a mut Vec<u8>,
    pub(super) messages: &'a mut u64,
    pub(super) sequence: u32,
    pub(super) time_ns: u64,
}

impl Out<'_> {
    /// The room for a message, empty.
    pub(super) fn fresh(&mut self) -> &mut Vec<u8> {
        self.message.clear();
        self.message
    }

    /// Appends the message at hand to the chunk.
    pub(super) fn send(&mut self, channel_id: u16) -> Result<(), ::mcap::McapError> {
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
    pub(super) fn add(
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
    pub(super) fn write_calibration(&self, out: &mut Out<'_>) -> Result<(), ::mcap::McapError> {
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
    pub(super) fn write(
        &self,
        out: &mut Out<'_>,
        frame: RgbdFrame<'_>,
    ) -> Result<(), ::mcap::McapError> {
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

pub(super) fn add_channel(
    writer: &mut Writer<Sink>,
    schema: &Schema,
    topic: &str,
    metadata: &BTreeMap<String, String>,
) -> Result<u16, ::mcap::McapError> {
    let schema = writer.add_schema(schema.name, "protobuf", schema.descriptor)?;
    writer.add_channel(schema, topic, "protobuf", metadata)
}
