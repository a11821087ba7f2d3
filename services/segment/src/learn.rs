//! Learning the sheet's colours from a picture, without a click.
//!
//! The sheet is taken for the largest × brightest region without texture that does not touch
//! the image's border; its surroundings are the clusters of the border's colours. Where the
//! border is one plain colour and nothing without texture fits (printed cloth before a blank
//! background), everything unlike the border is tried.

use crate::bits::BitImage;
use crate::cluster::k_means;
use crate::color_model::{ColorTable, Feature, distance_squared, feature};
use crate::components::Components;

/// Largest standard deviation of brightness over 9 × 9 pixels without texture, of 255.
const FLAT_DEVIATION_MAX: f32 = 6.0;

/// Radius of that window, pixels.
const WINDOW_PX: usize = 4;

/// Smallest region without texture, as a share of the image.
const REGION_SHARE_MIN: f32 = 0.003;

/// Most regions that are tried in one frame.
const REGIONS_MAX: usize = 6;

/// Clusters of the border's colours.
const BORDER_CLUSTERS: usize = 5;

/// Border colours this near to the sheet's are the sheet's.
const SAME_COLOR: f32 = 0.12;

/// A border nine tenths of which are this near to one colour is plain, and what is farther from
/// that colour is something else.
const PLAIN: f32 = 0.3;

/// Hands: chroma of skin of any tone, in light and in shade.
const SKIN: [Feature; 3] = [[0.5, -0.2, 1.93], [0.5, -0.22, 1.82], [0.55, -0.25, 1.7]];

/// A sheet this near to skin is not told from hands by colour.
const SKIN_LIKE: f32 = 0.3;

/// The colours next to the sheet are taken between these distances from its mask, pixels.
const RING_PX: [usize; 2] = [3, 16];

/// Clusters of the colours next to the sheet.
const RING_CLUSTERS: usize = 6;

/// Colours that may be the sheet's.
#[derive(Debug)]
pub(crate) struct Proposal {
    pub table: ColorTable,
    /// The sheet's own colours; none where it is only known what is not the sheet.
    pub seeds: Vec<Feature>,
}

/// How far from its hint a sheet's colour may look.
const HINT_REACH: f32 = 0.25;

/// Finds colours that may be the sheet's; keeps its memory.
#[derive(Debug)]
pub(crate) struct Learner {
    seed: u64,
    gray: Vec<u8>,
    /// Sums of brightness and of its square down each column of the window.
    columns: Vec<[u32; 2]>,
    flat: BitImage,
    inner: BitImage,
    scratch: BitImage,
    components: Components,
    samples: Vec<Feature>,
    /// Colours of the border, and their clusters.
    border: Vec<Feature>,
    around: Vec<Feature>,
}

impl Learner {
    pub fn new(width: usize, height: usize, seed: u64) -> Self {
        Self {
            seed,
            gray: vec![0; width * height],
            columns: vec![[0; 2]; width],
            flat: BitImage::new(width, height),
            inner: BitImage::new(width, height),
            scratch: BitImage::new(width, height),
            components: Components::new(width, height),
            samples: Vec::with_capacity(width * height),
            border: Vec::new(),
            around: Vec::new(),
        }
    }

    /// Looks at a picture, of which colours are then proposed.
    pub fn look(&mut self, color_rgb: &[u8]) {
        self.find_flat(color_rgb);
        self.components.find(&self.flat, true);
        self.around = self.border_clusters(color_rgb);
    }

    /// Colours near to that of the sheet's front, best first, and its own; with that of its back,
    /// if it is another.
    pub fn near(
        &mut self,
        color_rgb: &[u8],
        front: Feature,
        back: Option<Feature>,
    ) -> Vec<Proposal> {
        // The light decides how the known colour looks: what is flat and near to it is it.
        let gap = |f: &Feature| distance_squared(f, &front);
        let mut fronts = self.flat_colors(color_rgb, false);
        fronts.retain(|f| gap(f) < HINT_REACH * HINT_REACH);
        fronts.sort_by(|a, b| gap(a).total_cmp(&gap(b)));
        fronts.push(front);
        let seeds = fronts.into_iter().map(|front| [front].into_iter().chain(back).collect());
        seeds.map(|seeds| self.proposal(seeds)).collect()
    }

