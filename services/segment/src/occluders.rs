//! Things in front of the sheet, by the steps in depth at their edges.

use crate::bits::{BitImage, pack};
use crate::depth::DepthMap;
use crate::steps::{DIRECTIONS, SPAN_PX, Steps};

/// Half the width of the band around the sheet's patches in which a step is the sheet's.
const SHEET_BAND_PX: usize = 6;

/// Finds occluders; keeps its memory.
#[derive(Debug)]
pub(crate) struct Occluders {
    /// Depth pixels on both sides of the edges of things in front of the sheet, and of things
    /// in front of all of it.
    pub found: BitImage,
    /// Depth pixels on both sides of gaps that begin on the sheet and end beside it, level with
    /// it: perhaps something thin in front of it that returns no depth (a clip).
    pub unsure: BitImage,
    support: BitImage,
    band: BitImage,
    step: BitImage,
    scratch: BitImage,
}

impl Occluders {
    pub fn new(width: usize, height: usize) -> Self {
        let image = || BitImage::new(width, height);
        Self {
            found: image(),
            unsure: image(),
            support: image(),
            band: image(),
            step: image(),
            scratch: image(),
        }
    }

    /// Takes a window's size.
    pub fn reshape(&mut self, width: usize, height: usize) {
        let Self { found, unsure, support, band, step, scratch } = self;
        for image in [found, unsure, support, band, step, scratch] {
            image.reshape(width, height);
        }
    }

    /// What is nearer than this, metres. The steps at its edges may be far from what is known to be
    /// the sheet: a colour lens beside the depth lens does not see the strip between.
    pub fn add_nearer(&mut self, map: &DepthMap, nearest_m: f32) {
        for y in 0..map.height {
            for k in 0..self.found.words {
                let nearer = map.z_block(64 * k as i32, y as i32);
                let mut bits = [0; 64];
                for (bit, z_m) in bits.iter_mut().zip(nearer) {
                    *bit = u8::from(*z_m < nearest_m);
                }
                let used = self.found.used(k);
                self.found.row_mut(y)[k] |= pack(&bits) & used;
            }
        }
    }

    /// A step whose far side is the sheet and whose near side is not the sheet's own flap.
    pub fn find(&mut self, steps: &Steps, sheet: &BitImage) {
        self.support.copy_from(sheet);
        self.support.dilate(SPAN_PX as usize, &mut self.scratch);
        self.band.copy_from(sheet);
        self.band.dilate(SHEET_BAND_PX, &mut self.scratch);

        self.found.clear();
        for gap in &steps.gaps {
            let [near, far] = gap.map(|at| (at as usize % sheet.width, at as usize / sheet.width));
            if self.band.get(far.0, far.1) && !self.support.get(near.0, near.1) {
                self.found.set(near.0, near.1);
                self.found.set(far.0, far.1);
            }
        }
        self.unsure.clear();
        for gap in &steps.level_gaps {
            let [a, b] = gap.map(|at| (at as usize % sheet.width, at as usize / sheet.width));
            if self.support.get(a.0, a.1) != self.support.get(b.0, b.1) {
                self.unsure.set(a.0, a.1);
                self.unsure.set(b.0, b.1);
            }
        }
        for (near, [dx, dy]) in steps.near.iter().zip(DIRECTIONS) {
            self.step.copy_from(near);
            let across = [SPAN_PX * dx, SPAN_PX * dy];
            self.scratch.copy_from(&self.support);
            self.scratch.shift(across);
            self.step.and_not(&self.scratch);
            self.scratch.copy_from(&self.band);
            self.scratch.shift(across.map(|d| -d));
            self.step.and(&self.scratch);
            self.found.or(&self.step);
            self.step.shift(across);
            self.found.or(&self.step);
        }
    }
}
