//! The rendered source against geometry computed here, independently of its rasteriser.

use orime_capture::{
    CaptureParams, FaultParams, FaultPreset, FrameSource, RenderedParams, Viewpoints, open,
};
use orime_geometry::nalgebra::{Point3, Vector2};
use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid, Surface};

const SIZE_M: [f64; 2] = [0.15, 0.15];

fn source(rendered: RenderedParams, repeat: bool) -> Box<dyn FrameSource> {
    let params = CaptureParams { rendered, repeat, ..CaptureParams::default() };
    open(&params.check().unwrap(), &SheetGrid::new(SIZE_M, [5, 5])).unwrap()
}

/// No noise, no texture, no rounding to speak of.
fn clean() -> RenderedParams {
    RenderedParams {
        faults: FaultPreset::None,
        texture: 0.0,
        depth_m_per_unit: 1e-4,
        ..RenderedParams::default()
    }
}

/// One frame into poisoned buffers.
fn read(source: &mut dyn FrameSource, step: u64, camera: usize) -> (Vec<u8>, Vec<u16>) {
    let about = &source.cameras()[camera];
    let mut rgb = vec![0xa5; 3 * about.color.pixels()];
    let mut depth = vec![0xdead; about.depth.pixels()];
    let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
    let report = source.read(step, camera, frame).unwrap();
    assert_eq!(report.copies, 0);
    (rgb, depth)
}

/// World point that a depth pixel measured.
fn back_project(camera: &RgbdCamera, k: usize, raw: u16) -> Point3<f64> {
    let width = camera.depth.width as usize;
    let ray = camera.depth.ray(Vector2::new((k % width) as f64, (k / width) as f64));
    let z_m = f64::from(raw) * camera.depth_m_per_unit;
    camera.world_from_depth() * Point3::from(ray * z_m)
}

#[test]
fn without_noise_every_depth_pixel_lies_on_the_sheet_or_the_table() {
    let mut source = source(clean(), false);
    // A grid with a node row on the crease, so that its triangles follow the folded sheet.
    let grid = SheetGrid::new(SIZE_M, [25, 25]);
    let triangles = grid.triangles();
    let mut nodes = vec![[0.0; 3]; grid.len()];
    for step in [0, 45, 62, 80, 119] {
        assert!(source.truth_m(step, &grid, &mut nodes));
        let surface = Surface::new(&nodes, &triangles);
        for camera in 0..source.cameras().len() {
            let (_, depth) = read(source.as_mut(), step, camera);
            let about = source.cameras()[camera].clone();
            let mut on_sheet = 0;
            for (k, raw) in depth.iter().enumerate() {
                let point = back_project(&about, k, *raw);
                if point.z.abs() < 3e-4 {
                    continue; // The table; a resting sheet is nearer to it than this.
                }
                on_sheet += 1;
                let distance_m = surface.distance_m(point.coords.cast::<f32>().into());
                assert!(distance_m < 2e-4, "step {step} camera {camera}: {point} {distance_m}");
            }
            let folding = (45..=80).contains(&step);
            assert_eq!(on_sheet > 500, folding, "step {step} camera {camera}: {on_sheet}");
        }
    }
}

#[test]
fn white_on_black_adds_up_to_the_projected_area() {
    let mut scene = RenderedParams { table_rgb: [0; 3], sheet_rgb: [200; 3], ..clean() };
    scene.thickness_m = 1e-6;
    let mut source = source(scene, false);
    let corners = SheetGrid::new(SIZE_M, [2, 2]);
    for camera in 0..source.cameras().len() {
        let (rgb, _) = read(source.as_mut(), 0, camera);
        let full = f64::from(*rgb.iter().max().unwrap());
        let about = source.cameras()[camera].color.clone();
        let lens_from_world = source.cameras()[camera].world_from_color.inverse();
        let mut nodes = [[0.0; 3]; 4];
        source.truth_m(0, &corners, &mut nodes);
        let [a, b, c, d] = [0, 2, 3, 1].map(|k| {
            let corner = Point3::from(nodes[k]).cast::<f64>();
            about.project(&(lens_from_world * corner)).unwrap()
        });
        let area_px = ((c - a).perp(&(d - b)) / 2.0).abs();
        let (mut sum, mut moment) = (0.0, Vector2::zeros());
        for (k, pixel) in rgb.chunks_exact(3).enumerate() {
            let share = f64::from(pixel[1]) / full;
            let width = about.width as usize;
            sum += share;
            moment += Vector2::new((k % width) as f64, (k / width) as f64) * share;
        }
        assert!((sum / area_px - 1.0).abs() < 1e-3, "camera {camera}: {sum} of {area_px} px");
        // Centre of a quadrilateral: its two triangles', weighted by their areas.
        let [p, q] = [((b - a).perp(&(c - a))).abs(), ((c - a).perp(&(d - a))).abs()];
        let centre = ((a + b + c) * p + (a + c + d) * q) / (3.0 * (p + q));
        let off = (moment / sum - centre).norm();
        assert!(off < 0.02, "camera {camera}: centre off by {off} px");
    }
}

