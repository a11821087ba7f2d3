//! A pose from one cloud alone: a plane, and the rectangle of the known size on it.
//!
//! Nobody places the sheet by hand. Parts may be hidden (a hand, a clip), so the rectangle is not
//! the hull of what is seen: each side is matched robustly to the outermost points along it.

use crate::cloud::bounds;
use nalgebra::{Point3, Vector2, Vector3};
use orime_geometry::{ObservedPoint, SheetGrid, fit::Plane};

/// Points used at most; more are thinned evenly.
const POINTS_MAX: usize = 1500;
/// The same, for a folded sheet.
const FOLDED_POINTS_MAX: usize = 250;
/// Stretches along each side, in which the outermost point is looked up.
const BINS: usize = 16;

/// Node positions of a flat sheet that fits the cloud, or `None` where no plane holds enough of
/// it. Among the turns that nobody can tell apart, the one nearest to `previous_m` is taken.
pub(crate) fn flat_pose(
    cloud: &[ObservedPoint],
    sheet: &SheetGrid,
    previous_m: Option<&[[f32; 3]]>,
) -> Option<Vec<[f32; 3]>> {
    let side_m = (sheet.size_m[0] + sheet.size_m[1]) / 2.0;
    let step = cloud.len().div_ceil(POINTS_MAX).max(1);
    let points: Vec<Point3<f64>> =
        cloud.iter().step_by(step).map(|p| Point3::from(p.position_m).cast()).collect();
    let (plane, inliers) = find_plane(&points, (0.02 * side_m).max(0.003))?;
    let normal = if is_front(&plane.normal, cloud) { plane.normal } else { -plane.normal };
    let first = if normal.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let across = (first - normal * normal.dot(&first)).normalize();
    let along = normal.cross(&across);
    let origin = normal * normal.dot(&inliers[0].coords);
    let flat: Vec<Vector2<f64>> =
        inliers.iter().map(|p| Vector2::new(across.dot(&p.coords), along.dot(&p.coords))).collect();
    let rectangle = fit_rectangle(&flat, sheet.size_m)?;
    let (sin, cos) = rectangle.angle.sin_cos();
    let (u_axis, v_axis) = (across * cos + along * sin, along * cos - across * sin);
    let centre = origin + across * rectangle.centre.x + along * rectangle.centre.y;
    let pose: Vec<[f32; 3]> = sheet
        .uv_m()
        .map(|[u, v]| {
            let p = centre
                + u_axis * (u - sheet.size_m[0] / 2.0)
                + v_axis * (v - sheet.size_m[1] / 2.0);
            [p.x as f32, p.y as f32, p.z as f32]
        })
        .collect();
    Some(nearest_turn(pose, sheet, previous_m))
}

/// The turn of `pose` whose nodes are nearest to `previous_m`, else the one whose u axis points
/// most along world +x (ties, +y), so that equal scenes start equally.
fn nearest_turn(
    pose: Vec<[f32; 3]>,
    sheet: &SheetGrid,
    previous_m: Option<&[[f32; 3]]>,
) -> Vec<[f32; 3]> {
    let mut best: Option<(f64, Vec<[f32; 3]>)> = None;
    for turn in sheet.turns() {
        let turned: Vec<[f32; 3]> = turn.iter().map(|n| pose[*n]).collect();
        let cost: f64 = match previous_m {
            Some(previous) => turned
                .iter()
                .zip(previous)
                .map(|(a, b)| (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>())
                .sum(),
            None => {
                let (a, b) = (turned[0], turned[sheet.index(sheet.nodes[0] - 1, 0)]);
                -f64::from((b[0] - a[0]) + 0.01 * (b[1] - a[1]))
            }
        };
        if best.as_ref().is_none_or(|(lowest, _)| cost < *lowest) {
            best = Some((cost, turned));
        }
    }
    best.map_or(pose, |(_, turned)| turned)
}

/// Whether a normal of the sheet is its front's: most cameras see that side; where as many see the
/// other, it is the upper one. How many points each camera sees is no matter, for what hides the
/// sheet from one of them must not turn it over.
fn is_front(normal: &Vector3<f64>, cloud: &[ObservedPoint]) -> bool {
    let cameras = cloud.iter().map(|p| p.camera + 1).max().unwrap_or(0);
    let votes = (0..cameras).map(|camera| {
        let seen = cloud.iter().filter(|p| p.camera == camera);
        let sum: f64 = seen.map(|p| Vector3::from(p.normal).cast::<f64>().dot(normal)).sum();
        if sum == 0.0 { 0.0 } else { sum.signum() }
    });
    votes.sum::<f64>() + 0.5 * normal.z.signum() > 0.0
}

/// The plane with most points within `tolerance_m`, refined on them; needs 40 % of the points.
fn find_plane(points: &[Point3<f64>], tolerance_m: f64) -> Option<(Plane, Vec<Point3<f64>>)> {
    if points.len() < 3 {
        return None;
    }
    let mut best: Option<(usize, Plane)> = None;
    let mut random = 0x1234_5678_9abc_def1u64;
    let mut pick = || {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        points[(random >> 11) as usize % points.len()]
    };
    for _ in 0..150 {
        let Some(plane) = Plane::fit(&[pick(), pick(), pick()]) else { continue };
        let count = points.iter().filter(|p| plane.height_m(p).abs() < tolerance_m).count();
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, plane));
        }
    }
    let (_, mut plane) = best?;
    let mut inliers = Vec::new();
    for _ in 0..3 {
        inliers =
            points.iter().copied().filter(|p| plane.height_m(p).abs() < tolerance_m).collect();
        plane = Plane::fit(&inliers)?;
    }
    (inliers.len() * 5 >= points.len() * 2).then_some((plane, inliers))
}

