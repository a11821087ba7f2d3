//! A fold recorded by the RealSense SDK, tracked from its recordings with and without the SDK.

use orime_calibration::{Calibration, CameraEntry};
use orime_capture::{CaptureParams, RenderedParams, open};
use orime_geometry::{CameraModel, RgbdFrameMut, SheetGrid};
use orime_tests::{RunningSet, Scratch, root, run};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const STEPS: u64 = 24;

/// Folder of the SDK of this version, and its `paths`; `None`, said aloud, where it is not.
fn sdk(version: &str) -> Option<(PathBuf, String, Vec<String>)> {
    let folder = std::env::var_os("ORIME_REALSENSE")
        .map_or_else(|| root().join(".venv/realsense"), PathBuf::from);
    let found = fs::read_dir(&folder).ok().and_then(|entries| {
        let begins =
            |path: &PathBuf| path.file_name().unwrap().to_string_lossy().starts_with(version);
        let folder = entries.filter_map(|entry| Some(entry.ok()?.path())).find(begins)?;
        let paths = fs::read_to_string(folder.join("paths")).ok()?;
        let (library, preload) = paths.split_once('\n')?;
        let preload = preload.trim().split(':').map(str::to_owned).collect();
        Some((folder, library.to_owned(), preload))
    });
    if found.is_none() {
        eprintln!(
            "SKIPPED: no SDK {version} in `{}`: run deploy/fetch-realsense",
            folder.display()
        );
    }
    found
}

fn lens(lens: &CameraModel) -> Value {
    json!({
        "width": lens.width, "height": lens.height, "fx": lens.fx_px, "fy": lens.fy_px,
        "ppx": lens.cx_px, "ppy": lens.cy_px, "coeffs": lens.distortion,
    })
}

/// Renders the beginning of the embedded fold for the recording script, a folder a camera; the
/// cameras' names, and the calibration that says where they stand.
fn render(scratch: &Scratch) -> (Vec<String>, Calibration) {
    let rendered = RenderedParams { depth_registered: true, ..RenderedParams::default() };
    let params = CaptureParams { rendered, ..CaptureParams::default() };
    let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
    let mut source = open(&params.check().unwrap(), &sheet).unwrap();
    let cameras = source.cameras().to_vec();
    let mut calibration = Calibration::default();
    for (index, camera) in cameras.iter().enumerate() {
        let folder = scratch.path(&camera.name);
        fs::create_dir_all(&folder).unwrap();
        let (mut colors, mut depths, mut times_ms) = (vec![], vec![], vec![]);
        for step in 0..STEPS {
            let mut color_rgb = vec![0; 3 * camera.color.pixels()];
            let mut depth_units = vec![0; camera.depth.pixels()];
            let frame = RgbdFrameMut { color_rgb: &mut color_rgb, depth_units: &mut depth_units };
            source.read(step, index, frame).unwrap();
            colors.extend(color_rgb);
            depths.extend(depth_units.iter().flat_map(|raw| raw.to_le_bytes()));
            times_ms.push(source.exposure_ns(step, index) as f64 / 1e6);
        }
        let about = json!({
            "serial": camera.name, "fps": 30, "depth_units": camera.depth_m_per_unit,
            "depth": lens(&camera.depth), "color": lens(&camera.color), "times_ms": times_ms,
            "rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [0, 0, 0],
        });
        let write = |name: &str, bytes: &[u8]| fs::write(Path::new(&folder).join(name), bytes);
        write("camera.json", about.to_string().as_bytes()).unwrap();
        write("color.raw", &colors).unwrap();
        write("depth.raw", &depths).unwrap();
        calibration.camera.push(CameraEntry {
            name: camera.name.clone(),
            world_from_color: Some((&camera.world_from_color).into()),
            ..CameraEntry::default()
        });
    }
    (cameras.into_iter().map(|camera| camera.name).collect(), calibration)
}

/// Has the SDK record one camera's frames.
fn record(sdk: &Path, scratch: &Scratch, camera: &str, ending: &str) -> String {
    let out = scratch.path(&format!("{camera}.{ending}"));
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let done = Command::new(python)
        .arg(root().join("tests/realsense_record.py"))
        .args([&scratch.path(camera), &out])
        .env("PYTHONPATH", sdk)
        .env("LD_LIBRARY_PATH", sdk.join("libusb_package"))
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    out
}

/// Hash of every state that `orime-evaluate track` computes from a set.
fn states(scratch: &Scratch, set: &str) -> Vec<Value> {
    let out = scratch.path("figures.json");
    let steps = STEPS.to_string();
    let done = run("orime-evaluate", &["track", set, "--steps", &steps, "--json", &out]);
    assert!(done.status.success(), "{set}: {}", String::from_utf8_lossy(&done.stderr));
    let figures: Value = serde_json::from_str(&fs::read_to_string(&out).unwrap()).unwrap();
    let steps = figures["per_step"].as_array().unwrap();
    steps.iter().map(|step| step["state_hash"].clone()).collect()
}

/// Records with one SDK, tracks by both ways in one process, and as a set.
fn check(version: &str, ending: &str) {
    let Some((folder, library, preload)) = sdk(version) else { return };
    let scratch = Scratch::new(&format!("realsense_{ending}"));
    let (names, calibration) = render(&scratch);
    fs::write(scratch.path("calibration.toml"), calibration.to_text("")).unwrap();
    let files: Vec<String> =
        names.iter().map(|name| record(&folder, &scratch, name, ending)).collect();
    let head = "[sheet]\nsize_m = [0.15, 0.15]\nnodes = [25, 25]\n\n[capture]\n";
    let tail = "\n[capture.calibration]\nfile = \"calibration.toml\"\n";
    // The name of the section is that of the source.
    let reader =
        format!("{head}source = \"{ending}\"\n[capture.{ending}]\nfiles = {files:?}\n{tail}");
    let cameras = names.iter().zip(&files).map(|(name, file)| {
        format!("[[capture.realsense.camera]]\nname = \"{name}\"\nfile = \"{file}\"\n")
    });
    let by_sdk = format!(
        "{head}source = \"realsense\"\n[capture.realsense]\nreal_time = false\n\
         library = \"{library}\"\npreload = {preload:?}\n{}{tail}",
        cameras.collect::<String>()
    );
    let sets = [("reader.toml", reader), ("sdk.toml", by_sdk)].map(|(name, text)| {
        let path = scratch.path(name);
        fs::write(&path, text).unwrap();
        path
    });
    let [ours, theirs] = sets.each_ref().map(|set| states(&scratch, set));
    assert_eq!(ours.len(), STEPS as usize);
    assert_eq!(ours, theirs, "states with and without the SDK");
    for (set, test) in sets.iter().zip(["reader", "sdk"]) {
        let mut set = RunningSet::start(&format!("realsense_{ending}_{test}"), Some(set));
        let ended = set.wait();
        assert_eq!(ended.code, 0, "{}{}", ended.stdout, ended.stderr);
        let summary = fs::read_to_string(set.out("summary.json")).unwrap();
        let summary: Value = serde_json::from_str(&summary).unwrap();
        let steps = summary["per_step"].as_array().unwrap();
        let served: Vec<Value> = steps.iter().map(|s| s["state_hash"].clone()).collect();
        assert_eq!(served, ours, "states of the service set");
    }
}

#[test]
fn a_fold_recorded_by_sdk_2_56_is_tracked_by_both_ways() {
    check("2.56", "bag");
}

#[test]
fn a_fold_recorded_by_sdk_2_59_is_tracked_by_both_ways() {
    check("2.59", "db3");
}
