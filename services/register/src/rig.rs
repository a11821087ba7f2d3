//! How far each camera stands from where its calibration says, learnt while tracking.
//!
//! Cameras that are nudged, or drift as they warm up, see the sheet beside where the others see it.
//! For each camera the small motion (t, ω) about the middle c of its points is found that lays them
//! onto the registered surface, point to plane:
//!
//! ```text
//! min Σ (n·(x + t + ω × (x − c) − y))² + λ (|t|² + L² |ω|²)
//! ```
//!
//! with y the nearest point of the surface and n its normal there. What the surface does not show,
//! such as a motion along a flat sheet, stays as it is. Corrections follow slowly, without a mean:
//! that the whole rig moved cannot be told from a sheet that did.

use nalgebra::{
    Isometry3, Matrix6, Point3, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6,
};
use orime_geometry::{ObservedPoint, RgbdCamera, Surface};

/// Share of a found motion by which a correction follows in one frame.
const RATE: f64 = 0.05;
/// Points farther from the surface are of something else, metres.
const REACH_M: f32 = 0.008;
/// Fewest points that say something about a camera.
const POINTS_MIN: usize = 60;
/// λ as a share of the number of points.
const RIDGE: f64 = 0.03;
/// Largest correction, metres and radians.
const SHIFT_MAX_M: f64 = 0.02;
const TURN_MAX_RAD: f64 = 0.05;

/// One correction per camera.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rig {
    /// As the source calibrates them.
    given: Vec<RgbdCamera>,
    /// Where they are taken to stand.
    cameras: Vec<RgbdCamera>,
    /// Maps what a camera saw to where that is, world frame.
    corrections: Vec<Isometry3<f64>>,
}

impl Rig {
    /// Forgets what was learnt of other cameras.
    pub fn fit_to(&mut self, cameras: &[RgbdCamera]) {
        if self.given != cameras {
            self.given = cameras.to_vec();
            self.cameras = cameras.to_vec();
            self.corrections = vec![Isometry3::identity(); cameras.len()];
        }
    }

    /// Where the cameras are taken to stand.
    pub fn cameras(&self) -> &[RgbdCamera] {
        &self.cameras
    }

    /// Moves points to where they are.
    pub fn correct(&self, points: &mut [ObservedPoint]) {
        let corrections: Vec<Isometry3<f32>> =
            self.corrections.iter().map(|correction| correction.cast()).collect();
        for point in points {
            let Some(correction) = corrections.get(point.camera as usize) else { continue };
            point.position_m = (correction * Point3::from(point.position_m)).coords.into();
            point.normal = (correction * Vector3::from(point.normal)).into();
        }
    }

    /// Farthest that a correction moves a point in the middle of `points`, metres.
    pub fn shift_m(&self, points: &[ObservedPoint]) -> f32 {
        let c = middle(points.iter());
        let shifts = self.corrections.iter().map(|by| (by * c - c).norm());
        shifts.fold(0.0, f64::max) as f32
    }

    /// Learns from points, corrected as they are, and the surface that was registered to them.
    pub fn learn(
        &mut self,
        points: &[ObservedPoint],
        nodes_m: &[[f32; 3]],
        triangles: &[[u32; 3]],
    ) {
        let c = middle(points.iter());
        let surface = Sheet { surface: Surface::new(nodes_m, triangles), nodes_m, triangles };
        let mut seen = Vec::new();
        for (camera, correction) in self.corrections.iter_mut().enumerate() {
            let own = points.iter().filter(|point| point.camera as usize == camera);
            if let Some(step) = step(own, &surface, &c) {
                *correction = about(&c, &(RATE * step)) * *correction;
                seen.push(camera);
            }
        }
        let moves: Vec<Vector6<f64>> =
            seen.iter().map(|camera| motion(&c, &self.corrections[*camera])).collect();
        if moves.is_empty() {
            return;
        }
        let mean = moves.iter().sum::<Vector6<f64>>() / moves.len() as f64;
        for (camera, own) in seen.into_iter().zip(moves) {
            let mut own = own - mean;
            let shift = own.fixed_rows::<3>(0).norm() / SHIFT_MAX_M;
            let turn = own.fixed_rows::<3>(3).norm() / TURN_MAX_RAD;
            own /= shift.max(turn).max(1.0);
            self.corrections[camera] = about(&c, &own);
        }
        for ((camera, given), by) in self.cameras.iter_mut().zip(&self.given).zip(&self.corrections)
        {
            camera.world_from_color = by * given.world_from_color;
        }
    }
}

fn middle<'a>(points: impl Iterator<Item = &'a ObservedPoint>) -> Point3<f64> {
    let (sum, count) = points.fold((Vector3::zeros(), 0.0), |(sum, count), point| {
        (sum + Vector3::from(point.position_m.map(f64::from)), count + 1.0)
    });
    Point3::from(sum / f64::max(count, 1.0))
}

/// What was registered.
struct Sheet<'a> {
    surface: Surface<'a>,
    nodes_m: &'a [[f32; 3]],
    triangles: &'a [[u32; 3]],
}

impl Sheet<'_> {
    /// The nearest point of the surface and its normal, if it is within reach.
    fn near(&self, point_m: [f32; 3]) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let near = self.surface.nearest(point_m).filter(|near| near.distance_m < REACH_M)?;
        let corners = self.triangles[near.triangle as usize];
        let [a, b, c] =
            corners.map(|node| Vector3::from(self.nodes_m[node as usize].map(f64::from)));
        let [u, v, w] = near.weights.map(f64::from);
        let normal = (b - a).cross(&(c - a)).try_normalize(1e-12)?;
        Some((a * u + b * v + c * w, normal))
    }
}

