//! Where points and edgels lie, against the scene's geometry.

use crate::scene::{Bench, Patch, Scene, Seen, WHITE, camera, flat_sheet, lens};
use orime_geometry::nalgebra::{Isometry3, Point3, Vector2, Vector3};
use orime_geometry::{EdgelKind, RgbdCamera};
use orime_segment::SegmentParams;

/// Distance of every point from the sheet's plane, and outside its rectangle; metres.
fn errors_m(seen: &Seen, sheet: &Patch) -> (f64, f64) {
    let (mut off, mut outside) = (0f64, f64::NEG_INFINITY);
    for point in &seen.points {
        let local =
            sheet.world_from_patch.inverse() * Point3::from(point.position_m.map(f64::from));
        off = off.max(local.z.abs());
        outside = outside.max(local.x.abs() - sheet.size_m[0] / 2.0);
        outside = outside.max(local.y.abs() - sheet.size_m[1] / 2.0);
    }
    (off, outside)
}

#[test]
fn points_lie_on_a_tilted_sheet_with_its_normal() {
    let sheet = flat_sheet().turned([0.4, -0.5, 0.3]);
    let seen = Bench::new(&SegmentParams::default(), vec![camera()])
        .see(&Scene { table_z_m: 0.8, ..Scene::new(vec![sheet.clone()]) });
    assert!(seen.points.len() > 1000, "{:?}", seen.report);
    let (off, outside) = errors_m(&seen, &sheet);
    assert!(off < 1e-4 && outside < 0.0, "{off} m off the plane, {outside} m outside");
    let normal = sheet.world_from_patch * -Vector3::z();
    for point in seen.points.iter().filter(|point| point.normal != [0.0; 3]) {
        let cosine = Vector3::from(point.normal.map(f64::from)).dot(&normal);
        assert!(cosine > 0.999, "{point:?}");
    }
    let without = seen.points.iter().filter(|point| point.normal == [0.0; 3]).count();
    assert!(without * 4 < seen.points.len(), "{without} points without a normal");
}

#[test]
fn edgels_lie_on_an_anti_aliased_edge() {
    for turn in [0.0, 0.1, 0.35, 0.7] {
        let sheet = flat_sheet().turned([0.0, 0.0, turn]);
        let mut bench = Bench::new(&SegmentParams::default(), vec![camera()]);
        let seen = bench.see(&Scene::new(vec![sheet.clone()]));
        // 230 pixels of outline, less the corners.
        assert!(seen.edgels.len() > 70, "turn {turn}: {:?}", seen.report);
        let mut squares = 0.0;
        for edgel in &seen.edgels {
            assert_eq!(edgel.kind(), Some(EdgelKind::Silhouette));
            let pixel = Vector2::from(edgel.position_px.map(f64::from));
            let at = sheet.world_from_patch.inverse() * Point3::from(lens().ray(pixel) * 0.6);
            // To the nearest side, in pixels: 3 mm each.
            let gaps = [at.x.abs() - 0.1, at.y.abs() - 0.075].map(|gap| gap / 0.003);
            let axis = usize::from(gaps[1].abs() < gaps[0].abs());
            assert!(gaps[axis].abs() < 0.1, "turn {turn}: {} px off at {edgel:?}", gaps[axis]);
            squares += gaps[axis] * gaps[axis];
            let mut outward = Vector3::zeros();
            outward[axis] = at[axis].signum();
            let outward = sheet.world_from_patch * outward;
            let [x, y] = edgel.normal.map(f64::from);
            assert!(outward.x * x + outward.y * y > 0.99, "turn {turn}: {edgel:?}");
        }
        let rms = (squares / seen.edgels.len() as f64).sqrt();
        assert!(rms < 0.05, "turn {turn}: {rms} px rms");
    }
}

