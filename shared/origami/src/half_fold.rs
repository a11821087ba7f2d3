//! One fold along one straight line: the moving part turns by 180° onto the fixed one.
//!
//! Two rigid plates of thickness t, hinged where their upper faces meet, so that the layers end
//! face to face. In the plane across the crease, with s the distance from it and θ the angle:
//!
//! fixed:   (−s, t/2)
//! moving:  (s cos θ + t/2 sin θ,  t + s sin θ − t/2 cos θ)
//!
//! For every θ in [0, π] the moving middle surface lies at or above z = t/2 and the moving plate
//! at or above z = t, so nothing ever intersects; the two middle surfaces part by t sin(θ/2) at
//! the crease. The real bend that closes this gap is not modelled.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::line::ON_LINE_M;
use crate::{FoldError, FoldLine, Timing};

/// One rigid part of the sheet, a convex polygon.
#[derive(Debug, Clone, PartialEq)]
pub struct Facet {
    /// Corners in material coordinates, metres, counter-clockwise; the crease is the edge from
    /// the first corner to the second.
    pub corners_uv_m: Vec<[f64; 2]>,
}

/// A sheet that is folded once along a straight line.
#[derive(Debug, Clone)]
pub struct HalfFold {
    size_m: [f64; 2],
    line: FoldLine,
    thickness_m: f64,
    timing: Timing,
    /// Maps (u, v, height over the middle surface) of the flat sheet into the world.
    world_from_sheet: Isometry3<f64>,
    facets: [Facet; 2],
}

impl HalfFold {
    /// A fold of a sheet that lies flat on the table, centred on the world's origin, with its
    /// u axis along world x.
    pub fn new(size_m: [f64; 2], line: FoldLine, thickness_m: f64) -> Result<Self, FoldError> {
        let length = |l: f64| l > 0.0 && l.is_finite();
        if !(size_m.iter().all(|l| length(*l)) && length(thickness_m)) {
            return Err(FoldError::NotASheet { size_m, thickness_m });
        }
        let [a, b] = size_m;
        let sheet = [[0.0, 0.0], [a, 0.0], [a, b], [0.0, b]];
        let facet = |sign: f64| -> Option<Facet> {
            let mut corners = line.clip(&sheet, sign);
            let on_line = |uv: &[f64; 2]| line.side_m(*uv).abs() <= ON_LINE_M;
            let first = (0..corners.len())
                .find(|k| on_line(&corners[*k]) && on_line(&corners[(k + 1) % corners.len()]))?;
            corners.rotate_left(first);
            (corners.len() >= 3).then_some(Facet { corners_uv_m: corners })
        };
        let (Some(fixed), Some(moving)) = (facet(-1.0), facet(1.0)) else {
            return Err(FoldError::LineMissesSheet { line, size_m });
        };
        let fold = Self {
            size_m,
            line,
            thickness_m,
            timing: Timing::default(),
            world_from_sheet: Isometry3::identity(),
            facets: [fixed, moving],
        };
        Ok(fold.placed([0.0; 2], 0.0))
    }

    /// The same fold with the flat sheet's centre at `center_m` on the table, turned by
    /// `yaw_rad` about the vertical.
    pub fn placed(mut self, center_m: [f64; 2], yaw_rad: f64) -> Self {
        let [a, b] = self.size_m;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
        let center = Vector3::new(center_m[0], center_m[1], self.thickness_m / 2.0);
        let origin = center + turn * Vector3::new(-a / 2.0, -b / 2.0, 0.0);
        self.world_from_sheet = Isometry3::from_parts(Translation3::from(origin), turn);
        self
    }

    /// The same fold with other rests.
    pub fn timed(mut self, timing: Timing) -> Self {
        self.timing = timing;
        self
    }

    /// The fixed part and the moving part.
    pub fn facets(&self) -> &[Facet; 2] {
        &self.facets
    }

