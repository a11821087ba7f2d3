//! Foxglove's schemas, as compiled protobuf descriptors.
//!
//! The files are those of the `foxglove` crate 0.30.3 (MIT, © Foxglove Technologies Inc). The
//! crate itself would add 35 crates to the build for what is 9 KB of data here, and its message
//! types own their bytes.

/// A message type's name and its descriptor, a serialised `google.protobuf.FileDescriptorSet`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Schema {
    pub(super) name: &'static str,
    pub(super) descriptor: &'static [u8],
}

pub(super) const RAW_IMAGE: Schema =
    Schema { name: "foxglove.RawImage", descriptor: include_bytes!("schemas/RawImage.bin") };
pub(super) const CAMERA_CALIBRATION: Schema = Schema {
    name: "foxglove.CameraCalibration",
    descriptor: include_bytes!("schemas/CameraCalibration.bin"),
};
pub(super) const FRAME_TRANSFORM: Schema = Schema {
    name: "foxglove.FrameTransform",
    descriptor: include_bytes!("schemas/FrameTransform.bin"),
};
pub(super) const POINT_CLOUD: Schema =
    Schema { name: "foxglove.PointCloud", descriptor: include_bytes!("schemas/PointCloud.bin") };
pub(super) const SCENE_UPDATE: Schema =
    Schema { name: "foxglove.SceneUpdate", descriptor: include_bytes!("schemas/SceneUpdate.bin") };
