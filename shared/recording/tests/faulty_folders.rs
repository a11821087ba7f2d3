//! Small recordings written here, whole and broken.

use std::fs;
use std::path::{Path, PathBuf};

use orime_geometry::RgbdFrameMut;
use orime_recording::{FolderLayout, FolderRecording, ImageError, ImageReader};

const LAYOUT: &str = r#"
root = "set"
rate_hz = 10.0
frames = [1, 2, 5]

[[camera]]
name = "a"
color = "c{frame:02}.png"
depth = "d{frame:02}.png"
depth_m_per_unit = { file = "calib.json", pointer = "/unit" }

[camera.color_lens]
size_px = [8, 6]
k = { file = "calib.json", pointer = "/k" }

[camera.depth_lens]
size_px = [4, 2]
k = [[3, 0, 1.5], [0, 3, 0.5], [0, 0, 1]]

[camera.color_from_depth]
rotation = [1, 0, 0, 0, 1, 0, 0, 0, 1]
translation_m = { file = "calib.json", pointer = "/t" }

[camera.exposure]
file = "calib.json"
list = "/times"
frame = "/n"
time = "/at"
unit = "ms"
"#;

const CALIB: &str = r#"{
    "unit": 0.0005, "k": [[7.0, 0, 3.5], [0, 7.0, 2.5], [0, 0, 1]], "t": [[0.015], [0], [0]],
    "times": [{"n": 5, "at": 900.5}, {"n": 2, "at": 120}, {"n": 1, "at": 20}]
}"#;

/// Writes a PNG; 16-bit samples are given big-endian.
fn write_png(path: &Path, size: [u32; 2], color: png::ColorType, bits: png::BitDepth, data: &[u8]) {
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), size[0], size[1]);
    encoder.set_color(color);
    encoder.set_depth(bits);
    encoder.write_header().unwrap().write_image_data(data).unwrap();
}

/// A fresh folder with a whole recording.
fn folder(test: &str) -> PathBuf {
    let folder =
        std::env::temp_dir().join(format!("orime-recording-{test}-{}", std::process::id()));
    let _ = fs::remove_dir_all(&folder);
    let set = folder.join("set");
    fs::create_dir_all(&set).unwrap();
    fs::write(folder.join("layout.toml"), LAYOUT).unwrap();
    fs::write(set.join("calib.json"), CALIB).unwrap();
    for n in [1, 2, 5] {
        let color: Vec<u8> = (0..8 * 6 * 3).map(|k| k as u8 + n).collect();
        write_png(
            &set.join(format!("c{n:02}.png")),
            [8, 6],
            png::ColorType::Rgb,
            png::BitDepth::Eight,
            &color,
        );
        let depth: Vec<u8> =
            (0..8u16).flat_map(|k| (1000 * k + u16::from(n)).to_be_bytes()).collect();
        write_png(
            &set.join(format!("d{n:02}.png")),
            [4, 2],
            png::ColorType::Grayscale,
            png::BitDepth::Sixteen,
            &depth,
        );
    }
    folder
}

fn open(folder: &Path) -> Result<FolderRecording, String> {
    FolderRecording::open(&folder.join("layout.toml"), None).map_err(|error| error.to_string())
}

fn read(
    recording: &mut FolderRecording,
    step: u64,
) -> Result<(Vec<u8>, Vec<u16>, u32), ImageError> {
    let (mut rgb, mut depth) = (vec![0xa5; 8 * 6 * 3], vec![0xdead; 8]);
    let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
    let copies = recording.read(step, 0, frame)?;
    Ok((rgb, depth, copies))
}

