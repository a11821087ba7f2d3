//! Calibration of cameras whose truth is known, and of three real ones.

use std::path::{Path, PathBuf};

use orime_calibrate::agreement::left_out;
use orime_calibrate::command::{Arguments, run};
use orime_calibrate::fit::{FitError, fit};
use orime_calibrate::observe::{DepthSample, Observations, View, plane_depth_m};
use orime_calibrate::square::{corners_m, square_poses};
use orime_calibration::{Calibration, doubts, doubts_of_depth};
use orime_capture::{CaptureParams, FrameSource, TargetKind, open};
use orime_geometry::nalgebra::{Isometry3, Point3, UnitQuaternion, Vector2, Vector3};
use orime_geometry::{CameraModel, RgbdCamera, RgbdFrameMut, SheetParams};
use orime_runtime::SetFile;

const SIDE_M: f64 = 0.04;
/// Depth errors of the cameras: measured = scale · true + bias.
const BIAS_M: [f64; 3] = [-0.0045, 0.002, 0.0];
const SCALE: [f64; 3] = [1.0, 1.0, 1.0];

/// A fixed sequence of numbers in [-1, 1].
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Roughly normal with this deviation.
    fn normal(&mut self, sigma: f64) -> f64 {
        (0..4).map(|_| self.next()).sum::<f64>() * sigma * (3.0f64 / 4.0).sqrt()
    }
}

fn camera(name: &str, eye: [f64; 3]) -> RgbdCamera {
    let lens = CameraModel {
        width: 640,
        height: 480,
        fx_px: 610.0,
        fy_px: 608.0,
        cx_px: 323.0,
        cy_px: 241.0,
        distortion: [0.02, -0.03, 0.0005, -0.0004, 0.0],
    };
    let up = -Vector3::z();
    RgbdCamera {
        name: name.to_owned(),
        depth: CameraModel { fx_px: 390.0, fy_px: 390.0, distortion: [0.0; 5], ..lens.clone() },
        color: lens,
        color_from_depth: Isometry3::new(
            Vector3::new(0.015, 0.0, 0.0),
            Vector3::new(0.0, 0.01, 0.0),
        ),
        world_from_color: Isometry3::face_towards(&Point3::from(eye), &Point3::origin(), &up),
        depth_m_per_unit: 0.001,
    }
}

fn rig() -> Vec<RgbdCamera> {
    vec![
        camera("a", [0.5, 0.1, 0.35]),
        camera("b", [-0.3, 0.55, 0.3]),
        camera("c", [-0.25, -0.6, 0.45]),
    ]
}

/// Five faces of a cube, by number.
fn cube() -> Vec<Isometry3<f64>> {
    let face = |turn: UnitQuaternion<f64>| turn * Isometry3::translation(0.0, 0.0, -0.03);
    let about = |axis, quarter: f64| {
        UnitQuaternion::from_axis_angle(&axis, quarter * std::f64::consts::FRAC_PI_2)
    };
    let sides = (0..4).map(|k| face(about(Vector3::y_axis(), f64::from(k))));
    sides.chain([face(about(Vector3::x_axis(), 1.0))]).collect()
}

/// What the rig sees of the cube at `steps` poses of it.
fn observations(steps: u64, corner_px: f64, depth_m: f64) -> Observations {
    let (cameras, cube) = (rig(), cube());
    let mut noise = Noise(7);
    let mut views = Vec::new();
    for step in 0..steps {
        let [x, y, z, a, b, c] = [0.08, 0.08, 0.05, 1.5, 1.5, 3.0].map(|most| most * noise.next());
        let world_from_cube = Isometry3::new(Vector3::new(x, y, z), Vector3::new(a, b, c));
        for (index, camera) in cameras.iter().enumerate() {
            for (id, cube_from_marker) in cube.iter().enumerate() {
                let pose = camera.world_from_color.inverse() * world_from_cube * cube_from_marker;
                let normal = pose * Vector3::z();
                let slant = normal.dot(&pose.translation.vector.normalize());
                if slant < 0.35 {
                    continue;
                }
                let corners_px = corners_m(SIDE_M).map(|corner| {
                    let px = camera.color.project(&(pose * corner)).unwrap();
                    [px.x + noise.normal(corner_px), px.y + noise.normal(corner_px)]
                });
                let in_depth = camera.color_from_depth.inverse() * pose;
                let depth = (0..9).map(|k| {
                    let place =
                        Point3::new(0.01 * f64::from(k % 3 - 1), 0.01 * f64::from(k / 3 - 1), 0.0);
                    let ray = camera.depth.ray(camera.depth.project(&(in_depth * place)).unwrap());
                    let true_m = plane_depth_m(&in_depth, &ray);
                    let error_m = BIAS_M[index] + noise.normal(depth_m);
                    DepthSample { ray, depth_m: SCALE[index] * true_m + error_m }
                });
                views.push(View {
                    camera: index,
                    step,
                    id: id as u32,
                    side_m: SIDE_M,
                    rays: corners_px.map(|px| camera.color.ray(Vector2::from(px)).xy()),
                    depth: depth.collect(),
                    poses: square_poses(&camera.color, &corners_px, SIDE_M),
                });
            }
        }
    }
    Observations { cameras, side_m: SIDE_M, steps, views, border_shift: None, unreadable: 0 }
}