    /// Colours of regions without texture clear of the border, best first.
    pub fn plain(&mut self, color_rgb: &[u8]) -> Vec<Proposal> {
        let fronts = self.flat_colors(color_rgb, true);
        fronts.into_iter().map(|front| self.proposal(vec![front])).collect()
    }

    /// Everything unlike the border, where that is plain.
    pub fn unlike_border(&self) -> Option<Proposal> {
        let like = |a: &&Feature| {
            self.border.iter().filter(|b| distance_squared(a, b) < PLAIN * PLAIN).count()
        };
        let plain = self.around.iter().max_by_key(like)?;
        let is_plain = like(&plain) * 10 > self.border.len() * 9;
        let table = || ColorTable::unlike(&[*plain], PLAIN);
        is_plain.then(|| Proposal { table: table(), seeds: Vec::new() })
    }

    fn proposal(&self, seeds: Vec<Feature>) -> Proposal {
        Proposal { table: two_class(&seeds, &self.around), seeds }
    }

    /// The colour of each region without texture.
    fn flat_colors(&mut self, color_rgb: &[u8], inside_only: bool) -> Vec<Feature> {
        let regions = self.regions(inside_only);
        regions.into_iter().map(|region| self.median_feature(color_rgb, region)).collect()
    }

    /// Whether what was found by `seeds` has such a colour, not one that is merely nearer to them
    /// than to the surroundings'.
    pub fn resembles(&mut self, color_rgb: &[u8], seeds: &[Feature], mask: &BitImage) -> bool {
        sample(color_rgb, mask, &mut self.samples);
        if seeds.is_empty() || self.samples.is_empty() {
            return true;
        }
        let color = self.median();
        seeds.iter().any(|seed| distance_squared(seed, &color) < HINT_REACH * HINT_REACH)
    }

    /// The table of `seeds` against this picture's border and the colours around `mask`.
    pub fn refine(&mut self, color_rgb: &[u8], seeds: &[Feature], mask: &BitImage) -> ColorTable {
        let mut around = self.border_clusters(color_rgb);
        let [near, far] = RING_PX;
        self.flat.copy_from(mask);
        self.flat.dilate(far, &mut self.scratch);
        self.inner.copy_from(mask);
        self.inner.dilate(near, &mut self.scratch);
        self.flat.and_not(&self.inner);
        sample(color_rgb, &self.flat, &mut self.samples);
        around.extend(k_means(&self.samples, RING_CLUSTERS, self.seed));
        two_class(seeds, &around)
    }

    fn find_flat(&mut self, color_rgb: &[u8]) {
        for (gray, rgb) in self.gray.iter_mut().zip(color_rgb.chunks_exact(3)) {
            let sum = u16::from(rgb[0]) + 2 * u16::from(rgb[1]) + u16::from(rgb[2]);
            *gray = (sum / 4) as u8;
        }
        self.flat.clear();
        let (width, height) = (self.flat.width, self.flat.height);
        let side = 2 * WINDOW_PX + 1;
        if width < side || height < side {
            return;
        }
        let count = (side * side) as f32;
        for y in WINDOW_PX..height - WINDOW_PX {
            for (x, column) in self.columns.iter_mut().enumerate() {
                let rows = (y - WINDOW_PX)..=(y + WINDOW_PX);
                let values = rows.map(|row| u32::from(self.gray[row * width + x]));
                *column = values.fold([0, 0], |[s, q], v| [s + v, q + v * v]);
            }
            let mut sum = [0, 0];
            for x in 0..width {
                (0..2).for_each(|k| sum[k] += self.columns[x][k]);
                if x + 1 >= side {
                    let mean = sum[0] as f32 / count;
                    let variance = sum[1] as f32 / count - mean * mean;
                    if variance < FLAT_DEVIATION_MAX * FLAT_DEVIATION_MAX {
                        self.flat.set(x - WINDOW_PX, y);
                    }
                    (0..2).for_each(|k| sum[k] -= self.columns[x + 1 - side][k]);
                }
            }
        }
    }

