//! Sheets that bend about one direction: a curve along u, straight along v.

use nalgebra::Vector3;

use crate::facet::{Facet, FacetPose, Sheet};
use crate::wave::WaveCurve;

/// The curve at one time, by arc length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Profile {
    /// Flat parts on both sides of a cylinder.
    Bend {
        /// Of the cylinder, metres.
        radius_m: f64,
        /// Between the flat parts, radians.
        turn_rad: f64,
        /// Where the cylinder leaves the table, metres along u.
        foot_m: f64,
    },
    /// A running wave.
    Wave(WaveCurve),
}

impl Profile {
    /// Place along the table and height of the point at arc length `s`, metres.
    pub fn at(&self, s: f64) -> [f64; 2] {
        match *self {
            Self::Bend { radius_m, turn_rad, foot_m } => {
                let before = (foot_m - s).max(0.0);
                let bent = before.min(radius_m * turn_rad);
                let (sin, cos) = (bent / radius_m).sin_cos();
                let beyond = before - bent;
                let x = foot_m - radius_m * sin - beyond * cos;
                [if before > 0.0 { x } else { s }, radius_m * (1.0 - cos) + beyond * sin]
            }
            Self::Wave(curve) => curve.at(s),
        }
    }
}

/// The strips between `cuts_m` along u.
pub(crate) fn facets(sheet: &Sheet, cuts_m: &[f64]) -> Vec<Facet> {
    let b = sheet.size_m[1];
    let strip = |cut: &[f64]| Facet {
        corners_uv_m: vec![[cut[0], 0.0], [cut[1], 0.0], [cut[1], b], [cut[0], b]],
    };
    cuts_m.windows(2).map(strip).collect()
}

/// Chords of the curve: flat strips whose edges lie on it.
pub(crate) fn pose(cuts_m: &[f64], profile: &Profile, poses: &mut [FacetPose]) {
    let mut start = profile.at(cuts_m[0]);
    for (pose, cut) in poses.iter_mut().zip(cuts_m.windows(2)) {
        let end = profile.at(cut[1]);
        let width = cut[1] - cut[0];
        let along_u = Vector3::new((end[0] - start[0]) / width, 0.0, (end[1] - start[1]) / width);
        let origin_m = Vector3::new(start[0], 0.0, start[1]) - along_u * cut[0];
        *pose = FacetPose { origin_m, along_u, along_v: Vector3::y() };
        start = end;
    }
}
