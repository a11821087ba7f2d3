//! Which patches of surface are the sheet, among all that have its colour.
//!
//! A patch is a component of sheet-coloured depth pixels that no step in depth crosses. The
//! largest that is not larger than the sheet is its *anchor*. A hand in the mask, over-exposed
//! or reddish white, is a patch in front of others that goes on, without a step, in another
//! colour; it is refused. (A flap of the sheet ends where its colour does.) A part of the sheet
//! that a hand cuts off is accepted if nothing but the hand lies between it and the anchor. Where
//! hardly a patch is left, what was the sheet a frame ago stays the sheet.

use crate::bits::BitImage;
use crate::components::Components;
use crate::depth::DepthMap;
use crate::steps::{DIRECTIONS, SPAN_PX, Steps};

/// Smaller patches are dropped, pixels.
const PATCH_MIN_PX: u32 = 24;

/// How far beyond the mask's margin a surface is looked for that goes on in another colour, pixels.
const CONTINUED_PX: usize = 5;

/// Longest stretch between a part and the rest that is neither sheet nor in front of it, pixels:
/// print is narrower.
const BETWEEN_PX_MAX: u32 = 12;

/// How far something in front of the sheet is nearer, metres.
pub(crate) const IN_FRONT_M: f32 = 0.008;

/// Share of a patch's outline from which steps along it count.
const OUTLINE_SHARE: f32 = 0.12;

/// Limits that follow from the sheet's size and the params.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SheetSize {
    /// Largest and smallest visible area, m².
    pub area_m2_max: f32,
    pub area_m2_min: f32,
    /// Smallest area of a part that something in front cuts off, m².
    pub piece_m2_min: f32,
    /// Largest distance between two points, metres.
    pub diagonal_m: f32,
}

/// What was chosen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chosen {
    /// Visible area, m².
    pub area_m2: f32,
    /// Middle of the anchor, world, metres.
    pub centre_m: [f32; 3],
    /// Least depth, metres.
    pub nearest_m: f32,
}

/// One patch of surface.
#[derive(Debug, Clone, Copy, Default)]
struct Patch {
    pixels: u32,
    /// As seen: not corrected for slant, so never above the true area.
    area_m2: f32,
    /// Sum over runs of centre times pixels, world, m.
    moment_m: [f32; 3],
    /// Least depth of its runs' ends and middles, metres.
    nearest_m: f32,
    /// Pixels that are nearer, farther than what lies across a step.
    near: u32,
    far: u32,
    /// Runs: about half the length of the outline.
    runs: u32,
    /// Pixels beside which the surface goes on in another colour.
    continued: u32,
    /// Sums over runs: centre column, row of the whole image times pixels.
    moment_px: [f32; 2],
    /// Pixels that were sheet in the frame before.
    before: u32,
    /// Colour component, counted from 1.
    color: u32,
    accepted: bool,
}

/// Chooses patches; keeps its memory.
#[derive(Debug)]
pub(crate) struct Selector {
    components: Components,
    patches: Vec<Patch>,
    order: Vec<u32>,
    near: BitImage,
    far: BitImage,
    continued: BitImage,
    scratch: BitImage,
}

/// What the choice is made from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Evidence<'a> {
    pub map: &'a DepthMap,
    pub steps: &'a Steps,
    /// Depth pixels of the sheet's colour.
    pub sheet_colored: &'a BitImage,
    /// Those of them that lie clear of the mask's outline and of steps.
    pub surface: &'a BitImage,
    /// Components of the colour mask.
    pub colors: &'a Components,
    /// The sheet's depth pixels in the frame before.
    pub before: &'a BitImage,
}

impl Selector {
    pub fn new(width: usize, height: usize) -> Self {
        let image = || BitImage::new(width, height);
        Self {
            components: Components::new(width, height),
            patches: Vec::with_capacity(width.div_ceil(2) * height),
            order: Vec::with_capacity(width.div_ceil(2) * height),
            near: image(),
            far: image(),
            continued: image(),
            scratch: image(),
        }
    }

    /// Takes a window's size.
    pub fn reshape(&mut self, width: usize, height: usize) {
        let Self { near, far, continued, scratch, components: _, patches: _, order: _ } = self;
        for image in [near, far, continued, scratch] {
            image.reshape(width, height);
        }
    }