/// Largest error of the cameras' places, millimetres, and turns, degrees.
fn pose_errors(seen: &Observations, first_from_camera: &[Isometry3<f64>]) -> [f64; 2] {
    let first = seen.cameras[0].world_from_color;
    let errors = seen.cameras.iter().zip(first_from_camera).map(|(camera, pose)| {
        let off = camera.world_from_color.inverse() * (first * pose);
        [off.translation.vector.norm() * 1e3, off.rotation.angle().to_degrees()]
    });
    errors.fold([0.0; 2], |most, e| [f64::max(most[0], e[0]), f64::max(most[1], e[1])])
}

#[test]
fn exact_views_give_exact_cameras() {
    let seen = observations(12, 0.0, 0.0);
    let found = fit(&seen, TargetKind::Rigid, |_| true).unwrap();
    let [off_mm, off_deg] = pose_errors(&seen, &found.first_from_camera);
    assert!(off_mm < 0.01 && off_deg < 0.002, "{off_mm} mm, {off_deg}°");
    for (camera, bias_m) in BIAS_M.iter().enumerate() {
        let depth = found.depth[camera].unwrap();
        assert!((depth.offset_m - bias_m).abs() < 2e-5, "{depth:?} is not {bias_m}");
        assert_eq!(depth.scale, 1.0, "depths span too little to tell a scale");
    }
    // Neighbouring faces of the cube.
    let [a, b] = [0, 1].map(|id| found.target_from_marker[&id].translation.vector);
    assert!(((a - b).norm() - 0.03 * 2f64.sqrt()).abs() < 1e-5, "{a} {b}");
}

#[test]
fn noise_and_gross_errors_are_survived() {
    let mut seen = observations(24, 0.1, 0.001);
    // One view in twenty is of another marker than it says, or has a corner far off.
    for (k, view) in seen.views.iter_mut().enumerate().filter(|(k, _)| k % 20 == 7) {
        if k % 40 == 7 {
            view.id = (view.id + 1) % 5;
        } else {
            view.rays[2] += Vector2::new(0.01, -0.006);
        }
    }
    let found = fit(&seen, TargetKind::Rigid, |_| true).unwrap();
    let [off_mm, off_deg] = pose_errors(&seen, &found.first_from_camera);
    assert!(off_mm < 1.0 && off_deg < 0.15, "{off_mm} mm, {off_deg}°");
    for (camera, bias_m) in BIAS_M.iter().enumerate() {
        let depth = found.depth[camera].unwrap();
        assert!((depth.offset_m - bias_m).abs() < 0.5e-3, "{depth:?} is not {bias_m}");
    }
    for pair in left_out(&seen, TargetKind::Rigid).unwrap() {
        // The true poses agree no better: one marker's pose is as uncertain as that.
        let [found_mm, true_mm] =
            [pair.marker_agreement_mm_median, pair.source_agreement_mm_median].map(Option::unwrap);
        assert!(found_mm < 1.2 * true_mm, "{pair:?}");
    }
}

#[test]
fn markers_lying_about_do_without_a_body() {
    let mut seen = observations(20, 0.05, 0.001);
    // Only markers that two cameras see tell anything; all the others stay in as ballast.
    let found = fit(&seen, TargetKind::Free, |_| true).unwrap();
    let [off_mm, off_deg] = pose_errors(&seen, &found.first_from_camera);
    assert!(off_mm < 2.0 && off_deg < 0.3, "{off_mm} mm, {off_deg}°");
    // Equal views give equal bits.
    let again = fit(&seen, TargetKind::Free, |_| true).unwrap();
    assert_eq!(found.first_from_camera, again.first_from_camera);
    seen.views.retain(|view| view.camera != 2);
    let error = fit(&seen, TargetKind::Free, |_| true).unwrap_err();
    assert!(matches!(&error, FitError::Unconnected { camera, .. } if camera == "c"), "{error}");
}

