//! What the targets share: bytes as a file, bytes as numbers.

use orime_geometry::{CameraModel, RgbdCamera, RgbdFrameMut};
use orime_recording::RealsenseRecording;
use std::path::{Path, PathBuf};

/// Steps that are read; more of them are the same.
pub const STEPS_MAX: u64 = 4;
/// Pixels of a camera that are read; more only cost memory.
pub const PIXELS_MAX: usize = 1 << 22;

/// Opens the bytes as a recording of the RealSense SDK and reads its frames.
pub fn read_realsense(bytes: &[u8], ending: &str) {
    let path = as_file(bytes, ending);
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
}

/// Puts the bytes into a file of this ending, in memory where the system has such a folder. One
/// per process, so that several fuzzers do not meet.
pub fn as_file(bytes: &[u8], ending: &str) -> PathBuf {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    let path = folder.join(format!("orime-fuzz-{}.{ending}", std::process::id()));
    std::fs::write(&path, bytes).expect("the folder of temporary files can be written");
    path
}

/// Numbers from the bytes, little-endian, four bytes each: every f32, the broken ones too.
pub fn numbers(bytes: &[u8]) -> impl Iterator<Item = f32> + '_ {
    bytes.chunks_exact(4).map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]]))
}

/// A camera that calibrations can be applied to.
pub fn camera(name: &str) -> RgbdCamera {
    let lens = CameraModel {
        width: 64,
        height: 48,
        fx_px: 60.0,
        fy_px: 60.0,
        cx_px: 32.0,
        cy_px: 24.0,
        distortion: [0.0; 5],
    };
    RgbdCamera {
        name: name.to_owned(),
        color: lens.clone(),
        depth: lens,
        color_from_depth: Default::default(),
        world_from_color: Default::default(),
        depth_m_per_unit: 0.001,
    }
}