#[test]
fn a_whole_recording_reads_as_it_was_written() {
    let folder = folder("whole");
    let mut recording = open(&folder).unwrap();
    let camera = recording.cameras()[0].clone();
    assert_eq!((camera.color.fx_px, camera.color.cy_px), (7.0, 2.5));
    assert_eq!((camera.depth.cx_px, camera.depth.height), (1.5, 2));
    assert_eq!(camera.color_from_depth.translation.x, 0.015);
    assert_eq!(camera.depth_m_per_unit, 0.0005);
    assert_eq!(recording.steps(), 3);
    let times: Vec<u64> = (0..3).map(|step| recording.exposure_ns(step, 0)).collect();
    assert_eq!(times, [20_000_000, 120_000_000, 900_500_000]);
    // From the first stamp to the last, and one nominal period.
    assert_eq!(recording.round_ns(), 880_500_000 + 100_000_000);
    let (rgb, depth, copies) = read(&mut recording, 2).unwrap();
    assert_eq!(copies, 0);
    assert_eq!(rgb[..4], [5, 6, 7, 8]);
    assert_eq!(depth, [5, 1005, 2005, 3005, 4005, 5005, 6005, 7005]);
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn grey_and_transparent_pngs_take_one_counted_copy() {
    let folder = folder("kinds");
    let set = folder.join("set");
    let rgba: Vec<u8> = (0..48).flat_map(|k| [k, k + 1, k + 2, 7]).collect();
    let (rgb_kind, eight) = (png::ColorType::Rgba, png::BitDepth::Eight);
    write_png(&set.join("c01.png"), [8, 6], rgb_kind, eight, &rgba);
    let grey: Vec<u8> = (0..48).collect();
    write_png(&set.join("c02.png"), [8, 6], png::ColorType::Grayscale, eight, &grey);
    let mut recording = open(&folder).unwrap();
    let (rgb, _, copies) = read(&mut recording, 0).unwrap();
    assert_eq!((copies, &rgb[3..6]), (1, &[1, 2, 3][..]));
    let (rgb, _, copies) = read(&mut recording, 1).unwrap();
    assert_eq!((copies, &rgb[3..9]), (1, &[1, 1, 1, 2, 2, 2][..]));
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn one_broken_frame_is_named_and_the_others_live() {
    let folder = folder("broken");
    let set = folder.join("set");
    fs::remove_file(set.join("c01.png")).unwrap();
    // Cut the depth of frame 2 in its middle; flip a byte of frame 5's pixels.
    let whole = fs::read(set.join("d02.png")).unwrap();
    fs::write(set.join("d02.png"), &whole[..whole.len() - 20]).unwrap();
    let mut flipped = fs::read(set.join("c05.png")).unwrap();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 0x10;
    fs::write(set.join("c05.png"), flipped).unwrap();
    let mut recording = open(&folder).unwrap();
    for (step, file) in [(0, "c01.png"), (1, "d02.png"), (2, "c05.png")] {
        let message = read(&mut recording, step).unwrap_err().to_string();
        assert!(message.contains(file), "step {step}: {message}");
    }
    fs::write(set.join("d02.png"), whole).unwrap();
    assert!(read(&mut recording, 1).is_ok(), "a mended frame reads again");
    // An image of another size is that frame's fault as well.
    let eight = png::BitDepth::Eight;
    write_png(&set.join("c02.png"), [4, 6], png::ColorType::Rgb, eight, &[0; 72]);
    let message = read(&mut recording, 1).unwrap_err().to_string();
    assert!(message.contains("4×6") && message.contains("8×6"), "{message}");
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn everything_wrong_with_a_layout_is_said_at_once() {
    let folder = folder("wrong");
    let layout = LAYOUT
        .replace("/unit", "/units")
        .replace("size_px = [8, 6]", "size_px = [9, 6]")
        .replace("rotation = [1, 0", "rotation = [2, 0")
        .replace("d{frame:02}", "nothing{frame:02}")
        .replace("\"/n\"", "\"/number\"");
    fs::write(folder.join("layout.toml"), layout).unwrap();
    let message = open(&folder).err().unwrap();
    for part in [
        "layout.toml",
        "camera[0].depth_m_per_unit",
        "finds no `/units`",
        "camera[0].color_from_depth.rotation",
        "camera[0].exposure",
        "calib.json",
    ] {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
    // What needs a camera is said once there is one.
    let layout = LAYOUT
        .replace("size_px = [8, 6]", "size_px = [9, 6]")
        .replace("d{frame:02}", "nothing{frame:02}");
    fs::write(folder.join("layout.toml"), layout).unwrap();
    let message = open(&folder).err().unwrap();
    for part in ["color_lens.size_px", "8 × 6", "camera[0].depth", "nothing01.png"] {
        assert!(message.contains(part), "`{part}` is not in: {message}");
    }
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn missing_folders_files_and_unknown_keys_are_refused() {
    let folder = folder("missing");
    let try_layout = |text: &str| {
        fs::write(folder.join("layout.toml"), text).unwrap();
        open(&folder).err().unwrap()
    };
    let message = try_layout(&LAYOUT.replace("root = \"set\"", "root = \"elsewhere\""));
    assert!(message.contains("`root`") && message.contains("elsewhere"), "{message}");
    let message = try_layout(&LAYOUT.replace("rate_hz", "rate"));
    assert!(message.contains("rate") && message.contains("line 3"), "{message}");
    let message = try_layout(&LAYOUT.replace("calib.json", "absent.json"));
    assert!(message.contains("absent.json"), "{message}");
    let message = try_layout(&LAYOUT.replace("last", "lost").replace("[1, 2, 5]", "{ first = 1 }"));
    assert!(message.contains("frames") || message.contains("first"), "{message}");
    fs::remove_file(folder.join("layout.toml")).unwrap();
    assert!(open(&folder).err().unwrap().contains("layout.toml"));
    fs::remove_dir_all(folder).unwrap();
}

/// The format of the shipped layouts, which needs no data.
#[test]
fn shipped_layouts_are_understood() {
    let layouts = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/sets/layouts");
    for (name, cameras, frames) in
        [("paper_desk", 1, 16), ("three_cameras", 3, 24), ("cloth_swing", 1, 50)]
    {
        let layout = FolderLayout::load(&layouts.join(format!("{name}.toml"))).unwrap();
        assert_eq!(layout.camera.len(), cameras, "{name}");
        assert_eq!(layout.frames.list().unwrap().len(), frames, "{name}");
        assert_eq!(layout.root, Path::new(name));
    }
}

/// A real JPEG, where there is one, cut at many places: never silently half grey.
#[test]
fn truncated_jpegs_are_reported_wherever_they_are_cut() {
    let data = std::env::var_os("ORIME_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let Ok(whole) = fs::read(data.join("paper_desk/color_0000.jpg")) else {
        eprintln!("SKIPPED: no `paper_desk` under `{}`; set ORIME_DATA", data.display());
        return;
    };
    let path = std::env::temp_dir().join(format!("orime-cut-{}.jpg", std::process::id()));
    let mut reader = ImageReader::new();
    let mut rgb = vec![0; 640 * 480 * 3];
    fs::write(&path, &whole).unwrap();
    reader.color(&path, [640, 480], &mut rgb).unwrap();
    for k in 0..60 {
        let length = k * (whole.len() - 2) / 59;
        fs::write(&path, &whole[..length]).unwrap();
        let error = reader.color(&path, [640, 480], &mut rgb).expect_err("a cut file");
        assert!(error.to_string().contains("orime-cut"), "{error}");
    }
    fs::remove_file(path).unwrap();
}
