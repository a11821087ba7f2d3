//! Bytes as an MCAP recording, all of whose frames are read.
#![no_main]

use libfuzzer_sys::fuzz_target;
use orime_fuzz::{PIXELS_MAX, STEPS_MAX};
use orime_geometry::RgbdFrameMut;
use orime_recording::McapRecording;

fuzz_target!(|bytes: &[u8]| {
    let path = orime_fuzz::as_file(bytes, "mcap");
    let Ok(mut recording) = McapRecording::open(&path) else { return };
    let sizes = recording.cameras().iter().map(|c| {
        [&c.color, &c.depth].map(|lens| (lens.width as usize).saturating_mul(lens.height as usize))
    });
    let sizes: Vec<[usize; 2]> = sizes.collect();
    for step in 0..recording.steps().min(STEPS_MAX) {
        for (camera, [color, depth]) in sizes.iter().enumerate() {
            if color.max(depth) > &PIXELS_MAX {
                continue;
            }
            let (mut color_rgb, mut depth_units) = (vec![0; 3 * color], vec![0; *depth]);
            let frame = RgbdFrameMut { color_rgb: &mut color_rgb, depth_units: &mut depth_units };
            let _ = recording.read(step, camera, frame);
        }
    }
});
