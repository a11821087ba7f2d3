//! A plane through the depth pixels of one marker, and where a colour pixel's ray meets it.
//!
//! In the depth camera's frame a plane `w·P = 1` is linear in inverse depth: with the ray
//! `r = (X/Z, Y/Z, 1)` of a pixel, `1/z = w·r`. So `w` follows from least squares over pixels, and
//! a colour pixel's ray `o + t·d` (in the depth frame) meets the plane at `t = (1 − w·o)/(w·d)`.

use orime_geometry::nalgebra::{Matrix3, Vector3};

/// A depth pixel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    /// Viewing ray in the depth frame, `z = 1`.
    pub ray: Vector3<f64>,
    /// Depth, metres.
    pub z_m: f64,
}

/// A plane fitted to samples.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DepthPlane {
    /// `w`, 1/m.
    w: Vector3<f64>,
    /// Samples that it was fitted to in the end.
    pub kept: usize,
    /// Root mean square of what it leaves of them, metres of depth.
    pub rms_m: f64,
}

/// Rounds of fitting and leaving out what lies off the plane.
const ROUNDS: usize = 4;

/// Samples within this many deviations (or within [`NEAR_M`]) are kept.
const DEVIATIONS: f64 = 2.5;

/// Samples this near to the plane are always kept, metres.
const NEAR_M: f64 = 0.001;

/// Least share of the samples that must lie on the plane.
const KEPT_SHARE_MIN: f64 = 0.6;

/// Fewest of them.
const KEPT_MIN: usize = 12;

impl DepthPlane {
    /// Fits a plane to the samples of a marker whose diagonal is `diagonal_m`, or `None` where
    /// they are too few or no plane holds most of them. `gaps` is room.
    pub fn fit(samples: &[Sample], diagonal_m: f64, gaps: &mut Vec<f64>) -> Option<Self> {
        if samples.len() < KEPT_MIN {
            return None;
        }
        let middle = samples.len() / 2;
        gaps.clear();
        gaps.extend(samples.iter().map(|sample| sample.z_m));
        let z_m = *gaps.select_nth_unstable_by(middle, f64::total_cmp).1;
        // All of the marker lies this near to its middle; table and fingers beside it do not.
        let mut plane = Self { w: Vector3::new(0.0, 0.0, 1.0 / z_m), kept: 0, rms_m: 0.0 };
        let mut reach_m = 0.6 * diagonal_m;
        for _ in 0..ROUNDS {
            plane = plane.refined(samples, reach_m)?;
            gaps.clear();
            gaps.extend(samples.iter().map(|sample| plane.gap_m(sample).abs()));
            let median_m = *gaps.select_nth_unstable_by(middle, f64::total_cmp).1;
            reach_m = (DEVIATIONS * 1.4826 * median_m).max(NEAR_M);
        }
        let enough =
            plane.kept >= KEPT_MIN && plane.kept as f64 >= KEPT_SHARE_MIN * samples.len() as f64;
        enough.then_some(plane)
    }

    /// Where the ray `origin_m + t·direction`, `t > 0`, meets the plane, metres, depth frame.
    pub fn meet(&self, origin_m: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Vector3<f64>> {
        let t = (1.0 - self.w.dot(origin_m)) / self.w.dot(direction);
        (t.is_finite() && t > 0.0).then(|| origin_m + direction * t)
    }

    /// Cosine between the plane's normal and a ray.
    pub fn cosine(&self, ray: &Vector3<f64>) -> f64 {
        (self.w.dot(ray) / (self.w.norm() * ray.norm())).abs()
    }

    /// How far a sample lies behind the plane, metres along the optical axis.
    fn gap_m(&self, sample: &Sample) -> f64 {
        sample.z_m - 1.0 / self.w.dot(&sample.ray)
    }

    /// The plane through the samples within `reach_m` of this one.
    fn refined(&self, samples: &[Sample], reach_m: f64) -> Option<Self> {
        let near = || samples.iter().filter(|sample| self.gap_m(sample).abs() <= reach_m);
        let (mut normal, mut right, mut kept) = (Matrix3::zeros(), Vector3::zeros(), 0);
        for sample in near() {
            // Depth errs by z² times what inverse depth errs by.
            let weight = sample.z_m.powi(4);
            normal += sample.ray * sample.ray.transpose() * weight;
            right += sample.ray * (weight / sample.z_m);
            kept += 1;
        }
        let w = normal.cholesky()?.solve(&right);
        let fitted = Self { w, kept, rms_m: 0.0 };
        let squares: f64 = near().map(|sample| fitted.gap_m(sample).powi(2)).sum();
        (kept > 0).then(|| Self { rms_m: (squares / kept as f64).sqrt(), ..fitted })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels of the plane `z = 0.5 + 0.4 x`, with a third of them on a table behind.
    fn samples(others: usize) -> Vec<Sample> {
        (0..144)
            .map(|k| {
                let [x, y] = [k % 12, k / 12].map(|c| f64::from(c) / 600.0);
                let z_m = if (k as usize) < others { 0.7 } else { 0.5 / (1.0 - 0.4 * x) };
                Sample { ray: Vector3::new(x, y, 1.0), z_m }
            })
            .collect()
    }

    #[test]
    fn a_slanted_plane_is_met_where_it_is_in_spite_of_a_table_behind() {
        let plane = DepthPlane::fit(&samples(40), 0.0177, &mut Vec::new()).unwrap();
        assert_eq!(plane.kept, 104);
        assert!(plane.rms_m < 1e-9);
        // From a lens 15 mm beside: (0.015, 0, 0) + t (0.1, 0.02, 1), z = 0.5 + 0.4 x, so
        // t = 0.5 + 0.4 (0.015 + 0.1 t), t = 0.506 / 0.96.
        let direction = Vector3::new(0.1, 0.02, 1.0);
        let point = plane.meet(&Vector3::new(0.015, 0.0, 0.0), &direction).unwrap();
        assert!((point.z - 0.506 / 0.96).abs() < 1e-9, "{point}");
        // The normal (0.4, 0, −1)/√1.16 against the optical axis.
        assert!((plane.cosine(&Vector3::z()) - 1.0 / 1.16f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn where_no_plane_holds_most_there_is_none() {
        assert!(DepthPlane::fit(&samples(70), 0.0177, &mut Vec::new()).is_none());
        assert!(DepthPlane::fit(&samples(0)[..10], 0.0177, &mut Vec::new()).is_none());
    }
}
