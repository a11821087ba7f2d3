//! What each camera's depth errs by as a whole, learnt while tracking.
//!
//! Stereo cameras read a few millimetres short or long, each its own amount and steadily. The
//! contour and the other cameras show it: along a camera's rays r, with d = y − x the way from an
//! observed point to the registered surface and n the surface's normal,
//!
//! ```text
//! b = Σ p (r·d) / Σ p (r·n)²        d ≈ n (n·d), for only the way across the surface is seen
//! ```
//!
//! and the camera's correction follows b from frame to frame.

use crate::cloud::Cloud;
use crate::mixture::Answer;
use nalgebra::Vector3;
use orime_geometry::{ObservedPoint, RgbdCamera};

/// Share of the found error by which a correction follows in one frame.
const RATE: f64 = 0.15;
/// Frames over which corrections follow faster, at first.
const FRAMES_FAST: f64 = 10.0;
/// Largest correction, metres.
const CORRECTION_MAX_M: f64 = 0.02;
/// (r·n)² of points whose normal is not known.
const FACING_USUAL: f64 = 0.5;
/// Fewest points that say something about a camera.
const MASS_MIN: f64 = 30.0;

/// Sums over a camera's points in one E-step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct RaySums {
    /// Σ p.
    mass: f64,
    /// Σ p (r·(x − y)), metres.
    toward_m: f64,
}

/// One correction per camera.
#[derive(Debug, Clone, Default)]
pub(crate) struct DepthBias {
    /// Camera centres, world frame, metres.
    eyes_m: Vec<[f32; 3]>,
    /// By how much a camera's depth is lengthened, metres.
    corrections_m: Vec<f64>,
    frames: Vec<f64>,
    /// Σ (r·n)² and number of points, per camera, in this frame.
    facing: Vec<(f64, f64)>,
}

impl DepthBias {
    /// Forgets what was learnt of other cameras.
    pub fn fit_to(&mut self, cameras: &[RgbdCamera]) {
        let eye = |camera: &RgbdCamera| -> [f32; 3] {
            camera.world_from_depth().translation.vector.cast::<f32>().into()
        };
        if !self.eyes_m.iter().copied().eq(cameras.iter().map(eye)) {
            self.eyes_m = cameras.iter().map(eye).collect();
            self.corrections_m = vec![0.0; cameras.len()];
            self.frames = vec![0.0; cameras.len()];
        }
        self.facing.clear();
        self.facing.resize(cameras.len(), (0.0, 0.0));
    }

    /// The point where its camera's depth would be without error.
    pub fn corrected(&mut self, point: &ObservedPoint) -> [f32; 3] {
        let camera = point.camera as usize;
        let Some(eye) = self.eyes_m.get(camera) else { return point.position_m };
        let x = Vector3::from(point.position_m);
        let Some(ray) = (x - Vector3::from(*eye)).try_normalize(1e-6) else {
            return point.position_m;
        };
        let (sum, count) = &mut self.facing[camera];
        let cosine = f64::from(ray.dot(&Vector3::from(point.normal)));
        *sum += if cosine == 0.0 { FACING_USUAL } else { cosine * cosine };
        *count += 1.0;
        (x + ray * self.corrections_m[camera] as f32).into()
    }

    /// Learns from what a frame's last E-step said about its points, each of which stands for
    /// `weight` of them.
    pub fn learn(&mut self, cloud: &Cloud, answers: &[Answer], weight: f64) {
        let mut sums = vec![RaySums::default(); self.eyes_m.len()];
        for answer in answers {
            let camera = cloud.cameras[answer.point] as usize;
            let Some(eye) = self.eyes_m.get(camera) else { continue };
            let ray = Vector3::from(cloud.points_m[answer.point]) - Vector3::from(*eye);
            let Some(ray) = ray.try_normalize(1e-6) else { continue };
            sums[camera].mass += weight * f64::from(answer.mass);
            sums[camera].toward_m += weight * f64::from(ray.dot(&Vector3::from(answer.away_m)));
        }
        self.follow(&sums);
    }

    fn follow(&mut self, sums: &[RaySums]) {
        for (camera, sums) in sums.iter().enumerate().take(self.corrections_m.len()) {
            let (facing, count) = self.facing[camera];
            if sums.mass < MASS_MIN || facing <= 0.0 {
                continue;
            }
            let error_m = -sums.toward_m / (sums.mass * facing / count);
            self.frames[camera] += 1.0;
            let rate = RATE * (1.0 + FRAMES_FAST / self.frames[camera]).min(4.0);
            let corrected = self.corrections_m[camera] + rate * error_m;
            self.corrections_m[camera] = corrected.clamp(-CORRECTION_MAX_M, CORRECTION_MAX_M);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::CameraModel;
    use orime_geometry::nalgebra::Isometry3;

    #[test]
    fn a_camera_that_reads_short_is_found_out() {
        let lens = CameraModel {
            width: 640,
            height: 480,
            fx_px: 600.0,
            fy_px: 600.0,
            cx_px: 320.0,
            cy_px: 240.0,
            distortion: [0.0; 5],
        };
        let camera = RgbdCamera {
            name: "overhead".into(),
            color: lens.clone(),
            depth: lens,
            color_from_depth: Isometry3::identity(),
            world_from_color: Isometry3::identity(),
            depth_m_per_unit: 0.001,
        };
        // A plane at 0.5 m, facing the camera at 60 degrees, read 4 mm short along the ray.
        let point = ObservedPoint {
            position_m: [0.0, 0.0, 0.496],
            normal: [0.866, 0.0, -0.5],
            camera: 0,
            pixels: 1.0,
        };
        let mut bias = DepthBias::default();
        for _ in 0..60 {
            bias.fit_to(std::slice::from_ref(&camera));
            let seen = bias.corrected(&point);
            // Across the surface the point is this far in front of it; along it nobody can tell.
            let across_m = (0.5 - f64::from(seen[2])) * 0.5;
            // toward = r·(x − y), and y − x is the normal's part: r·n = −0.5.
            let sums = RaySums { mass: 100.0, toward_m: -100.0 * across_m * 0.5 };
            bias.follow(&[sums]);
        }
        bias.fit_to(std::slice::from_ref(&camera));
        assert!((f64::from(bias.corrected(&point)[2]) - 0.5).abs() < 1e-4);
        // Few points, or another camera, teach nothing.
        bias.follow(&[RaySums { mass: 5.0, toward_m: 1.0 }]);
        assert!((f64::from(bias.corrected(&point)[2]) - 0.5).abs() < 1e-4);
        bias.fit_to(&[RgbdCamera {
            world_from_color: Isometry3::translation(1.0, 0.0, 0.0),
            ..camera
        }]);
        assert_eq!(bias.corrected(&point), point.position_m);
    }
}
