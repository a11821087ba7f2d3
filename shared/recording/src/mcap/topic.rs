//! What the channels of a recording are called, and what their metadata says.
//!
//! Channel records lie inside chunks, whose checksums cover them; MCAP's own metadata records do
//! not. What replay depends on therefore stands in the channels' metadata.

use orime_geometry::RgbdCamera;

/// Version of this arrangement; another one is refused.
pub(super) const FORMAT: &str = "1";
/// Channel metadata: [`FORMAT`].
pub(super) const FORMAT_KEY: &str = "orime.format";
/// Channel metadata: what the channel holds, one of [`Role`]'s names.
pub(super) const ROLE_KEY: &str = "orime.role";
/// Channel metadata: index of the camera, from 0.
pub(super) const CAMERA_KEY: &str = "orime.camera";
/// Channel metadata: name of the camera.
pub(super) const NAME_KEY: &str = "orime.camera_name";
/// Channel metadata: metres per unit of a raw depth value.
pub(super) const DEPTH_UNIT_KEY: &str = "orime.depth_m_per_unit";
/// Metadata of a sheet's entity: nodes along u and v.
pub(super) const NODES_KEY: &str = "orime.nodes";
/// Metadata of a sheet's entity: extent along u and v, metres.
pub(super) const SIZE_KEY: &str = "orime.size_m";
/// Name of the metadata record that describes the whole recording, for people and tools.
pub(super) const DESCRIPTION: &str = "orime";
/// The frame that everything is placed in.
pub(super) const WORLD: &str = "world";

/// What stands for each camera in topics and frame names: its name, with `_` for what is special in
/// paths, and its index where two would be the same.
pub(super) fn camera_parts(cameras: &[RgbdCamera]) -> Vec<String> {
    let allowed = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.');
    let mut parts: Vec<String> = Vec::new();
    for (index, camera) in cameras.iter().enumerate() {
        let mut part = camera.name.replace(|c| !allowed(c), "_");
        while part.is_empty() || parts.contains(&part) {
            part += &format!("_{index}");
        }
        parts.push(part);
    }
    parts
}

/// What a channel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    ColorImage,
    DepthImage,
    ColorCalibration,
    DepthCalibration,
    WorldFromColor,
    ColorFromDepth,
    Cloud,
    Estimate,
    Truth,
}

impl Role {
    pub(super) const ALL: [Role; 9] = [
        Role::ColorImage,
        Role::DepthImage,
        Role::ColorCalibration,
        Role::DepthCalibration,
        Role::WorldFromColor,
        Role::ColorFromDepth,
        Role::Cloud,
        Role::Estimate,
        Role::Truth,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Role::ColorImage => "color_image",
            Role::DepthImage => "depth_image",
            Role::ColorCalibration => "color_calibration",
            Role::DepthCalibration => "depth_calibration",
            Role::WorldFromColor => "world_from_color",
            Role::ColorFromDepth => "color_from_depth",
            Role::Cloud => "cloud",
            Role::Estimate => "estimate",
            Role::Truth => "truth",
        }
    }

    pub(super) fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.name() == name)
    }

    /// The topic; `camera` is the camera's part of it, empty for roles that belong to none.
    pub(super) fn topic(self, camera: &str) -> String {
        match self {
            Role::ColorImage => format!("/camera/{camera}/color/image"),
            Role::DepthImage => format!("/camera/{camera}/depth/image"),
            Role::ColorCalibration => format!("/camera/{camera}/color/calibration"),
            Role::DepthCalibration => format!("/camera/{camera}/depth/calibration"),
            Role::WorldFromColor => format!("/camera/{camera}/color/transform"),
            Role::ColorFromDepth => format!("/camera/{camera}/depth/transform"),
            Role::Cloud => "/cloud/observed".into(),
            Role::Estimate => "/sheet/estimate".into(),
            Role::Truth => "/sheet/truth".into(),
        }
    }
}
