//! What the sheet's colours are against its surroundings, as a table over all colours.
//!
//! Colours are compared as `f = (ln R'/G', ln B'/G', 0.35 ln V')` with `X' = X + 8` and
//! `V = max(R, G, B)`: shading moves only the third coordinate, and that one counts less.
//!
//! Shade has an end: of a matte sheet's brightness in full light something is left on any side.
//! What has the sheet's chroma and is darker than [`SHADE_MIN`] of it (a grey gripper at white
//! paper) is something else. Full light is what the sheet was brightest in, so that floor follows.

use orime_lanes::{Lanes, Pass, Width};

use crate::bits::{BitImage, pack};
use crate::window::Window;

/// A colour as `(ln R'/G', ln B'/G', 0.35 ln V')`.
pub(crate) type Feature = [f32; 3];

/// Farthest that a sheet's pixel may be from the sheet's own chroma, `ln R'/G'` and `ln B'/G'`.
const CHROMA_BOX: [f32; 2] = [0.35, 0.5];

/// Least brightness `V'` of a sheet in its own shade, as a share of that in full light.
pub(crate) const SHADE_MIN: f32 = 0.41;

/// Dark things of the sheet's chroma: the sheet is at least this many times brighter.
const CLEAR_OF_DARK: f32 = 1.15;

/// Farthest that their chroma may be from the sheet's.
const DARK_CHROMA: f32 = 0.15;

/// How fast full light follows a brighter sheet, per frame.
const BRIGHTER_RATE: f32 = 0.2;

/// The feature of an 8-bit colour.
pub(crate) fn feature(rgb: [f32; 3]) -> Feature {
    let [r, g, b] = rgb.map(|c| c + 8.0);
    [(r / g).ln(), (b / g).ln(), 0.35 * r.max(g).max(b).ln()]
}

pub(crate) fn distance_squared(a: &Feature, b: &Feature) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Brightness `V'` of a feature.
pub(crate) fn brightness(color: &Feature) -> f32 {
    (color[2] / 0.35).exp()
}

/// Which of the 32768 colours of 5 bits a channel are the sheet's.
#[derive(Debug, Clone)]
pub(crate) struct ColorTable {
    /// 0 for what is not the sheet; else 1 and its brightest channel, 5 bits.
    levels: Box<[u8; 1 << 15]>,
    /// Least level of the sheet, above 0.
    floor: u8,
    light: Option<Light>,
}

/// How bright a sheet is.
#[derive(Debug, Clone, Copy)]
struct Light {
    /// Brightness `V'` in full light.
    full: f32,
    /// Least brightness as a share of it.
    share_min: f32,
    /// Whether full light is what was seen; two sides may differ in brightness for good.
    follows: bool,
}

impl Light {
    fn floor(&self) -> u8 {
        let value = self.full * self.share_min - 8.0;
        // The first level whose centre `8 (level - 1) + 4` is not below it.
        1 + ((value + 4.0) / 8.0).floor().clamp(0.0, 31.0) as u8
    }
}

impl ColorTable {
    /// Colours nearer to one of `sheet` than to any of `around`, within its chroma box, and not
    /// darker than its shade. What is around and darker than that bounds the shade instead.
    pub fn two_class(sheet: &[Feature], around: &[Feature]) -> Self {
        let darkest = sheet.iter().map(brightness).fold(f32::INFINITY, f32::min);
        let is_dark = |other: &&Feature| {
            let chroma = |seed: &Feature| (other[0] - seed[0]).hypot(other[1] - seed[1]);
            brightness(other) < SHADE_MIN * darkest && sheet.iter().any(|s| chroma(s) < DARK_CHROMA)
        };
        let (dark, around): (Vec<Feature>, Vec<Feature>) = around.iter().partition(is_dark);
        let dark = dark.iter().map(brightness).fold(0.0, f32::max);
        let mut table = Self::new(|color| {
            let nearest_around = nearest(color, &around);
            sheet.iter().any(|seed| {
                distance_squared(color, seed) < nearest_around
                    && (color[0] - seed[0]).abs() < CHROMA_BOX[0]
                    && (color[1] - seed[1]).abs() < CHROMA_BOX[1]
            })
        });
        if darkest.is_finite() {
            let share_min = SHADE_MIN.max(CLEAR_OF_DARK * dark / darkest);
            let light = Light { full: darkest, share_min, follows: sheet.len() == 1 };
            table.floor = light.floor();
            table.light = Some(light);
        }
        table
    }

