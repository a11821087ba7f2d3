//! Steps in depth: where one surface ends in front of another.
//!
//! Along a row (or column) with depths `a b · · c d`, three pixels apart, the step from `b` to
//! `c` stands out of the slopes on either side:
//!
//! left = c - (2b - a),  right = (2c - d) - b
//!
//! A step of height h makes both h; a crease makes them of opposite sign; a slope makes them 0.
//! Where the nearer surface bends away (a finger), the plain difference c - b decides against
//! the steepest slope that a sheet is followed to.

use orime_lanes::{Lanes, Pass, Width};

use crate::bits::{BitImage, pack};
use crate::depth::DepthMap;
use crate::params::SegmentParams;

/// Pixels from the near side of a step to its far side.
pub(crate) const SPAN_PX: i32 = 3;

/// Tangent of the steepest slope against the image plane that is not taken for a step.
const SLOPE_MAX: f32 = 2.5;

/// Widest gap in the depth image across which an occluder is looked for, pixels.
const GAP_MAX_PX: usize = 16;

/// Gaps without a step that matter, pixels: narrower ones are noise.
const LEVEL_GAP_MIN_PX: f32 = 4.0;
const LEVEL_GAP_MAX_PX: usize = 24;

/// Directions from the near side of a step to its far side.
pub(crate) const DIRECTIONS: [[i32; 2]; 4] = [[1, 0], [-1, 0], [0, 1], [0, -1]];

/// Steps of the depth image that was examined last.
#[derive(Debug)]
pub(crate) struct Steps {
    /// For each of [`DIRECTIONS`], pixels on the near side of a step that falls that way.
    pub near: [BitImage; 4],
    /// Everything from the near to the far side of any step.
    pub edge: BitImage,
    /// Steps across gaps in the depth image: the near and the far pixel, row-major.
    pub gaps: Vec<[u32; 2]>,
    /// Gaps between pixels at one depth: print, or something that reflects no depth. Row-major.
    pub level_gaps: Vec<[u32; 2]>,
    moved: BitImage,
    base_m: f32,
    growth_per_m: f32,
    /// Per metre of depth: by how much depth may change over [`SPAN_PX`].
    slope: [f32; 2],
    pub lanes: Width,
}

impl Steps {
    pub fn new(map: &DepthMap, params: &SegmentParams) -> Self {
        let image = || BitImage::new(map.width, map.height);
        Self {
            near: [image(), image(), image(), image()],
            edge: image(),
            level_gaps: Vec::with_capacity(map.width * map.height),
            moved: image(),
            // One gap in a row and one in a column may end at a pixel, but no two pixels in a
            // row can both end one.
            gaps: Vec::with_capacity(map.width * map.height),
            base_m: params.step_m as f32,
            growth_per_m: params.step_growth_per_m as f32,
            slope: map.focal_px.map(|f| SLOPE_MAX * SPAN_PX as f32 / f),
            lanes: Width::available()[0],
        }
    }

    /// Takes a window's size.
    pub fn reshape(&mut self, width: usize, height: usize) {
        for image in self.near.iter_mut().chain([&mut self.edge, &mut self.moved]) {
            image.reshape(width, height);
        }
    }

    /// Examines the words of `map` in which `region` has a pixel.
    pub fn find(&mut self, map: &DepthMap, region: &BitImage) {
        self.near.iter_mut().for_each(BitImage::clear);
        self.edge.clear();
        let lanes = self.lanes;
        lanes.run(FindSteps { steps: self, map, region });
        for (near, [dx, dy]) in self.near.iter().zip(DIRECTIONS) {
            self.moved.copy_from(near);
            self.edge.or(&self.moved);
            for _ in 0..SPAN_PX {
                self.moved.shift([dx, dy]);
                self.edge.or(&self.moved);
            }
        }
        self.find_gaps(map, region);
    }

    /// The least step at a depth, metres.
    pub fn least_m(&self, z_m: f32) -> f32 {
        self.base_m + self.growth_per_m * z_m * z_m
    }

    #[inline(always)]
    fn find_in_word(&mut self, map: &DepthMap, k: usize, y: usize) {
        let (x, row) = (64 * k as i32, y as i32);
        let used = self.edge.used(k);
        // A step that falls to +x has its near pixel here; one that falls to -x, its far pixel.
        let along = [-3, 0, 3, 6].map(|dx| map.z_block(x + dx, row));
        let (falls, rises) = self.compare(along, self.slope[0]);
        self.near[0].row_mut(y)[k] |= falls & used;
        // The near pixel of a rise is SPAN_PX further on, perhaps in the next word.
        self.near[1].row_mut(y)[k] |= rises << SPAN_PX & used;
        if k + 1 < self.edge.words {
            let used_next = self.edge.used(k + 1);
            self.near[1].row_mut(y)[k + 1] |= rises >> (64 - SPAN_PX) & used_next;
        }
        let across = [-3, 0, 3, 6].map(|dy| map.z_block(x, row + dy));
        let (falls, rises) = self.compare(across, self.slope[1]);
        self.near[2].row_mut(y)[k] |= falls & used;
        if y + SPAN_PX as usize - 1 < map.height - 1 {
            self.near[3].row_mut(y + SPAN_PX as usize)[k] |= rises & used;
        }
    }

