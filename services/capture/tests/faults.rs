//! Sequences and faults of the rendered cameras, against the exact kinematics.

use orime_capture::{
    CaptureParams, FaultParams, FaultPreset, FrameSource, Gripper, Occluder, RenderedParams,
    SequenceKind, Viewpoints, open,
};
use orime_geometry::nalgebra::{Point3, Vector2};
use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid, Surface};
use orime_origami::{Sequence, Sheet};

const SIZE_M: [f64; 2] = [0.15, 0.15];
const STEPS: u64 = 581;

fn source(rendered: &RenderedParams) -> Box<dyn FrameSource> {
    let params = CaptureParams { rendered: rendered.clone(), ..CaptureParams::default() };
    open(&params.check().unwrap(), &SheetGrid::new(SIZE_M, [5, 5])).unwrap()
}

/// The square base before five perfect cameras.
fn clean() -> RenderedParams {
    RenderedParams {
        sequence: SequenceKind::SquareBase,
        viewpoints: Viewpoints::Five,
        faults: FaultPreset::None,
        depth_m_per_unit: 1e-4,
        ..RenderedParams::default()
    }
}

fn read(source: &mut dyn FrameSource, step: u64, camera: usize) -> (Vec<u8>, Vec<u16>) {
    let about = &source.cameras()[camera];
    let mut rgb = vec![0xa5; 3 * about.color.pixels()];
    let mut depth = vec![0xdead; about.depth.pixels()];
    let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
    source.read(step, camera, frame).unwrap();
    (rgb, depth)
}

/// World points that a depth image shows over the table (from below, all), metres.
fn points(camera: &RgbdCamera, depth: &[u16]) -> Vec<[f32; 3]> {
    let width = camera.depth.width as usize;
    let world_from_depth = camera.world_from_depth();
    let measured = depth.iter().enumerate().filter(|(_, raw)| **raw > 0);
    let points = measured.map(|(k, raw)| {
        let pixel = Vector2::new((k % width) as f64, (k / width) as f64);
        let ray = camera.depth.ray(pixel) * (f64::from(*raw) * camera.depth_m_per_unit);
        world_from_depth * Point3::from(ray)
    });
    let is_below = world_from_depth.translation.vector.z < 0.0;
    points.filter(|p| is_below || p.z.abs() > 1e-3).map(|p| p.coords.cast::<f32>().into()).collect()
}

/// The exact square base as a mesh: nodes and triangles.
fn mesh(progress: f64) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let sheet = Sheet { size_m: SIZE_M, thickness_m: 1e-4 };
    let sequence = Sequence::square_base(sheet).unwrap().placed([0.0; 2], 10f64.to_radians());
    let pose = sequence.pose(progress);
    let (mut nodes, mut triangles) = (Vec::new(), Vec::new());
    for (facet, part) in sequence.facets().iter().zip(&pose.facets) {
        let start = nodes.len() as u32;
        let corners = facet.corners_uv_m.iter();
        nodes.extend(corners.map(|uv| <[f32; 3]>::from(part.position_m(*uv).coords.cast())));
        triangles.push([start, start + 1, start + 2]);
    }
    (nodes, triangles)
}

/// Largest distance of the points from the square base at `progress`, metres.
fn worst_m(points: &[[f32; 3]], progress: f64) -> f32 {
    let (nodes, triangles) = mesh(progress);
    let surface = Surface::new(&nodes, &triangles);
    points.iter().map(|p| surface.distance_m(*p)).fold(0.0, f32::max)
}

#[test]
fn perfect_cameras_see_the_square_base_where_it_is() {
    let mut source = source(&clean());
    assert_eq!(source.steps(), Some(STEPS));
    for step in [60, 170, 250, 350, 470] {
        let mut seen = 0;
        for camera in 0..5 {
            let about = source.cameras()[camera].clone();
            let (_, depth) = read(source.as_mut(), step, camera);
            let points = points(&about, &depth);
            let name = &about.name;
            let worst = worst_m(&points, step as f64 / 580.0);
            assert!(worst < 2e-4, "{name} at {step}: {worst} m");
            seen += points.len();
        }
        assert!(seen > 5000, "step {step}: {seen} points");
    }
}

#[test]
fn speed_takes_steps_away_and_changes_no_place() {
    let mut once = source(&clean());
    for (speed, steps) in [(2.0, 291), (4.0, 146)] {
        let mut fast = source(&RenderedParams { speed, ..clean() });
        assert_eq!(fast.steps(), Some(steps));
        let step = 280 / speed as u64;
        assert!(read(once.as_mut(), 280, 2).0 == read(fast.as_mut(), step, 2).0, "{speed}");
    }
}

