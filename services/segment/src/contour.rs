//! The outline of the sheet as sub-pixel edgels.
//!
//! From each pixel of the mask's outline a short profile runs along the mask's normal, from
//! inside to outside. With the mean colours `i` inside and `o` outside, a pixel's *sheetness* is
//! s = (c - o)·(i - o) / |i - o|², and the edge is where s = 1/2. Three parallel profiles give
//! the position (their middle) and the direction (their slope) of a straight piece of edge.

use orime_geometry::{Edgel, EdgelKind};

use crate::bits::BitImage;
use crate::color_model::ColorTable;
use crate::params::SegmentParams;
use crate::window::Window;

/// The profile runs this far to both sides, in half pixels.
const HALF_STEPS: i32 = 6;

/// Where the colours inside and outside are taken, pixels from the mask's outline.
const PLATEAU_PX: [f32; 2] = [3.0, 4.0];

/// Distance between the parallel profiles, pixels.
const APART_PX: f32 = 2.0;

/// Largest disagreement of the outer profiles' crossings with a straight edge, pixels.
const BEND_MAX_PX: f32 = 0.35;

/// Largest slope of the edge against the mask's own direction. More happens at corners.
const SLOPE_MAX: f32 = 0.25;

/// Sheetness must pass from this share to its complement within this distance of the edge.
const SHARP_SHARE: f32 = 0.8;
const SHARP_PX: f32 = 2.0;

/// Radius of the window that the mask's normal is taken from, pixels.
const WINDOW_PX: usize = 4;

/// Its rows, of nine pixels each.
const DISC: [u32; 9] = {
    let mut rows = [0; 9];
    let mut at = 0;
    while at < 81 {
        let (dx, dy) = (at as i32 % 9 - WINDOW_PX as i32, at as i32 / 9 - WINDOW_PX as i32);
        if dx * dx + dy * dy <= (WINDOW_PX * WINDOW_PX) as i32 {
            rows[at / 9] |= 1 << (at % 9);
        }
        at += 1;
    }
    rows
};

/// Columns of nine whose number has a binary digit.
const DIGITS: [u32; 4] = [0b0_1010_1010, 0b0_1100_1100, 0b0_1111_0000, 0b1_0000_0000];

/// A colour image and what is known about its pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Contour<'a> {
    /// Row-major `r, g, b`, all of the image.
    pub color_rgb: &'a [u8],
    /// The image's size.
    pub size: [usize; 2],
    /// The part of it that the binary images show.
    pub window: Window,
    pub table: &'a ColorTable,
    /// The sheet, print filled in.
    pub mask: &'a BitImage,
    /// What lies around the mask, without the holes in it.
    pub around: &'a BitImage,
    /// Pixels at which the outline is not the sheet's, but of something in front of it.
    pub occluded: &'a BitImage,
    pub camera: u32,
}

