//! The recording source gives back what the rendered source gave.

use std::fs;
use std::path::PathBuf;

use orime_capture::{
    CaptureParams, FrameSource, RecordingParams, RenderedParams, SourceKind, open,
};
use orime_geometry::{RgbdFrame, RgbdFrameMut, SheetGrid};
use orime_recording::{Recorder, SheetState};

const STEPS: u64 = 4;

fn sheet() -> SheetGrid {
    SheetGrid::new([0.15, 0.15], [9, 9])
}

fn rendered() -> Box<dyn FrameSource> {
    let rendered =
        RenderedParams { steps: Some(STEPS), size_px: [160, 120], ..RenderedParams::default() };
    let params = CaptureParams { rendered, ..CaptureParams::default() };
    open(&params.check().unwrap(), &sheet()).unwrap()
}

fn replayed(
    file: &std::path::Path,
    repeat: bool,
    damaged: bool,
) -> Result<Box<dyn FrameSource>, String> {
    let recording = RecordingParams { file: file.to_str().unwrap().into(), damaged };
    let params = CaptureParams {
        source: SourceKind::Recording,
        repeat,
        recording,
        ..CaptureParams::default()
    };
    open(&params.check().unwrap(), &sheet()).map_err(|error| error.to_string())
}

fn read(source: &mut dyn FrameSource, step: u64, camera: usize) -> (Vec<u8>, Vec<u16>) {
    let about = &source.cameras()[camera];
    let mut rgb = vec![0xa5; 3 * about.color.pixels()];
    let mut depth = vec![0xdead; about.depth.pixels()];
    let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
    let report = source.read(step, camera, frame).unwrap();
    assert_eq!(report.copies, 0);
    (rgb, depth)
}

fn truth(source: &dyn FrameSource, step: u64) -> Option<Vec<[f32; 3]>> {
    let mut nodes_m = vec![[0.0; 3]; sheet().len()];
    source.truth_m(step, &sheet(), &mut nodes_m).then_some(nodes_m)
}

/// Records the rendered source.
fn record(test: &str) -> PathBuf {
    let name = format!("orime-replay-{test}-{}.mcap", std::process::id());
    let path = std::env::temp_dir().join(name);
    let _ = fs::remove_file(&path);
    let mut source = rendered();
    let mut recorder = Recorder::create(&path, "test", source.cameras()).unwrap();
    for step in 0..STEPS {
        for camera in 0..source.cameras().len() {
            let (rgb, depth) = read(source.as_mut(), step, camera);
            let frame = RgbdFrame { color_rgb: &rgb, depth_units: &depth };
            recorder.frame(step, camera, source.exposure_ns(step, camera), frame).unwrap();
        }
        let nodes_m = truth(source.as_ref(), step).unwrap();
        let time_ns = source.exposure_ns(step, 0);
        recorder.sheet(step, time_ns, SheetState::Truth, &sheet(), &nodes_m).unwrap();
    }
    recorder.finish().unwrap();
    path
}

#[test]
fn a_replay_is_bit_for_bit_what_was_recorded() {
    let path = record("whole");
    let mut original = rendered();
    let mut replay = replayed(&path, false, false).unwrap();
    assert_eq!(replay.cameras(), original.cameras());
    assert_eq!(replay.steps(), Some(STEPS));
    // Backwards as well: frames do not depend on what was read before.
    for step in (0..STEPS).chain((0..STEPS).rev()) {
        for camera in 0..original.cameras().len() {
            assert_eq!(replay.exposure_ns(step, camera), original.exposure_ns(step, camera));
            let same = read(replay.as_mut(), step, camera) == read(original.as_mut(), step, camera);
            assert!(same, "step {step}, camera {camera}");
        }
        assert_eq!(truth(replay.as_ref(), step), truth(original.as_ref(), step));
    }
    // Truth on another grid is not given out as if it were on this one.
    let other = SheetGrid::new([0.15, 0.15], [5, 5]);
    assert!(!replay.truth_m(0, &other, &mut [[0.0; 3]; 25]));
    let mut repeated = replayed(&path, true, false).unwrap();
    assert_eq!(repeated.steps(), None);
    assert!(read(repeated.as_mut(), STEPS + 1, 0) == read(original.as_mut(), 1, 0));
    let times: Vec<u64> = (0..3 * STEPS).map(|step| repeated.exposure_ns(step, 1)).collect();
    assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{times:?}");
    fs::remove_file(path).unwrap();
}

#[test]
fn a_damaged_recording_is_played_only_where_the_set_says_so() {
    let path = record("damaged");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let error = replayed(&path, false, false).err().unwrap();
    assert!(error.contains("damaged = true") && error.contains("orime-replay"), "{error}");
    let mut replay = replayed(&path, false, true).unwrap();
    assert!(replay.steps().unwrap() < STEPS);
    assert!(read(replay.as_mut(), 0, 0) == read(rendered().as_mut(), 0, 0));
    fs::remove_file(path).unwrap();
    let error = replayed(std::path::Path::new("/nowhere/x.mcap"), false, true).err().unwrap();
    assert!(error.contains("/nowhere/x.mcap"), "{error}");
}
