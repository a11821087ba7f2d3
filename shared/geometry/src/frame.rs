//! Borrowed RGB-D frames: the pixels stay where capture wrote them.

use crate::RgbdCamera;

/// One RGB-D frame, read in place.
#[derive(Debug, Clone, Copy)]
pub struct RgbdFrame<'a> {
    /// Row-major `r, g, b` bytes, `3 * color.pixels()` of them.
    pub color_rgb: &'a [u8],
    /// Row-major raw depth, `depth.pixels()` of them; 0 means no return.
    pub depth_units: &'a [u16],
}

impl RgbdFrame<'_> {
    /// Whether the buffers have the sizes that `camera` promises.
    pub fn fits(&self, camera: &RgbdCamera) -> bool {
        self.color_rgb.len() == 3 * camera.color.pixels()
            && self.depth_units.len() == camera.depth.pixels()
    }
}

/// One RGB-D frame to be written in place, laid out as [`RgbdFrame`].
#[derive(Debug)]
pub struct RgbdFrameMut<'a> {
    /// Row-major `r, g, b` bytes.
    pub color_rgb: &'a mut [u8],
    /// Row-major raw depth; 0 means no return.
    pub depth_units: &'a mut [u16],
}

impl RgbdFrameMut<'_> {
    /// The same frame for reading.
    pub fn as_frame(&self) -> RgbdFrame<'_> {
        RgbdFrame { color_rgb: self.color_rgb, depth_units: self.depth_units }
    }
}
