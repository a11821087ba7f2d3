//! Depth that reads short, drawn into images of a cube with markers: what the whole of calibration,
//! from pixels on, says of it.

use orime_calibrate::fit::fit;
use orime_calibrate::observe::{Observations, observe};
use orime_capture::{FrameError, FrameReport, FrameSource, TargetKind};
use orime_geometry::nalgebra::{Isometry3, Point3, UnitQuaternion, Vector2, Vector3};
use orime_geometry::{CameraModel, RgbdCamera, RgbdFrameMut, SheetGrid};
use orime_markers::{Detector, DetectorParams, Dictionary, moved_outwards};

/// As `three_cameras`: a cube of 30 mm with markers of 22 mm, seen from half a metre.
const CUBE_M: f64 = 0.030;
const SIDE_M: f64 = 0.022;
/// What that recording's source says of its cameras: they read short, all of them.
const BIAS_M: [f64; 3] = [-0.005, -0.004, -0.0055];
/// Brightness of background, paper and ink.
const GREY: [f64; 3] = [110.0, 225.0, 30.0];
/// Rays a pixel, along each side.
const RAYS: usize = 4;
const UNIT_M: f64 = 0.001;
/// Blur of a lens (σ), pixels.
const LENS_PX: f64 = 0.5;

/// A number in [-1, 1] that follows from `at`.
fn noise(at: u64) -> f64 {
    let mut x = at.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Light of a display's level, 0 to 255, and the other way round (sRGB).
fn light(level: f64) -> f64 {
    let x = level / 255.0;
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

fn display(light: f64) -> f64 {
    let low = light <= 0.003_130_8;
    255.0 * if low { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// Cameras round a cube that is turned from step to step.
struct Drawn {
    cameras: Vec<RgbdCamera>,
    dictionary: Dictionary,
    /// Whether light is mixed by a lens before the display's curve, as in a camera; without, pixels
    /// are sharp and mix what is displayed.
    curve: bool,
}

impl Drawn {
    fn new(curve: bool) -> Self {
        let lens = CameraModel {
            width: 640,
            height: 480,
            fx_px: 612.0,
            fy_px: 611.0,
            cx_px: 322.0,
            cy_px: 243.0,
            distortion: [0.0; 5],
        };
        let eyes = [[0.36, 0.08, 0.26], [-0.22, 0.36, 0.24], [-0.18, -0.40, 0.30]];
        let camera = |(k, eye): (usize, &[f64; 3])| RgbdCamera {
            name: format!("cam{k}"),
            depth: lens.clone(),
            color: lens.clone(),
            color_from_depth: Isometry3::identity(),
            world_from_color: Isometry3::face_towards(
                &Point3::from(*eye),
                &Point3::origin(),
                &-Vector3::z(),
            ),
            depth_m_per_unit: UNIT_M,
        };
        Self {
            cameras: eyes.iter().enumerate().map(camera).collect(),
            dictionary: Dictionary::predefined("DICT_4X4_50").unwrap(),
            curve,
        }
    }

    /// What a pixel mixes of a level.
    fn mixed(&self, level: f64) -> f64 {
        if self.curve { light(level) } else { level }
    }

    /// Levels of a row-major image of what pixels have mixed.
    fn exposed(&self, mixed: &[f64], width: usize) -> Vec<f64> {
        if !self.curve {
            return mixed.to_vec();
        }
        let weight = |k: isize| (-0.5 * (k as f64 / LENS_PX).powi(2)).exp();
        let total: f64 = (-2..=2).map(weight).sum();
        // The border shows background only.
        let pass = |image: &[f64], step: isize| -> Vec<f64> {
            let at = |k: isize| image[k.clamp(0, image.len() as isize - 1) as usize];
            let blurred = |k: isize| (-2..=2).map(|n| weight(n) * at(k + n * step)).sum::<f64>();
            (0..image.len() as isize).map(|k| blurred(k) / total).collect()
        };
        let blurred = pass(&pass(mixed, 1), width as isize);
        blurred.into_iter().map(display).collect()
    }

    /// Poses of the five faces that have markers, in a camera.
    fn faces(&self, step: u64, camera: usize) -> Vec<Isometry3<f64>> {
        let random = |k: u64| noise(100 * step + k);
        let place = Vector3::new(0.06 * random(0), 0.06 * random(1), 0.03 * random(2));
        let turn = Vector3::new(0.5 * random(3), 0.5 * random(4), 3.0 * random(5));
        let pose = self.cameras[camera].world_from_color.inverse() * Isometry3::new(place, turn);
        let quarter = std::f64::consts::FRAC_PI_2;
        let about = |axis, k: f64| UnitQuaternion::from_axis_angle(&axis, k * quarter);
        // A face looks along its own -z; the one that lies on the table has none.
        let top = about(Vector3::x_axis(), 2.0);
        let sides = (0..4).map(|k| about(Vector3::z_axis(), f64::from(k)));
        let sides = sides.map(|turn| turn * about(Vector3::x_axis(), 1.0));
        let out = Isometry3::translation(0.0, 0.0, -CUBE_M / 2.0);
        [top].into_iter().chain(sides).map(|turn| pose * turn * out).collect()
    }

    /// The face that a line of sight (z = 1) meets: brightness and depth, metres.
    fn look(&self, faces: &[Isometry3<f64>], ray: &Vector3<f64>) -> Option<(f64, f64)> {
        faces.iter().enumerate().find_map(|(id, face)| {
            let normal = face * Vector3::z();
            let facing = normal.dot(ray);
            let depth_m = normal.dot(&face.translation.vector) / facing;
            let at = face.inverse_transform_point(&Point3::from(ray * depth_m));
            // Its back is behind others of the cube.
            (facing > 0.0 && at.x.abs().max(at.y.abs()) <= CUBE_M / 2.0)
                .then(|| (GREY[1 + usize::from(self.is_ink(id, at))], depth_m))
        })
    }

    fn is_ink(&self, id: usize, at: Point3<f64>) -> bool {
        let modules = self.dictionary.modules();
        let [column, row] =
            [at.x, at.y].map(|x| ((x / SIDE_M + 0.5) * modules as f64).floor() as i64);
        let inside = |k: i64| (0..modules as i64).contains(&k);
        inside(row)
            && inside(column)
            && self.dictionary.is_black(id as u32, row as usize, column as usize)
    }
}

impl FrameSource for Drawn {
    fn cameras(&self) -> &[RgbdCamera] {
        &self.cameras
    }

    fn steps(&self) -> Option<u64> {
        Some(24)
    }

    fn exposure_ns(&self, step: u64, _: usize) -> u64 {
        step
    }

    fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<FrameReport, FrameError> {
        let faces = self.faces(step, camera);
        let lens = &self.cameras[camera].color;
        // The cube's middle is behind its first face.
        let middle = faces[0] * Point3::new(0.0, 0.0, CUBE_M / 2.0);
        let center = lens.project(&middle).unwrap();
        let reach_px = lens.fx_px * CUBE_M / (middle.z - CUBE_M);
        let background = self.mixed(GREY[0]);
        let mut mixed = vec![background; lens.pixels()];
        let random =
            |at: usize, k: u64| noise(((step * 3 + camera as u64) << 32) + ((at as u64) << 2) + k);
        for (at, mixed) in mixed.iter_mut().enumerate() {
            let pixel = Vector2::new((at % 640) as f64, (at / 640) as f64);
            let mut hit = None;
            if (pixel - center).norm() < reach_px {
                let place = |k: usize| (k as f64 + 0.5) / RAYS as f64 - 0.5;
                let rays = (0..RAYS * RAYS).map(|k| Vector2::new(place(k % RAYS), place(k / RAYS)));
                let seen = rays.map(|offset| self.look(&faces, &lens.ray(pixel + offset)));
                let seen = seen.map(|seen| seen.map_or(background, |(grey, _)| self.mixed(grey)));
                *mixed = seen.sum::<f64>() / (RAYS * RAYS) as f64;
                hit = self.look(&faces, &lens.ray(pixel));
            }
            let spread_m = 0.0006 * (random(at, 1) + random(at, 2));
            frame.depth_units[at] = hit.map_or(0, |(_, depth_m)| {
                ((depth_m + BIAS_M[camera] + spread_m) / UNIT_M).round() as u16
            });
        }
        for (at, level) in self.exposed(&mixed, 640).into_iter().enumerate() {
            let grey = (level + 2.0 * random(at, 0) + 0.5) as u8;
            frame.color_rgb[3 * at..3 * at + 3].fill(grey);
        }
        Ok(FrameReport { copies: 0 })
    }

    fn truth_m(&self, _: u64, _: &SheetGrid, _: &mut [[f32; 3]]) -> bool {
        false
    }
}

fn seen_by(source: &mut Drawn) -> Observations {
    let config = DetectorParams::default().check().unwrap();
    let mut detector = Detector::new(&config, Dictionary::predefined("DICT_4X4_50").unwrap());
    let seen = observe(source, &mut detector, SIDE_M, 24);
    assert!(seen.views.len() > 100, "{} markers", seen.views.len());
    seen
}

/// What the fit says beyond each camera's bias, metres.
fn errors_m(seen: &Observations, what: &str) -> [f64; 3] {
    let found = fit(seen, TargetKind::Rigid, |_| true).unwrap();
    [0, 1, 2].map(|camera| {
        let (offset_m, bias_m) = (found.depth[camera].unwrap().offset_m, BIAS_M[camera]);
        let [offset_mm, bias_mm] = [offset_m, bias_m].map(|m| m * 1e3);
        println!("{what}: camera {camera}: bias {offset_mm:.2} mm of {bias_mm:.2}");
        offset_m - bias_m
    })
}

/// The views with squares that are moved outwards, pixels.
fn moved(source: &Drawn, mut seen: Observations, shift_px: [f64; 3]) -> Observations {
    for view in &mut seen.views {
        let lens = &source.cameras[view.camera].color;
        let corners_px = view.rays.map(|ray| lens.project(&ray.push(1.0).into()).unwrap().into());
        let corners_px = moved_outwards(&corners_px, shift_px[view.camera]);
        view.rays = corners_px.map(|px| lens.ray(Vector2::from(px)).xy());
    }
    seen
}

#[test]
fn depth_that_reads_short_is_found_from_pixels() {
    let mut source = Drawn::new(false);
    let seen = seen_by(&mut source);
    let shift = seen.border_shift.as_ref().unwrap();
    assert!(shift.used_px.iter().all(|px| px.abs() < 0.03), "{shift:?}");
    for error_m in errors_m(&seen, "sharp") {
        assert!(error_m.abs() < 0.5e-3, "{error_m}");
    }
    // Corners half a pixel inside their true place make every marker look farther, and its depth
    // still shorter: that is how depth that is right comes to look 5 mm short.
    for error_m in errors_m(&moved(&source, seen, [-0.5 / 2.0_f64.sqrt(); 3]), "inset") {
        assert!(error_m < -2e-3, "{error_m}");
    }
}

#[test]
fn a_camera_s_curve_does_not_pass_for_a_depth_bias() {
    let mut source = Drawn::new(true);
    let seen = seen_by(&mut source);
    let shift = seen.border_shift.clone().unwrap();
    println!("{shift:?}");
    for error_m in errors_m(&seen, "curve") {
        assert!(error_m.abs() < 0.7e-3, "{error_m}");
    }
    // Squares as they look, by which the markers were calibrated before.
    let back = [0, 1, 2].map(|camera| -shift.used_px[camera]);
    for error_m in errors_m(&moved(&source, seen, back), "curve, squares as they look") {
        assert!(error_m < -2e-3, "{error_m}");
    }
}