    /// Angle of the moving part at `progress` (0 to 1), radians: 0 flat, π folded.
    pub fn angle_rad(&self, progress: f64) -> f64 {
        PI * self.timing.done(progress)
    }

    /// World poses of the fixed and the moving part at `progress`; each maps `(u, v, 0)`, metres,
    /// to the middle surface.
    pub fn pose(&self, progress: f64) -> [Isometry3<f64>; 2] {
        let [c, s] = self.line.direction();
        // What lies on the line's left rises when it turns right-handedly about the line.
        let axis = Unit::new_unchecked(Vector3::new(c, s, 0.0));
        let turn = UnitQuaternion::from_axis_angle(&axis, self.angle_rad(progress));
        let [u, v] = self.line.point_m;
        let hinge = Vector3::new(u, v, self.thickness_m / 2.0);
        let lift = Isometry3::from_parts(Translation3::from(hinge - turn * hinge), turn);
        [self.world_from_sheet, self.world_from_sheet * lift]
    }

    /// World position of a material point's middle surface at `progress`, metres. Points on the
    /// crease belong to the fixed part.
    pub fn position_m(&self, uv_m: [f64; 2], progress: f64) -> Point3<f64> {
        let moves = self.line.side_m(uv_m) > ON_LINE_M;
        self.pose(progress)[usize::from(moves)] * Point3::new(uv_m[0], uv_m[1], 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE_M: [f64; 2] = [0.21, 0.297];
    const THICKNESS_M: f64 = 1e-4;

    fn folds() -> Vec<HalfFold> {
        let oblique = FoldLine { point_m: [0.08, 0.2], angle_rad: 0.7 };
        [FoldLine::book(SIZE_M), FoldLine::diagonal(SIZE_M), oblique]
            .map(|line| {
                HalfFold::new(SIZE_M, line, THICKNESS_M).unwrap().placed([0.03, -0.02], 0.4)
            })
            .into()
    }

    fn progresses() -> impl Iterator<Item = f64> {
        (0..=200).map(|k| f64::from(k) / 200.0)
    }

    #[test]
    fn facets_share_the_crease_and_cover_the_sheet_once() {
        let area = |facet: &Facet| -> f64 {
            let c = &facet.corners_uv_m;
            let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
            (0..c.len()).map(|k| cross(c[k], c[(k + 1) % c.len()])).sum::<f64>() / 2.0
        };
        for fold in folds() {
            let [fixed, moving] = fold.facets();
            assert!(area(fixed) > 0.0 && area(moving) > 0.0, "counter-clockwise");
            assert!((area(fixed) + area(moving) - SIZE_M[0] * SIZE_M[1]).abs() < 1e-15);
            for k in 0..2 {
                let (a, b) = (fixed.corners_uv_m[k], moving.corners_uv_m[1 - k]);
                assert!((0..2).all(|i| (a[i] - b[i]).abs() < 1e-12), "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn every_facet_is_isometric() {
        for fold in folds() {
            for (part, facet) in fold.facets().iter().enumerate() {
                let corners = &facet.corners_uv_m;
                for progress in progresses() {
                    let x: Vec<Point3<f64>> = corners
                        .iter()
                        .map(|[u, v]| fold.pose(progress)[part] * Point3::new(*u, *v, 0.0))
                        .collect();
                    for i in 0..x.len() {
                        for j in 0..i {
                            let (a, b) = (corners[i], corners[j]);
                            let rest = (a[0] - b[0]).hypot(a[1] - b[1]);
                            assert!(((x[i] - x[j]).norm() - rest).abs() < 1e-15 * 4.0);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn the_crease_parts_by_less_than_the_thickness() {
        for fold in folds() {
            for progress in progresses() {
                let [fixed, moving] = fold.pose(progress);
                for [u, v] in &fold.facets()[0].corners_uv_m[..2] {
                    let uv = Point3::new(*u, *v, 0.0);
                    let gap = (fixed * uv - moving * uv).norm();
                    let expected = THICKNESS_M * (fold.angle_rad(progress) / 2.0).sin();
                    assert!((gap - expected).abs() < 1e-15);
                }
            }
        }
    }

    /// Two convex plates are apart where a plane separates their corners: the crease's vertical
    /// plane up to 90°, the fixed plate's upper face beyond. A proof for each sampled angle.
    #[test]
    fn plates_never_intersect_each_other_or_the_table() {
        for fold in folds() {
            let sheet_from_world = fold.world_from_sheet.inverse();
            for progress in progresses() {
                let pose = fold.pose(progress)[1];
                let mut beside = true;
                let mut above = true;
                for [u, v] in &fold.facets()[1].corners_uv_m {
                    for side in [-0.5, 0.5] {
                        let world = pose * Point3::new(*u, *v, side * THICKNESS_M);
                        let sheet = sheet_from_world * world;
                        assert!(world.z >= -1e-15, "{} under the table", world.z);
                        beside &= fold.line.side_m([sheet.x, sheet.y]) >= -1e-15;
                        above &= world.z >= THICKNESS_M - 1e-15;
                    }
                }
                assert!(beside || above, "plates intersect at {progress}");
            }
        }
    }

    #[test]
    fn the_middle_of_a_book_fold_by_hand() {
        let fold = HalfFold::new([0.2, 0.3], FoldLine::book([0.2, 0.3]), THICKNESS_M).unwrap();
        let progress = (0.15 + 0.90) / 2.0;
        assert!((fold.angle_rad(progress) - PI / 2.0).abs() < 1e-12);
        // The free edge u = 0 stands 0.1 m above the hinge (z = t), half a thickness beside it.
        let top = fold.position_m([0.0, 0.05], progress);
        let expected = Point3::new(-THICKNESS_M / 2.0, 0.05 - 0.15, 0.1 + THICKNESS_M);
        assert!((top - expected).norm() < 1e-15, "{top}");
        let fixed = fold.position_m([0.2, 0.3], progress);
        assert!((fixed - Point3::new(0.1, 0.15, THICKNESS_M / 2.0)).norm() < 1e-15);
    }

    #[test]
    fn ends_flat_and_folded() {
        for fold in folds() {
            let sheet_from_world = fold.world_from_sheet.inverse();
            for uv in [[0.0, 0.297], [0.1, 0.28], [0.01, 0.2]] {
                let start = sheet_from_world * fold.position_m(uv, 0.0);
                assert!((start - Point3::new(uv[0], uv[1], 0.0)).norm() < 1e-15);
                // Mirrored at the line, one thickness higher.
                let end = sheet_from_world * fold.position_m(uv, 1.0);
                let side = fold.line.side_m(uv);
                assert!(side > 0.0, "the table lists moving points");
                let [c, s] = fold.line.direction();
                let mirrored = [uv[0] + 2.0 * side * s, uv[1] - 2.0 * side * c];
                let expected = Point3::new(mirrored[0], mirrored[1], THICKNESS_M);
                assert!((end - expected).norm() < 1e-15 * 4.0, "{end} against {expected}");
            }
        }
    }

    #[test]
    fn impossible_folds_are_refused() {
        let beside = FoldLine { point_m: [0.5, 0.0], angle_rad: PI / 2.0 };
        assert!(matches!(
            HalfFold::new(SIZE_M, beside, THICKNESS_M),
            Err(FoldError::LineMissesSheet { .. })
        ));
        // Along an edge there is nothing to move.
        let edge = FoldLine { point_m: [0.0, 0.0], angle_rad: PI / 2.0 };
        assert!(HalfFold::new(SIZE_M, edge, THICKNESS_M).is_err());
        let nothing = HalfFold::new([0.0, 0.3], FoldLine::book(SIZE_M), THICKNESS_M);
        assert!(matches!(nothing, Err(FoldError::NotASheet { .. })));
    }
}
