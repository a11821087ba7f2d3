//! Cameras that cannot be right: what a wrong unit, frame or direction of a transform looks like.

use orime_geometry::nalgebra::{
    Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector2, Vector3,
};
use orime_geometry::{CameraModel, RgbdCamera};

/// Cameras of one scene are not farther apart, metres.
const APART_MAX_M: f64 = 20.0;
/// Two cameras are not nearer to each other, metres.
const APART_MIN_M: f64 = 0.005;
/// Depth and colour lens of one camera are not farther apart, metres, nor turned more, radians.
const LENSES_APART_M: f64 = 0.25;
const LENSES_TURNED_RAD: f64 = 0.35;
/// Units of depth that cameras use, metres.
const UNIT_M: std::ops::RangeInclusive<f64> = 1e-5..=1e-2;
/// Half a lens's field of view, radians.
const HALF_VIEW_RAD: std::ops::RangeInclusive<f64> = 0.08..=1.3;
/// What all cameras look at is so far from each, metres: no depth camera measures nearer.
const SCENE_M: std::ops::RangeInclusive<f64> = 0.12..=10.0;

/// Everything about the cameras that cannot be right, phrased for the person who set them up.
///
/// It looks at the calibration alone; [`doubts_of_depth`] looks at images.
pub fn doubts(cameras: &[RgbdCamera]) -> Vec<String> {
    let mut found = Vec::new();
    for camera in cameras {
        lens_doubts(&camera.name, "colour", &camera.color, &mut found);
        lens_doubts(&camera.name, "depth", &camera.depth, &mut found);
        unit_doubts(camera, &mut found);
    }
    for (k, a) in cameras.iter().enumerate() {
        for b in &cameras[k + 1..] {
            pair_doubts(a, b, &mut found);
        }
    }
    if found.is_empty() {
        found.extend(scene_doubt(cameras));
    }
    found
}

fn lens_doubts(name: &str, which: &str, lens: &CameraModel, found: &mut Vec<String>) {
    let sizes = [f64::from(lens.width), f64::from(lens.height)];
    let [focal, centre] = [[lens.fx_px, lens.fy_px], [lens.cx_px, lens.cy_px]];
    let odd_view = (0..2).any(|k| !HALF_VIEW_RAD.contains(&(sizes[k] / 2.0 / focal[k]).atan()));
    if odd_view {
        found.push(format!(
            "the {which} lens of `{name}` has focal lengths of {focal:?} px at {sizes:?} px: is it \
             of another resolution, or in millimetres?"
        ));
    }
    if (0..2).any(|k| (centre[k] - sizes[k] / 2.0).abs() > 0.25 * sizes[k]) {
        found.push(format!(
            "the principal point of the {which} lens of `{name}` is {centre:?} in an image of \
             {sizes:?} px, far from its middle: is it of another resolution?"
        ));
    }
    let ratio = lens.fx_px / lens.fy_px;
    if !(0.8..=1.25).contains(&ratio) {
        found.push(format!("the {which} lens of `{name}` has pixels {ratio:.2} times as wide"));
    }
}

fn unit_doubts(camera: &RgbdCamera, found: &mut Vec<String>) {
    let RgbdCamera { name, color_from_depth, depth_m_per_unit, .. } = camera;
    if !UNIT_M.contains(depth_m_per_unit) {
        found.push(format!(
            "a unit of depth of `{name}` is {depth_m_per_unit} m: RealSense has 0.001, and raw \
             depth is a whole number"
        ));
    }
    let apart_m = color_from_depth.translation.vector.norm();
    if apart_m > LENSES_APART_M {
        found.push(format!(
            "`color_from_depth` of `{name}` puts the lenses {apart_m:.3} m apart: is it in \
             millimetres, or is it `world_from_color`?"
        ));
    }
    let turned_rad = color_from_depth.rotation.angle();
    if turned_rad > LENSES_TURNED_RAD {
        found.push(format!(
            "`color_from_depth` of `{name}` turns by {:.0}°: both frames must be optical ones \
             (x right, y down, z forward)",
            turned_rad.to_degrees()
        ));
    }
}

fn pair_doubts(a: &RgbdCamera, b: &RgbdCamera, found: &mut Vec<String>) {
    let between = a.world_from_color.translation.vector - b.world_from_color.translation.vector;
    let (apart_m, a, b) = (between.norm(), &a.name, &b.name);
    if apart_m > APART_MAX_M {
        found.push(format!(
            "`{a}` and `{b}` stand {apart_m:.0} m apart: are translations in millimetres?"
        ));
    } else if apart_m < APART_MIN_M {
        found.push(format!(
            "`{a}` and `{b}` stand in the same place: `world_from_color` of one is missing; \
             `orime calibrate` finds it"
        ));
    }
}

