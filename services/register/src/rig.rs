//! How far each camera stands from where its calibration says, learnt while tracking.
//!
//! Cameras that are nudged, or drift as they warm up, see the sheet beside where the others see it.
//! For each camera the small motion (t, ω) about its eye e is found that lays its points onto the
//! registered surface, and its contour onto the registered border:
//!
//! ```text
//! min Σ w (n·(x + t + ω × (x − e)) − n·y)² / Σ w, summed over the frames, + λ (|t|² + L² |ω|²)
//! ```
//!
//! with x as it would be seen without correction. For a point n is its normal and y where the
//! mixture has it; for a piece of contour n is the direction in which the contour is seen to move
//! the fastest. Frames fade slowly: poses that show a motion are remembered through those that do
//! not. About the eye, for there calibrations err by independent shifts and turns: one that is
//! seen to be off by more than its shift has turned, and is off elsewhere by as much as that turn
//! says. All is without a mean over the cameras: that the whole rig moved cannot be told from a
//! sheet that did (`services/simulate/src/alignment.rs` can, by grippers and table).

use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use orime_geometry::{ObservedPoint, RgbdCamera, fit};

/// What is left after a frame of what was known before it.
const KEPT: f64 = 1.0 - 1.0 / 300.0;
/// Frames that speak for a camera which stands as it is calibrated.
const PRIOR_FRAMES: f64 = 2.0;
/// Calibrations err by a turn as by a shift over so far, metres: 1 mm and 0.2°.
const PRIOR_LEVER_M: f64 = 0.29;
/// Points farther from the surface are of something else, metres.
const REACH_M: f64 = 0.008;
/// Least sum of weights that says something about a camera.
const WEIGHT_MIN: f64 = 30.0;
/// Largest correction, metres and radians.
const SHIFT_MAX_M: f64 = 0.02;
const TURN_MAX_RAD: f64 = 0.05;

/// What one point, or one piece of contour, says about its camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Word {
    pub camera: u32,
    /// Where it is seen, corrected as it is, metres.
    pub at_m: Vector3<f64>,
    /// Unit direction in which it is seen to be off.
    pub normal: Vector3<f64>,
    /// How far it must move that way, metres.
    pub way_m: f64,
    /// 1 for a point that is surely the sheet's.
    pub weight: f64,
}

/// One correction per camera.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rig {
    /// As the source calibrates them.
    given: Vec<RgbdCamera>,
    /// Where they are taken to stand.
    cameras: Vec<RgbdCamera>,
    /// Maps what a camera saw to where that is, world frame.
    corrections: Vec<Isometry3<f64>>,
    known: Vec<Known>,
}

