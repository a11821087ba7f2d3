//! Where a crease's line is, from all that was seen of it.
//!
//! The line is offset δ and slope γ against the one that it was found at; each fit measures δ at
//! some distance along the line, and γ. Information adds up and old information fades.

use super::hinge::{Hinge, moved};
use crate::line::Line;

/// Share of the old information that a measurement leaves, so that nothing is fixed for ever.
const MEMORY: f64 = 0.995;
/// Share of a fit's information in its offset: what [1, s, t, |s|] leave of sgn s.
const OFFSET_SHARE: f64 = 0.25;
/// Noise below this many spacings does not make a fit better.
const FLOOR: f64 = 0.02;
/// Farthest measurement that is believed, spacings.
const OFFSET_MAX: f64 = 1.5;
/// Steepest, radians.
const SLOPE_MAX: f64 = 0.2;

/// A line and what is known of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Estimate {
    /// The line that others see.
    pub line: Line,
    /// Whether it was put on landmarks.
    pub at_landmarks: bool,
    /// Whether it is known beforehand, so that no fit moves it.
    pub fixed: bool,
    /// What the line was before the last [`Estimate::publish`].
    before: (Line, bool),
    /// The line that offset and slope are against.
    base: Line,
    /// Information on (δ, γ): [[a, b], [b, c]], and the information-weighted sums.
    a: [f64; 3],
    b: [f64; 2],
}

impl Estimate {
    /// Found by a fit.
    pub fn new(hinge: &Hinge, h_m: f64) -> Self {
        let mut estimate = Self {
            line: hinge.line,
            at_landmarks: false,
            fixed: false,
            before: (hinge.line, false),
            base: hinge.line,
            a: [0.0; 3],
            b: [0.0; 2],
        };
        estimate.measure(hinge, h_m);
        estimate
    }

    /// Takes a fit into account; one that is far off is not believed.
    pub fn measure(&mut self, hinge: &Hinge, h_m: f64) -> bool {
        let [at_m, variance_m2] = self.along(hinge);
        let (offset_m, slope) = self.offset_and_slope(&hinge.line, at_m);
        let [now_m, now_slope] = self.now();
        let off_m = offset_m - (now_m + now_slope * at_m);
        if off_m.abs() > OFFSET_MAX * h_m || (slope - now_slope).abs() > SLOPE_MAX {
            return false;
        }
        let noise_m2 = hinge.noise_m2(FLOOR * h_m);
        let sine = (0.5 * hinge.angle_rad).sin();
        let w = OFFSET_SHARE * hinge.weight * sine * sine / noise_m2;
        let seen = [w, w * at_m, w * (at_m * at_m + variance_m2)];
        let sums = [w * offset_m, w * (offset_m * at_m + slope * variance_m2)];
        self.a = [0, 1, 2].map(|k| MEMORY * self.a[k] + seen[k]);
        self.b = [0, 1].map(|k| MEMORY * self.b[k] + sums[k]);
        true
    }

    /// The best line, by all that was seen.
    pub fn best(&self) -> Line {
        let [offset_m, slope] = self.now();
        moved(&self.base, 0.0, offset_m, slope)
    }

    /// Shows a line to others; `at_landmarks` where it is not the best one but near it.
    pub fn publish(&mut self, line: Line, at_landmarks: bool) {
        self.before = (self.line, self.at_landmarks);
        (self.line, self.at_landmarks) = (line, at_landmarks);
    }

    /// Takes [`Estimate::publish`] back.
    pub fn withdraw(&mut self) {
        (self.line, self.at_landmarks) = self.before;
    }

    /// Standard deviation of the line's offset at a material point, metres, as if fits were
    /// independent.
    pub fn deviation_m(&self, uv_m: [f64; 2]) -> f64 {
        let t = self.base.along_m(uv_m);
        let det = self.a[0] * self.a[2] - self.a[1] * self.a[1];
        if det <= 0.0 {
            return f64::INFINITY;
        }
        ((self.a[2] - 2.0 * t * self.a[1] + t * t * self.a[0]) / det).max(0.0).sqrt()
    }

    fn now(&self) -> [f64; 2] {
        let det = self.a[0] * self.a[2] - self.a[1] * self.a[1];
        if det <= 1e-12 * self.a[0] * self.a[2] {
            return [0.0; 2];
        }
        [
            (self.b[0] * self.a[2] - self.b[1] * self.a[1]) / det,
            (self.b[1] * self.a[0] - self.b[0] * self.a[1]) / det,
        ]
    }

    /// Mean and variance of the fit's nodes along the base line.
    fn along(&self, hinge: &Hinge) -> [f64; 2] {
        [self.base.along_m(hinge.middle_m()), hinge.along[1]]
    }

    /// Offset of a line from the base at distance `at_m` along it, and its slope.
    fn offset_and_slope(&self, line: &Line, at_m: f64) -> (f64, f64) {
        let d = self.base.direction;
        let turn = d[0] * line.direction[1] - d[1] * line.direction[0];
        let cos = d[0] * line.direction[0] + d[1] * line.direction[1];
        let slope = if cos.abs() < 1e-6 { f64::INFINITY } else { turn / cos };
        let offset_m = self.base.side_m(line.point_m);
        (offset_m + slope * (at_m - self.base.along_m(line.point_m)), slope)
    }
}