#[test]
fn the_offset_between_the_lenses_is_honoured() {
    // Depth 40 pixels beside colour at this distance, and turned, with its own focal length.
    let offset = Isometry3::new(Vector3::new(0.12, -0.03, 0.01), Vector3::new(0.02, 0.15, 0.05));
    let mut depth = lens();
    (depth.fx_px, depth.fy_px, depth.cx_px) = (180.0, 185.0, 70.0);
    depth.distortion = [0.05, -0.02, 0.001, -0.001, 0.0];
    let mut color = lens();
    color.distortion = [-0.04, 0.03, -0.001, 0.002, 0.0];
    let world_from_color =
        Isometry3::new(Vector3::new(0.03, 0.02, -0.05), Vector3::new(0.1, -0.05, 0.3));
    let apart = RgbdCamera { color, depth, color_from_depth: offset, world_from_color, ..camera() };
    let sheet = flat_sheet();
    let scene = Scene::new(vec![sheet.clone()]);
    let mut bench = Bench::new(&SegmentParams::default(), vec![camera(), apart]);
    let seen = bench.see(&scene);
    assert_eq!(seen.report.cameras_without_sheet, 0);
    let (off, outside) = errors_m(&seen, &sheet);
    assert!(off < 1e-4 && outside < 0.0, "{off} m off the plane, {outside} m outside");
    for camera in [0, 1] {
        let of_camera = seen.points.iter().filter(|p| p.camera == camera).count();
        assert!(of_camera > 1000, "camera {camera}: {of_camera} points");
    }
    // The same camera, believed to have no offset, would put points beside the sheet.
    let mut bench = Bench::new(&SegmentParams::default(), vec![bench.cameras[1].clone()]);
    let images = vec![scene.render(&bench.cameras[0])];
    bench.cameras[0].color_from_depth = Isometry3::identity();
    let mut wrong = Bench::new(&SegmentParams::default(), bench.cameras);
    let seen = wrong.see_images(&images);
    let (off, outside) = errors_m(&seen, &sheet);
    assert!(seen.points.is_empty() || off.max(outside) > 0.02, "the test cannot fail");
}

#[test]
fn near_a_hand_there_are_neither_points_nor_edgels() {
    let hand = Patch::facing([0.09, 0.05, 0.55], [0.06, 0.2], [205, 130, 105]);
    let mut bench = Bench::new(&SegmentParams::default(), vec![camera()]);
    bench.see(&Scene::new(vec![flat_sheet()]));
    let seen = bench.see(&Scene::new(vec![flat_sheet(), hand.clone()]));
    let (off, outside) = errors_m(&seen, &flat_sheet());
    assert!(off < 1e-4 && outside < 0.0, "{off} m off the plane, {outside} m outside");
    let gap_px = |pixel: [f64; 2]| {
        let at =
            hand.world_from_patch.inverse() * Point3::from(lens().ray(Vector2::from(pixel)) * 0.55);
        let gaps = [0, 1].map(|k| (at[k].abs() - hand.size_m[k] / 2.0) / (0.55 / 200.0));
        gaps[0].max(gaps[1])
    };
    assert!(seen.edgels.len() > 30, "{:?}", seen.report);
    for edgel in &seen.edgels {
        let gap_px = gap_px(edgel.position_px.map(f64::from));
        assert!(gap_px > 3.0, "an edgel {gap_px} px from the hand: {edgel:?}");
    }
    for point in &seen.points {
        let pixel = lens().project(&Point3::from(point.position_m.map(f64::from))).unwrap();
        let gap_px = gap_px(pixel.into());
        assert!(gap_px > 4.0, "a point {gap_px} px from the hand: {point:?}");
    }
}

#[test]
fn the_workspace_and_the_depth_range_bound_the_points() {
    let params = SegmentParams {
        workspace_m: Some([[-1.0, -1.0, 0.0], [0.03, 1.0, 1.0]]),
        ..SegmentParams::default()
    };
    let seen = Bench::new(&params, vec![camera()]).see(&Scene::new(vec![flat_sheet()]));
    assert!(seen.points.len() > 500);
    assert!(seen.points.iter().all(|p| p.position_m[0] <= 0.03));
    let params = SegmentParams { depth_max_m: 0.5, ..SegmentParams::default() };
    let seen = Bench::new(&params, vec![camera()]).see(&Scene::new(vec![flat_sheet()]));
    assert_eq!((seen.report.points, seen.report.cameras_without_sheet), (0, 1));
}

#[test]
fn the_inner_edge_of_a_flap_is_on_the_flap() {
    let flap = Patch::facing([-0.05, 0.0, 0.58], [0.1, 0.13], WHITE);
    let mut bench = Bench::new(&SegmentParams::default(), vec![camera()]);
    bench.see(&Scene::new(vec![flat_sheet()]));
    let seen = bench.see(&Scene::new(vec![flat_sheet(), flap]));
    let inner: Vec<_> =
        seen.edgels.iter().filter(|e| e.kind() == Some(EdgelKind::InnerDepthStep)).collect();
    // The flap's right edge is at x = 0, 38 pixels high.
    assert!(inner.len() > 20, "{} inner edgels", inner.len());
    let right = inner.iter().filter(|e| e.normal[0] > 0.9);
    assert!(right.clone().count() > 15);
    for edgel in right {
        assert!((edgel.position_px[0] - 74.5).abs() < 1.0, "{edgel:?}");
    }
}
