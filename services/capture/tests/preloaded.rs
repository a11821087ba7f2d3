//! Frames out of memory are the source's own, and those beyond what there was room for too.

use orime_capture::{CaptureParams, FrameSource, open};
use orime_geometry::{RgbdFrameMut, SheetGrid};

fn source(preload_mb: f64) -> Box<dyn FrameSource> {
    let mut params = CaptureParams { preload_mb, ..CaptureParams::default() };
    params.rendered.size_px = [160, 120];
    params.rendered.steps = Some(6);
    let sheet = SheetGrid::new([0.15, 0.15], [13, 13]);
    open(&params.check().expect("good parameters"), &sheet).expect("it opens")
}

fn frame(source: &mut dyn FrameSource, step: u64, camera: usize) -> (Vec<u8>, Vec<u16>, u32) {
    let (mut color_rgb, mut depth_units) = (vec![1; 3 * 160 * 120], vec![1; 160 * 120]);
    let into = RgbdFrameMut { color_rgb: &mut color_rgb, depth_units: &mut depth_units };
    let report = source.read(step, camera, into).expect("it can be read");
    (color_rgb, depth_units, report.copies)
}

#[test]
fn frames_out_of_memory_are_the_same() {
    // Three cameras of 5 bytes a pixel: 288 kB a set, of which three have room.
    let (mut plain, mut preloaded) = (source(0.0), source(0.9));
    assert_eq!(plain.cameras(), preloaded.cameras());
    assert_eq!((plain.steps(), preloaded.steps()), (Some(6), Some(6)));
    for step in 0..6 {
        for camera in 0..plain.cameras().len() {
            assert_eq!(plain.exposure_ns(step, camera), preloaded.exposure_ns(step, camera));
            let (a, b) = (frame(&mut *plain, step, camera), frame(&mut *preloaded, step, camera));
            assert_eq!((a.0, a.1), (b.0, b.1), "step {step}, camera {camera}");
            assert_eq!([a.2, b.2], [0, u32::from(step < 3)], "step {step}");
        }
    }
}
