//! The E-step's inner kernel: one cell of observed points against its candidate components.
//!
//! Inlined into passes for AVX-512, AVX2 and the baseline. Products and sums are never fused, and
//! every sum runs in [`LANES`] fixed lanes, so all three give the same bits.

use orime_lanes::LANES;

/// Candidate components of a cell and what the cell gives them, as arrays of which the first are
/// in use; padding to a multiple of [`LANES`] stands so far off that its weight is zero.
#[derive(Debug, Clone, Default)]
pub(crate) struct Candidates {
    /// Positions relative to the cell's origin, metres.
    pub x: Vec<f32>,
    /// See `x`.
    pub y: Vec<f32>,
    /// See `x`.
    pub z: Vec<f32>,
    /// Prior weight of each component.
    pub prior: Vec<f32>,
    /// Σ p over the cell's points.
    pub mass: Vec<f32>,
    /// Σ p·(point − component), metres.
    pub pull_x: Vec<f32>,
    /// See `pull_x`.
    pub pull_y: Vec<f32>,
    /// See `pull_x`.
    pub pull_z: Vec<f32>,
    weight: Vec<f32>,
    squared: Vec<f32>,
    /// Components that are there, then with their padding.
    len: usize,
}

/// Sums of one cell over its points.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct CellSums {
    /// Σ p over points and components.
    pub mass: f64,
    /// Σ p·|point − component|², m².
    pub squared_m2: f64,
}

impl Candidates {
    /// Makes room for so many components.
    pub fn reserve(&mut self, count: usize) {
        let len = count.next_multiple_of(LANES);
        for column in self.columns() {
            column.resize(len.max(column.len()), 0.0);
        }
    }

    /// Forgets the last cell.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds a component; there must be room for it.
    #[inline(always)]
    pub fn push(&mut self, position: [f32; 3]) {
        self.x[self.len] = position[0];
        self.y[self.len] = position[1];
        self.z[self.len] = position[2];
        self.len += 1;
    }

    /// Sets the prior weights of the components, in the order in which they were added.
    #[inline(always)]
    pub fn set_priors(&mut self, priors: impl Iterator<Item = f32>) {
        for (own, prior) in self.prior.iter_mut().zip(priors) {
            *own = prior;
        }
    }

    /// Pads to a multiple of [`LANES`] and zeroes the sums; all priors are 1.
    #[inline(always)]
    pub fn seal(&mut self) {
        self.prior[..self.len].fill(1.0);
        while !self.len.is_multiple_of(LANES) {
            self.prior[self.len] = 0.0;
            self.push([1e3; 3]);
        }
        for sums in [&mut self.mass, &mut self.pull_x, &mut self.pull_y, &mut self.pull_z] {
            sums[..self.len].fill(0.0);
        }
    }

    /// Σ of the pulls over all components, metres.
    pub fn pull_sum(&self) -> [f32; 3] {
        [&self.pull_x, &self.pull_y, &self.pull_z].map(|pull| pull[..self.len].iter().sum())
    }

    fn columns(&mut self) -> [&mut Vec<f32>; 10] {
        [
            &mut self.x,
            &mut self.y,
            &mut self.z,
            &mut self.prior,
            &mut self.mass,
            &mut self.pull_x,
            &mut self.pull_y,
            &mut self.pull_z,
            &mut self.weight,
            &mut self.squared,
        ]
    }
}

/// Soft correspondences between the points of one cell and its candidates.
///
/// p[m,n] = α[m] exp(−|x[n]−y[m]|²/2σ²) / (Σ_k α[k] exp(−|x[n]−y[k]|²/2σ²) + c)
///
/// `points` are relative to the cell's origin, metres.
#[inline(always)]
pub(crate) fn expect_cell(
    points: &[[f32; 3]],
    candidates: &mut Candidates,
    variance_m2: f32,
    uniform: f32,
) -> CellSums {
    let n = candidates.len;
    let Candidates { x, y, z, prior, mass, pull_x, pull_y, pull_z, weight, squared, .. } =
        candidates;
    // One length for all, so that no bound is checked inside the loops.
    let (x, y, z, prior) = (&x[..n], &y[..n], &z[..n], &prior[..n]);
    let (mass, weight, squared) = (&mut mass[..n], &mut weight[..n], &mut squared[..n]);
    let (pull_x, pull_y, pull_z) = (&mut pull_x[..n], &mut pull_y[..n], &mut pull_z[..n]);
    let exponent = -std::f32::consts::LOG2_E / (2.0 * variance_m2);
    let mut sums = CellSums::default();
    for point in points {
        let mut total = [0f32; LANES];
        for first in (0..n).step_by(LANES) {
            for (lane, total) in total.iter_mut().enumerate() {
                let k = first + lane;
                let (dx, dy, dz) = (point[0] - x[k], point[1] - y[k], point[2] - z[k]);
                squared[k] = dx * dx + dy * dy + dz * dz;
                weight[k] = prior[k] * exp2(exponent * squared[k]);
                *total += weight[k];
            }
        }
        let total: f32 = fold(total);
        let inverse = if total > 0.0 { 1.0 / (total + uniform) } else { 0.0 };
        let mut squared_sum = [0f32; LANES];
        for first in (0..n).step_by(LANES) {
            for (lane, sum) in squared_sum.iter_mut().enumerate() {
                let k = first + lane;
                let p = weight[k] * inverse;
                mass[k] += p;
                pull_x[k] += p * (point[0] - x[k]);
                pull_y[k] += p * (point[1] - y[k]);
                pull_z[k] += p * (point[2] - z[k]);
                *sum += p * squared[k];
            }
        }
        sums.mass += f64::from(total * inverse);
        sums.squared_m2 += f64::from(fold(squared_sum));
    }
    sums
}

