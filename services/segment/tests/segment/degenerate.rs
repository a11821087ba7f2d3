//! Frames that show nothing, or nothing sensible.

use crate::scene::{Bench, Patch, Scene, WHITE, camera, flat_sheet};
use orime_geometry::nalgebra::Isometry3;
use orime_geometry::{CameraModel, RgbdCamera, RgbdFrame};
use orime_segment::{ObservedMut, SegmentParams, SegmentReport};

const PIXELS: usize = 150 * 120;

fn images(rgb: u8, depth: u16) -> Vec<(Vec<u8>, Vec<u16>)> {
    vec![(vec![rgb; 3 * PIXELS], vec![depth; PIXELS])]
}

fn nothing(bench: &mut Bench, images: &[(Vec<u8>, Vec<u16>)]) {
    let seen = bench.see_images(images);
    let expected = SegmentReport { cameras_without_sheet: 1, ..SegmentReport::default() };
    assert_eq!(seen.report, expected);
    assert!(!bench.picture(0).contains('#'));
}

#[test]
fn plain_frames_show_no_sheet_before_or_after_one_was_seen() {
    let mut bench = Bench::new(&SegmentParams::default(), vec![camera()]);
    for round in 0..2 {
        for rgb in [0, 128, 255] {
            for depth in [0, 1, 6000, u16::MAX] {
                nothing(&mut bench, &images(rgb, depth));
            }
        }
        if round == 0 {
            assert_eq!(bench.see(&Scene::new(vec![flat_sheet()])).report.cameras_without_sheet, 0);
        }
    }
}

#[test]
fn the_sheet_leaves_and_returns() {
    let scene = Scene::new(vec![flat_sheet()]);
    for away in [1, 40] {
        let mut bench = Bench::new(&SegmentParams::default(), vec![camera()]);
        let before = bench.see(&scene);
        for _ in 0..away {
            assert_eq!(bench.see(&Scene::new(vec![])).report.points, 0);
        }
        assert_eq!(bench.see(&scene), before);
    }
}

#[test]
fn another_colour_is_learnt_after_a_while() {
    let scene = Scene::new(vec![Patch { rgb: [90, 200, 60], ..flat_sheet() }]);
    let params = SegmentParams { relearn_after_frames: 3, ..SegmentParams::default() };
    let mut bench = Bench::new(&params, vec![camera()]);
    bench.see(&Scene::new(vec![flat_sheet()]));
    let found: Vec<bool> = (0..5).map(|_| bench.see(&scene).report.points > 0).collect();
    assert_eq!(found, [false, false, false, true, true]);
}

#[test]
fn missing_and_wrong_sized_frames_are_counted() {
    let mut bench = Bench::new(&SegmentParams::default(), vec![camera(), camera(), camera()]);
    let (color_rgb, depth_units) = Scene::new(vec![flat_sheet()]).render(&camera());
    let good = RgbdFrame { color_rgb: &color_rgb, depth_units: &depth_units };
    let short = RgbdFrame { color_rgb: &color_rgb[3..], ..good };
    let mut points = vec![bytemuck::Zeroable::zeroed(); 40_000];
    let mut edgels = vec![bytemuck::Zeroable::zeroed(); 4_000];
    let mut see = |frames: &[Option<RgbdFrame>]| {
        let out = ObservedMut { points: &mut points, edgels: &mut edgels, features: &mut [] };
        bench.segmenter.segment(frames, out)
    };
    let report = see(&[Some(good), Some(short), None]);
    assert_eq!((report.cameras_without_frame, report.cameras_without_sheet), (2, 0));
    assert!(report.points > 0);
    assert_eq!(see(&[]).cameras_without_frame, 3);
    // What does not fit is counted, and what is written is spread over all cameras.
    let whole = see(&[Some(good); 3]);
    let out =
        ObservedMut { points: &mut points[..300], edgels: &mut edgels[..30], features: &mut [] };
    let report = bench.segmenter.segment(&[Some(good); 3], out);
    assert_eq!((report.points, report.edgels), (300, 30));
    assert_eq!(report.points_left_out as usize, whole.points - 300);
    assert_eq!(report.edgels_left_out as usize, whole.edgels - 30);
    for camera in 0..3 {
        assert_eq!(points[..300].iter().filter(|p| p.camera == camera).count(), 100);
    }
    assert!(!bench.segmenter.is_sheet(3, 0, 0) && !bench.segmenter.is_sheet(0, 150, 0));
}

#[test]
fn a_camera_of_one_pixel_sees_nothing() {
    for (width, height) in [(1, 1), (3, 200), (200, 2), (64, 64)] {
        let lens = CameraModel { width, height, ..crate::scene::lens() };
        let offset = Isometry3::translation(0.01, 0.0, 0.0);
        for color_from_depth in [Isometry3::identity(), offset] {
            let tiny = RgbdCamera {
                color: lens.clone(),
                depth: lens.clone(),
                color_from_depth,
                ..camera()
            };
            let mut bench = Bench::new(&SegmentParams::default(), vec![tiny]);
            let pixels = lens.pixels();
            nothing(&mut bench, &[(vec![255; 3 * pixels], vec![6000; pixels])]);
            nothing(&mut bench, &[(vec![0; 3 * pixels], vec![0; pixels])]);
        }
    }
}

#[test]
fn a_single_bright_pixel_is_no_sheet() {
    let mut bench = Bench::new(&SegmentParams::default(), vec![camera()]);
    let mut images = images(10, 6000);
    images[0].0[3 * (60 * 150 + 75)..][..3].copy_from_slice(&WHITE);
    nothing(&mut bench, &images);
    bench.see(&Scene::new(vec![flat_sheet()]));
    nothing(&mut bench, &images);
}

#[test]
fn without_depth_a_visible_sheet_has_no_points() {
    let (color, depth) = Scene::new(vec![flat_sheet()]).render(&camera());
    let mut bench = Bench::new(&SegmentParams::default(), vec![camera()]);
    nothing(&mut bench, &[(color.clone(), vec![0; PIXELS])]);
    assert!(bench.see_images(&[(color.clone(), depth)]).report.points > 0);
    nothing(&mut bench, &[(color, vec![0; PIXELS])]);
}

#[test]
fn results_do_not_depend_on_threads_or_on_the_run() {
    let tilted = flat_sheet().turned([0.3, 0.2, 0.1]);
    let scenes = [Scene::new(vec![flat_sheet()]), Scene::new(vec![tilted])];
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut bench = Bench::new(&SegmentParams::default(), vec![camera(); 4]);
        let seen: Vec<_> = scenes.iter().map(|s| pool.install(|| bench.see(s))).collect();
        seen
    };
    let reference = run(1);
    assert!(reference[1].points.len() > 4000);
    assert_eq!(run(1), reference);
    assert_eq!(run(4), reference);
}
