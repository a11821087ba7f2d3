//! The colour mask of the sheet, from its accepted patches of depth.

use crate::bits::BitImage;
use crate::components::Components;
use crate::depth::DepthMap;
use crate::select::Selector;

/// Parts of the mask that are farther than `SUPPORT_PX` from accepted depth, and wider than
/// twice `UNSUPPORTED_PX`, are dropped; the shadows that edges leave in depth are narrower.
const SUPPORT_PX: usize = 4;
const UNSUPPORTED_PX: usize = 5;

/// Rim of accepted and refused depth that counts with it, pixels: what steps cut off.
const RIM_PX: usize = 2;

/// Least share of a piece of the mask whose depth must have been accepted.
const PIECE_SHARE_MIN: f32 = 0.3;

/// What is known about the sheet before its mask.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Accepted<'a> {
    pub map: &'a DepthMap,
    /// Components of the sheet-coloured pixels, and which of them hold accepted patches.
    pub colors: &'a Components,
    pub selector: &'a Selector,
    /// Depth pixels that are the sheet's.
    pub accepted: &'a BitImage,
    /// Depth pixels of the sheet's colour that are not the sheet's.
    pub refused: &'a BitImage,
}

/// Builds masks; keeps its memory.
#[derive(Debug)]
pub(crate) struct MaskBuilder {
    components: Components,
    /// Per component of the mask: pixels with accepted depth.
    support_px: Vec<u32>,
    support: BitImage,
    bare: BitImage,
    scratch: BitImage,
}

impl MaskBuilder {
    pub fn new(width: usize, height: usize) -> Self {
        let image = || BitImage::new(width, height);
        Self {
            components: Components::new(width, height),
            support_px: Vec::with_capacity(width.div_ceil(2) * height),
            support: image(),
            bare: image(),
            scratch: image(),
        }
    }

    /// Takes a window's size.
    pub fn reshape(&mut self, width: usize, height: usize) {
        for image in [&mut self.support, &mut self.bare, &mut self.scratch] {
            image.reshape(width, height);
        }
    }

    /// Writes the mask (the colour components of the accepted patches, less what was refused,
    /// holes up to `hole_ratio_max` of it filled) and what lies around it, holes not included.
    pub fn build(
        &mut self,
        surface: &Accepted<'_>,
        hole_ratio_max: f64,
        mask: &mut BitImage,
        around: &mut BitImage,
    ) {
        mask.clear();
        for run in &surface.colors.runs {
            if surface.selector.accepts_color(run.component as usize) {
                mask.set_run(run.y as usize, run.start as usize, run.end as usize);
            }
        }
        self.bare.clear();
        surface.map.splat(surface.refused, &mut self.bare);
        self.bare.dilate(RIM_PX, &mut self.scratch);
        mask.and_not(&self.bare);
        self.keep_supported(surface, mask);
        self.fill_holes(hole_ratio_max, mask, around);
    }

    /// Drops the parts of the mask without accepted depth: what is left of things that were
    /// refused, or that return no depth.
    fn keep_supported(&mut self, surface: &Accepted<'_>, mask: &mut BitImage) {
        self.support.clear();
        surface.map.splat(surface.accepted, &mut self.support);
        self.support.dilate(RIM_PX, &mut self.scratch);
        self.bare.copy_from(&self.support);
        self.bare.dilate(SUPPORT_PX - RIM_PX, &mut self.scratch);
        self.bare.invert();
        self.bare.and(mask);
        self.bare.erode(UNSUPPORTED_PX, &mut self.scratch);
        self.bare.dilate(UNSUPPORTED_PX + SUPPORT_PX, &mut self.scratch);
        mask.and_not(&self.bare);

        self.components.find(mask, true);
        self.support_px.clear();
        self.support_px.resize(self.components.list.len(), 0);
        for run in &self.components.runs {
            let (y, start, end) = (run.y as usize, run.start as usize, run.end as usize);
            self.support_px[run.component as usize] += self.support.count_run(y, start, end);
        }
        mask.clear();
        for run in &self.components.runs {
            let pixels = self.components.list[run.component as usize].pixels;
            if self.support_px[run.component as usize] as f32 >= PIECE_SHARE_MIN * pixels as f32 {
                mask.set_run(run.y as usize, run.start as usize, run.end as usize);
            }
        }
    }

    fn fill_holes(&mut self, hole_ratio_max: f64, mask: &mut BitImage, around: &mut BitImage) {
        let hole_px_max = hole_ratio_max * mask.count() as f64;
        self.components.find(mask, false);
        around.clear();
        for run in &self.components.runs {
            let component = &self.components.list[run.component as usize];
            let (y, start, end) = (run.y as usize, run.start as usize, run.end as usize);
            if component.at_border {
                around.set_run(y, start, end);
            } else if f64::from(component.pixels) <= hole_px_max {
                mask.set_run(y, start, end);
            }
        }
    }
}
