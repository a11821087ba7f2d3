//! Things in front of the sheet, by the steps in depth at their edges.

use crate::bits::BitImage;
use crate::steps::{DIRECTIONS, SPAN_PX, Steps};

/// Half the width of the band around the sheet's patches in which a step is the sheet's.
const SHEET_BAND_PX: usize = 6;

/// Finds occluders; keeps its memory.
#[derive(Debug)]
pub(crate) struct Occluders {
    /// Depth pixels on both sides of the edges of things in front of the sheet.
    pub found: BitImage,
    support: BitImage,
    band: BitImage,
    step: BitImage,
    scratch: BitImage,
}

impl Occluders {
    pub fn new(width: usize, height: usize) -> Self {
        let image = || BitImage::new(width, height);
        Self { found: image(), support: image(), band: image(), step: image(), scratch: image() }
    }

    /// A step whose far side is the sheet and whose near side is not the sheet's own flap.
    pub fn find(&mut self, steps: &Steps, sheet: &BitImage) {
        self.support.copy_from(sheet);
        self.support.dilate(SPAN_PX as usize, &mut self.scratch);
        self.band.copy_from(sheet);
        self.band.dilate(SHEET_BAND_PX, &mut self.scratch);

        // Across gaps in depth the two sides are farther apart than across steps.
        self.found.copy_from(&steps.gap_far);
        self.found.and(&self.band);
        self.step.copy_from(&self.found);
        self.step.dilate(2 * SHEET_BAND_PX, &mut self.scratch);
        self.step.and(&steps.gap_near);
        self.found.or(&self.step);

        for (near, [dx, dy]) in steps.near.iter().zip(DIRECTIONS) {
            self.step.copy_from(near);
            self.scratch.clear();
            self.scratch.or_shifted(&self.support, SPAN_PX * dx, SPAN_PX * dy);
            self.step.and_not(&self.scratch);
            self.scratch.clear();
            self.scratch.or_shifted(&self.band, -SPAN_PX * dx, -SPAN_PX * dy);
            self.step.and(&self.scratch);
            self.found.or(&self.step);
            self.found.or_shifted(&self.step, SPAN_PX * dx, SPAN_PX * dy);
        }
    }
}