/// A rectangle of the sheet's size in the plane.
#[derive(Debug, Clone, Copy)]
struct Rectangle {
    centre: Vector2<f64>,
    /// Angle of the u side, radians.
    angle: f64,
}

fn fit_rectangle(points: &[Vector2<f64>], size_m: [f64; 2]) -> Option<Rectangle> {
    let side_m = (size_m[0] + size_m[1]) / 2.0;
    let mut best: Option<(f64, Rectangle)> = None;
    // A rectangle repeats after half a turn; a square after a quarter, which then is tried twice.
    for step in 0..60 {
        let angle = f64::from(step) * std::f64::consts::PI / 60.0;
        for centre in starts(points, angle, size_m) {
            let rectangle = Rectangle { centre, angle };
            let cost = cost(points, &rectangle, size_m);
            if best.is_none_or(|(lowest, _)| cost < lowest) {
                best = Some((cost, rectangle));
            }
        }
    }
    let (mut lowest, mut rectangle) = best?;
    let mut step_m = 0.03 * side_m;
    while step_m > 0.0005 * side_m {
        let mut improved = false;
        for (dx, dy, turn) in [
            (1.0, 0.0, 0.0),
            (-1.0, 0.0, 0.0),
            (0.0, 1.0, 0.0),
            (0.0, -1.0, 0.0),
            (0.0, 0.0, 1.0),
            (0.0, 0.0, -1.0),
        ] {
            let tried = Rectangle {
                centre: rectangle.centre + Vector2::new(dx, dy) * step_m,
                angle: rectangle.angle + turn * step_m / side_m,
            };
            let cost = cost(points, &tried, size_m);
            if cost < lowest {
                (lowest, rectangle, improved) = (cost, tried, true);
            }
        }
        if !improved {
            step_m *= 0.6;
        }
    }
    Some(rectangle)
}

/// Centres that put the points' extent flush with one side, the other, or in the middle, per axis.
fn starts(points: &[Vector2<f64>], angle: f64, size_m: [f64; 2]) -> Vec<Vector2<f64>> {
    let (sin, cos) = angle.sin_cos();
    let axes = [Vector2::new(cos, sin), Vector2::new(-sin, cos)];
    let options = [0, 1].map(|k| {
        let mut along: Vec<f64> = points.iter().map(|p| axes[k].dot(p)).collect();
        along.sort_by(f64::total_cmp);
        let cut = along.len() / 200;
        let (low, high) = (along[cut], along[along.len() - 1 - cut]);
        [low + size_m[k] / 2.0, high - size_m[k] / 2.0, (low + high) / 2.0]
    });
    options[0].iter().flat_map(|a| options[1].iter().map(|b| axes[0] * *a + axes[1] * *b)).collect()
}

