//! Recording and replaying rendered frames: megabytes of pixels per second, and the file's size.
//!
//! `cargo bench -p orime-capture --no-default-features --bench recording [-- FOLDER]`; the file
//! lies in FOLDER, by default the system's for temporary files.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use orime_capture::{CaptureParams, open};
use orime_geometry::{RgbdFrame, RgbdFrameMut, SheetGrid};
use orime_recording::{McapRecording, Recorder};

const STEPS: u64 = 60;

fn main() {
    let folder = std::env::args().skip(1).find(|argument| !argument.starts_with("--"));
    let folder = folder.map_or_else(std::env::temp_dir, PathBuf::from);
    let path = folder.join(format!("orime-bench-{}.mcap", std::process::id()));
    let config = CaptureParams::default().check().expect("the defaults are right");
    let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
    let mut source = open(&config, &sheet).expect("the defaults open");
    let cameras = source.cameras().to_vec();
    let mut buffers: Vec<(Vec<u8>, Vec<u16>)> = cameras
        .iter()
        .map(|about| (vec![0; 3 * about.color.pixels()], vec![0; about.depth.pixels()]))
        .collect();
    let frame_bytes: usize = buffers.iter().map(|(rgb, depth)| rgb.len() + 2 * depth.len()).sum();
    let megabytes = STEPS as f64 * frame_bytes as f64 / 1e6;

    let mut written = Duration::ZERO;
    let mut recorder = Recorder::create(&path, "bench", &cameras).expect("FOLDER is writable");
    for step in 0..STEPS {
        // The fold's own frames, not only its rest at the start.
        let shown = step * source.steps().unwrap_or(STEPS) / STEPS;
        for (camera, (rgb, depth)) in buffers.iter_mut().enumerate() {
            let frame = RgbdFrameMut { color_rgb: rgb, depth_units: depth };
            source.read(shown, camera, frame).expect("frames render");
            let frame = RgbdFrame { color_rgb: rgb, depth_units: depth };
            let start = Instant::now();
            let time_ns = source.exposure_ns(shown, camera);
            recorder.frame(step, camera, time_ns, frame).expect("there is room");
            written += start.elapsed();
        }
    }
    let start = Instant::now();
    let recorded = recorder.finish().expect("there is room");
    written += start.elapsed();

    let start = Instant::now();
    let mut recording = McapRecording::open(&path).expect("it is whole");
    let opened = start.elapsed();
    let start = Instant::now();
    for step in 0..STEPS {
        for (camera, (rgb, depth)) in buffers.iter_mut().enumerate() {
            let frame = RgbdFrameMut { color_rgb: rgb, depth_units: depth };
            recording.read(step, camera, frame).expect("it is whole");
        }
    }
    let read = start.elapsed();
    report(&path, cameras.len(), megabytes, recorded.bytes);
    for (what, took) in [("written", written), ("opened and checked", opened), ("read", read)] {
        let per_set_ms = 1e3 * took.as_secs_f64() / STEPS as f64;
        let rate = megabytes / took.as_secs_f64();
        println!("{what}: {rate:.0} MB/s of pixels, {per_set_ms:.2} ms a set");
    }
    std::fs::remove_file(path).expect("the file was just read");
}

fn report(path: &Path, cameras: usize, megabytes: f64, bytes: u64) {
    let share = bytes as f64 / 1e6 / megabytes;
    println!(
        "{STEPS} sets of {cameras} cameras, {megabytes:.0} MB of pixels: \
         `{}` has {:.0} MB ({:.0} %)",
        path.display(),
        bytes as f64 / 1e6,
        100.0 * share
    );
}
