//! The SDK through its C API against the reader without it, on a real recording and on ones that
//! the SDK itself makes. Skipped, and said so, where `deploy/fetch-realsense` was not run.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use orime_capture::{
    Advance, CaptureParams, FrameSource, LiveCameraParams, RealsenseParams, SourceKind, open,
};
use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Folder of a version of the SDK, its library and what it needs before.
struct Sdk {
    folder: PathBuf,
    library: String,
    preload: Vec<String>,
}

/// The SDK whose version begins so; `None`, said aloud, where it is not.
fn sdk(version: &str) -> Option<Sdk> {
    let folder = std::env::var_os("ORIME_REALSENSE")
        .map_or_else(|| root().join(".venv/realsense"), PathBuf::from);
    let found = std::fs::read_dir(&folder).ok().and_then(|entries| {
        let named =
            |path: &PathBuf| path.file_name().unwrap().to_string_lossy().starts_with(version);
        let folder = entries.filter_map(|e| Some(e.ok()?.path())).find(named)?;
        let paths = std::fs::read_to_string(folder.join("paths")).ok()?;
        let (library, preload) = paths.split_once('\n')?;
        let preload = preload.trim().split(':').map(str::to_owned).collect();
        Some(Sdk { folder, library: library.to_owned(), preload })
    });
    if found.is_none() {
        eprintln!(
            "SKIPPED: no SDK {version} in `{}`: run deploy/fetch-realsense",
            folder.display()
        );
    }
    found
}

fn params(sdk: &Sdk, files: &[&Path], real_time: bool, reopen: bool) -> CaptureParams {
    let camera = files.iter().enumerate().map(|(k, file)| LiveCameraParams {
        name: format!("c{k}"),
        file: Some(file.to_string_lossy().into_owned()),
        ..LiveCameraParams::default()
    });
    CaptureParams {
        source: SourceKind::Realsense,
        realsense: RealsenseParams {
            camera: camera.collect(),
            real_time,
            reopen,
            stall_s: 0.3,
            library: Some(sdk.library.clone()),
            preload: sdk.preload.clone(),
            ..RealsenseParams::default()
        },
        ..CaptureParams::default()
    }
}

fn start(params: &CaptureParams) -> Box<dyn FrameSource> {
    open(&params.check().unwrap(), &SheetGrid::new([0.2, 0.2], [5, 5])).unwrap()
}

fn by_reader(kind: SourceKind, file: &Path) -> Box<dyn FrameSource> {
    let mut params = CaptureParams { source: kind, ..CaptureParams::default() };
    params.bag.files = vec![file.to_string_lossy().into_owned()];
    params.db3.files = params.bag.files.clone();
    start(&params)
}

/// One step of one camera: colour, depth, time.
fn read(source: &mut dyn FrameSource, step: u64) -> (Vec<u8>, Vec<u16>, u64) {
    let about = &source.cameras()[0];
    let mut rgb = vec![0xa5; 3 * about.color.pixels()];
    let mut depth = vec![0xdead; about.depth.pixels()];
    let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
    source.read(step, 0, frame).unwrap();
    (rgb, depth, source.exposure_ns(step, 0))
}

/// Waits until a step is there; `false` at the end.
fn wait(source: &mut dyn FrameSource, step: u64) -> bool {
    let due = Instant::now() + Duration::from_secs(20);
    loop {
        match source.advance(step) {
            Advance::Ready => return true,
            Advance::Ended => return false,
            Advance::Waiting => assert!(Instant::now() < due, "step {step} never came"),
        }
    }
}

/// Lenses and units to the bit; extrinsics to two units in the last place of the SDK's single
/// precision, for it takes them through its reference stream.
fn assert_same_camera(sdk: &RgbdCamera, reader: &RgbdCamera) {
    assert_eq!((&sdk.color, &sdk.depth), (&reader.color, &reader.depth));
    assert_eq!(sdk.depth_m_per_unit, reader.depth_m_per_unit);
    let (a, b) = (&sdk.color_from_depth, &reader.color_from_depth);
    let apart_m = (a.translation.vector - b.translation.vector).amax();
    assert!(apart_m < 2.0 * 0.016 * f64::from(f32::EPSILON), "{apart_m} m");
    let apart_rad = a.rotation.angle_to(&b.rotation);
    assert!(apart_rad < 2.0 * f64::from(f32::EPSILON), "{apart_rad} rad");
}

