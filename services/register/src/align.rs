//! Rigid alignment of a template to a cloud by iterated closest points.

use nalgebra::{
    Isometry3, Matrix3, Matrix6, Point3, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6,
};
use orime_geometry::{ObservedPoint, fit};

/// Rounds per start.
const ROUNDS: usize = 60;
/// Weight of sliding along the surface beside moving towards it: smooth sheets slide slowly under
/// point-to-point distances, and do not feel sliding at all under point-to-plane ones.
const SLIDE: f64 = 0.01;

/// Node positions of the template, moved rigidly onto the points; the best of several starts: the
/// template where it stands, over the cloud's centre, and turned by quarter turns there.
///
/// Points find their nearest node, not the other way round: a cloud that sees a part of the sheet
/// is matched by that part. `None` for fewer than three points or nodes.
pub(crate) fn iterated_closest_points(
    points: &[ObservedPoint],
    template_m: &[[f32; 3]],
) -> Option<Vec<[f32; 3]>> {
    let template: Vec<Point3<f64>> = template_m.iter().map(|p| Point3::from(*p).cast()).collect();
    if points.len() < 3 || template.len() < 3 {
        return None;
    }
    let targets: Vec<Target> = points.iter().map(Target::new).collect();
    let cloud_centre = fit::centroid(targets.iter().map(|t| t.position));
    let template_centre = fit::centroid(template.iter().copied());
    let to_centre = Translation3::from(cloud_centre - template_centre);
    let normal = fit::Plane::fit(&template).map_or(Vector3::z(), |plane| plane.normal);
    let mut starts = vec![Isometry3::identity(), to_centre.into()];
    for quarter in 1..4 {
        let angle = f64::from(quarter) * std::f64::consts::FRAC_PI_2;
        let turn =
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_scaled_axis(normal * angle));
        starts.push(to_centre * Isometry3::rotation_wrt_point(turn, template_centre));
    }
    let mut best: Option<(f64, Isometry3<f64>)> = None;
    for start in starts {
        let Some((error, pose)) = descend(&targets, &template, start) else { continue };
        // Ties go to the earlier start: the template as it was given is the likeliest.
        if best.is_none_or(|(lowest, _)| error < 0.98 * lowest) {
            best = Some((error, pose));
        }
    }
    let (_, pose) = best?;
    let moved = template.iter().map(|p| pose * p);
    Some(moved.map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect())
}

/// An observed point and how its distance is weighed by direction.
#[derive(Debug)]
struct Target {
    position: Point3<f64>,
    metric: Matrix3<f64>,
}

impl Target {
    fn new(point: &ObservedPoint) -> Self {
        let normal = Vector3::from(point.normal).cast::<f64>();
        let metric = if normal.norm() > 0.5 {
            normal * normal.transpose() * (1.0 - SLIDE) + Matrix3::identity() * SLIDE
        } else {
            Matrix3::identity()
        };
        Self { position: Point3::from(point.position_m).cast(), metric }
    }
}

/// Mean distance and pose after at most [`ROUNDS`] rounds from `start`.
fn descend(
    targets: &[Target],
    template: &[Point3<f64>],
    start: Isometry3<f64>,
) -> Option<(f64, Isometry3<f64>)> {
    let mut pose = start;
    let mut error = f64::INFINITY;
    for _ in 0..ROUNDS {
        let moved: Vec<Point3<f64>> = template.iter().map(|p| pose * p).collect();
        let matches: Vec<(usize, f64)> =
            targets.iter().map(|t| nearest(&t.position, &moved)).collect();
        error = matches.iter().map(|m| m.1.sqrt()).sum::<f64>() / targets.len() as f64;
        // Far matches are wrong matches: trust falls with distance.
        let scale = (2.0 * error).powi(2).max(1e-12);
        let step = rigid_step(targets, |k| {
            let (node, squared) = matches[k];
            (moved[node], 1.0 / (1.0 + squared / scale))
        })?;
        pose = step * pose;
        if step.translation.vector.norm() < 1e-6 && step.rotation.angle() < 1e-6 {
            break;
        }
    }
    Some((error, pose))
}

