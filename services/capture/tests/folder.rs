//! The folder source over a real recording, where it is at hand.

use std::path::{Path, PathBuf};

use orime_capture::{CaptureParams, FrameSource, SourceKind, open};
use orime_geometry::{RgbdFrameMut, SheetGrid};

fn params(data: &Path, layout: &str) -> CaptureParams {
    let layouts = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/sets/layouts");
    let mut params = CaptureParams { source: SourceKind::Folder, ..CaptureParams::default() };
    params.folder.layout = layouts.join(layout).to_string_lossy().into_owned();
    params.folder.data_dir = Some(data.to_string_lossy().into_owned());
    params
}

fn data() -> PathBuf {
    std::env::var_os("ORIME_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    )
}

fn sheet() -> SheetGrid {
    SheetGrid::new([0.21, 0.297], [5, 5])
}

#[test]
fn a_repeated_recording_starts_over_and_its_clock_goes_on() {
    if !data().join("paper_desk").is_dir() {
        eprintln!("SKIPPED: no `paper_desk` under `{}`; set ORIME_DATA", data().display());
        return;
    }
    let params = CaptureParams { repeat: true, ..params(&data(), "paper_desk.toml") };
    let mut source = open(&params.check().unwrap(), &sheet()).unwrap();
    assert_eq!(source.steps(), None);
    let read = |source: &mut dyn FrameSource, step: u64| {
        let (mut rgb, mut depth) = (vec![0xa5; 640 * 480 * 3], vec![0xdead; 640 * 480]);
        let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
        source.read(step, 0, frame).unwrap();
        (rgb, depth)
    };
    let first = read(source.as_mut(), 3);
    assert!(first == read(source.as_mut(), 19), "step 19 shows frame 3 again");
    assert!(first != read(source.as_mut(), 4));
    let times: Vec<u64> = (0..40).map(|step| source.exposure_ns(step, 0)).collect();
    assert!(times.windows(2).all(|pair| pair[0] < pair[1]));
    assert!(!source.truth_m(0, &sheet(), &mut [[0.0; 3]; 25]), "nobody knows the truth");
}

#[test]
fn an_absent_recording_is_refused_with_the_place_where_it_should_be() {
    let params = params(Path::new("/nowhere"), "paper_desk.toml");
    let message = open(&params.check().unwrap(), &sheet()).err().unwrap().to_string();
    assert!(message.contains("/nowhere/paper_desk"), "{message}");
    let unresolved = CaptureParams {
        folder: orime_capture::FolderParams {
            layout: "x.toml".into(),
            data_dir: Some("${ORIME_DATA}".into()),
        },
        ..params
    };
    let problems = unresolved.check().unwrap_err();
    assert_eq!(problems[0].key, "folder.data_dir");
}