/// Whether there is no place that all cameras look at, and what would make one.
fn scene_doubt(cameras: &[RgbdCamera]) -> Option<String> {
    let poses: Vec<Isometry3<f64>> = cameras.iter().map(|c| c.world_from_color).collect();
    if cameras.len() < 2 || all_see_one_place(cameras, &poses) {
        return None;
    }
    if let Some(one) = one_inverted(cameras, &poses) {
        return Some(format!(
            "the cameras look at no common place, but would if the pose of `{}` were inverted: \
             `world_from_color` maps the camera's coordinates into the world",
            cameras[one].name
        ));
    }
    Some(
        "the cameras look at no common place: do they watch the same sheet? `orime calibrate` \
         finds where they stand"
            .to_owned(),
    )
}

/// The poses of optical frames, if `poses` are those of ROS body frames (x forward, z up).
fn optical_from_body(poses: &[Isometry3<f64>]) -> Vec<Isometry3<f64>> {
    let body_from_optical =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::new(
            0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0,
        )));
    poses.iter().map(|pose| pose * body_from_optical).collect()
}

/// What depth images of one frame set say against the poses: surfaces that two cameras see lie in
/// different places, and would lie in one if the poses were inverted.
///
/// `depth_units[k]` is camera k's image, empty where there is none. A rig that looks at one place
/// does so inverted, too: only what it sees can tell.
pub fn doubts_of_depth(cameras: &[RgbdCamera], depth_units: &[Vec<u16>]) -> Option<String> {
    let poses: Vec<Isometry3<f64>> = cameras.iter().map(|c| c.world_from_color).collect();
    let share = |poses: &[Isometry3<f64>]| agreeing_share(cameras, poses, depth_units);
    let as_they_are = share(&poses)?;
    let inverted: Vec<_> = poses.iter().map(Isometry3::inverse).collect();
    let others = [
        (
            inverted,
            "all poses were inverted: `world_from_color` maps the camera's coordinates \
                    into the world, not the world's into the camera (RealSense's extrinsics and \
                    Kalibr's T_cn_cnm1 map A into B)",
        ),
        (
            optical_from_body(&poses),
            "the poses were of ROS body frames (x forward, z up): give \
                    those of the optical frames (x right, y down, z forward)",
        ),
    ];
    others.into_iter().find_map(|(other, what)| {
        let better = share(&other)?;
        (better >= SHARE_MIN && better >= SHARE_RATIO * as_they_are).then(|| {
            format!(
                "what two cameras see agrees for {:.1} % of the depth pixels, and would for \
                 {:.1} % if {what}",
                100.0 * as_they_are,
                100.0 * better
            )
        })
    })
}

/// Other poses are believed if this share of pixels agrees, and so many times as many as now.
const SHARE_MIN: f64 = 0.01;
const SHARE_RATIO: f64 = 3.0;
/// Every so many pixels along both sides are looked at.
const STRIDE_PX: usize = 6;
/// Depths agree within this, metres, and as a share.
const AGREE_M: f64 = 0.01;
const AGREE_SHARE: f64 = 0.02;

/// Share of the depth pixels of one camera that another camera sees at the same place; `None`
/// without pixels or without a second camera.
fn agreeing_share(
    cameras: &[RgbdCamera],
    poses: &[Isometry3<f64>],
    depth_units: &[Vec<u16>],
) -> Option<f64> {
    let (mut agree, mut looked_at) = (0u64, 0u64);
    for (a, from) in cameras.iter().enumerate() {
        for (b, to) in cameras.iter().enumerate().filter(|(b, _)| *b != a) {
            if depth_units[b].len() != to.depth.pixels() {
                continue;
            }
            let b_from_a =
                (poses[b] * to.color_from_depth).inverse() * (poses[a] * from.color_from_depth);
            for (px, depth_m) in samples(from, &depth_units[a]) {
                looked_at += 1;
                let p = b_from_a * Point3::from(from.depth.ray(px) * depth_m);
                let Some(px) = to.depth.project(&p) else { continue };
                let (x, y) = (px.x.round(), px.y.round());
                let inside = 0.0 <= x
                    && x < f64::from(to.depth.width)
                    && 0.0 <= y
                    && y < f64::from(to.depth.height);
                if inside {
                    let raw = depth_units[b][y as usize * to.depth.width as usize + x as usize];
                    let seen_m = f64::from(raw) * to.depth_m_per_unit;
                    let near = (seen_m - p.z).abs() < AGREE_M + AGREE_SHARE * p.z;
                    agree += u64::from(raw > 0 && near);
                }
            }
        }
    }
    (looked_at > 0).then(|| agree as f64 / looked_at as f64)
}