/// Robust misfit of the four sides: per stretch of a side, the distance from the side to the
/// outermost point, saturated where something hides it, dearer where points lie outside.
fn cost(points: &[Vector2<f64>], rectangle: &Rectangle, size_m: [f64; 2]) -> f64 {
    let (sin, cos) = rectangle.angle.sin_cos();
    // gaps[side][bin]: smallest distance inward from the side; negative is outside.
    let mut gaps = [[f64::INFINITY; BINS]; 4];
    let mut outside = 0.0;
    for point in points {
        let d = point - rectangle.centre;
        let at = [d.x * cos + d.y * sin, d.y * cos - d.x * sin];
        for axis in 0..2 {
            let other = 1 - axis;
            let bin =
                ((at[other] / size_m[other] + 0.5) * BINS as f64).clamp(0.0, BINS as f64 - 1.0);
            let low = at[axis] + size_m[axis] / 2.0;
            let high = size_m[axis] / 2.0 - at[axis];
            let bin = bin as usize;
            gaps[2 * axis][bin] = gaps[2 * axis][bin].min(low);
            gaps[2 * axis + 1][bin] = gaps[2 * axis + 1][bin].min(high);
            outside += (-low.min(high)).max(0.0);
        }
    }
    let scale = 0.015 * (size_m[0] + size_m[1]) / 2.0;
    let inward: f64 = gaps
        .iter()
        .flatten()
        .map(|gap| {
            let ratio = (gap.max(0.0) / scale).powi(2);
            if ratio.is_finite() { ratio / (1.0 + ratio) } else { 1.0 }
        })
        .sum();
    inward + 40.0 * outside / (scale * points.len() as f64)
}

/// The template's pose on the cloud: rigid, from several starts, by iterated closest points.
pub(crate) fn template_pose(
    cloud: &[ObservedPoint],
    template_m: &[[f32; 3]],
) -> Option<Vec<[f32; 3]>> {
    shape_pose(cloud, template_m, POINTS_MAX / 2)
}

/// The same of a folded sheet, as it was folded; fewer points, for a lost one asks in every frame.
pub(crate) fn folded_pose(cloud: &[ObservedPoint], folded_m: &[[f32; 3]]) -> Option<Vec<[f32; 3]>> {
    shape_pose(cloud, folded_m, FOLDED_POINTS_MAX)
}

fn shape_pose(
    cloud: &[ObservedPoint],
    shape_m: &[[f32; 3]],
    points_max: usize,
) -> Option<Vec<[f32; 3]>> {
    let step = cloud.len().div_ceil(points_max).max(1);
    let points: Vec<ObservedPoint> = cloud.iter().step_by(step).copied().collect();
    crate::align::iterated_closest_points(&points, shape_m)
}

