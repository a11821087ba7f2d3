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
    /// Pixels in the sheet's mask; kept for the next frame, in the shape of its own window.
    pub sheet: BitImage,
    /// Those of them that see the sheet and nothing else.
    pub clear: BitImage,
    /// Those of the frame before.
    pub before: BitImage,
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

    /// Takes a window's size.
    pub fn reshape(&mut self, width: usize, height: usize) {
        let Self { candidate, mask, eroded, around, occluded, scratch } = self;
        for image in [candidate, mask, eroded, around, occluded, scratch] {
            image.reshape(width, height);
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
            clear: image(),
            before: image(),
            scratch: image(),
        }
    }

    /// Takes a window's size; what is of the frame before keeps its own.
    pub fn reshape(&mut self, width: usize, height: usize) {
        let Self {
            sheet_colored,
            region,
            surface,
            accepted,
            refused,
            sheet: _,
            clear,
            before: _,
            scratch,
        } = self;
        for image in [sheet_colored, region, surface, accepted, refused, clear, scratch] {
            image.reshape(width, height);
        }
    }
}
