//! Milliseconds per RGB-D frame and core: `cargo bench -p orime-capture --no-default-features`.
//!
//! Folders are measured where `$ORIME_DATA` (or `../shared/data`) holds the recordings.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use orime_capture::{
    CaptureParams, FaultPreset, FrameSource, SequenceKind, SourceKind, Viewpoints, open,
};
use orime_geometry::{RgbdFrameMut, SheetGrid};

fn main() {
    measure("rendered, 0.15 m square", &CaptureParams::default(), [0.15, 0.15]);
    measure("rendered, A4", &CaptureParams::default(), [0.21, 0.297]);
    for (name, sequence) in [
        ("square base", SequenceKind::SquareBase),
        ("soft fold", SequenceKind::SoftFold),
        ("blintz", SequenceKind::Blintz),
    ] {
        for (faults, what) in [(FaultPreset::Noise, "noise"), (FaultPreset::Real, "all faults")] {
            let mut params = CaptureParams::default();
            params.rendered.sequence = sequence;
            params.rendered.viewpoints = Viewpoints::Five;
            params.rendered.faults = faults;
            params.rendered.steps = Some(60);
            measure(&format!("rendered, {name}, 5 cameras, {what}"), &params, [0.15, 0.15]);
        }
    }
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let data = std::env::var_os("ORIME_DATA")
        .map_or_else(|| repository.join("../shared/data"), PathBuf::from);
    for name in ["paper_desk", "three_cameras", "cloth_swing"] {
        if !data.join(name).is_dir() {
            println!("{name}: SKIPPED, not found under {}", data.display());
            continue;
        }
        let mut params = CaptureParams { source: SourceKind::Folder, ..CaptureParams::default() };
        let layout = repository.join(format!("tests/sets/layouts/{name}.toml"));
        params.folder.layout = layout.to_string_lossy().into_owned();
        params.folder.data_dir = Some(data.to_string_lossy().into_owned());
        measure(name, &params, [0.21, 0.297]);
    }
}

/// Reads every frame twice and prints the median and the 99th percentile of the second pass.
fn measure(name: &str, params: &CaptureParams, size_m: [f64; 2]) {
    let config = params.check().expect("the parameters are right");
    let opening = Instant::now();
    let mut source = open(&config, &SheetGrid::new(size_m, [25, 25])).expect("the source opens");
    let opening_ms = opening.elapsed().as_secs_f64() * 1e3;
    let mut frames = buffers(source.as_ref());
    let mut times_ms = Vec::new();
    for pass in 0..2 {
        for step in 0..source.steps().expect("the source ends") {
            for (camera, (rgb, depth)) in frames.iter_mut().enumerate() {
                let start = Instant::now();
                let frame = RgbdFrameMut { color_rgb: rgb, depth_units: depth };
                source.read(step, camera, frame).expect("the frame is whole");
                if pass == 1 {
                    times_ms.push(start.elapsed().as_secs_f64() * 1e3);
                }
                black_box(&rgb);
            }
        }
    }
    times_ms.sort_by(f64::total_cmp);
    let at = |share: f64| times_ms[(share * (times_ms.len() - 1) as f64) as usize];
    println!(
        "{name}: open {opening_ms:.0} ms, frame p50 {:.2} ms, p99 {:.2} ms ({} frames)",
        at(0.5),
        at(0.99),
        times_ms.len()
    );
}

fn buffers(source: &dyn FrameSource) -> Vec<(Vec<u8>, Vec<u16>)> {
    let cameras = source.cameras().iter();
    cameras.map(|c| (vec![0; 3 * c.color.pixels()], vec![0; c.depth.pixels()])).collect()
}
