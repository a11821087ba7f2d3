//! The rendered sheet's print against geometry computed here and the detector's own eyes.

use orime_capture::{
    CaptureParams, FaultPreset, FrameSource, Printed, RenderedParams, Viewpoints, open,
};
use orime_geometry::nalgebra::{Point3, Vector2};
use orime_geometry::{RgbdFrameMut, SheetGrid};
use orime_markers::{Detector, DetectorParams, SheetPrint};

fn source(rendered: RenderedParams) -> Box<dyn FrameSource> {
    let params = CaptureParams { rendered, ..CaptureParams::default() };
    open(&params.check().unwrap(), &SheetGrid::new([0.15, 0.15], [25, 25])).unwrap()
}

fn rgb(source: &mut dyn FrameSource, step: u64, camera: usize) -> Vec<u8> {
    let about = &source.cameras()[camera];
    let mut color_rgb = vec![0xa5; 3 * about.color.pixels()];
    let mut depth_units = vec![0xdead; about.depth.pixels()];
    let frame = RgbdFrameMut { color_rgb: &mut color_rgb, depth_units: &mut depth_units };
    source.read(step, camera, frame).unwrap();
    color_rgb
}

#[test]
fn the_detector_finds_the_printed_corners_where_the_truth_projects_them() {
    let grid = SheetGrid::new([0.15, 0.15], [25, 25]);
    let print = SheetPrint::new(grid.nodes).unwrap();
    let config = DetectorParams::default().check().unwrap();
    let mut detector = Detector::new(&config, print.dictionary().clone());
    let mut source = source(RenderedParams {
        printed: Printed::Markers,
        faults: FaultPreset::None,
        viewpoints: Viewpoints::Five,
        ..RenderedParams::default()
    });
    let mut nodes = vec![[0.0; 3]; grid.len()];
    // Flat, and half folded: then some cameras see both sides.
    for (step, markers_min) in [(0, 15), (60, 8)] {
        source.truth_m(step, &grid, &mut nodes);
        let mut seen = [0, 0];
        for camera in 0..source.cameras().len() {
            let image = rgb(source.as_mut(), step, camera);
            let about = source.cameras()[camera].clone();
            let lens_from_world = about.world_from_color.inverse();
            let (width, height) = (about.color.width as usize, about.color.height as usize);
            let markers = detector.detect_rgb(width, height, &image).unwrap();
            let mut errors_px = Vec::new();
            for marker in markers {
                let printed = print.marker(marker.id).expect("an id that is not on the sheet");
                seen[usize::from(marker.id >= 49)] += 1;
                for (corner, place) in marker.corners_px.iter().zip(printed.corners) {
                    let Some(node) = place.node else { continue };
                    let point = Point3::from(nodes[node]).cast::<f64>();
                    let truth_px = about.color.project(&(lens_from_world * point)).unwrap();
                    errors_px.push((Vector2::from(*corner) - truth_px).norm());
                }
            }
            let name = format!("step {step}, camera `{}`", about.name);
            assert!(markers.len() >= markers_min, "{name}: {} markers", markers.len());
            errors_px.sort_by(f64::total_cmp);
            let median_px = errors_px[errors_px.len() / 2];
            let p95_px = errors_px[errors_px.len() * 95 / 100];
            println!("{name}: {} markers, {median_px:.3} and {p95_px:.3} px", markers.len());
            assert!(median_px < 0.2 && p95_px < 0.6, "{name}: {median_px}, {p95_px} px");
        }
        assert!(seen[0] > 20 && seen[1] > 20, "step {step}: front and back markers {seen:?}");
    }
}

#[test]
fn sheets_that_cannot_be_printed_are_refused() {
    let rendered = RenderedParams { printed: Printed::Markers, ..RenderedParams::default() };
    let params = CaptureParams { rendered, ..CaptureParams::default() };
    let sheet = SheetGrid::new([0.15, 0.15], [24, 25]);
    let error = open(&params.check().unwrap(), &sheet).err().expect("must be refused");
    assert!(error.to_string().contains("`rendered.printed`: sheet."), "{error}");
}