impl Contour<'_> {
    /// Appends the outline's edgels to `out`, in raster order, as far as it has capacity; returns
    /// how many did not fit. `taken` is scratch of the image's size.
    pub fn trace(&self, params: &SegmentParams, taken: &mut BitImage, out: &mut Vec<Edgel>) -> u32 {
        taken.clear();
        let mut left_out = 0;
        let edge = 8;
        let [width, height] = self.size;
        let start = [self.window.x, self.window.y];
        let first = start.map(|c| c / params.edgel_spacing_px);
        for y in 0..self.mask.height {
            if start[1] + y < edge || start[1] + y + edge >= height {
                continue;
            }
            for k in 0..self.mask.words {
                let mut rest = self.outline(k, y);
                while rest != 0 {
                    let x = 64 * k + rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    if start[0] + x < edge || start[0] + x + edge >= width {
                        continue;
                    }
                    let cell = [(0, x), (1, y)]
                        .map(|(k, c)| (start[k] + c) / params.edgel_spacing_px - first[k]);
                    if taken.get(cell[0], cell[1]) {
                        continue;
                    }
                    let Some(edgel) = self.edgel(x, y, params.contrast_min as f32) else {
                        continue;
                    };
                    taken.set(cell[0], cell[1]);
                    if out.len() == out.capacity() {
                        left_out += 1;
                    } else {
                        out.push(edgel);
                    }
                }
            }
        }
        left_out
    }

    /// Pixels of the mask in word `k` of row `y` that touch what lies around it.
    fn outline(&self, k: usize, y: usize) -> u64 {
        let mask = self.mask.row(y)[k];
        if mask == 0 || y == 0 || y + 1 == self.mask.height {
            return 0;
        }
        let around = self.around.row(y);
        let left = around[k] << 1 | if k > 0 { around[k - 1] >> 63 } else { 0 };
        let right = around[k] >> 1 | around.get(k + 1).map_or(0, |next| next << 63);
        mask & (left | right | self.around.row(y - 1)[k] | self.around.row(y + 1)[k])
    }

    fn edgel(&self, x: usize, y: usize, contrast_min: f32) -> Option<Edgel> {
        if self.occluded.get(x, y) {
            return None;
        }
        let normal = self.mask_normal(x, y)?;
        let tangent = [-normal[1], normal[0]];
        let (x, y) = (self.window.x + x, self.window.y + y);
        let centre = [x as f32 + 0.5 * normal[0], y as f32 + 0.5 * normal[1]];
        let offset = |along: f32| {
            let at = [0, 1].map(|k| centre[k] + along * APART_PX * tangent[k]);
            self.crossing_px(at, normal, contrast_min)
        };
        let [before, here, after] = [offset(-1.0)?, offset(0.0)?, offset(1.0)?];
        // The edge runs along `tangent + slope normal`; its normal is turned back by as much.
        let slope = (after - before) / (2.0 * APART_PX);
        let bend_px = (before + after) / 2.0 - here;
        if bend_px.abs() > BEND_MAX_PX || slope.abs() > SLOPE_MAX {
            return None;
        }
        let mean = (before + here + after) / 3.0;
        let length = (1.0 + slope * slope).sqrt();
        let normal_out = [0, 1].map(|k| (normal[k] - slope * tangent[k]) / length);
        Some(Edgel {
            position_px: [0, 1].map(|k| centre[k] + mean * normal[k]),
            normal: normal_out,
            camera: self.camera,
            kind: EdgelKind::Silhouette as u32,
        })
    }

    /// Outward normal of the mask, from the centre of its pixels in a round window; the pixel is
    /// [`WINDOW_PX`] inside the image at least.
    fn mask_normal(&self, x: usize, y: usize) -> Option<[f32; 2]> {
        let mut sum = [0, 0];
        for (row, disc) in DISC.iter().enumerate() {
            let bits = self.mask.nine(x - WINDOW_PX, y + row - WINDOW_PX) & disc;
            // Columns add up to what their numbers' binary digits add up to.
            let columns: u32 =
                (0..4).map(|digit| (bits & DIGITS[digit]).count_ones() << digit).sum();
            let count = bits.count_ones() as i32;
            sum[0] -= columns as i32 - WINDOW_PX as i32 * count;
            sum[1] -= (row as i32 - WINDOW_PX as i32) * count;
        }
        let length = ((sum[0] * sum[0] + sum[1] * sum[1]) as f32).sqrt();
        (length > 0.0).then(|| sum.map(|s| s as f32 / length))
    }

    /// Signed distance along `normal` from `at` to where the sheet's colour ends, pixels.
    fn crossing_px(&self, at: [f32; 2], normal: [f32; 2], contrast_min: f32) -> Option<f32> {
        let sample = |t: f32| self.sample([at[0] + t * normal[0], at[1] + t * normal[1]]);
        let plateau = |sign: f32| {
            let (a, b) = (sample(sign * PLATEAU_PX[0]), sample(sign * PLATEAU_PX[1]));
            [(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0, (a[2] + b[2]) / 2.0]
        };
        let (inside, outside) = (plateau(-1.0), plateau(1.0));
        if !self.is_sheet(inside) || self.is_sheet(outside) {
            return None;
        }
        let across = [0, 1, 2].map(|k| inside[k] - outside[k]);
        let contrast_squared: f32 = across.iter().map(|d| d * d).sum();
        if contrast_squared < contrast_min * contrast_min {
            return None;
        }
        let sheetness = |t: f32| {
            let color = sample(t);
            let mut sum = 0.0;
            for k in 0..3 {
                sum += (color[k] - outside[k]) * across[k];
            }
            sum / contrast_squared
        };
        // Between two neighbours of the profile, from inside to outside.
        let between = |t: f32, before: f32, here: f32| {
            let crosses = before >= 0.5 && here < 0.5;
            crosses.then(|| t - 0.5 * (0.5 - here) / (before - here))
        };
        // From the middle to both sides: the first crossing is the nearest.
        let mut best: Option<f32> = None;
        let middle = sheetness(0.0);
        let (mut left, mut right) = (middle, middle);
        for step in 1..=HALF_STEPS {
            let t = 0.5 * step as f32;
            let (farther_left, farther_right) = (sheetness(-t), sheetness(t));
            best = between(0.5 - t, farther_left, left);
            if let Some(other) = between(t, right, farther_right)
                && best.is_none_or(|b| other.abs() < b.abs())
            {
                best = Some(other);
            }
            if best.is_some() {
                break;
            }
            (left, right) = (farther_left, farther_right);
        }
        // A shadow's border is softer than an edge of paper.
        best.filter(|t| {
            sheetness(t - SHARP_PX) > SHARP_SHARE && sheetness(t + SHARP_PX) < 1.0 - SHARP_SHARE
        })
    }

    fn is_sheet(&self, color: [f32; 3]) -> bool {
        self.table.is_sheet(color.map(|c| c as u8))
    }

    /// Bilinear colour; the position must be a pixel inside the image.
    #[inline(always)]
    fn sample(&self, [x, y]: [f32; 2]) -> [f32; 3] {
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f32, y - row as f32);
        let width = self.size[0];
        let at = 3 * (row * width + column);
        let (top, bottom) = (&self.color_rgb[at..][..6], &self.color_rgb[at + 3 * width..][..6]);
        let mut mixed = [0.0; 3];
        for k in 0..3 {
            let (left, right) = (f32::from(top[k]), f32::from(top[k + 3]));
            let a = left + fx * (right - left);
            let (left, right) = (f32::from(bottom[k]), f32::from(bottom[k + 3]));
            let b = left + fx * (right - left);
            mixed[k] = a + fy * (b - a);
        }
        mixed
    }
}
