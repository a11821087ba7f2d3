//! The binary images that one camera's segmentation works on.

use crate::bits::BitImage;

/// Binary images of the colour camera's size.
#[derive(Debug)]
pub(crate) struct ColorImages {
    pub candidate: BitImage,
    /// The sheet, print filled in.
    pub mask: BitImage,
    pub eroded: BitImage,
    pub around: BitImage,
    pub occluded: BitImage,
    pub scratch: BitImage,
}

/// Binary images of the depth camera's size.
#[derive(Debug)]
pub(crate) struct DepthImages {
    pub sheet_colored: BitImage,
    pub region: BitImage,
    pub surface: BitImage,
    pub accepted: BitImage,
    pub refused: BitImage,
    /// Pixels whose points were taken; kept for the next frame.
    pub sheet: BitImage,
    pub scratch: BitImage,
}

impl ColorImages {
    pub fn new(width: usize, height: usize) -> Self {
        let image = || BitImage::new(width, height);
        Self {
            candidate: image(),
            mask: image(),
            eroded: image(),
            around: image(),
            occluded: image(),
            scratch: image(),
        }
    }
}

impl DepthImages {
    pub fn new(width: usize, height: usize) -> Self {
        let image = || BitImage::new(width, height);
        Self {
            sheet_colored: image(),
            region: image(),
            surface: image(),
            accepted: image(),
            refused: image(),
            sheet: image(),
            scratch: image(),
        }
    }
}