#[test]
fn each_camera_shows_its_own_time_and_its_stamp_says_so() {
    let fault = FaultParams { shutter_spread: Some(0.5), ..FaultParams::default() };
    let mut source = source(&RenderedParams { fault, ..clean() });
    let period_ns = (1e9f64 / 30.0).round();
    let mut spread: f64 = 0.0;
    for camera in 0..5 {
        let step = 350;
        let late = source.exposure_ns(step, camera) as f64 / period_ns - (step + 1) as f64;
        assert!(late.abs() <= 0.5 && (camera > 0 || late.abs() < 1e-6), "{late}");
        spread = spread.max(late.abs());
        let about = source.cameras()[camera].clone();
        let (_, depth) = read(source.as_mut(), step, camera);
        let points = points(&about, &depth);
        let worst = worst_m(&points, (step as f64 + late) / 580.0);
        assert!(worst < 2e-4, "{}: {worst} m", about.name);
        // The turn-over is fast enough to tell the times apart.
        if late.abs() > 0.2 {
            assert!(worst_m(&points, step as f64 / 580.0) > 4e-4, "{}", about.name);
        }
    }
    assert!(spread > 0.2, "the shutters are all but synchronous: {spread}");
    let mut nodes = vec![[0.0; 3]; 25];
    assert!(source.truth_m(350, &SheetGrid::new(SIZE_M, [5, 5]), &mut nodes));
    assert!(worst_m(&nodes, 350.0 / 580.0) < 1e-6, "truth is at camera 0's time");
}

#[test]
fn stamps_jitter_but_never_go_back() {
    let jitter = FaultParams { stamp_jitter_s: Some(0.1), ..FaultParams::default() };
    let source = source(&RenderedParams { fault: jitter, faults: FaultPreset::Real, ..clean() });
    for camera in 0..5 {
        let stamps: Vec<u64> = (0..200).map(|step| source.exposure_ns(step, camera)).collect();
        assert!(stamps.windows(2).all(|w| w[0] < w[1]), "camera {camera}");
        let gaps: Vec<u64> = stamps.windows(2).map(|w| w[1] - w[0]).collect();
        assert!(gaps.iter().max() > gaps.iter().min(), "no jitter");
    }
}

#[test]
fn faulty_frames_depend_on_seed_step_and_camera_alone() {
    let scene = RenderedParams { faults: FaultPreset::Real, ..clean() };
    let order = [(60, 1), (60, 4), (350, 2), (470, 0)];
    let expected = {
        let mut source = source(&scene);
        order.map(|(step, camera)| read(source.as_mut(), step, camera))
    };
    // Backwards, each half in a thread of its own.
    let again: Vec<_> = std::thread::scope(|scope| {
        let halves = [&order[..2], &order[2..]].map(|half| {
            let scene = &scene;
            scope.spawn(move || {
                let mut source = source(scene);
                let backwards = half.iter().rev();
                let frames = backwards.map(|(step, camera)| read(source.as_mut(), *step, *camera));
                frames.collect::<Vec<_>>()
            })
        });
        halves.into_iter().flat_map(|h| h.join().unwrap().into_iter().rev()).collect()
    });
    assert!(expected.as_slice() == again.as_slice(), "frames differ");
    let mut other = source(&RenderedParams { seed: 2, ..scene });
    assert!(read(other.as_mut(), 60, 1) != expected[0], "the seed has no effect");
}

fn holes(depth: &[u16]) -> usize {
    depth.iter().filter(|raw| **raw == 0).count()
}

/// Checks that one fault alone changes step 60 of the rear camera's view of the square base, and
/// how many depth pixels it takes away.
fn check(before: &(Vec<u8>, Vec<u16>), fault: FaultParams, lost: std::ops::Range<usize>) {
    let mut faulty = source(&RenderedParams { fault: fault.clone(), ..rear() });
    let after = read(faulty.as_mut(), 60, 1);
    assert!(*before != after, "{fault:?} changes nothing");
    let more = holes(&after.1).saturating_sub(holes(&before.1));
    assert!(lost.contains(&more), "{fault:?} takes {more} pixels away");
}

/// Two of the five cameras: the second, which is not camera 0, may be late.
fn rear() -> RenderedParams {
    RenderedParams { views: Viewpoints::Five.views()[..2].to_vec(), ..clean() }
}