/// One Gauss–Newton step: the small motion (ω, t) that minimises Σ w (r − ω×s − t)ᵀ M (r − ω×s − t)
/// with s the matched node and r the way from it to its target.
fn rigid_step(
    targets: &[Target],
    matched: impl Fn(usize) -> (Point3<f64>, f64),
) -> Option<Isometry3<f64>> {
    let mut normal = Matrix6::<f64>::zeros();
    let mut right = Vector6::<f64>::zeros();
    // About the targets' centre: far from the origin ω and t would be nearly the same motion.
    let centre = fit::centroid(targets.iter().map(|t| t.position));
    for (k, target) in targets.iter().enumerate() {
        let (node, weight) = matched(k);
        let lever = (node - centre).cross_matrix();
        let metric = target.metric * weight;
        // The motion of the node is −[s]× ω + t.
        let (turn, slide) = (lever * metric, metric);
        let residual = target.position - node;
        let mut add = |row: usize, column: usize, block: Matrix3<f64>| {
            let mut place = normal.fixed_view_mut::<3, 3>(row, column);
            place += block;
        };
        add(0, 0, -turn * lever);
        add(0, 3, turn);
        add(3, 0, -slide * lever);
        add(3, 3, slide);
        let mut upper = right.fixed_rows_mut::<3>(0);
        upper += turn * residual;
        let mut lower = right.fixed_rows_mut::<3>(3);
        lower += slide * residual;
    }
    let small = normal.cholesky()?.solve(&right);
    let turn = UnitQuaternion::from_scaled_axis(small.fixed_rows::<3>(0).into_owned());
    let slide = Translation3::from(small.fixed_rows::<3>(3).into_owned());
    Some(slide * Isometry3::rotation_wrt_point(turn, centre))
}

fn nearest(point: &Point3<f64>, candidates: &[Point3<f64>]) -> (usize, f64) {
    let mut best = (0, f64::INFINITY);
    for (k, candidate) in candidates.iter().enumerate() {
        let squared = (candidate - point).norm_squared();
        if squared < best.1 {
            best = (k, squared);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::SheetGrid;

    #[test]
    fn a_moved_template_is_found_though_a_part_is_hidden() {
        let sheet = SheetGrid::new([0.5, 0.4], [25, 25]);
        let height = |x: f32, y: f32| 0.06 * (9.0 * x).sin() + 0.04 * (11.0 * y).cos();
        let wavy: Vec<[f32; 3]> =
            sheet.flat_m().iter().map(|p| [p[0], p[1], height(p[0], p[1])]).collect();
        let pose = Isometry3::new(Vector3::new(0.05, -0.03, 1.2), Vector3::new(0.1, -0.15, 0.1));
        let truth: Vec<Point3<f64>> =
            wavy.iter().map(|p| pose * Point3::from(*p).cast::<f64>()).collect();
        let seen: Vec<ObservedPoint> = sheet
            .flat_m()
            .iter()
            .zip(&truth)
            .filter(|(flat, _)| flat[0] < 0.15)
            .map(|(flat, p)| {
                let slope_x = 0.54 * (9.0 * flat[0]).cos();
                let slope_y = -0.44 * (11.0 * flat[1]).sin();
                let normal =
                    pose.rotation * Vector3::new(-slope_x, -slope_y, 1.0).cast::<f64>().normalize();
                ObservedPoint {
                    position_m: [p.x as f32, p.y as f32, p.z as f32],
                    normal: [normal.x as f32, normal.y as f32, normal.z as f32],
                    camera: 0,
                    pixels: 1.0,
                }
            })
            .collect();
        let found = iterated_closest_points(&seen, &wavy).unwrap();
        let error = found
            .iter()
            .zip(&truth)
            .map(|(a, b)| (Point3::from(*a).cast::<f64>() - b).norm())
            .fold(0.0, f64::max);
        assert!(error < 0.002, "worst node is off by {} mm", error * 1e3);
    }
}