    /// Splits the evidence's surface into what is the sheet, into `accepted`, and what is not,
    /// into `refused`. `None` if no patch can be the sheet.
    pub fn select(
        &mut self,
        evidence: &Evidence<'_>,
        size: &SheetSize,
        accepted: &mut BitImage,
        refused: &mut BitImage,
    ) -> Option<Chosen> {
        accepted.clear();
        refused.clear();
        self.mark_steps(evidence.steps);
        self.mark_continued(evidence);
        self.components.find(evidence.surface, true);
        self.measure(evidence);
        let chosen = self.accept(evidence, size).or_else(|| {
            self.components.find(evidence.sheet_colored, true);
            self.measure(evidence);
            self.accept_known(size)
        })?;
        for run in &self.components.runs {
            let patch = &self.patches[run.component as usize];
            let out = match patch {
                patch if patch.accepted => &mut *accepted,
                patch if patch.pixels >= PATCH_MIN_PX => &mut *refused,
                _ => continue,
            };
            out.set_run(run.y as usize, run.start as usize, run.end as usize);
        }
        Some(chosen)
    }

    /// Whether a colour component (counted from 0) holds an accepted patch.
    pub fn accepts_color(&self, color: usize) -> bool {
        self.patches.iter().any(|p| p.accepted && p.color as usize == color + 1)
    }

    fn mark_steps(&mut self, steps: &Steps) {
        self.near.clear();
        self.far.clear();
        let width = self.near.width;
        for [near, far] in steps.gaps.iter().map(|gap| gap.map(|at| at as usize)) {
            self.near.set(near % width, near / width);
            self.far.set(far % width, far / width);
        }
        for (near, [dx, dy]) in steps.near.iter().zip(DIRECTIONS) {
            self.near.or(near);
            self.scratch.copy_from(near);
            self.scratch.shift([SPAN_PX * dx, SPAN_PX * dy]);
            self.far.or(&self.scratch);
        }
        self.near.dilate(3, &mut self.scratch);
        self.far.dilate(3, &mut self.scratch);
        // Of a pixel close to both sides nothing is known.
        self.scratch.copy_from(&self.near);
        self.near.and_not(&self.far);
        self.far.and_not(&self.scratch);
    }

    fn mark_continued(&mut self, evidence: &Evidence<'_>) {
        self.continued.copy_from(&evidence.steps.edge);
        self.continued.dilate(2, &mut self.scratch);
        self.continued.or(evidence.sheet_colored);
        self.continued.invert();
        self.continued.and(&evidence.map.valid);
        self.continued.dilate(CONTINUED_PX, &mut self.scratch);
    }

    fn measure(&mut self, evidence: &Evidence<'_>) {
        let map = evidence.map;
        self.patches.clear();
        let none = Patch { nearest_m: f32::INFINITY, ..Patch::default() };
        self.patches.resize(self.components.list.len(), none);
        let per_pixel = 1.0 / (map.focal_px[0] * map.focal_px[1]);
        for run in &self.components.runs {
            let patch = &mut self.patches[run.component as usize];
            let (y, start, end) = (run.y as usize, run.start as usize, run.end as usize);
            let middle = (start + end - 1) / 2;
            let z_m = map.z_m(middle as i32, y as i32);
            patch.area_m2 += run.len() as f32 * z_m * z_m * per_pixel;
            let ends = [start, end - 1].map(|x| map.z_m(x as i32, y as i32));
            patch.nearest_m = ends.into_iter().fold(z_m, f32::min).min(patch.nearest_m);
            let point = map.world_m(middle, y);
            (0..3).for_each(|k| patch.moment_m[k] += run.len() as f32 * point[k]);
            patch.pixels += run.len();
            patch.runs += 1;
            patch.near += self.near.count_run(y, start, end);
            patch.far += self.far.count_run(y, start, end);
            patch.continued += self.continued.count_run(y, start, end);
            let twice = 2 * map.window.x as u32 + run.start + run.end - 1;
            patch.moment_px[0] += (run.len() * twice) as f32 / 2.0;
            patch.moment_px[1] += (run.len() * (map.window.y as u32 + run.y)) as f32;
            patch.before += evidence.before.count_run(y, start, end);
            if patch.color == 0 {
                let color = map.color_pixel(middle, y).and_then(|(x, y)| evidence.colors.at(x, y));
                patch.color = color.map_or(0, |k| k as u32 + 1);
            }
        }
    }

    /// Accepts what was the sheet a frame ago, whatever its depth: pleats and edges that the
    /// camera looks along have steps everywhere, and yet an outline.
    fn accept_known(&mut self, size: &SheetSize) -> Option<Chosen> {
        let known = |p: &Patch| p.pixels >= PATCH_MIN_PX && 2 * p.before > p.pixels;
        self.patches.iter_mut().for_each(|p| p.accepted = known(p));
        let accepted = || self.patches.iter().filter(|p| p.accepted);
        let area_m2: f32 = accepted().map(|p| p.area_m2).sum();
        let largest = accepted().max_by(|a, b| a.area_m2.total_cmp(&b.area_m2))?;
        let chosen = Chosen {
            area_m2,
            centre_m: largest.centre_m(),
            nearest_m: accepted().map(|p| p.nearest_m).fold(f32::INFINITY, f32::min),
        };
        (size.area_m2_min..=size.area_m2_max).contains(&area_m2).then_some(chosen)
    }

