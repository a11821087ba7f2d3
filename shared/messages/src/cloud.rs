//! What segment publishes.

use orime_geometry::{Edgel, Feature, ObservedPoint};

use crate::{CAMERAS_MAX, CameraMeta, Header, layout, message};

/// Most points in a cloud.
pub const POINTS_MAX: usize = 32_768;
/// Most edgels beside a cloud.
pub const EDGELS_MAX: usize = 16_384;
/// Most features beside a cloud.
pub const FEATURES_MAX: usize = 1024;

layout!(ObservedPoint { position_m: [f32; 3], normal: [f32; 3], camera: u32, pixels: f32 });
layout!(Feature { position_m: [f32; 3], node: u32, camera: u32, pixels: f32 });
layout!(Edgel { position_px: [f32; 2], normal: [f32; 2], camera: u32, kind: u32 });

message! {
    /// Surface points, contour and printed features of one frame set; only the first `n_points`,
    /// `n_edgels` and `n_features` elements mean anything.
    pub struct ObservedCloud as "orime.ObservedCloud.v1" {
        /// Lineage and times.
        pub header: Header,
        /// Used elements of `points`.
        pub n_points: u32,
        /// Used elements of `edgels`.
        pub n_edgels: u32,
        /// Cameras in which no sheet was found.
        pub cameras_without_sheet: u32,
        /// Cameras whose frame was missing or had the wrong size.
        pub cameras_without_frame: u32,
        /// Points that did not fit.
        pub points_left_out: u32,
        /// Used elements of `cameras`.
        pub n_cameras: u32,
        /// Used elements of `features`.
        pub n_features: u32,
        /// Features that did not fit.
        pub features_left_out: u32,
        /// The cameras that saw it, in the order of their indices.
        pub cameras: [CameraMeta; CAMERAS_MAX],
        /// Surface points, world frame.
        pub points: [ObservedPoint; POINTS_MAX],
        /// Contour elements.
        pub edgels: [Edgel; EDGELS_MAX],
        /// Recognised points of a printed sheet.
        pub features: [Feature; FEATURES_MAX],
    }
}

impl ObservedCloud {
    /// The cameras.
    pub fn cameras(&self) -> &[CameraMeta] {
        &self.cameras[..(self.n_cameras as usize).min(CAMERAS_MAX)]
    }

    /// The used points.
    pub fn points(&self) -> &[ObservedPoint] {
        &self.points[..(self.n_points as usize).min(POINTS_MAX)]
    }

    /// The used edgels.
    pub fn edgels(&self) -> &[Edgel] {
        &self.edgels[..(self.n_edgels as usize).min(EDGELS_MAX)]
    }

    /// The used features.
    pub fn features(&self) -> &[Feature] {
        &self.features[..(self.n_features as usize).min(FEATURES_MAX)]
    }
}

const CAMERAS_BYTES: usize = size_of::<CameraMeta>() * CAMERAS_MAX;
const _: () = assert!(core::mem::offset_of!(ObservedCloud, points) == 72 + 32 + CAMERAS_BYTES);
const _: () = assert!(
    size_of::<ObservedCloud>()
        == core::mem::offset_of!(ObservedCloud, points)
            + 32 * POINTS_MAX
            + 24 * EDGELS_MAX
            + 24 * FEATURES_MAX
);