#[test]
fn a_real_recording_is_the_same_by_both_ways_to_the_bit() {
    let data =
        std::env::var_os("ORIME_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
    let bag = data.join("realsense_bag/single_depth_color_640x480.bag");
    if !bag.is_file() {
        eprintln!("SKIPPED: no `{}`; set ORIME_DATA", bag.display());
        return;
    }
    let Some(sdk) = sdk("2.56") else { return };
    let mut live = start(&params(&sdk, &[&bag], false, false));
    let mut file = by_reader(SourceKind::Bag, &bag);
    assert_same_camera(&live.cameras()[0], &file.cameras()[0]);
    assert!(wait(live.as_mut(), 0));
    assert!(read(live.as_mut(), 0) == read(file.as_mut(), 0), "pixels or time differ");
}

/// What a software device is to show: a camera and its frames.
struct Made {
    folder: PathBuf,
    frames: Vec<(Vec<u8>, Vec<u16>)>,
    times_ms: Vec<f64>,
}

const SIZE_PX: [usize; 2] = [160, 120];
const UNIT_M: f32 = 0.0005;

/// Frames whose every pixel differs from its neighbours, laid down for the recording script.
fn make(name: &str, count: usize) -> Made {
    let folder = std::env::temp_dir().join(format!("orime-sdk-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let [width, height] = SIZE_PX;
    let pixel = |k: usize, n: usize| (n * 7919 + k * 104_729 + n * n % 251) as u32;
    let frames: Vec<(Vec<u8>, Vec<u16>)> = (0..count)
        .map(|k| {
            let rgb = (0..3 * width * height).map(|n| (pixel(k, n) >> 3) as u8).collect();
            let depth = (0..width * height).map(|n| (pixel(k, n) % 9000) as u16).collect();
            (rgb, depth)
        })
        .collect();
    let times_ms: Vec<f64> = (0..count).map(|k| 5000.0 + (k as f64 * 33.25)).collect();
    let lens = |f: f32| {
        format!(
            "{{\"width\": {width}, \"height\": {height}, \"fx\": {f}, \"fy\": {}, \"ppx\": 81.25, \
             \"ppy\": 60.5, \"coeffs\": [0, 0, 0, 0, 0]}}",
            f + 0.5
        )
    };
    let about = format!(
        "{{\"serial\": \"0123456789\", \"fps\": 30, \"depth\": {}, \"color\": {}, \
         \"rotation\": [1, 0, 0, 0, 1, 0, 0, 0, 1], \"translation\": [0.015, 0, 0], \
         \"depth_units\": {UNIT_M}, \"times_ms\": {times_ms:?}}}",
        lens(98.5),
        lens(153.25)
    );
    std::fs::write(folder.join("camera.json"), about).unwrap();
    let rgb: Vec<u8> = frames.iter().flat_map(|(rgb, _)| rgb.iter().copied()).collect();
    let depth: Vec<u8> =
        frames.iter().flat_map(|(_, depth)| depth.iter().flat_map(|d| d.to_le_bytes())).collect();
    std::fs::write(folder.join("color.raw"), rgb).unwrap();
    std::fs::write(folder.join("depth.raw"), depth).unwrap();
    Made { folder, frames, times_ms }
}

/// Has the SDK record them.
fn record(sdk: &Sdk, made: &Made, file: &str) -> PathBuf {
    let out = made.folder.join(file);
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let done = Command::new(python)
        .arg(root().join("tests/realsense_record.py"))
        .args([&made.folder, &out])
        .env("PYTHONPATH", &sdk.folder)
        .env("LD_LIBRARY_PATH", sdk.folder.join("libusb_package"))
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    out
}

/// Records with one SDK; the reader and the SDK must both give what was recorded.
fn check_recording(version: &str, kind: SourceKind, file: &str) {
    let Some(sdk) = sdk(version) else { return };
    let made = make(file, 12);
    let file = record(&sdk, &made, file);
    let mut by_reader = by_reader(kind, &file);
    let mut by_sdk = start(&params(&sdk, &[&file], false, false));
    assert_same_camera(&by_sdk.cameras()[0], &by_reader.cameras()[0]);
    let camera = &by_reader.cameras()[0];
    assert_eq!(camera.depth_m_per_unit, f64::from(UNIT_M));
    assert_eq!((camera.depth.fx_px, camera.color.cx_px), (98.5, 81.25));
    assert_eq!(by_reader.steps(), Some(made.frames.len() as u64));
    for (k, (rgb, depth)) in made.frames.iter().enumerate() {
        let time_ns = (made.times_ms[k] * 1e6) as u64;
        let ours = read(by_reader.as_mut(), k as u64);
        assert!(ours.0 == *rgb && ours.1 == *depth, "frame {k} by the reader");
        assert!(ours.2.abs_diff(time_ns) <= 1, "time {} is not {time_ns}", ours.2);
        assert!(wait(by_sdk.as_mut(), k as u64), "the SDK ended before frame {k}");
        let theirs = read(by_sdk.as_mut(), k as u64);
        assert!(theirs.0 == *rgb && theirs.1 == *depth, "frame {k} by the SDK");
        assert!(theirs.2.abs_diff(ours.2) <= 1000, "times {} and {}", theirs.2, ours.2);
    }
    assert!(!wait(by_sdk.as_mut(), made.frames.len() as u64), "the recording has an end");
    std::fs::remove_dir_all(&made.folder).unwrap();
}

#[test]
fn a_recording_of_sdk_2_56_is_the_same_by_both_ways() {
    check_recording("2.56", SourceKind::Bag, "software.bag");
}

#[test]
fn a_recording_of_sdk_2_59_is_the_same_by_both_ways() {
    check_recording("2.59", SourceKind::Db3, "software.db3");
}

#[test]
fn a_camera_that_goes_is_counted_opened_again_and_stops_no_other() {
    let Some(sdk) = sdk("2.59") else { return };
    let (long, short) = (make("long", 90), make("short", 12));
    let [long_file, short_file] =
        [record(&sdk, &long, "long.db3"), record(&sdk, &short, "short.db3")];
    // In real time, as cameras send; the short one is "unplugged" again and again.
    let mut source = start(&params(&sdk, &[&long_file, &short_file], true, true));
    let begun = Instant::now();
    let (mut step, mut whole, mut missing, mut last_ns) = (0, 0, 0, 0);
    while begun.elapsed() < Duration::from_secs(6) {
        if source.advance(step) != Advance::Ready {
            continue;
        }
        let good = [0, 1].map(|camera| {
            let mut rgb = vec![0; 3 * SIZE_PX[0] * SIZE_PX[1]];
            let mut depth = vec![0; SIZE_PX[0] * SIZE_PX[1]];
            let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
            source.read(step, camera, frame).is_ok()
        });
        whole += u64::from(good == [true, true]);
        missing += u64::from(good == [true, false]);
        let time_ns = source.exposure_ns(step, 0);
        assert!(time_ns > last_ns, "time goes on");
        (step, last_ns) = (step + 1, time_ns);
    }
    let losses = source.losses();
    assert!(losses.stalls >= 3 && losses.returns >= 2, "{losses:?}");
    assert!(whole >= 5, "{whole} sets of both cameras");
    assert!(missing >= 20, "{missing} sets of the first camera alone");
    for made in [long, short] {
        std::fs::remove_dir_all(&made.folder).unwrap();
    }
}

#[test]
fn a_missing_library_or_recording_is_said_with_the_remedy() {
    let mut params = CaptureParams { source: SourceKind::Realsense, ..CaptureParams::default() };
    params.realsense.library = Some("/nowhere/librealsense2.so".to_owned());
    let sheet = SheetGrid::new([0.2, 0.2], [5, 5]);
    let message = |params: &CaptureParams| {
        open(&params.check().unwrap(), &sheet).err().expect("it opened").to_string()
    };
    let text = message(&params);
    assert!(
        text.contains("/nowhere/librealsense2.so") && text.contains("docs/cameras.md"),
        "{text}"
    );
    let Some(sdk) = sdk("2.59") else { return };
    let nowhere = Path::new("/nowhere/recording.db3");
    let text = message(&self::params(&sdk, &[nowhere], true, false));
    assert!(text.contains("/nowhere/recording.db3"), "{text}");
    let mut live = self::params(&sdk, &[], true, false);
    live.realsense.camera = vec![LiveCameraParams { serial: "42".into(), ..Default::default() }];
    let text = message(&live);
    assert!(text.contains("serial `42`") && text.contains("plugged in are: none"), "{text}");
}