    /// Colours farther than `distance` from all of `around`.
    pub fn unlike(around: &[Feature], distance: f32) -> Self {
        Self::new(|color| nearest(color, around) > distance * distance)
    }

    fn new(is_sheet: impl Fn(&Feature) -> bool) -> Self {
        let mut levels = Box::new([0; 1 << 15]);
        for (index, entry) in levels.iter_mut().enumerate() {
            let channels = [10, 5, 0].map(|shift: usize| (index >> shift & 31) as u8);
            if is_sheet(&feature(channels.map(|c| f32::from(c * 8 + 4)))) {
                *entry = 1 + channels.into_iter().fold(0, u8::max);
            }
        }
        Self { levels, floor: 1, light: None }
    }

    /// Learns from the sheet's pixels how bright it is: from their upper quartile. `sheet` is the
    /// part `window` of an image that is `width` pixels wide.
    pub fn follow(&mut self, color_rgb: &[u8], width: usize, window: &Window, sheet: &BitImage) {
        let Some(light) = self.light.as_mut().filter(|light| light.follows) else { return };
        let mut histogram = [0_u32; 32];
        for y in (0..sheet.height).step_by(4) {
            for (k, word) in sheet.row(y).iter().enumerate() {
                let mut rest = word & 0x1111_1111_1111_1111;
                while rest != 0 {
                    let x = window.x + 64 * k + rest.trailing_zeros() as usize;
                    let at = 3 * ((window.y + y) * width + x);
                    rest &= rest - 1;
                    let value = color_rgb[at..at + 3].iter().fold(0, |a, b| a.max(*b));
                    histogram[usize::from(value >> 3)] += 1;
                }
            }
        }
        let quarter = histogram.iter().sum::<u32>() / 4;
        let mut above = 0;
        let level = (0..32).rev().find(|level| {
            above += histogram[*level];
            above > quarter
        });
        let Some(level) = level else { return };
        let seen = (8 * level + 4 + 8) as f32;
        light.full += BRIGHTER_RATE * (seen - light.full).max(0.0);
        self.floor = light.floor();
    }

    /// Whether a colour is the sheet's.
    pub fn is_sheet(&self, rgb: [u8; 3]) -> bool {
        self.levels[index(rgb)] >= self.floor
    }

    /// Marks the sheet-coloured pixels of the part `window` of a row-major `r, g, b` image that
    /// is `width` pixels wide.
    pub fn classify(
        &self,
        lanes: Width,
        color_rgb: &[u8],
        width: usize,
        window: &Window,
        out: &mut BitImage,
    ) {
        let first = 3 * (window.y * width + window.x);
        lanes.run(Classify { table: self, color_rgb: &color_rgb[first..], width, out });
    }

    /// Which of 64 pixels are sheet-coloured.
    #[inline(always)]
    fn word(&self, pixels: &[u8; 3 * 64]) -> u64 {
        // One loop of vectors, one of look-ups, one of vectors.
        let mut indices = [0_u16; 64];
        for (index, rgb) in indices.iter_mut().zip(pixels.chunks_exact(3)) {
            let (r, g, b) = (u16::from(rgb[0]), u16::from(rgb[1]), u16::from(rgb[2]));
            *index = r >> 3 << 10 | g >> 3 << 5 | b >> 3;
        }
        let mut bytes = [0; 64];
        for (byte, index) in bytes.iter_mut().zip(indices) {
            *byte = self.levels[usize::from(index & 0x7fff)];
        }
        let floor = self.floor;
        for byte in &mut bytes {
            *byte = u8::from(*byte >= floor);
        }
        pack(&bytes)
    }
}

/// Classifies the rows of an image from a window's corner on.
struct Classify<'a> {
    table: &'a ColorTable,
    color_rgb: &'a [u8],
    /// Of the image, pixels.
    width: usize,
    out: &'a mut BitImage,
}

