//! What segmentation sees: surface points, contour edgels and printed features, as plain old data.

use bytemuck::{Pod, Zeroable};

/// One observed point of the sheet's surface.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Zeroable, Pod)]
pub struct ObservedPoint {
    /// World frame, metres.
    pub position_m: [f32; 3],
    /// Unit normal towards the camera, world frame; zero where it could not be measured.
    pub normal: [f32; 3],
    /// Index of the camera in the set.
    pub camera: u32,
    /// Number of depth pixels that were averaged into this point.
    pub pixels: f32,
}

/// What kind of boundary an edgel lies on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EdgelKind {
    /// The sheet's outline against something else.
    Silhouette,
    /// A step in depth inside the sheet's mask.
    InnerDepthStep,
}

/// One contour element of the sheet's mask in a colour image.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Zeroable, Pod)]
pub struct Edgel {
    /// Sub-pixel column and row in the colour image.
    pub position_px: [f32; 2],
    /// Unit normal in the image, pointing out of the sheet.
    pub normal: [f32; 2],
    /// Index of the camera in the set.
    pub camera: u32,
    /// 0 = silhouette, 1 = inner depth step; see [`EdgelKind`].
    pub kind: u32,
}

impl Edgel {
    /// The kind, or `None` for a number that no version of this crate wrote.
    pub fn kind(&self) -> Option<EdgelKind> {
        match self.kind {
            0 => Some(EdgelKind::Silhouette),
            1 => Some(EdgelKind::InnerDepthStep),
            _ => None,
        }
    }
}

/// One point of a printed sheet that was recognised, and where it is.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Zeroable, Pod)]
pub struct Feature {
    /// World frame, metres.
    pub position_m: [f32; 3],
    /// Index of the sheet's node that it is.
    pub node: u32,
    /// Index of the camera in the set.
    pub camera: u32,
    /// Number of depth pixels that the position was measured with.
    pub pixels: f32,
}
