//! Looking where the sheet was a frame ago gives what looking everywhere gives.

use crate::scene::{Bench, Patch, SKIN, Scene, Seen, WHITE, camera, lens};
use orime_geometry::nalgebra::{Isometry3, Vector3};
use orime_geometry::{CameraModel, RgbdCamera};
use orime_segment::SegmentParams;

/// 450 × 330 pixels, at 0.6 m 2 mm each: the sheet covers a twentieth of the image.
fn wide() -> RgbdCamera {
    let (width, height) = (450, 330);
    let (cx_px, cy_px) = (224.5, 164.5);
    let (fx_px, fy_px) = (300.0, 300.0);
    let lens = CameraModel { width, height, fx_px, fy_px, cx_px, cy_px, ..lens() };
    RgbdCamera { color: lens.clone(), depth: lens, ..camera() }
}

/// Depth with its own size and lens beside the colour lens.
fn apart() -> RgbdCamera {
    let mut depth = wide().depth;
    (depth.width, depth.height, depth.cx_px, depth.cy_px) = (380, 300, 185.0, 148.0);
    (depth.fx_px, depth.fy_px) = (250.0, 252.0);
    depth.distortion = [0.05, -0.02, 0.001, -0.001, 0.0];
    let color_from_depth =
        Isometry3::new(Vector3::new(0.02, -0.004, 0.001), Vector3::new(0.01, 0.02, 0.005));
    RgbdCamera { depth, color_from_depth, ..wide() }
}

fn at(x_m: f64, y_m: f64) -> Patch {
    Patch::facing([x_m, y_m, 0.6], [0.2, 0.15], WHITE)
}

fn scene(patches: Vec<Patch>) -> Scene {
    Scene { rays: 2, ..Scene::new(patches) }
}

/// What the scenes show to a segmenter with windows and to one without, and the share of each
/// camera's colour image that the first looked at.
fn look(cameras: &[RgbdCamera], scenes: &[Scene]) -> Vec<(Seen, Seen, Vec<f64>)> {
    let bench = |whole_image_every| {
        let params = SegmentParams { whole_image_every, ..SegmentParams::default() };
        Bench::new(&params, cameras.to_vec())
    };
    let (mut windows, mut whole) = (bench(16), bench(1));
    let show = |scene: &Scene| {
        let images: Vec<_> = cameras.iter().map(|camera| scene.render(camera)).collect();
        let seen = windows.see_images(&images);
        let shares = (0..cameras.len()).map(|k| {
            let [_, size] = windows.segmenter.window(k).unwrap();
            (size[0] * size[1]) as f64 / cameras[k].color.pixels() as f64
        });
        (seen, whole.see_images(&images), shares.collect())
    };
    scenes.iter().map(show).collect()
}

/// How many looks of how many were at less than half of an image.
fn narrow(seen: &[(Seen, Seen, Vec<f64>)]) -> (usize, usize) {
    let shares = || seen.iter().flat_map(|(_, _, shares)| shares);
    (shares().filter(|share| **share < 0.5).count(), shares().count())
}

fn assert_equal(seen: &[(Seen, Seen, Vec<f64>)]) {
    for (k, (window, whole, shares)) in seen.iter().enumerate() {
        assert_eq!(window.report, whole.report, "frame {k}, {shares:?}");
        assert!(window == whole, "frame {k}, {shares:?}");
    }
}

/// A hand with a white cuff crosses the sheet, white things stand about, and the sheet moves and
/// turns by up to 13 pixels a frame.
#[test]
fn a_moving_sheet_among_clutter_is_the_same_to_the_bit() {
    let clutter = [
        Patch::facing([0.38, 0.25, 0.6], [0.12, 0.1], WHITE),
        Patch::facing([-0.36, -0.24, 0.61], [0.2, 0.14], WHITE),
        Patch::facing([0.35, -0.2, 0.5], [0.05, 0.2], [200, 200, 205]),
    ];
    let frame = |k: i32| {
        let t = f64::from(k);
        let sheet = at(-0.1 + 0.012 * t, 0.08 * (0.4 * t).sin()).turned([0.02 * t, 0.3, 0.03 * t]);
        let hand = Patch::facing([0.3 - 0.02 * t, 0.1, 0.53], [0.04, 0.2], SKIN);
        let cuff = Patch::facing([0.3 - 0.02 * t, 0.24, 0.53], [0.06, 0.08], WHITE);
        let mut patches = vec![sheet, hand, cuff];
        patches.extend(clutter.clone());
        Scene { table_z_m: 0.75, ..scene(patches) }
    };
    let first = Scene { table_z_m: 0.75, ..scene(vec![at(-0.1, 0.0)]) };
    let scenes: Vec<Scene> = [first].into_iter().chain((0..24).map(frame)).collect();
    let seen = look(&[wide(), apart()], &scenes);
    assert_equal(&seen);
    assert!(seen.iter().all(|(seen, _, _)| seen.report.cameras_without_sheet == 0));
    assert!(seen.iter().all(|(seen, _, _)| seen.points.len() > 1000));
    let (narrow, looks) = narrow(&seen);
    assert!(narrow * 10 > looks * 7, "{narrow} of {looks}");
}

