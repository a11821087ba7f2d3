//! What several cameras say about one node, as one position.
//!
//! A pixel says where a feature lies across its ray r to a fraction of a millimetre; depth along
//! it errs by several, and often by as much everywhere. With ρ the ratio of the two errors:
//!
//! W = I − r rᵀ + r rᵀ/ρ²,   (Σ W) x = Σ W p,   d² = (p − x)ᵀ W (p − x)
//!
//! The worst is left out while its d is too large; ρ = 1 makes x the mean.

use nalgebra::{Matrix3, Vector3};

/// A feature as one camera sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sight {
    /// Node of the sheet.
    pub node: u32,
    /// Index of the camera.
    pub camera: u32,
    /// World frame, metres.
    pub position_m: Vector3<f64>,
    /// From the camera to it, unit length; zero where the camera is not known.
    pub ray: Vector3<f64>,
}

/// When sights are taken for one and the same.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// ρ.
    pub ray_error_ratio: f64,
    /// Largest d of a sight that agrees, metres.
    pub agree_m: f64,
    /// Largest d of a lone sight from the prediction, metres.
    pub gate_m: f64,
}

impl Sight {
    fn precision(&self, limits: &Limits) -> Matrix3<f64> {
        let along = self.ray * self.ray.transpose();
        Matrix3::identity() + along * (limits.ray_error_ratio.powi(-2) - 1.0)
    }

    /// d.
    pub fn distance_m(&self, position_m: &Vector3<f64>, limits: &Limits) -> f64 {
        let offset = self.position_m - position_m;
        offset.dot(&(self.precision(limits) * offset)).sqrt()
    }
}

/// Merges the sights of one node; those that agree come first in `sights` then. Gives the position
/// and how many agree; of sights that do not, the one nearest to the prediction, if it is near.
pub(crate) fn merge(
    sights: &mut [Sight],
    predicted_m: Option<Vector3<f64>>,
    limits: &Limits,
) -> Option<(Vector3<f64>, usize)> {
    let mut count = sights.len();
    while count >= 2 {
        let agreeing = &mut sights[..count];
        let position_m = solve(agreeing, limits)?;
        let by_distance = |a: &Sight, b: &Sight| {
            let of = |s: &Sight| s.distance_m(&position_m, limits);
            of(a).total_cmp(&of(b))
        };
        agreeing.sort_by(by_distance);
        if agreeing[count - 1].distance_m(&position_m, limits) <= limits.agree_m {
            return Some((position_m, count));
        }
        count -= 1;
    }
    let Some(predicted) = predicted_m else {
        return (sights.len() == 1).then(|| (sights[0].position_m, 1));
    };
    let by_distance = |a: &Sight, b: &Sight| {
        let of = |s: &Sight| s.distance_m(&predicted, limits);
        of(a).total_cmp(&of(b))
    };
    sights.sort_by(by_distance);
    let nearest = sights.first()?;
    let is_near = nearest.distance_m(&predicted, limits) <= limits.gate_m;
    is_near.then_some((nearest.position_m, 1))
}

fn solve(sights: &[Sight], limits: &Limits) -> Option<Vector3<f64>> {
    let (mut left, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for sight in sights {
        let precision = sight.precision(limits);
        left += precision;
        right += precision * sight.position_m;
    }
    Some(left.cholesky()?.solve(&right))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits { ray_error_ratio: 4.0, agree_m: 0.006, gate_m: 0.015 };

    fn sight(camera: u32, position_mm: [f64; 3], ray: [f64; 3]) -> Sight {
        let position_m = Vector3::from(position_mm) * 1e-3;
        Sight { node: 0, camera, position_m, ray: Vector3::from(ray).normalize() }
    }

    #[test]
    fn rays_outweigh_depths() {
        // From above 5 mm too near, from the side exact: x = (1·0 + 5/16)/(1 + 1/16).
        let mut sights = [sight(0, [0.0, 0.0, 5.0], [0.0, 0.0, -1.0]), {
            sight(1, [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0])
        }];
        let (position_m, count) = merge(&mut sights, None, &LIMITS).unwrap();
        assert_eq!(count, 2);
        assert!((position_m.z - 0.005 / 17.0).abs() < 1e-12, "{position_m}");
        let plain = Limits { ray_error_ratio: 1.0, ..LIMITS };
        assert!((merge(&mut sights, None, &plain).unwrap().0.z - 0.0025).abs() < 1e-12);
    }

    #[test]
    fn the_odd_one_out_is_left_out_and_strangers_need_a_prediction() {
        let down = [0.0, 0.0, -1.0];
        let good = [sight(0, [0.0, 1.0, 0.0], down), sight(1, [0.0, -1.0, 0.0], down)];
        let odd = sight(2, [30.0, 0.0, 0.0], down);
        let (position_m, count) = merge(&mut [odd, good[0], good[1]], None, &LIMITS).unwrap();
        assert_eq!((count, position_m.norm() < 1e-12), (2, true));
        let mut strangers = [odd, good[0]];
        assert_eq!(merge(&mut strangers, None, &LIMITS), None);
        let known = merge(&mut strangers, Some(Vector3::zeros()), &LIMITS);
        assert_eq!(known, Some((good[0].position_m, 1)));
        assert_eq!(merge(&mut [odd], Some(Vector3::zeros()), &LIMITS), None);
        assert_eq!(merge(&mut [odd], None, &LIMITS), Some((odd.position_m, 1)));
    }
}
