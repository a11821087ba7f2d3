//! Several cameras, of which some see little of the sheet.

use crate::scene::{Bench, Patch, Scene, Seen, camera, flat_sheet, lens};
use orime_geometry::RgbdCamera;
use orime_geometry::nalgebra::{Isometry3, Point3};
use orime_segment::SegmentParams;

const GREY: [u8; 3] = [75, 78, 84];
const WOOD: [u8; 3] = [120, 80, 45];

/// A second camera 0.2 m beside the first, turned towards the sheet.
fn beside() -> RgbdCamera {
    let turn = Isometry3::rotation([0.0, -0.32, 0.0].into());
    let world_from_color = Isometry3::translation(0.2, 0.0, 0.0) * turn;
    RgbdCamera { name: "beside".into(), world_from_color, ..camera() }
}

/// A bar upright in the second camera's image, 0.3 m before it, that leaves a strip of the sheet,
/// and a grey box beside the sheet.
fn scene() -> Scene {
    let bar = Patch {
        world_from_patch: beside().world_from_color * Isometry3::translation(0.012, 0.0, 0.3),
        size_m: [0.07, 0.6],
        rgb: GREY,
    };
    let gripper = Patch::facing([-0.14, 0.02, 0.59], [0.06, 0.06], GREY);
    Scene { table_rgb: WOOD, ..Scene::new(vec![flat_sheet(), bar, gripper]) }
}

fn of_camera(seen: &Seen, camera: u32) -> Vec<[f32; 3]> {
    seen.points.iter().filter(|p| p.camera == camera).map(|p| p.position_m).collect()
}

#[test]
fn a_camera_is_told_the_sheets_colour_by_others() {
    let params = SegmentParams::default();
    let mut alone = Bench::new(&params, vec![beside()]);
    let seen = (0..8).map(|_| alone.see(&scene())).last().unwrap();
    assert_eq!(seen.points.len(), 0, "the strip is too small to learn from: {:?}", seen.report);

    let mut both = Bench::new(&params, vec![camera(), beside()]);
    let first = both.see(&scene());
    assert_eq!((first.report.cameras_without_sheet, of_camera(&first, 1).len()), (1, 0));
    let seen = both.see(&scene());
    assert_eq!(seen.report.cameras_without_sheet, 0);
    let points = of_camera(&seen, 1);
    assert!(points.len() > 50, "{} points", points.len());
    for [x, y, z] in points {
        let inside = x.abs() < 0.1 && y.abs() < 0.075 && (z - 0.6).abs() < 1e-3;
        assert!(inside, "({x}, {y}, {z}) is not on the sheet");
    }
}

#[test]
fn a_colour_that_finds_something_else_is_not_learnt() {
    // A white thing too small for the sheet, and a grey one at its side: grey is nearer to white
    // than wood is, so that its colour finds both, mostly white.
    let white = Patch::facing([0.0, 0.0, 0.6], [0.08, 0.1], [235, 235, 240]);
    let grey = Patch::facing([0.065, 0.0, 0.6], [0.05, 0.11], [55, 57, 62]);
    let patches = vec![white, grey];
    // Of two cameras, in their first frame, none takes all that is unlike wood.
    let mut bench = Bench::new(&SegmentParams::default(), vec![camera(), camera()]);
    let seen = bench.see(&Scene { table_rgb: WOOD, ..Scene::new(patches) });
    assert_eq!(seen.report.cameras_without_sheet, 2, "{}", bench.picture(0));
}

#[test]
fn what_is_before_the_sheet_has_no_outline() {
    // Near the lens, nearer than the sheet may be, and with a colour lens beside the depth lens.
    // Where nothing behind the sheet returns depth, only the bar's own depth tells.
    let params = SegmentParams { depth_max_m: 0.61, ..SegmentParams::default() };
    for (z_m, offset_m) in [(0.12, 0.0), (0.25, 0.02), (0.25, -0.02)] {
        let color_from_depth = Isometry3::translation(offset_m, 0.0, 0.0);
        let camera = RgbdCamera { color_from_depth, ..camera() };
        let bar = Patch::facing([0.01, 0.0, z_m], [0.15 * z_m, z_m], GREY);
        let mut bench = Bench::new(&params, vec![camera.clone()]);
        let sheet = Scene { table_rgb: WOOD, ..Scene::new(vec![flat_sheet()]) };
        bench.see(&sheet);
        let mut hidden = sheet.clone();
        hidden.patches.push(bar.clone());
        let seen = bench.see(&hidden);
        assert!(seen.edgels.len() > 20, "{z_m} m: {:?}", seen.report);
        let column = |x_m: f64| lens().project(&Point3::new(x_m, 0.0, z_m)).unwrap().x as f32;
        let sides = [-0.5, 0.5].map(|side| column(0.01 + side * bar.size_m[0]));
        for edgel in &seen.edgels {
            let gap_px = sides.map(|side| (edgel.position_px[0] - side).abs());
            let gap_px = gap_px[0].min(gap_px[1]);
            assert!(gap_px > 3.0, "{z_m} m, {offset_m} m: {gap_px} px from the bar: {edgel:?}");
        }
    }
}