#[test]
fn a_sheet_that_jumps_out_of_its_window_is_found_in_the_same_frame() {
    let stay = |n: usize, x_m: f64, y_m: f64| vec![scene(vec![at(x_m, y_m)]); n];
    // To the far corner, half out of the window, and back.
    let scenes = [stay(3, -0.28, -0.2), stay(3, 0.28, 0.2), stay(3, 0.2, 0.05)].concat();
    let seen = look(&[wide(), apart()], &scenes);
    assert_equal(&seen);
    assert!(seen.iter().all(|(seen, _, _)| seen.report.cameras_without_sheet == 0));
    // Jumps are looked at as a whole, and so is the frame after them.
    let whole = |k: usize| seen[k].2.iter().all(|share| *share == 1.0);
    let looks: Vec<bool> = (0..9).map(whole).collect();
    assert_eq!(looks, [true, false, false, true, true, false, true, true, false]);
}

#[test]
fn a_sheet_that_leaves_and_comes_back_elsewhere_is_found_at_once() {
    let scenes = [
        vec![scene(vec![at(-0.25, -0.1)]); 3],
        vec![scene(vec![]); 2],
        vec![scene(vec![at(0.25, 0.12)]); 3],
    ];
    let seen = look(&[wide(), apart()], &scenes.concat());
    assert_equal(&seen);
    let missing: Vec<u32> = seen.iter().map(|(s, _, _)| s.report.cameras_without_sheet).collect();
    assert_eq!(missing, [0, 0, 0, 2, 2, 0, 0, 0]);
}

#[test]
fn of_two_sheets_the_tracked_one_stays_and_the_other_changes_nothing() {
    let other = Patch::facing([0.3, 0.2, 0.6], [0.16, 0.12], WHITE);
    let scenes =
        [vec![scene(vec![at(-0.2, -0.1)]); 2], vec![scene(vec![at(-0.2, -0.1), other]); 4]];
    let seen = look(&[wide(), apart()], &scenes.concat());
    assert_equal(&seen);
    assert!(seen.iter().all(|(window, _, _)| window.points == seen[1].0.points));
    let (narrow, looks) = narrow(&seen);
    assert!(narrow + 3 >= looks, "{narrow} of {looks}");
}

/// A broad hand hides the right two thirds of the sheet, and then sets the right quarter free.
#[test]
fn a_part_that_reappears_out_of_the_window_is_found_within_the_period() {
    let sheet = || Patch::facing([0.0, 0.0, 0.3], [0.2, 0.15], WHITE);
    // In front of the sheet's columns `from..to`, metres.
    let hand = |from: f64, to: f64| {
        let share = 0.25 / 0.3;
        Patch::facing([share * (from + to) / 2.0, 0.0, 0.25], [share * (to - from), 0.4], SKIN)
    };
    let scenes = [
        vec![scene(vec![sheet()])],
        vec![scene(vec![sheet(), hand(-0.04, 0.12)]); 3],
        vec![scene(vec![sheet(), hand(-0.04, 0.05)]); 16],
    ];
    let seen = look(&[wide()], &scenes.concat());
    assert_equal(&seen[..4]);
    let points = |k: usize| [seen[k].0.points.len(), seen[k].1.points.len()];
    assert!(points(4)[0] < points(4)[1], "the part is in the window: {:?}", points(4));
    assert_equal(&seen[19..]);
}