#[test]
fn every_fault_has_its_own_switch() {
    let none = FaultParams::default;
    let before = read(source(&rear()).as_mut(), 60, 1);
    let check = |fault, lost| check(&before, fault, lost);
    check(FaultParams { noise_floor_m: Some(0.0004), ..none() }, 0..1);
    check(FaultParams { noise_per_m: Some(0.0028), ..none() }, 0..1);
    check(FaultParams { bias_m: Some(0.0045), ..none() }, 0..1);
    check(FaultParams { disparity_step_px: Some(0.03), ..none() }, 0..1);
    check(FaultParams { hole_rate: Some(0.01), ..none() }, 1000..6000);
    check(FaultParams { grazing_deg: Some(70.0), ..none() }, 100..20_000);
    check(FaultParams { shadow: Some(1.0), ..none() }, 100..20_000);
    check(FaultParams { flying_rate: Some(0.45), ..none() }, 0..1);
    check(FaultParams { calibration_error_m: Some(0.001), ..none() }, 0..500);
    check(FaultParams { calibration_error_deg: Some(0.2), ..none() }, 0..5000);
    check(FaultParams { shutter_spread: Some(0.5), ..none() }, 0..500);
    check(FaultParams { exposure_s: Some(0.01), ..none() }, 0..1);
    check(FaultParams { color_noise: Some(2.0), ..none() }, 0..1);
    check(FaultParams { occluder: Some(Occluder::Grippers), ..none() }, 0..1);
    check(FaultParams { occluder: Some(Occluder::Hand), ..none() }, 0..1);
    // The lamp is mirrored to a camera only while a part leans by half the lamp's angle.
    let fault = FaultParams { saturation: Some(0.2), ..none() };
    let mut shiny = source(&RenderedParams { fault, ..rear() });
    let mut matt = source(&rear());
    let mut lost = (0..580).step_by(20).map(|step| {
        holes(&read(shiny.as_mut(), step, 1).1) - holes(&read(matt.as_mut(), step, 1).1)
    });
    assert_eq!(lost.next(), Some(0), "the flat sheet mirrors the lamp elsewhere");
    let most = lost.max();
    assert!(most > Some(200), "no blind spot ever: {most:?}");
}

#[test]
fn motion_blurs_only_what_moves() {
    let fault = FaultParams { exposure_s: Some(0.01), ..FaultParams::default() };
    let mut blurred = source(&RenderedParams { fault, ..clean() });
    let mut sharp = source(&clean());
    assert!(read(blurred.as_mut(), 570, 1) == read(sharp.as_mut(), 570, 1), "at rest");
    assert!(read(blurred.as_mut(), 350, 1).0 != read(sharp.as_mut(), 350, 1).0, "in motion");
}

#[test]
fn a_table_that_is_not_glass_hides_the_sheet_from_below() {
    let mut wood = source(&RenderedParams { glass_table: false, ..clean() });
    let (flat, folded) = (read(wood.as_mut(), 0, 4), read(wood.as_mut(), 350, 4));
    assert!(flat == folded, "it shows through");
    let depth_m = f64::from(flat.1[320 + 240 * 640]) * wood.cameras()[4].depth_m_per_unit;
    assert!((depth_m - 0.28).abs() < 0.001, "the table is at {depth_m} m");
}

#[test]
fn robots_tell_their_grippers_when_asked() {
    let mut out = vec![];
    source(&clean()).grippers(350, &mut out);
    assert!(out.is_empty(), "nobody asked");
    let asked = RenderedParams { gripper_poses: true, ..clean() };
    source(&asked).grippers(350, &mut out);
    let exact = out.clone();
    assert_eq!(exact.len(), 2, "both hands turn the sheet over");
    let held: Vec<[f32; 3]> = exact.iter().map(place).collect();
    assert!(worst_m(&held, 350.0 / 580.0) < 1e-6, "they hold the sheet");
    source(&RenderedParams { faults: FaultPreset::Real, ..asked }).grippers(350, &mut out);
    let off_m = (Point3::from(place(&out[0])) - Point3::from(place(&exact[0]))).norm();
    assert!(0.0 < off_m && off_m < 0.003, "noise of half a millimetre: {off_m} m");
}

fn place(gripper: &Gripper) -> [f32; 3] {
    gripper.world_from_gripper.translation.vector.cast::<f32>().into()
}