fn data() -> Option<PathBuf> {
    let data = orime_runtime::data_dir();
    if !data.join("three_cameras").is_dir() {
        eprintln!("SKIPPED: no `three_cameras` under `{}`; set ORIME_DATA", data.display());
        return None;
    }
    Some(data)
}

fn three_cameras() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/sets/three_cameras.toml")
}

#[test]
fn three_real_cameras_agree_better_than_their_source_says() {
    if data().is_none() {
        return;
    }
    let out = std::env::temp_dir().join(format!("orime-calibrate-{}", std::process::id()));
    let json = out.join("figures.json");
    let arguments = Arguments {
        set: three_cameras(),
        out: out.clone(),
        json: Some(json.clone()),
        import: None,
    };
    run(&arguments).unwrap();
    let figures: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(figures["frame_sets"], 24);
    let pairs = figures["pairs"].as_array().unwrap();
    assert_eq!(pairs.len(), 3);
    for pair in pairs {
        let mm = pair["marker_agreement_mm_median"].as_f64().unwrap();
        // The best pair of the source's calibration agrees to 2.7 mm.
        assert!(mm < 2.7, "{pair}");
        assert!(mm < pair["source_agreement_mm_median"].as_f64().unwrap(), "{pair}");
    }
    // Its depth reads 2 to 4 mm long by every scale that a camera's curve does not move.
    assert_eq!(figures["scale"], "grid");
    let shift = &figures["border_shift"];
    assert!(shift["sigma_px"].as_f64().unwrap() < 0.03, "{shift}");
    for camera in figures["cameras"].as_array().unwrap() {
        let [bias_mm, sigma_mm] =
            ["depth_bias_mm", "depth_bias_sigma_mm"].map(|key| camera[key].as_f64().unwrap());
        assert!((1.5..4.5).contains(&bias_mm) && sigma_mm < 0.5, "{camera}");
    }
    let report = std::fs::read_to_string(out.join("report.md")).unwrap();
    assert!(report.contains("scale: the markers' grids"), "{report}");
    // The cube's opposite faces are 30 mm apart, which no parameter says.
    let centre = |id: u64| {
        let marker = figures["target"].as_array().unwrap().iter().find(|m| m["id"] == id).unwrap();
        Vector3::from_fn(|k, _| marker["centre_mm"][k].as_f64().unwrap())
    };
    let apart_mm = (centre(2) - centre(4)).norm();
    assert!((apart_mm - 30.0).abs() < 0.4, "{apart_mm} mm");
    // The set with the file that was written: no doubts, and depth in tenths of a millimetre.
    let set = SetFile::load(&three_cameras()).unwrap();
    let mut params: CaptureParams = set.section("capture").unwrap();
    params.calibration.file = Some(out.join("calibration.toml").to_string_lossy().into_owned());
    let sheet = set.checked("sheet", SheetParams::check).unwrap();
    let source = open(&params.check().unwrap(), &sheet).unwrap();
    params.calibration.correct_depth = false;
    let uncorrected = open(&params.check().unwrap(), &sheet).unwrap();
    assert_eq!(doubts(source.cameras()), Vec::<String>::new());
    assert!(source.cameras().iter().all(|camera| camera.depth_m_per_unit == 1e-4));
    corrected_depth_is_the_raw_one_without_its_bias(&set, source, uncorrected, &figures);
    let pictures = std::fs::read_dir(&out).unwrap().filter(|entry| {
        entry.as_ref().unwrap().path().extension().is_some_and(|ending| ending == "png")
    });
    assert_eq!(pictures.count(), 6, "every pair, both ways");
    std::fs::remove_dir_all(&out).unwrap();
}