/// Some pixels with depth of an image, and their depth, metres.
fn samples<'a>(
    camera: &'a RgbdCamera,
    depth_units: &'a [u16],
) -> impl Iterator<Item = (Vector2<f64>, f64)> + 'a {
    let width = camera.depth.width as usize;
    let rows = depth_units.chunks_exact(width).enumerate().step_by(STRIDE_PX);
    rows.flat_map(move |(y, row)| {
        let with_depth = row.iter().enumerate().step_by(STRIDE_PX).filter(|(_, raw)| **raw > 0);
        with_depth.map(move |(x, raw)| {
            (Vector2::new(x as f64, y as f64), f64::from(*raw) * camera.depth_m_per_unit)
        })
    })
}

fn one_inverted(cameras: &[RgbdCamera], poses: &[Isometry3<f64>]) -> Option<usize> {
    (0..poses.len()).find(|k| {
        let mut changed = poses.to_vec();
        changed[*k] = changed[*k].inverse();
        all_see_one_place(cameras, &changed)
    })
}

/// Whether the place nearest to all optical axes is before all cameras and in their images.
fn all_see_one_place(cameras: &[RgbdCamera], poses: &[Isometry3<f64>]) -> bool {
    // Σ (1 − d dᵀ) x = Σ (1 − d dᵀ) eye
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for pose in poses {
        let direction = pose * Vector3::z();
        let across = Matrix3::identity() - direction * direction.transpose();
        matrix += across;
        right += across * pose.translation.vector;
    }
    // Cameras that look the same way have no nearest place: a little pull to one before them.
    let ahead: Vector3<f64> = poses.iter().map(|p| (p * Point3::new(0.0, 0.0, 0.5)).coords).sum();
    let pull = 1e-3;
    matrix += Matrix3::identity() * (pull * poses.len() as f64);
    right += ahead * pull;
    let Some(place) = matrix.lu().solve(&right) else { return true };
    cameras.iter().zip(poses).all(|(camera, pose)| {
        let seen = pose.inverse() * Point3::from(place);
        let [width, height] = [camera.color.width, camera.color.height].map(f64::from);
        SCENE_M.contains(&seen.z)
            && camera
                .color
                .project(&seen)
                .is_some_and(|px| (0.0..=width).contains(&px.x) && (0.0..=height).contains(&px.y))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cameras on a ring round the origin, looking at it from above.
    fn ring(n: usize) -> Vec<RgbdCamera> {
        let lens = CameraModel {
            width: 640,
            height: 480,
            fx_px: 610.0,
            fy_px: 609.0,
            cx_px: 325.0,
            cy_px: 243.0,
            distortion: [0.0; 5],
        };
        let camera = |k: usize| {
            let angle = 0.4 + k as f64 * 1.9;
            let (reach, height) = (0.6 + 0.13 * k as f64, 0.35 + 0.11 * k as f64);
            let eye = Point3::new(reach * angle.cos(), reach * angle.sin(), height);
            let up = -Vector3::z();
            let pose = Isometry3::face_towards(&eye, &Point3::new(0.02, 0.0, 0.01), &up);
            RgbdCamera {
                name: format!("c{k}"),
                color: lens.clone(),
                depth: lens.clone(),
                color_from_depth: Isometry3::translation(0.015, 0.0, 0.0),
                world_from_color: pose,
                depth_m_per_unit: 0.001,
            }
        };
        (0..n).map(camera).collect()
    }

    fn check(change: impl Fn(&mut Vec<RgbdCamera>), expected: &str) {
        let mut cameras = ring(3);
        change(&mut cameras);
        let found = doubts(&cameras).join("\n");
        assert!(found.contains(expected), "`{expected}` is not in `{found}`");
    }

    #[test]
    fn good_cameras_raise_no_doubt() {
        for n in 1..=5 {
            assert_eq!(doubts(&ring(n)), Vec::<String>::new(), "{n} cameras");
        }
    }

    #[test]
    fn each_mistake_is_named() {
        check(|c| c[1].depth_m_per_unit = 1.0, "unit of depth of `c1`");
        check(|c| c[0].color.fx_px = 1.93, "millimetres");
        check(|c| c[2].depth.cx_px = 640.0, "another resolution");
        check(|c| c[1].color_from_depth = Isometry3::translation(15.0, 0.0, 0.0), "millimetres");
        check(|c| c[1].color_from_depth = c[1].world_from_color, "optical");
        check(|c| c[1].world_from_color = c[0].world_from_color, "same place");
        let in_mm = |c: &mut Vec<RgbdCamera>| {
            for camera in c {
                camera.world_from_color.translation.vector *= 1000.0;
            }
        };
        check(in_mm, "m apart");
    }

    #[test]
    fn an_inverted_pose_is_recognised() {
        check(
            |c| c[2].world_from_color = c[2].world_from_color.inverse(),
            "if the pose of `c2` were inverted",
        );
    }
}
