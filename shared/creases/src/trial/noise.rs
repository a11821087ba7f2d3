//! Noise of nodes: half of its variance white, half smooth in space and time.

use orime_geometry::SheetGrid;

/// Width of the smooth part's Gaussian kernel, as a share of the sheet's nodes, over √2 so that
/// its correlation reaches over 0.2 of the sheet.
const SMOOTH_SHARE: f64 = 0.2 / std::f64::consts::SQRT_2;
/// Steps over which the smooth part forgets itself.
const SMOOTH_STEPS: f64 = 10.0;

/// Counter-based random numbers (splitmix64): equal seeds give equal numbers everywhere.
#[derive(Debug, Clone)]
pub struct Random {
    state: u64,
}

impl Random {
    /// Starts at a seed.
    pub fn new(seed: u64) -> Self {
        Self { state: seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03 }
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.state ^ (self.state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// Noise of a sheet's nodes, step by step.
#[derive(Debug, Clone)]
pub struct Noise {
    random: Random,
    nodes: [usize; 2],
    sigma_m: f64,
    white_share: f64,
    kernels: [Vec<f64>; 2],
    smooth: [Vec<f64>; 3],
}

impl Noise {
    /// `sigma_m`: root mean square per coordinate, metres; `white_share`: of the variance.
    pub fn new(sheet: &SheetGrid, sigma_m: f64, white_share: f64, seed: u64) -> Self {
        let kernels = sheet.nodes.map(|n| kernel(SMOOTH_SHARE * (n - 1) as f64));
        let smooth = [(); 3].map(|()| vec![0.0; sheet.len()]);
        let random = Random::new(seed);
        let mut noise = Self { random, nodes: sheet.nodes, sigma_m, white_share, kernels, smooth };
        for k in 0..3 {
            noise.smooth[k] = noise.field();
        }
        noise
    }

    /// The positions with the next step's noise.
    pub fn add(&mut self, exact_m: &[[f64; 3]]) -> Vec<[f32; 3]> {
        let keep = (-1.0 / SMOOTH_STEPS).exp();
        let fresh = (1.0 - keep * keep).sqrt();
        for k in 0..3 {
            let field = self.field();
            for (old, new) in self.smooth[k].iter_mut().zip(field) {
                *old = keep * *old + fresh * new;
            }
        }
        let white = self.sigma_m * self.white_share.sqrt();
        let smooth = self.sigma_m * (1.0 - self.white_share).sqrt();
        let mut noisy = Vec::with_capacity(exact_m.len());
        for (n, x) in exact_m.iter().enumerate() {
            let mut add = |k: usize| {
                (x[k] + white * self.random.normal() + smooth * self.smooth[k][n]) as f32
            };
            noisy.push([add(0), add(1), add(2)]);
        }
        noisy
    }

    /// A smooth field of unit variance: white noise under a separable Gaussian.
    fn field(&mut self) -> Vec<f64> {
        let [rows, columns] = self.nodes;
        let [long_u, long_v] = [0, 1].map(|axis| self.nodes[axis] + self.kernels[axis].len() - 1);
        let mut across = vec![0.0; long_u * columns];
        for i in 0..long_u {
            let white: Vec<f64> = (0..long_v).map(|_| self.random.normal()).collect();
            for j in 0..columns {
                let window = white[j..].iter().zip(&self.kernels[1]);
                across[i * columns + j] = window.map(|(w, k)| w * k).sum();
            }
        }
        let at = |i: usize, j: usize| -> f64 {
            let kernel = self.kernels[0].iter().enumerate();
            kernel.map(|(k, weight)| weight * across[(i + k) * columns + j]).sum()
        };
        (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))).map(|(i, j)| at(i, j)).collect()
    }
}

/// Gaussian weights whose squares add up to 1, so that white noise keeps its variance.
fn kernel(sigma: f64) -> Vec<f64> {
    let reach = (4.0 * sigma).ceil() as i64;
    let weights: Vec<f64> =
        (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let norm = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
    weights.into_iter().map(|w| w / norm).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_halves_have_their_variance() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        for white_share in [0.0, 0.5, 1.0] {
            let mut noise = Noise::new(&sheet, 2e-3, white_share, 7);
            let (mut squares, mut count) = (0.0, 0.0);
            for _ in 0..200 {
                for x in noise.add(&vec![[0.0; 3]; sheet.len()]) {
                    squares += x.iter().map(|c| f64::from(c * c)).sum::<f64>();
                    count += 3.0;
                }
            }
            let rms_m = (squares / count).sqrt();
            assert!((rms_m / 2e-3 - 1.0).abs() < 0.15, "{rms_m} at white share {white_share}");
        }
    }
}