#[test]
fn the_flat_sheet_shows_no_seam_and_edges_have_intermediate_values() {
    let mut source =
        source(RenderedParams { table_rgb: [0; 3], sheet_rgb: [200; 3], ..clean() }, false);
    let (rgb, _) = read(source.as_mut(), 0, 0);
    let full = *rgb.iter().max().unwrap();
    let width = source.cameras()[0].color.width as usize;
    let mut grey = 0;
    for row in rgb.chunks_exact(3 * width) {
        let values: Vec<u8> = row.chunks_exact(3).map(|p| p[0]).collect();
        let Some(first) = values.iter().position(|v| *v == full) else { continue };
        let last = values.iter().rposition(|v| *v == full).unwrap();
        assert!(values[first..=last].iter().all(|v| *v == full), "a seam");
        grey += values.iter().filter(|v| 0 < **v && **v < full).count();
    }
    assert!(grey > 400, "{grey} edge pixels");
}

#[test]
fn frames_do_not_depend_on_the_order_of_reading() {
    let mut forwards = source(RenderedParams::default(), false);
    let mut backwards = source(RenderedParams::default(), false);
    let order = [(3, 0), (60, 1), (60, 2), (119, 0)];
    let first = order.map(|(step, camera)| read(forwards.as_mut(), step, camera));
    let mut reversed = order;
    reversed.reverse();
    let mut second = reversed.map(|(step, camera)| read(backwards.as_mut(), step, camera));
    second.reverse();
    assert!(first == second, "frames differ");
    let other = RenderedParams { seed: 2, ..RenderedParams::default() };
    assert!(read(source(other, false).as_mut(), 3, 0) != first[0], "the seed has no effect");
}

#[test]
fn noise_over_time_has_the_documented_size_and_is_independent() {
    let quiet = RenderedParams { depth_m_per_unit: 1e-5, ..RenderedParams::default() };
    let mut source = source(quiet, false);
    let frames: Vec<Vec<u16>> = (0..60).map(|step| read(source.as_mut(), step, 0).1).collect();
    let expected_m = (0.00039f64.powi(2) + (0.0028 * 0.52 * 0.52f64).powi(2)).sqrt();
    let (mut squares, mut products, mut count) = (0.0, 0.0, 0.0);
    // Pixels of the table's corner, far apart.
    for k in (0..60).map(|k| k % 10 * 12 + (k / 10) * 12 * 640) {
        let mean = frames.iter().map(|f| f64::from(f[k])).sum::<f64>() / frames.len() as f64;
        let error = |step: usize| (f64::from(frames[step][k]) - mean) * 1e-5;
        for step in 1..frames.len() {
            squares += error(step).powi(2);
            products += error(step) * error(step - 1);
            count += 1.0;
        }
    }
    let sigma_m = f64::sqrt(squares / count);
    // 3540 values: the standard error of σ is 1.2 %; the tolerance is four of them.
    assert!((sigma_m / expected_m - 1.0).abs() < 0.05, "{sigma_m} against {expected_m}");
    assert!((products / squares).abs() < 0.07, "consecutive frames correlate");
}

#[test]
fn holes_have_their_rate_and_are_off_by_default() {
    let zeros = |rendered: RenderedParams| -> f64 {
        let mut source = source(rendered, false);
        let (mut zero, mut all) = (0, 0);
        for step in 0..20 {
            let (_, depth) = read(source.as_mut(), step, 0);
            zero += depth.iter().filter(|raw| **raw == 0).count();
            all += depth.len();
        }
        zero as f64 / all as f64
    };
    assert_eq!(zeros(RenderedParams::default()), 0.0);
    let rate = zeros(RenderedParams {
        fault: FaultParams { hole_rate: Some(0.03), ..FaultParams::default() },
        ..RenderedParams::default()
    });
    assert!((rate - 0.03).abs() < 0.003, "{rate}");
}

#[test]
fn a_repeated_fold_turns_back_without_a_jump_and_time_goes_on() {
    let mut source = source(RenderedParams { steps: Some(20), ..clean() }, true);
    assert_eq!(source.steps(), None);
    let grid = SheetGrid::new(SIZE_M, [5, 5]);
    let mut before = vec![[0.0; 3]; grid.len()];
    source.truth_m(0, &grid, &mut before);
    for step in 1..100 {
        let mut now = before.clone();
        source.truth_m(step, &grid, &mut now);
        for (a, b) in before.iter().zip(&now) {
            let moved = (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>().sqrt();
            assert!(moved < 0.03, "a jump at step {step}");
        }
        assert!(source.exposure_ns(step, 0) > source.exposure_ns(step - 1, 0));
        before = now;
    }
    // The end and its mirror image are the same frame.
    assert!(read(source.as_mut(), 19, 1).0 == read(source.as_mut(), 20, 1).0);
}

#[test]
fn scenes_that_cannot_be_seen_or_folded_are_refused() {
    let refuse = |rendered: RenderedParams| {
        let params = CaptureParams { rendered, ..CaptureParams::default() };
        let sheet = SheetGrid::new(SIZE_M, [5, 5]);
        open(&params.check().unwrap(), &sheet).err().expect("must be refused").to_string()
    };
    let edge = RenderedParams { fold_point: [0.0, 0.5], ..RenderedParams::default() };
    assert!(refuse(edge).contains("rendered.fold_point"));
    let views = Viewpoints::Three.views();
    let mut near = RenderedParams { views, ..RenderedParams::default() };
    near.views[0].eye_m = [0.0, 0.0, 0.12];
    assert!(refuse(near).contains("`overhead`"));
}