    /// Bits of the pixels `b` from which depth steps away (falls) or nearer (rises) to `c`.
    #[inline(always)]
    fn compare(&self, [a, b, c, d]: [&[f32]; 4], slope: f32) -> (u64, u64) {
        let (mut falls, mut rises) = ([0; 64], [0; 64]);
        let lanes = a.iter().zip(b).zip(c).zip(d);
        for ((((a, b), c), d), (fall, rise)) in lanes.zip(falls.iter_mut().zip(&mut rises)) {
            let least = self.base_m + self.growth_per_m * b * b;
            let (left, right) = (c - 2.0 * b + a, 2.0 * c - d - b);
            let plain = c - b;
            let steep = least + slope * b;
            // NaN fails every comparison.
            let (falls_left, falls_right) = (left > least, right > least);
            let (rises_left, rises_right) = (left < -least, right < -least);
            // Between equal slopes a steep one is a plane; at a gap's edge it is a step.
            let plane = (left.abs() <= least) & (right.abs() <= least);
            *fall = u8::from(falls_left & falls_right | (plain > steep) & !plane);
            *rise = u8::from(rises_left & rises_right | (plain < -steep) & !plane);
        }
        (pack(&falls), pack(&rises))
    }

    /// Compares the two sides of each gap in the depth image.
    fn find_gaps(&mut self, map: &DepthMap, region: &BitImage) {
        self.gaps.clear();
        self.level_gaps.clear();
        for y in 0..map.height {
            for k in 0..region.words {
                if region.row(y)[k] == 0 {
                    continue;
                }
                let valid = map.valid.row(y)[k];
                let carry = if k > 0 { map.valid.row(y)[k - 1] >> 63 } else { 0 };
                let above = if y > 0 { map.valid.row(y - 1)[k] } else { 0 };
                // Pixels that end a gap in their row, and in their column.
                let after_gap = valid & !(valid << 1 | carry);
                let below_gap = valid & !above;
                let mut rest = after_gap | below_gap;
                while rest != 0 {
                    let bit = rest.trailing_zeros();
                    rest &= rest - 1;
                    let x = 64 * k + bit as usize;
                    if after_gap >> bit & 1 == 1 {
                        let mut before = (2..=LEVEL_GAP_MAX_PX.min(x)).map(|n| x - n);
                        if let Some(left) = before.find(|left| map.valid.get(*left, y)) {
                            self.compare_gap(map, (left, y), (x, y));
                        }
                    }
                    if below_gap >> bit & 1 == 1 {
                        let mut before = (2..=LEVEL_GAP_MAX_PX.min(y)).map(|n| y - n);
                        if let Some(up) = before.find(|up| map.valid.get(x, *up)) {
                            self.compare_gap(map, (x, up), (x, y));
                        }
                    }
                }
            }
        }
    }

    fn compare_gap(&mut self, map: &DepthMap, a: (usize, usize), b: (usize, usize)) {
        let z_m = |p: (usize, usize)| map.z_m(p.0 as i32, p.1 as i32);
        let (near, far) = if z_m(a) < z_m(b) { (a, b) } else { (b, a) };
        let gap_px = (b.0 - a.0 + b.1 - a.1) as f32;
        let slope = self.slope[0] / SPAN_PX as f32 * gap_px;
        let step_m = z_m(far) - z_m(near);
        let ends = [near, far].map(|(x, y)| (y * map.width + x) as u32);
        if step_m > self.least_m(z_m(near)) + slope * z_m(near) {
            if gap_px <= GAP_MAX_PX as f32 {
                self.gaps.push(ends);
            }
        } else if gap_px >= LEVEL_GAP_MIN_PX {
            self.level_gaps.push(ends);
        }
    }
}

/// Examines words.
struct FindSteps<'a> {
    steps: &'a mut Steps,
    map: &'a DepthMap,
    region: &'a BitImage,
}

impl Pass for FindSteps<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        for y in 0..self.map.height {
            for k in 0..self.region.words {
                if self.region.row(y)[k] != 0 {
                    self.steps.find_in_word(self.map, k, y);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::nalgebra::Isometry3;
    use orime_geometry::{CameraModel, RgbdCamera};

    /// Columns with steps in a picture whose rows all have these depths, 0.1 mm.
    fn step_columns(depth: impl Fn(i32) -> i32) -> Vec<usize> {
        let (width, height) = (90, 12);
        let lens = CameraModel {
            width,
            height,
            fx_px: 200.0,
            fy_px: 200.0,
            cx_px: 44.5,
            cy_px: 5.5,
            distortion: [0.0; 5],
        };
        let camera = RgbdCamera {
            name: "front".into(),
            color: lens.clone(),
            depth: lens,
            color_from_depth: Isometry3::identity(),
            world_from_color: Isometry3::identity(),
            depth_m_per_unit: 1e-4,
        };
        let params = SegmentParams::default();
        let mut map = DepthMap::new(&camera, &params);
        let row: Vec<u16> = (0..width as i32).map(|x| depth(x) as u16).collect();
        map.load(&row.repeat(height as usize));
        let mut steps = Steps::new(&map, &params);
        steps.find(&map, &map.valid);
        (0..width as usize).filter(|x| steps.edge.get(*x, 6)).collect()
    }

    #[test]
    fn a_steep_plane_has_no_step_and_what_ends_it_has() {
        // 12 mm a pixel at 0.5 to 0.7 m: a tangent of 4.
        let ramp = |x: i32| 5000 + 120 * (x - 40).clamp(0, 16);
        let columns = step_columns(ramp);
        assert!((46..51).all(|x| !columns.contains(&x)), "on the plane: {columns:?}");
        // A finger that bends away before a sheet 20 mm behind it.
        let finger = |x: i32| if x < 40 { 5036 - (40 - x).min(6).pow(2) } else { 5236 };
        assert!((38..43).all(|x| step_columns(finger).contains(&x)));
        // As steep between two pixels only: a step of 24 mm.
        let step = |x: i32| if x < 40 { 5000 } else { 5240 };
        assert_eq!(step_columns(step), [37, 38, 39, 40, 41, 42]);
    }
}