/// Sum of the lanes, pairwise.
#[inline(always)]
fn fold(mut lanes: [f32; LANES]) -> f32 {
    let mut width = LANES / 2;
    while width > 0 {
        for lane in 0..width {
            lanes[lane] += lanes[lane + width];
        }
        width /= 2;
    }
    lanes[0]
}

/// 2^t for t ≤ 0, relative error below 1e-6; 0 below 2^-125.
#[inline(always)]
fn exp2(t: f32) -> f32 {
    // Adding 1.5·2²³ rounds to an integer, which then stands in the lowest mantissa bits.
    const ROUND: f32 = 12_582_912.0;
    let clamped = if t > -125.0 { t } else { -125.0 };
    let shifted = clamped + ROUND;
    let f = clamped - (shifted - ROUND);
    let scale =
        f32::from_bits((shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127)) << 23);
    let series = 1.0
        + f * (std::f32::consts::LN_2
            + f * (0.240_226_5
                + f * (0.055_504_11
                    + f * (0.009_618_129 + f * (0.001_333_355_8 + f * 0.000_154_035_3)))));
    let value = scale * series;
    if t > -125.0 { value } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_lanes::{Lanes, Pass, Width};

    #[test]
    fn exp2_is_close_everywhere() {
        for k in 0..=130_000 {
            let t = -(k as f32) / 1000.0;
            let (found, exact) = (f64::from(exp2(t)), f64::from(t).exp2());
            assert!((found - exact).abs() <= 1e-6 * exact + 1e-37, "2^{t}: {found}");
        }
        assert_eq!(exp2(f32::NEG_INFINITY), 0.0);
    }

    fn candidates() -> Candidates {
        let mut candidates = Candidates::default();
        candidates.reserve(37);
        for k in 0..37 {
            let k = k as f32;
            candidates.push([0.001 * k, 0.002 * (k * 0.7).sin(), 0.001 * (k * 1.3).cos()]);
        }
        candidates.seal();
        candidates
    }

    fn points() -> Vec<[f32; 3]> {
        (0..53).map(|k| k as f32).map(|k| [0.0007 * k, 0.001 * k.sin(), 0.001 * k.cos()]).collect()
    }

    struct Once<'a>(&'a [[f32; 3]], &'a mut Candidates, &'a mut CellSums);

    impl Pass for Once<'_> {
        #[inline(always)]
        fn run<V: Lanes>(self) {
            *self.2 = expect_cell(self.0, self.1, 4e-6, 0.3);
        }
    }

    #[test]
    fn every_path_gives_the_bits_of_the_portable_one() {
        let (points, candidates) = (points(), candidates());
        let at = |width: Width| {
            let (mut candidates, mut sums) = (candidates.clone(), CellSums::default());
            width.run(Once(&points, &mut candidates, &mut sums));
            let Candidates { mass, pull_x, pull_y, pull_z, .. } = candidates;
            (sums.mass, sums.squared_m2, mass, pull_x, pull_y, pull_z)
        };
        let portable = at(Width::Portable);
        assert!(portable.0 > 1.0);
        for width in Width::available() {
            assert_eq!(at(width), portable, "{width:?}");
        }
    }

    #[test]
    fn the_kernel_is_the_formula() {
        let (points, mut found) = (points(), candidates());
        let sums = expect_cell(&points, &mut found, 4e-6, 0.3);
        let at = |k: usize| [found.x[k], found.y[k], found.z[k]].map(f64::from);
        let mut mass = vec![0f64; 37];
        let mut squared_m2 = 0.0;
        for point in &points {
            let squared: Vec<f64> = (0..37)
                .map(|k| (0..3).map(|i| (f64::from(point[i]) - at(k)[i]).powi(2)).sum())
                .collect();
            let weight: Vec<f64> = squared.iter().map(|d| (-d / 8e-6).exp()).collect();
            let total = weight.iter().sum::<f64>() + 0.3;
            for ((mass, weight), squared) in mass.iter_mut().zip(&weight).zip(&squared) {
                *mass += weight / total;
                squared_m2 += weight / total * squared;
            }
        }
        for (found, mass) in found.mass.iter().zip(&mass) {
            assert!((f64::from(*found) - mass).abs() < 1e-4);
        }
        assert!((sums.squared_m2 / squared_m2 - 1.0).abs() < 1e-4);
    }
}