/// The first image of every camera, pixel by pixel; without `correct_depth` it is the raw one.
fn corrected_depth_is_the_raw_one_without_its_bias(
    set: &SetFile,
    mut corrected: Box<dyn FrameSource>,
    mut uncorrected: Box<dyn FrameSource>,
    figures: &serde_json::Value,
) {
    let params: CaptureParams = set.section("capture").unwrap();
    let sheet = set.checked("sheet", SheetParams::check).unwrap();
    let mut raw = open(&params.check().unwrap(), &sheet).unwrap();
    let depth_m = |source: &mut dyn FrameSource, camera: usize| -> Vec<f64> {
        let unit_m = source.cameras()[camera].depth_m_per_unit;
        let pixels = source.cameras()[camera].depth.pixels();
        let (mut color_rgb, mut depth_units) = (vec![0; 3 * pixels], vec![0; pixels]);
        let frame = RgbdFrameMut { color_rgb: &mut color_rgb, depth_units: &mut depth_units };
        source.read(0, camera, frame).unwrap();
        depth_units.iter().map(|units| f64::from(*units) * unit_m).collect()
    };
    for camera in 0..3 {
        let bias_mm = figures["cameras"][camera]["depth_bias_mm"].as_f64().unwrap();
        let [before, after] = [depth_m(raw.as_mut(), camera), depth_m(corrected.as_mut(), camera)];
        assert_eq!(depth_m(uncorrected.as_mut(), camera), before, "camera {camera}");
        for (before_m, after_m) in before.iter().zip(&after) {
            // Beyond 6.55 m nothing is left; the median in the figures is not quite the fit.
            let expected_m = if *before_m == 0.0 || *before_m > 6.5 { 0.0 } else { *before_m };
            let moved_mm = (after_m - expected_m) * 1e3;
            let wanted_mm = if expected_m == 0.0 { 0.0 } else { -bias_mm };
            assert!(
                *before_m > 6.5 || (moved_mm - wanted_mm).abs() < 0.3,
                "camera {camera}: {before_m} m became {after_m} m, bias {bias_mm} mm"
            );
        }
    }
}

#[test]
fn inverted_poses_of_real_cameras_are_seen_in_their_depth() {
    if data().is_none() {
        return;
    }
    let set = SetFile::load(&three_cameras()).unwrap();
    let params: CaptureParams = set.section("capture").unwrap();
    let sheet = set.checked("sheet", SheetParams::check).unwrap();
    let mut source = open(&params.check().unwrap(), &sheet).unwrap();
    let mut cameras = source.cameras().to_vec();
    let depth: Vec<Vec<u16>> = (0..cameras.len())
        .map(|camera| {
            let pixels = cameras[camera].depth.pixels();
            let (mut color_rgb, mut depth_units) = (vec![0; 3 * pixels], vec![0; pixels]);
            let frame = RgbdFrameMut { color_rgb: &mut color_rgb, depth_units: &mut depth_units };
            source.read(0, camera, frame).unwrap();
            depth_units
        })
        .collect();
    assert_eq!(doubts_of_depth(&cameras, &depth), None);
    for camera in &mut cameras {
        camera.world_from_color = camera.world_from_color.inverse();
    }
    let doubt = doubts_of_depth(&cameras, &depth);
    assert!(doubt.as_ref().is_some_and(|d| d.contains("inverted")), "{doubt:?}");
}

#[test]
fn kalibr_gives_the_same_cameras_back() {
    if data().is_none() {
        return;
    }
    let set = SetFile::load(&three_cameras()).unwrap();
    let params: CaptureParams = set.section("capture").unwrap();
    let sheet = set.checked("sheet", SheetParams::check).unwrap();
    let source = open(&params.check().unwrap(), &sheet).unwrap();
    let cameras = source.cameras();
    let mut text = String::new();
    for (k, camera) in cameras.iter().enumerate() {
        text += &format!("cam{k}:\n  camera_model: pinhole\n");
        if k > 0 {
            let this_from_before =
                camera.world_from_color.inverse() * cameras[k - 1].world_from_color;
            text += "  T_cn_cnm1:\n";
            for row in this_from_before.to_homogeneous().row_iter() {
                let row: Vec<String> = row.iter().map(|x| format!("{x:.17}")).collect();
                text += &format!("  - [{}]\n", row.join(", "));
            }
        }
        let lens = &camera.color;
        text += &format!(
            "  intrinsics: [{}, {}, {}, {}]\n  resolution: [{}, {}]\n  distortion_model: radtan\n  \
             distortion_coeffs: [0.0, 0.0, 0.0, 0.0]\n",
            lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, lens.width, lens.height
        );
    }
    let path = std::env::temp_dir().join(format!("orime-camchain-{}.yaml", std::process::id()));
    std::fs::write(&path, text).unwrap();
    let mut imported = cameras.to_vec();
    let calibration = Calibration::load(&path, cameras).unwrap();
    calibration.apply(&path, &mut imported).unwrap();
    for (new, old) in imported.iter().zip(cameras) {
        assert_eq!((&new.color, new.depth_is_registered()), (&old.color, true));
        let off = new.world_from_color.inverse() * old.world_from_color;
        assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-7, "{off}");
    }
    std::fs::remove_file(&path).unwrap();
}