/// Whether a pose is finite and not absurdly far from the cloud.
pub(crate) fn is_sane(pose_m: &[[f32; 3]], cloud: &[ObservedPoint]) -> bool {
    if !pose_m.iter().flatten().all(|c| c.is_finite()) {
        return false;
    }
    let positions: Vec<[f32; 3]> = cloud.iter().map(|p| p.position_m).collect();
    let ((low, high), (pose_low, pose_high)) = (bounds(&positions), bounds(pose_m));
    (0..3).all(|axis| pose_low[axis] < high[axis] + 1.0 && pose_high[axis] > low[axis] - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, UnitQuaternion};

    /// A dense cloud of the flat sheet in some pose, without the material where `hidden` holds.
    fn observe(
        sheet: &SheetGrid,
        pose: &Isometry3<f64>,
        hidden: impl Fn(f64, f64) -> bool,
    ) -> Vec<ObservedPoint> {
        let dense = SheetGrid::new(sheet.size_m, [61, 61]);
        let normal = pose * Vector3::z();
        dense
            .uv_m()
            .enumerate()
            .filter(|(_, [u, v])| !hidden(u / sheet.size_m[0], v / sheet.size_m[1]))
            .map(|(k, [u, v])| {
                let noise = 0.001 * ((k as f64 * 12.9898).sin() * 43758.5453).fract();
                let local =
                    Point3::new(u - sheet.size_m[0] / 2.0, v - sheet.size_m[1] / 2.0, noise);
                let p = pose * local;
                ObservedPoint {
                    position_m: [p.x as f32, p.y as f32, p.z as f32],
                    normal: [normal.x as f32, normal.y as f32, normal.z as f32],
                    camera: 0,
                    pixels: 1.0,
                }
            })
            .collect()
    }

    fn check(size_m: [f64; 2], angle: f64, hidden: impl Fn(f64, f64) -> bool) {
        let sheet = SheetGrid::new(size_m, [9, 9]);
        let turn = UnitQuaternion::from_euler_angles(0.4, -0.3, angle);
        let pose = Isometry3::from_parts(Vector3::new(0.1, -0.2, 0.6).into(), turn);
        let cloud = observe(&sheet, &pose, hidden);
        let truth: Vec<[f32; 3]> =
            observe(&sheet, &pose, |_, _| false).iter().map(|p| p.position_m).collect();
        let dense = SheetGrid::new(size_m, [61, 61]);
        let corner = |x: &[[f32; 3]], grid: &SheetGrid, i: usize, j: usize| {
            Point3::from(x[grid.index(i * (grid.nodes[0] - 1), j * (grid.nodes[1] - 1))])
        };
        let found = flat_pose(&cloud, &sheet, None).unwrap();
        let worst = sheet
            .turns()
            .iter()
            .map(|turn| {
                let turned: Vec<[f32; 3]> = turn.iter().map(|n| found[*n]).collect();
                [(0, 0), (0, 1), (1, 0), (1, 1)]
                    .into_iter()
                    .map(|(i, j)| {
                        (corner(&turned, &sheet, i, j) - corner(&truth, &dense, i, j)).norm()
                    })
                    .fold(0f32, f32::max)
            })
            .fold(f32::INFINITY, f32::min);
        assert!(worst < 0.004, "a corner is off by {} mm", worst * 1e3);
    }

    #[test]
    fn whole_sheets_are_found_at_any_angle() {
        for angle in [0.0, 0.35, 0.8, 1.5, 2.9] {
            check([0.21, 0.297], angle, |_, _| false);
            check([0.15, 0.15], angle, |_, _| false);
        }
    }

    #[test]
    fn hidden_parts_do_not_drag_the_rectangle() {
        check([0.21, 0.297], 0.6, |u, v| u > 0.7 && v > 0.75); // A hand over a corner.
        check([0.21, 0.297], 2.1, |u, v| v > 0.94 && (0.2..0.8).contains(&u)); // A clip.
        check([0.15, 0.15], 1.1, |u, v| u < 0.2 && (0.3..0.7).contains(&v));
    }

    #[test]
    fn what_hides_the_sheet_from_one_camera_does_not_turn_it_over() {
        let sheet = SheetGrid::new([0.15, 0.15], [9, 9]);
        let pose = Isometry3::translation(0.0, 0.0, 0.02);
        // From above a quarter is seen, from below all of it.
        let mut cloud = observe(&sheet, &pose, |u, v| u > 0.5 || v > 0.5);
        let below = observe(&sheet, &pose, |_, _| false).into_iter();
        cloud.extend(below.map(|p| ObservedPoint { normal: [0.0, 0.0, -1.0], camera: 1, ..p }));
        let up_m = |cloud: &[ObservedPoint]| {
            let nodes = flat_pose(cloud, &sheet, None).unwrap();
            let at = |i: usize, j: usize| Point3::from(nodes[sheet.index(i, j)]);
            (at(8, 0) - at(0, 0)).cross(&(at(0, 8) - at(0, 0))).z
        };
        assert!(up_m(&cloud) > 0.02);
        // Two that see it from below are more than one from above.
        let again: Vec<_> = cloud.iter().filter(|p| p.camera == 1).copied().collect();
        cloud.extend(again.into_iter().map(|p| ObservedPoint { camera: 2, ..p }));
        assert!(up_m(&cloud) < -0.02);
    }

    #[test]
    fn no_plane_no_pose() {
        let sheet = SheetGrid::new([0.15, 0.15], [9, 9]);
        assert_eq!(flat_pose(&[], &sheet, None), None);
        let mut blob = observe(&sheet, &Isometry3::identity(), |_, _| false);
        for (k, p) in blob.iter_mut().enumerate() {
            p.position_m[2] = 0.1 * ((k as f32 * 78.233).sin() * 43758.547).fract();
        }
        assert_eq!(flat_pose(&blob, &sheet, None), None);
        let one = vec![blob[0]; 100];
        assert_eq!(flat_pose(&one, &sheet, None), None);
    }
}
