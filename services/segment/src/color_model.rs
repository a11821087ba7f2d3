//! What the sheet's colours are against its surroundings, as a table over all colours.
//!
//! Colours are compared as `f = (ln R'/G', ln B'/G', 0.35 ln V')` with `X' = X + 8` and
//! `V = max(R, G, B)`: shading moves only the third coordinate, and that one counts less.

use crate::bits::{BitImage, pack};

/// A colour as `(ln R'/G', ln B'/G', 0.35 ln V')`.
pub(crate) type Feature = [f32; 3];

/// Farthest that a sheet's pixel may be from the sheet's own chroma, `ln R'/G'` and `ln B'/G'`.
const CHROMA_BOX: [f32; 2] = [0.35, 0.5];

/// The feature of an 8-bit colour.
pub(crate) fn feature(rgb: [f32; 3]) -> Feature {
    let [r, g, b] = rgb.map(|c| c + 8.0);
    [(r / g).ln(), (b / g).ln(), 0.35 * r.max(g).max(b).ln()]
}

pub(crate) fn distance_squared(a: &Feature, b: &Feature) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Which of the 32768 colours of 5 bits a channel are the sheet's.
#[derive(Debug, Clone)]
pub(crate) struct ColorTable {
    sheet: Box<[u8; 1 << 15]>,
}

impl ColorTable {
    /// Colours nearer to one of `sheet` than to any of `around`, and within its chroma box.
    pub fn two_class(sheet: &[Feature], around: &[Feature]) -> Self {
        Self::new(|color| {
            let nearest_around = nearest(color, around);
            sheet.iter().any(|seed| {
                distance_squared(color, seed) < nearest_around
                    && (color[0] - seed[0]).abs() < CHROMA_BOX[0]
                    && (color[1] - seed[1]).abs() < CHROMA_BOX[1]
            })
        })
    }

    /// Colours farther than `distance` from all of `around`.
    pub fn unlike(around: &[Feature], distance: f32) -> Self {
        Self::new(|color| nearest(color, around) > distance * distance)
    }

    fn new(is_sheet: impl Fn(&Feature) -> bool) -> Self {
        let mut sheet = Box::new([0; 1 << 15]);
        for (index, entry) in sheet.iter_mut().enumerate() {
            let centre = |shift: usize| ((index >> shift & 31) * 8 + 4) as f32;
            *entry = u8::from(is_sheet(&feature([centre(10), centre(5), centre(0)])));
        }
        Self { sheet }
    }

    /// Whether a colour is the sheet's.
    pub fn is_sheet(&self, rgb: [u8; 3]) -> bool {
        self.sheet[index(rgb)] == 1
    }

    /// Marks the sheet-coloured pixels of a row-major `r, g, b` image.
    pub fn classify(&self, color_rgb: &[u8], out: &mut BitImage) {
        let width = out.width;
        for (y, row) in color_rgb.chunks_exact(3 * width).enumerate() {
            for (word, pixels) in out.row_mut(y).iter_mut().zip(row.chunks(3 * 64)) {
                let mut bytes = [0; 64];
                for (byte, rgb) in bytes.iter_mut().zip(pixels.chunks_exact(3)) {
                    *byte = self.sheet[index([rgb[0], rgb[1], rgb[2]])];
                }
                *word = pack(&bytes);
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

/// Centres of at most `k` clusters of `samples`: k-means++ from a seeded start, 20 rounds.
///
/// Source: Arthur & Vassilvitskii, SODA 2007. Equal samples and seed give equal centres.
pub(crate) fn k_means(samples: &[Feature], k: usize, seed: u64) -> Vec<Feature> {
    let mut centres = Vec::with_capacity(k);
    let mut gaps = vec![f32::INFINITY; samples.len()];
    for round in 0..k {
        let total: f64 = gaps.iter().map(|g| f64::from(*g)).sum();
        let pick = if round == 0 {
            samples.len() / 2
        } else {
            let target = uniform(seed, round as u64) * total;
            let mut sum = 0.0;
            gaps.iter()
                .take_while(|g| {
                    sum += f64::from(**g);
                    sum < target
                })
                .count()
        };
        // Fewer distinct samples than centres, or none at all.
        if round > 0 && total <= 1e-6 {
            break;
        }
        let Some(centre) = samples.get(pick) else { break };
        centres.push(*centre);
        for (gap, sample) in gaps.iter_mut().zip(samples) {
            *gap = gap.min(distance_squared(sample, centre));
        }
    }
    for _ in 0..20 {
        refine(&mut centres, samples);
    }
    centres
}

/// One round of Lloyd's iteration.
fn refine(centres: &mut [Feature], samples: &[Feature]) {
    let mut sums = vec![([0.0; 3], 0.0); centres.len()];
    for sample in samples {
        let of = |c: &Feature| distance_squared(sample, c);
        let owner = (0..centres.len()).min_by(|a, b| of(&centres[*a]).total_cmp(&of(&centres[*b])));
        if let Some((sum, count)) = owner.map(|k| &mut sums[k]) {
            (0..3).for_each(|axis| sum[axis] += f64::from(sample[axis]));
            *count += 1.0;
        }
    }
    for (centre, (sum, count)) in centres.iter_mut().zip(sums) {
        if count > 0.0 {
            *centre = sum.map(|s| (s / count) as f32);
        }
    }
}

/// A number in [0, 1) from a seed and a counter (SplitMix64).
fn uniform(seed: u64, counter: u64) -> f64 {
    let mut x = seed.wrapping_add(counter.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ x >> 31) >> 11) as f64 / (1u64 << 53) as f64
}