impl Rig {
    /// Forgets what was learnt of other cameras.
    pub fn fit_to(&mut self, cameras: &[RgbdCamera]) {
        if self.given != cameras {
            self.given = cameras.to_vec();
            self.cameras = cameras.to_vec();
            self.corrections = vec![Isometry3::identity(); cameras.len()];
            self.known = vec![Known::default(); cameras.len()];
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
        let c = middle(points);
        let shifts = self.corrections.iter().map(|by| (by * c - c).norm());
        shifts.fold(0.0, f64::max) as f32
    }

    /// Learns from one frame.
    pub fn learn(&mut self, words: &[Word]) {
        let total: f64 = words.iter().map(|word| word.weight).sum();
        let sum: Vector3<f64> = words.iter().map(|word| word.at_m * word.weight).sum();
        let c = Point3::from(sum / total.max(1e-9));
        let mut seen = Vec::new();
        for (camera, given) in self.given.iter().enumerate() {
            let own = words.iter().filter(|word| word.camera as usize == camera);
            let eye = Point3::from(given.world_from_color.translation.vector);
            let known = &mut self.known[camera];
            if known.hear(own, &eye, &motion(&eye, &self.corrections[camera])) {
                self.corrections[camera] = about(&eye, &known.motion());
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

fn middle(points: &[ObservedPoint]) -> Point3<f64> {
    fit::centroid(points.iter().map(|point| Point3::from(point.position_m).cast()))
}

/// What is known of one camera: Σ w row rowᵀ and Σ w row way over the frames, a frame counting 1.
#[derive(Debug, Clone, Default)]
struct Known {
    normal: Matrix6<f64>,
    right: Vector6<f64>,
}

impl Known {
    /// Takes in a frame's words, seen while a motion about the camera's eye was applied. Whether
    /// they were enough.
    fn hear<'a>(
        &mut self,
        words: impl Iterator<Item = &'a Word>,
        eye: &Point3<f64>,
        applied: &Vector6<f64>,
    ) -> bool {
        let (mut normal, mut right, mut weights) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
        for word in words.filter(|word| word.way_m.abs() < REACH_M) {
            let (n, turn) = (word.normal, (word.at_m - eye.coords).cross(&word.normal));
            let row = Vector6::new(n.x, n.y, n.z, turn.x, turn.y, turn.z);
            normal += row * row.transpose() * word.weight;
            right += row * (word.weight * (word.way_m + row.dot(applied)));
            weights += word.weight;
        }
        if weights < WEIGHT_MIN {
            return false;
        }
        self.normal = self.normal * KEPT + normal / weights;
        self.right = self.right * KEPT + right / weights;
        true
    }

    /// The likeliest motion (t, ω) about the camera's eye.
    fn motion(&self) -> Vector6<f64> {
        let mut normal = self.normal;
        for k in 0..6 {
            normal[(k, k)] +=
                PRIOR_FRAMES * if k < 3 { 1.0 } else { PRIOR_LEVER_M * PRIOR_LEVER_M };
        }
        normal.cholesky().map_or_else(Vector6::zeros, |factor| factor.solve(&self.right))
    }
}

/// The rigid motion (t, ω) about `c`.
fn about(c: &Point3<f64>, motion: &Vector6<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(motion.fixed_rows::<3>(3).into_owned());
    let shift = motion.fixed_rows::<3>(0).into_owned();
    Translation3::from(c.coords + shift) * turn * Translation3::from(-c.coords)
}

/// … and back.
fn motion(c: &Point3<f64>, by: &Isometry3<f64>) -> Vector6<f64> {
    let (shift, turn) = (by * c - c, by.rotation.scaled_axis());
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

    const RADIUS_M: f64 = 0.06;

    /// Places on a half pipe.
    fn pipe_m() -> Vec<Vector3<f64>> {
        let grid = SheetGrid::new([0.15, 0.15], [31, 31]);
        let place = |[u, v]: [f64; 2]| {
            let (sin, cos) = ((u - 0.075) / RADIUS_M).sin_cos();
            Vector3::new(RADIUS_M * sin, v - 0.075, RADIUS_M * cos)
        };
        grid.uv_m().map(place).collect()
    }

    /// What a point that was seen there says about its camera.
    fn on_pipe(camera: u32, at_m: Vector3<f64>) -> Word {
        let across = Vector3::new(at_m.x, 0.0, at_m.z);
        let (normal, way_m) = (across.normalize(), RADIUS_M - across.norm());
        Word { camera, at_m, normal, way_m, weight: 1.0 }
    }

    /// Three cameras see a sheet bent to a half pipe; all stand elsewhere than they say.
    #[test]
    fn cameras_that_were_nudged_are_found_without_moving_the_rig() {
        let errors = [
            Isometry3::translation(-0.002, 0.0, 0.0),
            Isometry3::new(Vector3::new(0.0, 0.0, 0.003), Vector3::new(0.0, 0.015, 0.0)),
            Isometry3::new(Vector3::new(0.002, 0.0, -0.003), Vector3::new(0.0, -0.015, 0.0)),
        ];
        let seen: Vec<ObservedPoint> = (0..3u32)
            .flat_map(|camera| {
                pipe_m().into_iter().skip(camera as usize).step_by(3).map(move |x| (camera, x))
            })
            .map(|(camera, x)| ObservedPoint {
                position_m: (errors[camera as usize] * Point3::from(x)).coords.cast::<f32>().into(),
                normal: [0.0; 3],
                camera,
                pixels: 1.0,
            })
            .collect();
        let cameras = ["a", "b", "c"].map(camera);
        let mut rig = Rig::default();
        let words = |points: &[ObservedPoint]| -> Vec<Word> {
            points.iter().map(|p| on_pipe(p.camera, Vector3::from(p.position_m).cast())).collect()
        };
        let disagreement_mm = |points: &[ObservedPoint]| {
            let sum: f64 = words(points).iter().map(|word| word.way_m.abs()).sum();
            1e3 * sum / points.len() as f64
        };
        let mut points = seen.clone();
        let before_mm = disagreement_mm(&points);
        for _ in 0..200 {
            rig.fit_to(&cameras);
            points.clone_from(&seen);
            rig.correct(&mut points);
            rig.learn(&words(&points));
        }
        let after_mm = disagreement_mm(&points);
        assert!(before_mm > 1.0 && after_mm < 0.2 * before_mm, "{before_mm} mm, {after_mm} mm");
        let c = middle(&points);
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
        rig.learn(&words(&points[..20]));
        rig.learn(&[]);
        assert_eq!(rig.corrections, before);
        rig.fit_to(&cameras[..2]);
        assert_eq!(rig.corrections, vec![Isometry3::identity(); 2]);
    }

    /// A flat sheet shows nothing along itself; its contour does.
    #[test]
    fn contour_tells_where_a_flat_sheet_does_not() {
        let off_m = [Vector3::new(0.001, 0.0, 0.0), Vector3::new(-0.001, 0.0, 0.0)];
        let border = |camera: u32, correction: &Isometry3<f64>| {
            let side = move |k: i32| {
                let normal = Vector3::x() * if k % 2 == 0 { 1.0 } else { -1.0 };
                (normal * 0.075 + Vector3::y() * (0.005 * f64::from(k) - 0.15), normal)
            };
            let at =
                |x: Vector3<f64>| (correction * Point3::from(x + off_m[camera as usize])).coords;
            (0..60)
                .map(side)
                .map(|(x, normal)| Word {
                    camera,
                    at_m: at(x),
                    normal,
                    way_m: normal.dot(&(x - at(x))),
                    weight: 1.0,
                })
                .collect::<Vec<Word>>()
        };
        let mut rig = Rig::default();
        rig.fit_to(&["a", "b"].map(camera));
        for _ in 0..200 {
            let words = [0, 1].map(|k| border(k, &rig.corrections[k as usize])).concat();
            rig.learn(&words);
        }
        for (correction, off_m) in rig.corrections.iter().zip(off_m) {
            let left_m = (correction.translation.vector + off_m).norm();
            assert!(left_m < 2e-4, "{correction} for {off_m}");
        }
    }
}