impl Pass for Classify<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { table, color_rgb, width, out } = self;
        let (inside, height) = (out.width, out.height);
        for y in 0..height {
            let row = &color_rgb[3 * y * width..][..3 * inside];
            let mut words = row.chunks_exact(3 * 64);
            let out = out.row_mut(y);
            for (word, pixels) in out.iter_mut().zip(&mut words) {
                if let Ok(pixels) = pixels.try_into() {
                    *word = table.word(pixels);
                }
            }
            let rest = words.remainder();
            if let Some(word) = out.last_mut().filter(|_| !rest.is_empty()) {
                let mut pixels = [0; 3 * 64];
                pixels[..rest.len()].copy_from_slice(rest);
                *word = table.word(&pixels) & ((1 << (rest.len() / 3)) - 1);
            }
        }
    }
}

fn index([r, g, b]: [u8; 3]) -> usize {
    usize::from(r >> 3) << 10 | usize::from(g >> 3) << 5 | usize::from(b >> 3)
}

fn nearest(color: &Feature, all: &[Feature]) -> f32 {
    all.iter().map(|other| distance_squared(color, other)).fold(f32::INFINITY, f32::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAPER: [f32; 3] = [250.0, 247.0, 240.0];
    const STEEL: [f32; 3] = [74.0, 78.0, 84.0];
    const WOOD: [f32; 3] = [132.0, 92.0, 60.0];

    fn lit(rgb: [f32; 3], light: f32) -> [f32; 3] {
        rgb.map(|c| (c * light).min(255.0))
    }

    fn is_sheet(table: &ColorTable, rgb: [f32; 3]) -> bool {
        table.is_sheet(rgb.map(|c| c as u8))
    }

    /// White paper in any light of `lights` is the sheet, steel and wood in none of them.
    fn check(table: &ColorTable, lights: &[f32]) {
        for light in lights {
            assert!(is_sheet(table, lit(PAPER, *light)), "paper in {light}");
            assert!(!is_sheet(table, lit(STEEL, *light)), "steel in {light}");
            assert!(!is_sheet(table, lit(WOOD, *light)), "wood in {light}");
        }
    }

    const LIGHTS: [f32; 5] = [0.45, 0.6, 0.8, 1.0, 1.1];

    #[test]
    fn steel_that_was_not_seen_is_not_white_paper() {
        check(&ColorTable::two_class(&[feature(PAPER)], &[feature(WOOD)]), &LIGHTS);
    }

    #[test]
    fn steel_that_was_seen_does_not_take_the_papers_shaded_sides() {
        for light in [0.45, 0.8, 1.1] {
            let around = [feature(WOOD), feature(lit(STEEL, light))];
            check(&ColorTable::two_class(&[feature(PAPER)], &around), &LIGHTS);
        }
    }

    #[test]
    fn a_grey_table_that_is_not_much_darker_still_competes() {
        let table = ColorTable::two_class(&[feature(PAPER)], &[feature([120.0; 3])]);
        assert!(!is_sheet(&table, [130.0; 3]) && is_sheet(&table, [200.0; 3]));
        // A darker one bounds the shade.
        let table = ColorTable::two_class(&[feature(PAPER)], &[feature([92.0; 3])]);
        assert!(!is_sheet(&table, [100.0; 3]) && is_sheet(&table, [132.0; 3]));
    }

    /// A sheet first seen from below, in its own shade, and then turned into the light.
    #[test]
    fn the_floor_follows_the_light() {
        let mut table = ColorTable::two_class(&[feature(lit(PAPER, 0.58))], &[feature(WOOD)]);
        assert!(is_sheet(&table, lit(PAPER, 0.45)) && is_sheet(&table, lit(STEEL, 1.1)));
        let mut sheet = BitImage::new(130, 40);
        (0..40).for_each(|y| sheet.set_run(y, 3, 129));
        let image = |light: f32| [0; 130 * 40].map(|_: u8| lit(PAPER, light).map(|c| c as u8));
        for _ in 0..30 {
            table.follow(image(1.0).as_flattened(), 130, &Window::whole(130, 40), &sheet);
        }
        check(&table, &LIGHTS);
        // Shade is no reason to forget what full light was.
        for _ in 0..300 {
            table.follow(image(0.45).as_flattened(), 130, &Window::whole(130, 40), &sheet);
        }
        check(&table, &LIGHTS);
    }
}