    /// Regions without texture, best first; `inside_only` leaves out those that reach the border.
    fn regions(&self, inside_only: bool) -> Vec<usize> {
        let (width, height) = (self.flat.width, self.flat.height);
        let list = &self.components.list;
        let least = REGION_SHARE_MIN * (width * height) as f32;
        let mut brightness = vec![0.0; list.len()];
        let mut inside = vec![true; list.len()];
        for run in &self.components.runs {
            let (y, start, end) = (run.y as usize, run.start as usize, run.end as usize);
            let row = &self.gray[y * width + start..y * width + end];
            let sum: u32 = row.iter().map(|g| u32::from(*g)).sum();
            brightness[run.component as usize] += f64::from(sum);
            // The window itself keeps off the border by its radius.
            inside[run.component as usize] &= y > WINDOW_PX
                && y + WINDOW_PX + 1 < height
                && start > WINDOW_PX
                && end + WINDOW_PX < width;
        }
        let mut regions: Vec<usize> = (0..list.len())
            .filter(|k| (inside[*k] || !inside_only) && list[*k].pixels as f32 >= least)
            .collect();
        // The sum of brightness is the area times the mean brightness.
        regions.sort_by(|a, b| brightness[*b].total_cmp(&brightness[*a]).then(a.cmp(b)));
        regions.truncate(REGIONS_MAX);
        regions
    }

    fn median_feature(&mut self, color_rgb: &[u8], region: usize) -> Feature {
        let width = self.flat.width;
        self.samples.clear();
        for run in self.components.runs.iter().filter(|run| run.component as usize == region) {
            let pixels = (run.start..run.end).map(|x| run.y as usize * width + x as usize);
            self.samples.extend(pixels.map(|at| feature_at(color_rgb, at)));
        }
        self.median()
    }

    /// Of the samples, of which there is one at least, by coordinate.
    fn median(&mut self) -> Feature {
        let middle = self.samples.len() / 2;
        [0, 1, 2].map(|axis| {
            let by_axis = |a: &Feature, b: &Feature| a[axis].total_cmp(&b[axis]);
            self.samples.select_nth_unstable_by(middle, by_axis).1[axis]
        })
    }

    /// Clusters of the colours of a strip along the border, a fiftieth of the image wide.
    fn border_clusters(&mut self, color_rgb: &[u8]) -> Vec<Feature> {
        let (width, height) = (self.flat.width, self.flat.height);
        let strip = (width / 50).max(1);
        self.border.clear();
        for y in 0..height {
            let whole = y < strip || y + strip >= height;
            for x in 0..width {
                if (whole || x < strip || x + strip >= width) && (x + y) % 5 == 0 {
                    self.border.push(feature_at(color_rgb, y * width + x));
                }
            }
        }
        k_means(&self.border, BORDER_CLUSTERS, self.seed)
    }
}

fn two_class(seeds: &[Feature], around: &[Feature]) -> ColorTable {
    let other =
        |c: &&Feature| seeds.iter().all(|seed| distance_squared(seed, c) > SAME_COLOR * SAME_COLOR);
    let unlike_skin = |skin: &Feature| {
        seeds.iter().all(|seed| distance_squared(seed, skin) > SKIN_LIKE * SKIN_LIKE)
    };
    let mut around: Vec<Feature> = around.iter().filter(other).copied().collect();
    if SKIN.iter().all(unlike_skin) {
        around.extend(SKIN);
    }
    ColorTable::two_class(seeds, &around)
}

/// Takes every third pixel of a mask.
fn sample(color_rgb: &[u8], mask: &BitImage, out: &mut Vec<Feature>) {
    out.clear();
    for y in 0..mask.height {
        let pixels = (0..mask.width).filter(|x| (x + y) % 3 == 0 && mask.get(*x, y));
        out.extend(pixels.map(|x| feature_at(color_rgb, y * mask.width + x)));
    }
}

fn feature_at(color_rgb: &[u8], pixel: usize) -> Feature {
    let rgb = &color_rgb[3 * pixel..3 * pixel + 3];
    feature([rgb[0], rgb[1], rgb[2]].map(f32::from))
}
