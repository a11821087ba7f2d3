//! The reader of RealSense recordings on a real one, where it is at hand, and on broken ones.

use std::path::{Path, PathBuf};

use orime_geometry::{CameraModel, RgbdFrameMut};
use orime_recording::{RealsenseError, RealsenseRecording};

fn bag() -> Option<PathBuf> {
    let data = std::env::var_os("ORIME_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let bag = data.join("realsense_bag/single_depth_color_640x480.bag");
    if !bag.is_file() {
        eprintln!("SKIPPED: no `{}`; set ORIME_DATA", bag.display());
        return None;
    }
    Some(bag)
}

/// A number of meta.json. All are of single precision; serde_json's parser is not exact to the
/// last bit of double precision.
fn exact(value: &serde_json::Value) -> f64 {
    f64::from(value.as_f64().unwrap() as f32)
}

/// The lens that meta.json states for a topic.
fn lens(meta: &serde_json::Value, topic: &str) -> CameraModel {
    let info = &meta[topic];
    let number = |k: usize| exact(&info["K"][k]);
    CameraModel {
        width: info["w"].as_u64().unwrap() as u32,
        height: info["h"].as_u64().unwrap() as u32,
        fx_px: number(0),
        fy_px: number(4),
        cx_px: number(2),
        cy_px: number(5),
        distortion: std::array::from_fn(|k| exact(&info["D"][k])),
    }
}

#[test]
fn a_real_recording_is_what_its_description_says_to_the_bit() {
    let Some(bag) = bag() else { return };
    let meta = std::fs::read_to_string(bag.with_file_name("meta.json")).unwrap();
    let meta: serde_json::Value = serde_json::from_str(&meta).unwrap();
    let recording = RealsenseRecording::open(&bag, None).unwrap();
    let camera = recording.camera();
    assert_eq!(camera.depth, lens(&meta, "/device_0/sensor_0/Depth_0/info/camera_info"));
    assert_eq!(camera.color, lens(&meta, "/device_0/sensor_1/Color_0/info/camera_info"));
    let unit = exact(&meta["/device_0/sensor_0/option/Depth Units/value"]);
    assert_eq!(camera.depth_m_per_unit, unit);
    for (key, value) in recording.info() {
        assert_eq!(Some(value.as_str()), meta[key].as_str(), "{key}");
    }
    let tf = &meta["/device_0/sensor_1/Color_0/tf/0"];
    let [_, color] = recording.extrinsics();
    for k in 0..3 {
        assert_eq!(f64::from(color.translation_m[k]), exact(&tf["t"][k]));
    }
    // The quaternion, from the rotation that the SDK makes of it: single precision.
    let rotation = color.isometry().rotation;
    for (k, found) in rotation.coords.iter().enumerate() {
        let expected = tf["q_xyzw"][k].as_f64().unwrap();
        assert!((found - expected).abs() < 1e-7, "{found} is not {expected}");
    }
    assert_eq!(camera.color_from_depth, color.isometry(), "maps depth into colour");
}

#[test]
fn frames_of_a_real_recording_are_read_whole() {
    let Some(bag) = bag() else { return };
    let mut recording = RealsenseRecording::open(&bag, None).unwrap();
    assert_eq!((recording.steps(), recording.unpaired()), (1, 1), "a depth frame is left over");
    assert_eq!(recording.frame_numbers(0), [169, 162]);
    assert_eq!(recording.exposure_ns(0), 360_815_089_000, "the header's stamp");
    let mut rgb = vec![0; 3 * 640 * 480];
    let mut depth = vec![0xdead; 640 * 480];
    let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
    recording.read(0, frame).unwrap();
    assert_eq!(rgb[..6], [0xac, 0x96, 0x73, 0xab, 0x95, 0x72], "the first pixels of the file");
    let metres: Vec<u16> = depth.iter().copied().filter(|raw| *raw > 0).collect();
    assert!(metres.len() > 200_000, "{} pixels with depth", metres.len());
}

#[test]
fn what_is_no_recording_is_refused_with_its_name() {
    let folder = std::env::temp_dir().join(format!("orime-realsense-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let refuse = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        let error = RealsenseRecording::open(&path, None).err().expect(name);
        assert!(error.to_string().contains(name), "{error}");
        error
    };
    assert!(matches!(refuse("text.bag", b"hello"), RealsenseError::Damaged { .. }));
    assert!(matches!(refuse("text.db3", b"hello"), RealsenseError::Damaged { .. }));
    refuse("empty.bag", b"");
    refuse("empty.db3", b"");
    let missing = RealsenseRecording::open(&folder.join("none.db3"), None).err().unwrap();
    assert!(matches!(missing, RealsenseError::File { .. }), "{missing}");
    if let Some(bag) = bag() {
        // Cut off anywhere, and with a flipped byte anywhere: an error or a recording, no panic.
        let whole = std::fs::read(&bag).unwrap();
        for share in [0.001, 0.3, 0.7, 0.99] {
            let cut = (whole.len() as f64 * share) as usize;
            refuse("cut.bag", &whole[..cut]);
        }
        for k in 0..40 {
            let mut flipped = whole.clone();
            let at = (k * 26_003 + 20) % flipped.len();
            flipped[at] ^= 0x55;
            let path = folder.join("flipped.bag");
            std::fs::write(&path, &flipped).unwrap();
            if let Ok(mut recording) = RealsenseRecording::open(&path, None) {
                let pixels = recording.camera().clone();
                let mut rgb = vec![0; 3 * pixels.color.pixels()];
                let mut depth = vec![0; pixels.depth.pixels()];
                let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
                let _ = recording.read(0, frame);
            }
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
