//! A book fold without a hinge: flat, a cylinder over the middle, flat.
//!
//! The half with large u lies still. First the cylinder of radius R₀ bends from 0 to π, then R
//! shrinks to R₁; s is the distance along u, a = R·θ the bent length, s₀ = L/2 + a/2 its foot:
//!
//! flat:  (s, 0);  bent, φ = (s₀ − s)/R:  (s₀ − R sin φ, R (1 − cos φ));  beyond:  along θ.
//!
//! Exactly isometric: |d(x, z)/ds| = 1 everywhere. Layers end 2 R₁ apart.

use std::f64::consts::PI;

use crate::Timing;
use crate::facet::{Crease, Sheet};
use crate::strips::Profile;

/// Radii before and after shrinking, metres, for sheets of at least 150 mm.
const RADII_M: [f64; 2] = [0.030, 0.0005];

/// The motion; rulings along v.
#[derive(Debug, Clone)]
pub(crate) struct SoftFold {
    length_m: f64,
    radii_m: [f64; 2],
    bend: Timing,
    shrink: Timing,
}

impl SoftFold {
    pub fn new(sheet: &Sheet) -> Self {
        let length_m = sheet.size_m[0];
        let end_m = RADII_M[1].max(2.0 * sheet.thickness_m);
        Self {
            length_m,
            radii_m: [RADII_M[0].min(0.2 * length_m).max(end_m), end_m],
            bend: Timing { rest_before: 0.05, rest_after: 0.50 },
            shrink: Timing { rest_before: 0.50, rest_after: 0.08 },
        }
    }

    /// Strip boundaries along u, metres: finer the nearer to the middle, so that no strip ever
    /// turns by more than 0.17 rad.
    pub fn cuts_m(&self) -> Vec<f64> {
        let half = self.length_m / 2.0;
        let inner = self.radii_m[1] * PI / 2.0;
        let mut offsets: Vec<f64> = (0..10).map(|k| inner * f64::from(k) / 10.0).collect();
        let count = ((half / inner).ln() / 1.1f64.ln()).ceil();
        let ratio = (half / inner).powf(1.0 / count);
        offsets.extend((0..=count as i32).map(|k| inner * ratio.powi(k)));
        let before = offsets.iter().skip(1).rev().map(|d| half - d);
        let mut cuts: Vec<f64> = before.chain(offsets.iter().map(|d| half + d)).collect();
        let last = cuts.len() - 1;
        (cuts[0], cuts[last]) = (0.0, self.length_m);
        cuts
    }

    /// The line that the shrinking cylinder becomes.
    pub fn crease(&self, sheet: &Sheet, strips: usize) -> Crease {
        let middle = self.length_m / 2.0;
        let ends_uv_m = [[middle, 0.0], [middle, sheet.size_m[1]]];
        Crease { ends_uv_m, facets: [strips - 1, 0] }
    }

    pub fn profile(&self, progress: f64) -> Profile {
        let turn_rad = PI * self.bend.done(progress);
        let shrunk = self.shrink.done(progress);
        let radius_m = self.radii_m[0] * (self.radii_m[1] / self.radii_m[0]).powf(shrunk);
        let foot_m = self.length_m / 2.0 + radius_m * turn_rad / 2.0;
        Profile::Bend { radius_m, turn_rad, foot_m }
    }
}
