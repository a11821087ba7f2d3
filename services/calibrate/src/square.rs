//! The pose of a square from its four corners in one image: both solutions of a planar target.
//!
//! A square seen small has two poses that explain its corners almost equally well, mirrored about
//! the line of sight. Which one is true shows only together with other views, so both are given.

use orime_geometry::CameraModel;
use orime_geometry::nalgebra::{
    Isometry3, Matrix3, Matrix6, Point3, Rotation3, SMatrix, SVector, Translation3, Unit,
    UnitQuaternion, Vector2, Vector3, Vector6,
};

/// A pose that explains the corners.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SquarePose {
    /// Maps the marker's coordinates into the camera, metres.
    pub camera_from_marker: Isometry3<f64>,
    /// Root mean square distance of the corners from where the pose puts them, pixels.
    pub rms_px: f64,
}

/// Most steps of one refinement.
const STEPS_MAX: usize = 30;

/// Two poses nearer than this are one, radians.
const SAME_RAD: f64 = 0.02;

/// A marker's corners in its own frame (+x right, +y down, +z away from who looks at it), in the
/// detector's order: clockwise from its own top-left corner.
pub fn corners_m(side_m: f64) -> [Point3<f64>; 4] {
    let h = side_m / 2.0;
    [[-h, -h], [h, -h], [h, h], [-h, h]].map(|[x, y]| Point3::new(x, y, 0.0))
}

/// The poses that explain a marker's corners, the better one first; none if they are no
/// quadrangle in front of the camera.
pub fn square_poses(
    lens: &CameraModel,
    corners_px: &[[f64; 2]; 4],
    side_m: f64,
) -> Vec<SquarePose> {
    let rays = corners_px.map(|px| lens.ray(Vector2::from(px)).xy());
    let focal_px = [lens.fx_px, lens.fy_px];
    let corners = corners_m(side_m);
    let Some(start) = from_homography(&rays, side_m) else { return Vec::new() };
    let refine = |pose| refine(pose, &corners, &rays, focal_px);
    let Some(first) = refine(start) else { return Vec::new() };
    let mut poses = vec![first];
    if let Some(second) = refine(mirrored(&first.camera_from_marker)) {
        let between =
            first.camera_from_marker.rotation.angle_to(&second.camera_from_marker.rotation);
        if between > SAME_RAD {
            poses.push(second);
        }
    }
    poses.sort_by(|a, b| a.rms_px.total_cmp(&b.rms_px));
    poses
}

/// The pose that the plane's homography says, exact for exact corners.
fn from_homography(rays: &[Vector2<f64>; 4], side_m: f64) -> Option<Isometry3<f64>> {
    let corners = corners_m(side_m);
    let mut a = SMatrix::<f64, 8, 8>::zeros();
    let mut b = SVector::<f64, 8>::zeros();
    for (k, (corner, ray)) in corners.iter().zip(rays).enumerate() {
        let (x, y) = (corner.x, corner.y);
        for (axis, to) in [ray.x, ray.y].into_iter().enumerate() {
            let row = 2 * k + axis;
            let first = 3 * axis;
            a[(row, first)] = x;
            a[(row, first + 1)] = y;
            a[(row, first + 2)] = 1.0;
            a[(row, 6)] = -to * x;
            a[(row, 7)] = -to * y;
            b[row] = to;
        }
    }
    let h = a.lu().solve(&b)?;
    let columns = [
        Vector3::new(h[0], h[3], h[6]),
        Vector3::new(h[1], h[4], h[7]),
        Vector3::new(h[2], h[5], 1.0),
    ];
    let scale = 2.0 / (columns[0].norm() + columns[1].norm());
    if !(scale.is_finite() && scale > 0.0) {
        return None;
    }
    let (x, y) = (columns[0] * scale, columns[1] * scale);
    let rough = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    let svd = rough.svd(true, true);
    let rotation = Rotation3::from_matrix_unchecked(svd.u? * svd.v_t?);
    let translation = Translation3::from(columns[2] * scale);
    Some(Isometry3::from_parts(translation, UnitQuaternion::from_rotation_matrix(&rotation)))
}

/// The pose whose normal is mirrored about the line of sight.
fn mirrored(pose: &Isometry3<f64>) -> Isometry3<f64> {
    let sight = Unit::new_normalize(pose.translation.vector);
    let half_turn = |axis| UnitQuaternion::from_axis_angle(&axis, std::f64::consts::PI);
    let rotation = half_turn(sight) * pose.rotation * half_turn(Vector3::z_axis());
    Isometry3::from_parts(pose.translation, rotation)
}

