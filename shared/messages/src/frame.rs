//! One camera's RGB-D frame: the pixels are the payload, this is the header beside them.

use orime_geometry::nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use orime_geometry::{CameraModel, RgbdCamera};

use bytemuck::{Pod, Zeroable};

use crate::{Header, layout, message};

/// Most cameras a set may have; bounds the buffers of the frame channel.
pub const CAMERAS_MAX: usize = 8;
/// Longest camera name, bytes of UTF-8.
pub const CAMERA_NAME_MAX: usize = 32;
/// Alignment of the payload and of the depth image in it, bytes.
pub const FRAME_ALIGNMENT: usize = 64;

/// Whether a frame has pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum FrameStatus {
    /// Colour and depth are there.
    Ok = 0,
    /// The source could not read this frame; sent so that the set stays complete.
    Unreadable = 1,
}

/// One lens, as [`CameraModel`].
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct LensMeta {
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// Focal lengths, pixels.
    pub focal_px: [f64; 2],
    /// Principal point, pixels.
    pub principal_px: [f64; 2],
    /// `k1, k2, p1, p2, k3`.
    pub distortion: [f64; 5],
}
layout!(LensMeta {
    size_px: [u32; 2],
    focal_px: [f64; 2],
    principal_px: [f64; 2],
    distortion: [f64; 5],
});

/// A rigid transform: translation, then the unit quaternion's `i, j, k, w`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct PoseMeta {
    /// Metres.
    pub translation_m: [f64; 3],
    /// `i, j, k, w`.
    pub rotation_ijkw: [f64; 4],
}
layout!(PoseMeta { translation_m: [f64; 3], rotation_ijkw: [f64; 4] });

/// One camera's calibration, as [`RgbdCamera`].
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct CameraMeta {
    /// The colour lens.
    pub color: LensMeta,
    /// The depth lens.
    pub depth: LensMeta,
    /// Maps depth-optical coordinates into colour-optical ones.
    pub color_from_depth: PoseMeta,
    /// Maps colour-optical coordinates into the world.
    pub world_from_color: PoseMeta,
    /// Metres per unit of raw depth.
    pub depth_m_per_unit: f64,
    /// UTF-8, filled up with zeros.
    pub name: [u8; CAMERA_NAME_MAX],
}
layout!(CameraMeta {
    color: LensMeta,
    depth: LensMeta,
    color_from_depth: PoseMeta,
    world_from_color: PoseMeta,
    depth_m_per_unit: f64,
    name: [u8; CAMERA_NAME_MAX],
});

message! {
    /// Everything about a frame but its pixels.
    ///
    /// The payload is `3 · width · height` bytes of colour (row-major `r, g, b`), then, from
    /// `depth_offset` on, `width · height` raw depths as native `u16`.
    pub struct FrameMeta as "orime.FrameMeta.v1" {
        /// Lineage and times; `exposure_ns` and `arrival_ns` are this camera's own.
        pub header: Header,
        /// Index of the camera in the set.
        pub camera: u32,
        /// Cameras of the set: so many frames make a frame set.
        pub n_cameras: u32,
        /// Number of a [`FrameStatus`].
        pub status: u32,
        /// Whole-image copies made on the way into shared memory.
        pub copies: u32,
        /// Bytes of the colour image, which begins at 0.
        pub color_bytes: u64,
        /// Where the depth image begins, bytes; a multiple of [`FRAME_ALIGNMENT`].
        pub depth_offset: u64,
        /// Bytes of the depth image.
        pub depth_bytes: u64,
        /// The camera's calibration.
        pub calibration: CameraMeta,
    }
}

/// Where the two images of a frame lie in its payload, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameExtent {
    /// Length of the colour image, which begins at 0.
    pub color_bytes: usize,
    /// Beginning of the depth image.
    pub depth_offset: usize,
    /// Length of the depth image.
    pub depth_bytes: usize,
}

impl FrameExtent {
    /// The extent of this camera's frames.
    pub fn of(camera: &RgbdCamera) -> Self {
        let color_bytes = 3 * camera.color.pixels();
        Self {
            color_bytes,
            depth_offset: color_bytes.next_multiple_of(FRAME_ALIGNMENT),
            depth_bytes: 2 * camera.depth.pixels(),
        }
    }

    /// Length of the whole payload, bytes.
    pub fn total_bytes(&self) -> usize {
        self.depth_offset + self.depth_bytes
    }
}