    fn accept(&mut self, evidence: &Evidence<'_>, size: &SheetSize) -> Option<Chosen> {
        let patches = &mut self.patches;
        self.order.clear();
        let large = |k: &u32| patches[*k as usize].pixels >= PATCH_MIN_PX;
        self.order.extend((0..patches.len() as u32).filter(large));
        let by_area = |a: &u32, b: &u32| {
            let of = |k: &u32| patches[*k as usize].area_m2;
            of(b).total_cmp(&of(a)).then(a.cmp(b))
        };
        self.order.sort_unstable_by(by_area);
        // What was the sheet a frame ago wins against what is three times as large.
        let weight = |p: &Patch| p.area_m2 * if 2 * p.before > p.pixels { 3.0 } else { 1.0 };
        let anchor = *self
            .order
            .iter()
            .filter(|k| patches[**k as usize].area_m2 <= size.area_m2_max)
            .max_by(|a, b| {
                let of = |k: &u32| weight(&patches[*k as usize]);
                of(a).total_cmp(&of(b)).then(b.cmp(a))
            })? as usize;
        patches[anchor].accepted = true;
        let anchor = patches[anchor];
        let mut chosen = Chosen {
            area_m2: anchor.area_m2,
            centre_m: anchor.centre_m(),
            nearest_m: anchor.nearest_m,
        };
        for k in &self.order {
            let patch = &mut patches[*k as usize];
            if !patch.accepted
                && chosen.area_m2 + patch.area_m2 <= size.area_m2_max
                && belongs(patch, &anchor, size, evidence)
            {
                patch.accepted = true;
                chosen.area_m2 += patch.area_m2;
                chosen.nearest_m = chosen.nearest_m.min(patch.nearest_m);
            }
        }
        (chosen.area_m2 >= size.area_m2_min).then_some(chosen)
    }
}

impl Patch {
    /// Its middle, world, metres.
    fn centre_m(&self) -> [f32; 3] {
        self.moment_m.map(|m| m / self.pixels as f32)
    }
}

/// Whether a patch is part of the same sheet as the anchor.
fn belongs(patch: &Patch, anchor: &Patch, size: &SheetSize, evidence: &Evidence<'_>) -> bool {
    if distance_m(&patch.centre_m(), &anchor.centre_m()) > size.diagonal_m {
        return false;
    }
    let share = OUTLINE_SHARE * 2.0 * patch.runs as f32;
    let in_front = patch.near > 2 * patch.far
        && patch.near as f32 > share
        && patch.continued as f32 > share
        && patch.area_m2 < 0.5 * anchor.area_m2;
    if patch.color == anchor.color {
        return !in_front;
    }
    let behind = patch.far as f32 > share && patch.area_m2 > size.piece_m2_min;
    !in_front && behind && only_occluders_between(patch, anchor, evidence)
}

/// Distance between two points, metres.
pub(crate) fn distance_m(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>().sqrt()
}

/// Whether a straight line between two patches crosses nothing but things of the sheet's colour,
/// things in front of it, and gaps in depth.
fn only_occluders_between(patch: &Patch, anchor: &Patch, evidence: &Evidence<'_>) -> bool {
    let map = evidence.map;
    let end = |p: &Patch| {
        let [x, y] = p.moment_px.map(|m| m / p.pixels as f32);
        // Per pixel the area is z² / f²; depth is interpolated as 1/z, which is exact on planes.
        let z_m = (p.area_m2 / p.pixels as f32 * map.focal_px[0] * map.focal_px[1]).sqrt();
        [x, y, 1.0 / z_m]
    };
    let (from, to) = (end(patch), end(anchor));
    let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).ceil().max(1.0);
    let mut stretch = 0;
    for n in 0..=steps as u32 {
        let t = n as f32 / steps;
        let [x, y, inverse] = [0, 1, 2].map(|k| from[k] + t * (to[k] - from[k]));
        let (x, y) = ((x + 0.5) as usize, (y + 0.5) as usize);
        let (x, y) = (x.saturating_sub(map.window.x), y.saturating_sub(map.window.y));
        let (x, y) = (x.min(map.width - 1), y.min(map.height - 1));
        let level = map.z_m(x as i32, y as i32) > 1.0 / inverse - IN_FRONT_M;
        let other = level && !evidence.sheet_colored.get(x, y);
        stretch = if other { stretch + 1 } else { 0 };
        if stretch > BETWEEN_PX_MAX {
            return false;
        }
    }
    true
}
