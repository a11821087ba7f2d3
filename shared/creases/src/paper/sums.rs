//! Sums over a cluster's points, and the distance that follows from them.

use super::eigen::eigen;

/// (x, y, z, u, v), metres.
pub(super) type Point = [f64; 5];

/// Σw, Σwp and the lower half of Σwppᵀ.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sums {
    pub weight: f64,
    first: Point,
    second: [Point; 5],
}

impl Sums {
    pub const NONE: Self = Self { weight: 0.0, first: [0.0; 5], second: [[0.0; 5]; 5] };

    pub fn add(&mut self, p: &Point, weight: f64) {
        self.weight += weight;
        for i in 0..5 {
            self.first[i] += weight * p[i];
            for j in 0..=i {
                self.second[i][j] += weight * p[i] * p[j];
            }
        }
    }

    pub fn plus(&self, other: &Self) -> Self {
        let mut sum = *self;
        sum.weight += other.weight;
        for i in 0..5 {
            sum.first[i] += other.first[i];
            for j in 0..=i {
                sum.second[i][j] += other.second[i][j];
            }
        }
        sum
    }

    pub fn mean(&self) -> Point {
        self.first.map(|f| f / self.weight.max(1e-12))
    }

    pub fn covariance<const N: usize>(&self) -> [[f64; N]; N] {
        let (mean, weight) = (self.mean(), self.weight.max(1e-12));
        let at = |i: usize, j: usize| self.second[i.max(j)][i.min(j)] / weight - mean[i] * mean[j];
        std::array::from_fn(|i| std::array::from_fn(|j| at(i, j)))
    }

    pub fn flatness(&self) -> f64 {
        let (l, _) = eigen(self.covariance::<5>());
        ((l[2] + l[3] + l[4]).max(0.0) / (l[0] + l[1]).max(1e-12)).sqrt()
    }

    pub fn thickness_m2(&self) -> f64 {
        eigen(self.covariance::<3>()).0[2].max(0.0)
    }
}

/// A cluster's distance: mean and Σ⁻¹ with the small variances replaced by S.
#[derive(Debug, Clone, Copy)]
pub(super) struct Metric {
    mean: Point,
    inverse: [Point; 5],
}

impl Metric {
    pub const NONE: Self = Self { mean: [0.0; 5], inverse: [[0.0; 5]; 5] };

    pub fn new(sums: &Sums, s_m2: f64) -> Self {
        let (values, axes) = eigen(sums.covariance::<5>());
        let mut inverse = [[0.0; 5]; 5];
        for (k, axis) in axes.iter().enumerate() {
            let variance = if k < 2 { values[k].max(1e-12) } else { s_m2 };
            for i in 0..5 {
                for j in 0..5 {
                    inverse[i][j] += axis[i] * axis[j] / variance;
                }
            }
        }
        Self { mean: sums.mean(), inverse }
    }

    pub fn squared(&self, p: &Point) -> f64 {
        let d: Point = std::array::from_fn(|k| p[k] - self.mean[k]);
        (0..5).map(|i| d[i] * (0..5).map(|j| self.inverse[i][j] * d[j]).sum::<f64>()).sum()
    }
}
