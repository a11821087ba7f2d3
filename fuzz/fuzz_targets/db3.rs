//! Bytes as a RealSense recording in a .db3 file, all of whose frames are read.
#![no_main]

use libfuzzer_sys::fuzz_target;
use orime_geometry::RgbdFrameMut;
use orime_recording::RealsenseRecording;

/// Steps that are read; more of them are the same.
const STEPS_MAX: u64 = 4;
/// Pixels of a camera that are read; more only cost memory.
const PIXELS_MAX: usize = 1 << 22;

fuzz_target!(|bytes: &[u8]| {
    let path = orime_fuzz::as_file(bytes, "db3");
    let Ok(mut recording) = RealsenseRecording::open(&path, None) else { return };
    let [color, depth] = [&recording.camera().color, &recording.camera().depth]
        .map(|lens| (lens.width as usize).saturating_mul(lens.height as usize));
    if color.max(depth) > PIXELS_MAX {
        return;
    }
    let (mut color_rgb, mut depth_units) = (vec![0; 3 * color], vec![0; depth]);
    for step in 0..recording.steps().min(STEPS_MAX) {
        let frame = RgbdFrameMut { color_rgb: &mut color_rgb, depth_units: &mut depth_units };
        let _ = recording.read(step, frame);
    }
});
