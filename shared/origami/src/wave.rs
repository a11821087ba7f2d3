//! A wave that runs through a sheet held at both ends; no crease is ever made.
//!
//! Tangent angle ψ(s) = A sin θ, θ = ω s − p, ω = 2π/L, so the curve is ∫(cos ψ, sin ψ) ds. With
//! Bessel functions of A (Jacobi and Anger), in closed form:
//!
//! ∫ cos(A sin θ) ds = J₀ s + (2/ω) Σ J₂ₖ sin(2kθ)/2k
//! ∫ sin(A sin θ) ds = −(2/ω) Σ J₂ₖ₊₁ cos((2k+1)θ)/(2k+1)
//!
//! The second is periodic with zero mean and lowest at θ = 0, so its lowest point can touch the
//! table at all times.

use std::f64::consts::{PI, TAU};

use crate::Timing;
use crate::facet::Sheet;
use crate::strips::Profile;

/// Bessel functions that are kept: J₁₁(A) < 1e-12 for A below 0.9.
pub(crate) const TERMS: usize = 12;

/// Largest slope, radians.
const SLOPE_MAX_RAD: f64 = PI / 4.0;

/// Wave lengths that run through during the sequence.
const RUNS: f64 = 2.0;

/// The motion; rulings along v.
#[derive(Debug, Clone)]
pub(crate) struct Wave {
    length_m: f64,
    rise: Timing,
    fall: Timing,
}

impl Wave {
    pub fn new(sheet: &Sheet) -> Self {
        Self {
            length_m: sheet.size_m[0],
            rise: Timing { rest_before: 0.05, rest_after: 0.65 },
            fall: Timing { rest_before: 0.65, rest_after: 0.05 },
        }
    }

    /// Strip boundaries along u, metres.
    pub fn cuts_m(&self) -> Vec<f64> {
        (0..=60).map(|k| self.length_m * f64::from(k) / 60.0).collect()
    }

    pub fn profile(&self, progress: f64) -> Profile {
        let slope_rad = SLOPE_MAX_RAD * (self.rise.done(progress) - self.fall.done(progress));
        let phase_rad = TAU * RUNS * progress;
        let mut curve = WaveCurve {
            omega_per_m: TAU / self.length_m,
            phase_rad,
            bessel: std::array::from_fn(|n| bessel(n, slope_rad)),
            shift_m: [0.0; 2],
        };
        let ends = [0.0, self.length_m].map(|s| curve.at(s)[0]);
        let lowest = curve.at(phase_rad / curve.omega_per_m)[1];
        curve.shift_m = [self.length_m / 2.0 - (ends[0] + ends[1]) / 2.0, -lowest];
        Profile::Wave(curve)
    }
}

/// The wave at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WaveCurve {
    omega_per_m: f64,
    phase_rad: f64,
    bessel: [f64; TERMS],
    shift_m: [f64; 2],
}

impl WaveCurve {
    /// Place along the table and height of the point at arc length `s`, metres.
    pub fn at(&self, s: f64) -> [f64; 2] {
        let theta = self.omega_per_m * s - self.phase_rad;
        let (mut x, mut z) = (self.bessel[0] * s, 0.0);
        for (n, j) in self.bessel.iter().enumerate().skip(1) {
            let (sin, cos) = (n as f64 * theta).sin_cos();
            let weight = 2.0 * j / (self.omega_per_m * n as f64);
            if n % 2 == 0 {
                x += weight * sin;
            } else {
                z -= weight * cos;
            }
        }
        [x + self.shift_m[0], z + self.shift_m[1]]
    }
}

/// Bessel function of the first kind Jₙ(x) by its power series; exact to rounding for |x| < 2.
fn bessel(n: usize, x: f64) -> f64 {
    let mut term = (1..=n).fold(1.0, |term, k| term * x / 2.0 / k as f64);
    let mut sum = 0.0;
    for m in 1..20 {
        sum += term;
        term *= -(x / 2.0).powi(2) / (m as f64 * (m + n) as f64);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bessel_functions_by_the_tables() {
        // Abramowitz and Stegun, table 9.1.
        for (n, x, expected) in
            [(0, 1.0, 0.765_197_686_557_967), (1, 1.0, 0.440_050_585_744_934), (2, 0.5, 0.030604)]
        {
            let tolerance = if n < 2 { 1e-14 } else { 1e-6 };
            assert!((bessel(n, x) - expected).abs() < tolerance, "J{n}({x})");
        }
    }
}