impl FrameMeta {
    /// Where the images lie, as the sender said.
    pub fn extent(&self) -> FrameExtent {
        FrameExtent {
            color_bytes: self.color_bytes as usize,
            depth_offset: self.depth_offset as usize,
            depth_bytes: self.depth_bytes as usize,
        }
    }
}

impl From<&CameraModel> for LensMeta {
    fn from(model: &CameraModel) -> Self {
        Self {
            size_px: [model.width, model.height],
            focal_px: [model.fx_px, model.fy_px],
            principal_px: [model.cx_px, model.cy_px],
            distortion: model.distortion,
        }
    }
}

impl From<&LensMeta> for CameraModel {
    fn from(lens: &LensMeta) -> Self {
        Self {
            width: lens.size_px[0],
            height: lens.size_px[1],
            fx_px: lens.focal_px[0],
            fy_px: lens.focal_px[1],
            cx_px: lens.principal_px[0],
            cy_px: lens.principal_px[1],
            distortion: lens.distortion,
        }
    }
}

impl From<&Isometry3<f64>> for PoseMeta {
    fn from(pose: &Isometry3<f64>) -> Self {
        let [i, j, k, w]: [f64; 4] = pose.rotation.coords.into();
        Self { translation_m: pose.translation.vector.into(), rotation_ijkw: [i, j, k, w] }
    }
}

impl From<&PoseMeta> for Isometry3<f64> {
    fn from(pose: &PoseMeta) -> Self {
        let [i, j, k, w] = pose.rotation_ijkw;
        // Not normalised again: the pose must arrive bit for bit as it was sent.
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
        Isometry3::from_parts(Translation3::from(pose.translation_m), rotation)
    }
}

impl From<&RgbdCamera> for CameraMeta {
    /// Names longer than [`CAMERA_NAME_MAX`] bytes are cut at a character.
    fn from(camera: &RgbdCamera) -> Self {
        let mut name = [0; CAMERA_NAME_MAX];
        let mut cut = camera.name.len().min(CAMERA_NAME_MAX);
        while !camera.name.is_char_boundary(cut) {
            cut -= 1;
        }
        name[..cut].copy_from_slice(&camera.name.as_bytes()[..cut]);
        Self {
            color: (&camera.color).into(),
            depth: (&camera.depth).into(),
            color_from_depth: (&camera.color_from_depth).into(),
            world_from_color: (&camera.world_from_color).into(),
            depth_m_per_unit: camera.depth_m_per_unit,
            name,
        }
    }
}

impl From<&CameraMeta> for RgbdCamera {
    fn from(meta: &CameraMeta) -> Self {
        let end = meta.name.iter().position(|byte| *byte == 0).unwrap_or(CAMERA_NAME_MAX);
        Self {
            name: String::from_utf8_lossy(&meta.name[..end]).into_owned(),
            color: (&meta.color).into(),
            depth: (&meta.depth).into(),
            color_from_depth: (&meta.color_from_depth).into(),
            world_from_color: (&meta.world_from_color).into(),
            depth_m_per_unit: meta.depth_m_per_unit,
        }
    }
}

const _: () = assert!(size_of::<FrameMeta>() == 72 + 40 + size_of::<CameraMeta>());
const _: () = assert!(size_of::<CameraMeta>() == 2 * 80 + 2 * 56 + 8 + 32);

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::nalgebra::Vector3;

    #[test]
    fn a_calibration_survives_the_way_bit_for_bit() {
        let color = CameraModel {
            width: 640,
            height: 480,
            fx_px: 534.3,
            fy_px: 534.7,
            cx_px: 309.6,
            cy_px: 243.1,
            distortion: [-0.0438, 0.0517, 0.0004, -0.0021, -0.0912],
        };
        let camera = RgbdCamera {
            name: "über dem Tisch, links".to_owned(),
            depth: CameraModel { width: 320, height: 241, ..color.clone() },
            color,
            color_from_depth: Isometry3::new(
                Vector3::new(0.015, -0.001, 0.0003),
                Vector3::new(0.01, 0.02, -0.003),
            ),
            world_from_color: Isometry3::new(
                Vector3::new(0.3, -0.2, 0.9),
                Vector3::new(2.1, 0.4, -0.7),
            ),
            depth_m_per_unit: 0.001,
        };
        let back = RgbdCamera::from(&CameraMeta::from(&camera));
        assert_eq!(back, camera);
        let extent = FrameExtent::of(&camera);
        assert_eq!(extent.depth_offset % FRAME_ALIGNMENT, 0);
        assert_eq!(extent.total_bytes(), 921_600 + 154_240);
    }
}