/// Levenberg–Marquardt on the corners' distances in the image.
fn refine(
    start: Isometry3<f64>,
    corners: &[Point3<f64>; 4],
    rays: &[Vector2<f64>; 4],
    focal_px: [f64; 2],
) -> Option<SquarePose> {
    let mut pose = start;
    let (mut hessian, mut gradient, mut cost) = normal(&pose, corners, rays, focal_px)?;
    let mut damping = 1e-4;
    for _ in 0..STEPS_MAX {
        let mut damped = hessian;
        for k in 0..6 {
            damped[(k, k)] *= 1.0 + damping;
        }
        let Some(factor) = damped.cholesky() else { break };
        let next = pose * motion(&-factor.solve(&gradient));
        match normal(&next, corners, rays, focal_px) {
            Some((h, g, c)) if c <= cost => {
                let done = cost - c <= 1e-12 * cost;
                (pose, hessian, gradient, cost) = (next, h, g, c);
                damping = (damping * 0.2).max(1e-12);
                if done {
                    break;
                }
            }
            _ => damping *= 10.0,
        }
        if damping > 1e8 {
            break;
        }
    }
    Some(SquarePose { camera_from_marker: pose, rms_px: (cost / 4.0).sqrt() })
}

type Normal = (Matrix6<f64>, Vector6<f64>, f64);

/// Normal equations and the sum of squares; `None` where a corner is behind the camera.
fn normal(
    pose: &Isometry3<f64>,
    corners: &[Point3<f64>; 4],
    rays: &[Vector2<f64>; 4],
    focal_px: [f64; 2],
) -> Option<Normal> {
    let (mut hessian, mut gradient, mut cost) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
    let rotation = pose.rotation.to_rotation_matrix();
    for (corner, ray) in corners.iter().zip(rays) {
        let p = pose * corner;
        if p.z <= 1e-6 {
            return None;
        }
        let turned = -(rotation * corner.coords.cross_matrix());
        for (axis, focal) in focal_px.into_iter().enumerate() {
            let residual = focal * (p[axis] / p.z - ray[axis]);
            let mut along = Vector3::zeros();
            along[axis] = focal / p.z;
            along.z = -focal * p[axis] / (p.z * p.z);
            let mut row = Vector6::zeros();
            row.fixed_rows_mut::<3>(0).copy_from(&rotation.matrix().tr_mul(&along));
            row.fixed_rows_mut::<3>(3).copy_from(&turned.tr_mul(&along));
            hessian += row * row.transpose();
            gradient += row * residual;
            cost += residual * residual;
        }
    }
    Some((hessian, gradient, cost))
}

/// The motion of a small step: translation, then rotation vector.
pub fn motion(step: &Vector6<f64>) -> Isometry3<f64> {
    Isometry3::new(step.fixed_rows::<3>(0).into_owned(), step.fixed_rows::<3>(3).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens() -> CameraModel {
        CameraModel {
            width: 640,
            height: 480,
            fx_px: 610.0,
            fy_px: 605.0,
            cx_px: 321.0,
            cy_px: 243.0,
            distortion: [0.05, -0.02, 0.001, -0.002, 0.0],
        }
    }

    #[test]
    fn a_slanted_square_is_found_where_it_is() {
        let true_pose =
            Isometry3::new(Vector3::new(0.05, -0.03, 0.35), Vector3::new(0.7, -0.4, 1.9));
        let seen = corners_m(0.022).map(|c| lens().project(&(true_pose * c)).unwrap().into());
        let poses = square_poses(&lens(), &seen, 0.022);
        let error = poses[0].camera_from_marker.inverse() * true_pose;
        assert!(error.translation.vector.norm() < 1e-7, "{error}");
        assert!(error.rotation.angle() < 1e-5 && poses[0].rms_px < 1e-5, "{error}");
        assert_eq!(poses.len(), 2, "the mirrored pose is a solution too");
        assert!(poses[1].rms_px > 0.02, "{}", poses[1].rms_px);
    }

    #[test]
    fn corners_in_a_line_have_no_pose() {
        let line = [[100.0, 100.0], [110.0, 110.0], [120.0, 120.0], [130.0, 130.0]];
        let found = square_poses(&lens(), &line, 0.022);
        assert!(found.iter().all(|pose| pose.rms_px > 1.0 || !pose.rms_px.is_finite()));
    }
}
