//! Seeded, counter-based randomness: the same for any order of reading and any thread count.

/// A well-mixed number for each pair of `seed` and `counter` (SplitMix64's finaliser, twice).
pub(super) fn hash(seed: u64, counter: u64) -> u64 {
    mix(mix(seed ^ 0x9e37_79b9_7f4a_7c15).wrapping_add(counter.wrapping_mul(0x2545_f491_4f6c_dd1d)))
}

fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Uniform in (0, 1).
pub(super) fn uniform(seed: u64, counter: u64) -> f64 {
    ((hash(seed, counter) >> 11) as f64 + 0.5) / (1u64 << 53) as f64
}

/// Normally distributed with zero mean and unit variance.
pub(super) fn normal(seed: u64, counter: u64) -> f64 {
    let (a, b) = (uniform(seed, 2 * counter), uniform(seed, 2 * counter + 1));
    (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

/// A periodic field of unit normal noise with Gaussian correlation, larger than any image.
///
/// A frame takes the tile at an offset and with a sign that its own number picks, so one pixel
/// sees independent values over time, at the price of one addition.
#[derive(Debug)]
pub(super) struct NoiseTile {
    width: usize,
    height: usize,
    values: Vec<f32>,
    /// The values in ascending order, for the thresholds of holes.
    sorted: Vec<f32>,
}

/// The tile as one frame sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grain<'a> {
    tile: &'a NoiseTile,
    offset: [usize; 2],
    /// 1 or -1.
    pub sign: f32,
}

impl NoiseTile {
    /// A tile for images of up to `size_px`; `correlation_px` is where correlation is 1/e.
    pub fn new(seed: u64, size_px: [u32; 2], correlation_px: f64) -> Self {
        let [width, height] = size_px.map(|n| n as usize + 61);
        let white: Vec<f32> = (0..width * height).map(|k| normal(seed, k as u64) as f32).collect();
        // Blurring with a Gaussian of σ correlates by exp(-d²/4σ²): 1/e at d = 2σ.
        let kernel = gaussian(correlation_px / 2.0);
        let rows = blur(&white, width, 1, width, height, &kernel);
        let mut values = blur(&rows, height, width, 1, width, &kernel);
        // Exactly zero mean and unit variance over the tile.
        let n = values.len() as f64;
        let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
        let variance = values.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / n;
        for v in &mut values {
            *v = ((f64::from(*v) - mean) / variance.sqrt()) as f32;
        }
        let mut sorted = values.clone();
        sorted.sort_by(f32::total_cmp);
        Self { width, height, values, sorted }
    }

    /// The tile as the frame with this random number sees it.
    pub fn at(&self, random: u64) -> Grain<'_> {
        let offset =
            [random as u32 as usize % self.width, (random >> 32) as u32 as usize % self.height];
        let sign = if random.count_ones().is_multiple_of(2) { 1.0 } else { -1.0 };
        Grain { tile: self, offset, sign }
    }

    /// The value that a share `rate` of the tile lies under.
    pub fn quantile(&self, rate: f64) -> f32 {
        self.sorted[((rate * self.sorted.len() as f64) as usize).min(self.sorted.len() - 1)]
    }
}

impl<'a> Grain<'a> {
    /// Values of image row `y` for columns `0..width`, in two pieces where the tile wraps round.
    pub fn row(&self, y: usize, width: usize) -> [&'a [f32]; 2] {
        let tile = self.tile;
        let start = (y + self.offset[1]) % tile.height * tile.width;
        let row = &tile.values[start..start + tile.width];
        let first = &row[self.offset[0]..tile.width.min(self.offset[0] + width)];
        [first, &row[..width - first.len()]]
    }

    /// An unrelated look at the same tile.
    pub fn other(&self) -> Grain<'a> {
        let [x, y] = self.offset;
        self.tile.at(hash(0x601e, (x as u64) << 32 | y as u64))
    }

    /// See [`NoiseTile::quantile`].
    pub fn quantile(&self, rate: f64) -> f32 {
        self.tile.quantile(rate)
    }
}

/// Half a Gaussian kernel from its middle outwards; a single 1 for σ = 0.
fn gaussian(sigma_px: f64) -> Vec<f32> {
    let reach = (3.0 * sigma_px).ceil() as usize;
    (0..=reach)
        .map(|d| (-(d as f64).powi(2) / (2.0 * sigma_px.powi(2).max(1e-9))).exp() as f32)
        .collect()
}

/// Blurs `lines` periodic lines of `length` values each: value `i` of line `j` stands at
/// `i * step + j * line_step`.
fn blur(
    values: &[f32],
    length: usize,
    step: usize,
    line_step: usize,
    lines: usize,
    half_kernel: &[f32],
) -> Vec<f32> {
    let mut blurred = vec![0.0; values.len()];
    for line in 0..lines {
        let at = |i: usize| line * line_step + (i % length) * step;
        for i in 0..length {
            let mut sum = half_kernel[0] * values[at(i)];
            for (d, weight) in half_kernel.iter().enumerate().skip(1) {
                sum += weight * (values[at(i + d)] + values[at(i + length - d)]);
            }
            blurred[at(i)] = sum;
        }
    }
    blurred
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean product of values `d` columns apart.
    fn correlation(tile: &NoiseTile, d: usize) -> f64 {
        let mut sum = 0.0;
        for row in tile.values.chunks_exact(tile.width) {
            for x in 0..tile.width {
                sum += f64::from(row[x]) * f64::from(row[(x + d) % tile.width]);
            }
        }
        sum / tile.values.len() as f64
    }

    #[test]
    fn correlation_is_one_over_e_where_it_was_asked_for() {
        let tile = NoiseTile::new(7, [640, 480], 4.0);
        assert!((correlation(&tile, 0) - 1.0).abs() < 1e-3);
        // The blurred field has some 12 000 independent patches: ±0.01 is one standard error.
        assert!((correlation(&tile, 4) - (-1.0f64).exp()).abs() < 0.04);
        let white = NoiseTile::new(7, [640, 480], 0.0);
        assert!(correlation(&white, 1).abs() < 0.01);
    }

    #[test]
    fn rows_are_whole_at_every_offset_and_frames_differ() {
        let tile = NoiseTile::new(7, [64, 48], 0.0);
        for frame in 0..200 {
            let grain = tile.at(hash(7, frame));
            for y in [0, 47] {
                assert_eq!(grain.row(y, 64).iter().map(|piece| piece.len()).sum::<usize>(), 64);
            }
        }
        let offsets: std::collections::BTreeSet<_> =
            (0..200).map(|frame| tile.at(hash(7, frame)).offset).collect();
        assert!(offsets.len() > 190);
    }

    #[test]
    fn quantiles_hold_their_share() {
        let tile = NoiseTile::new(7, [64, 48], 2.0);
        let under = tile.values.iter().filter(|v| **v < tile.quantile(0.1)).count();
        assert!((under as f64 / tile.values.len() as f64 - 0.1).abs() < 0.002);
    }
}