/// The motion about `c` that lays a camera's points onto the surface; `None` if they are too few.
fn step<'a>(
    points: impl Iterator<Item = &'a ObservedPoint>,
    surface: &Sheet<'_>,
    c: &Point3<f64>,
) -> Option<Vector6<f64>> {
    let (mut normal, mut right, mut used, mut arm_m2) =
        (Matrix6::zeros(), Vector6::zeros(), 0, 0.0);
    for point in points {
        let Some((y, n)) = surface.near(point.position_m) else { continue };
        let x = Vector3::from(point.position_m.map(f64::from));
        let arm = x - c.coords;
        let turn = arm.cross(&n);
        let row = Vector6::new(n.x, n.y, n.z, turn.x, turn.y, turn.z);
        normal += row * row.transpose();
        right += row * n.dot(&(y - x));
        arm_m2 += arm.norm_squared();
        used += 1;
    }
    if used < POINTS_MIN {
        return None;
    }
    // L² is the mean square distance from c: both kinds of motion cost by what they move.
    let ridge = RIDGE * used as f64;
    for k in 0..6 {
        normal[(k, k)] += if k < 3 { ridge } else { ridge * arm_m2 / used as f64 };
    }
    normal.cholesky().map(|factor| factor.solve(&right))
}

/// The rigid motion (t, ω) about `c`.
fn about(c: &Point3<f64>, motion: &Vector6<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(motion.fixed_rows::<3>(3).into_owned());
    let shift = motion.fixed_rows::<3>(0).into_owned();
    Translation3::from(c.coords + shift) * turn * Translation3::from(-c.coords)
}

/// … and back.
fn motion(c: &Point3<f64>, by: &Isometry3<f64>) -> Vector6<f64> {
    let (shift, turn) = (by * c - c, Rotation3::from(by.rotation).scaled_axis());
    Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::{CameraModel, SheetGrid};

    fn camera(name: &str) -> RgbdCamera {
        let lens = CameraModel {
            width: 640,
            height: 480,
            fx_px: 600.0,
            fy_px: 600.0,
            cx_px: 320.0,
            cy_px: 240.0,
            distortion: [0.0; 5],
        };
        RgbdCamera {
            name: name.into(),
            color: lens.clone(),
            depth: lens,
            color_from_depth: Isometry3::identity(),
            world_from_color: Isometry3::translation(0.0, 0.0, -0.5),
            depth_m_per_unit: 0.001,
        }
    }

    /// Three cameras see a sheet bent to a half pipe; all stand elsewhere than they say.
    #[test]
    fn cameras_that_were_nudged_are_found_without_moving_the_rig() {
        let grid = SheetGrid::new([0.15, 0.15], [31, 31]);
        let (radius_m, triangles) = (0.06, grid.triangles());
        let nodes_m: Vec<[f32; 3]> = grid
            .uv_m()
            .map(|[u, v]| {
                let (sin, cos) = ((u - 0.075) / radius_m).sin_cos();
                [radius_m * sin, v - 0.075, radius_m * cos].map(|x| x as f32)
            })
            .collect();
        let errors = [
            Isometry3::translation(-0.002, 0.0, 0.0),
            Isometry3::new(Vector3::new(0.0, 0.0, 0.003), Vector3::new(0.0, 0.015, 0.0)),
            Isometry3::new(Vector3::new(0.002, 0.0, -0.003), Vector3::new(0.0, -0.015, 0.0)),
        ];
        let seen: Vec<ObservedPoint> = (0..3u32)
            .flat_map(|camera| {
                nodes_m.iter().skip(camera as usize).step_by(3).map(move |x| (camera, *x))
            })
            .map(|(camera, x)| ObservedPoint {
                position_m: (errors[camera as usize].cast::<f32>() * Point3::from(x)).coords.into(),
                normal: [0.0; 3],
                camera,
                pixels: 1.0,
            })
            .collect();
        let cameras = ["a", "b", "c"].map(camera);
        let mut rig = Rig::default();
        let disagreement_mm = |points: &[ObservedPoint]| {
            let surface = Surface::new(&nodes_m, &triangles);
            let sum: f32 = points.iter().map(|p| surface.distance_m(p.position_m)).sum();
            1e3 * sum / points.len() as f32
        };
        let mut points = seen.clone();
        let before_mm = disagreement_mm(&points);
        for _ in 0..200 {
            rig.fit_to(&cameras);
            points.clone_from(&seen);
            rig.correct(&mut points);
            rig.learn(&points, &nodes_m, &triangles);
        }
        let after_mm = disagreement_mm(&points);
        assert!(before_mm > 1.0 && after_mm < 0.2 * before_mm, "{before_mm} mm, {after_mm} mm");
        let c = middle(points.iter());
        let moves = rig.corrections.iter().map(|by| motion(&c, by));
        let mean = moves.sum::<Vector6<f64>>() / 3.0;
        assert!(mean.norm() < 1e-4, "the rig has moved: {mean}");
        assert!(rig.shift_m(&points) > 0.002);
        // The camera stands where its points say.
        let off = rig.cameras()[1].world_from_color.inverse()
            * (rig.corrections[1] * cameras[1].world_from_color);
        assert!(off.translation.vector.norm() < 1e-12);
        // Others, and a part of the surface that is too small, teach nothing.
        let before = rig.corrections.clone();
        rig.learn(&points[..40], &nodes_m, &triangles);
        assert_eq!(rig.corrections, before);
        rig.fit_to(&cameras[..2]);
        assert_eq!(rig.corrections, vec![Isometry3::identity(); 2]);
    }
}
