//! Recordings written here: whole, damaged, cut off, and written to a disk that fills up.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use orime_geometry::nalgebra::{Isometry3, Vector3};
use orime_geometry::{CameraModel, ObservedPoint, RgbdCamera, RgbdFrame, RgbdFrameMut, SheetGrid};
use orime_recording::{McapRecording, ReadError, RecordError, Recorder, SheetState};

const STEPS: u64 = 6;

fn cameras() -> Vec<RgbdCamera> {
    let color = CameraModel {
        width: 20,
        height: 12,
        fx_px: 17.3,
        fy_px: 17.1,
        cx_px: 9.4,
        cy_px: 5.7,
        distortion: [0.1, -0.2, 0.0003, -0.0004, 0.05],
    };
    let depth = CameraModel { width: 14, height: 9, distortion: [0.0; 5], ..color.clone() };
    [("left", 0.3), ("right hand", -1.9)]
        .map(|(name, turn)| RgbdCamera {
            name: name.into(),
            color: color.clone(),
            depth: depth.clone(),
            color_from_depth: Isometry3::new(
                Vector3::new(0.015, 0.001 * turn, 0.0),
                Vector3::new(0.01, turn * 0.02, -0.005),
            ),
            world_from_color: Isometry3::new(
                Vector3::new(turn, 0.1, 0.7),
                Vector3::new(1.1, 0.4 * turn, -0.8),
            ),
            depth_m_per_unit: 0.1 + 0.2, // A number whose text is long.
        })
        .into()
}

fn grid() -> SheetGrid {
    SheetGrid::new([0.15, 0.1 + 0.2], [4, 3])
}

/// Pixels that differ in every frame and do not compress.
fn pixels(step: u64, camera: u64) -> (Vec<u8>, Vec<u16>) {
    let mut state = (step << 8 | camera | 1 << 40).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut next = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    ((0..20 * 12 * 3).map(|_| next() as u8).collect(), (0..14 * 9).map(|_| next() as u16).collect())
}

fn exposure_ns(step: u64, camera: u64) -> u64 {
    7_000_000_123 + step * 33_333_333 + camera * 4_000_001
}

/// The step numbers have gaps, as those of a live recording do.
fn number(step: u64) -> u64 {
    3 * step + 2
}

fn points(step: u64) -> Vec<ObservedPoint> {
    (0..5)
        .map(|k| ObservedPoint {
            position_m: [k as f32 * 0.1, step as f32 / 3.0, -0.0],
            normal: [0.0, 0.6, 0.8],
            camera: k % 2,
            pixels: 3.5,
        })
        .collect()
}

fn nodes(step: u64) -> Vec<[f32; 3]> {
    (0..grid().len()).map(|k| [k as f32 / 7.0, step as f32 * 0.01, 1.0e-30]).collect()
}

fn record(mut recorder: Recorder) -> Result<orime_recording::Recorded, RecordError> {
    for step in 0..STEPS {
        for camera in 0..2 {
            let (rgb, depth) = pixels(step, camera);
            let frame = RgbdFrame { color_rgb: &rgb, depth_units: &depth };
            recorder.frame(number(step), camera as usize, exposure_ns(step, camera), frame)?;
        }
        let time_ns = exposure_ns(step, 0);
        recorder.cloud(number(step), time_ns, &points(step))?;
        let mut nodes_m = nodes(step);
        recorder.sheet(number(step), time_ns, SheetState::Estimate, &grid(), &nodes_m)?;
        nodes_m.reverse();
        recorder.sheet(number(step), time_ns, SheetState::Truth, &grid(), &nodes_m)?;
    }
    recorder.finish()
}

/// A path of this test's own, with no file.
fn fresh(test: &str) -> PathBuf {
    let name = format!("orime-mcap-{test}-{}.mcap", std::process::id());
    let path = std::env::temp_dir().join(name);
    let _ = fs::remove_file(&path);
    path
}

/// A whole recording's bytes.
fn whole(test: &str) -> (PathBuf, Vec<u8>) {
    let path = fresh(test);
    record(Recorder::create(&path, "a set", &cameras()).unwrap()).unwrap();
    let bytes = fs::read(&path).unwrap();
    (path, bytes)
}

fn read(
    recording: &mut McapRecording,
    step: u64,
    camera: usize,
) -> Result<(Vec<u8>, Vec<u16>), ReadError> {
    let (mut rgb, mut depth) = (vec![0xa5; 20 * 12 * 3], vec![0xdead; 14 * 9]);
    let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
    recording.read(step, camera, frame)?;
    Ok((rgb, depth))
}

/// Everything that is readable is what was written; the number of readable frames.
fn check_content(recording: &mut McapRecording) -> u64 {
    assert_eq!(recording.cameras(), cameras());
    let mut frames = 0;
    for k in 0..recording.steps() {
        let step = (recording.step_number(k) - 2) / 3;
        for camera in 0..2 {
            match read(recording, k, camera) {
                Ok(frame) => {
                    assert!(frame == pixels(step, camera as u64), "step {step}, camera {camera}");
                    assert_eq!(recording.exposure_ns(k, camera), exposure_ns(step, camera as u64));
                    frames += 1;
                }
                Err(error) => assert!(error.to_string().contains(".mcap"), "{error}"),
            }
        }
        let mut found = Vec::new();
        if recording.cloud(number(step), &mut found).unwrap() {
            assert_eq!(found, points(step));
        }
        let mut found = Vec::new();
        if let Some(found_grid) =
            recording.sheet(number(step), SheetState::Estimate, &mut found).unwrap()
        {
            assert_eq!((found_grid, found), (grid(), nodes(step)));
        }
    }
    frames
}

#[test]
fn a_whole_recording_comes_back_bit_for_bit() {
    let (path, bytes) = whole("whole");
    let mut recording = McapRecording::open(&path).unwrap();
    assert!(recording.loss().is_none(), "{}", recording.loss());
    assert_eq!(recording.set(), Some("a set"));
    assert_eq!(recording.steps(), STEPS);
    let numbers: Vec<u64> = (0..STEPS).map(|step| recording.step_number(step)).collect();
    assert_eq!(numbers, [2, 5, 8, 11, 14, 17]);
    assert_eq!(check_content(&mut recording), 2 * STEPS);
    // From the first stamp to the last, and a fifth of it.
    let length_ns = exposure_ns(5, 1) - exposure_ns(0, 0);
    assert_eq!(recording.round_ns(), length_ns + length_ns / 5);
    let mut truth = Vec::new();
    assert!(recording.sheet(8, SheetState::Truth, &mut truth).unwrap().is_some());
    assert_eq!(truth[0], *nodes(2).last().unwrap());
    assert!(recording.sheet(9, SheetState::Truth, &mut truth).unwrap().is_none());
    assert!(truth.is_empty());
    assert!(!recording.cloud(u64::MAX, &mut Vec::new()).unwrap());
    // The same calls give the same bytes.
    let (again, same) = whole("whole-again");
    assert!(bytes == same);
    fs::remove_file(again).unwrap();
    fs::remove_file(path).unwrap();
}

#[test]
fn a_flipped_byte_is_never_silent() {
    let (path, mut bytes) = whole("flipped");
    let mut kinds = [0; 3];
    // Every 31st byte, and all of the end, where each byte has another meaning.
    let near_end = bytes.len() - 600;
    for at in (0..near_end).step_by(31).chain(near_end..bytes.len()) {
        bytes[at] ^= 0x10;
        fs::write(&path, &bytes).unwrap();
        match McapRecording::open(&path) {
            Ok(mut recording) => {
                assert!(!recording.loss().is_none(), "byte {at} is silent");
                let frames = check_content(&mut recording);
                let sets = 2 * recording.steps();
                assert_eq!(frames + recording.loss().frames, sets, "byte {at}");
                kinds[usize::from(frames == 2 * STEPS)] += 1;
            }
            Err(error) => {
                assert!(error.to_string().contains(".mcap"), "{error}");
                kinds[2] += 1;
            }
        }
        bytes[at] ^= 0x10;
    }
    // Frames lost, only something else lost, refused altogether: all of them occur.
    assert!(kinds.iter().all(|count| *count > 0), "{kinds:?}");
    fs::remove_file(path).unwrap();
}

#[test]
fn one_damaged_chunk_costs_one_frame() {
    let (path, mut bytes) = whole("chunk");
    let (rgb, _) = pixels(3, 1);
    // Noise does not compress: the pixels lie in the file as they are.
    let at = bytes.windows(64).position(|window| window == &rgb[100..164]).unwrap();
    bytes[at] ^= 1;
    fs::write(&path, &bytes).unwrap();
    let mut recording = McapRecording::open(&path).unwrap();
    let loss = *recording.loss();
    assert_eq!((loss.chunks, loss.messages, loss.frames), (1, Some(6), 1));
    assert!(!loss.end_missing && !loss.outside_chunks && loss.bytes > 900, "{loss}");
    assert_eq!(check_content(&mut recording), 2 * STEPS - 1);
    let times: Vec<u64> = (0..STEPS).map(|step| recording.exposure_ns(step, 1)).collect();
    assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{times:?}");
    let error = read(&mut recording, 3, 1).unwrap_err().to_string();
    for part in ["step 11", "right hand", "orime-mcap-chunk", "lost"] {
        assert!(error.contains(part), "`{part}` is not in: {error}");
    }
    fs::remove_file(path).unwrap();
}

#[test]
fn damage_after_opening_is_noticed_too() {
    let (path, bytes) = whole("later");
    let mut recording = McapRecording::open(&path).unwrap();
    let (rgb, _) = pixels(2, 0);
    let at = bytes.windows(64).position(|window| window == &rgb[100..164]).unwrap();
    let mut damaged = bytes.clone();
    damaged[at] ^= 1;
    fs::write(&path, damaged).unwrap();
    let error = read(&mut recording, 2, 0).unwrap_err().to_string();
    assert!(error.contains("checksum") && error.contains("step 8"), "{error}");
    assert!(read(&mut recording, 2, 1).is_ok());
    fs::remove_file(path).unwrap();
}

#[test]
fn wherever_a_file_is_cut_its_front_reads() {
    let (path, bytes) = whole("cut");
    let mut frames_before = 0;
    for length in (0..bytes.len()).step_by(37) {
        fs::write(&path, &bytes[..length]).unwrap();
        match McapRecording::open(&path) {
            Ok(mut recording) => {
                let loss = *recording.loss();
                assert!(loss.end_missing && loss.messages.is_none(), "cut at {length}: {loss}");
                let frames = check_content(&mut recording);
                assert!(frames >= frames_before, "cut at {length}: fewer frames than before");
                frames_before = frames;
            }
            Err(error) => {
                assert_eq!(frames_before, 0, "cut at {length}: {error}");
                let text = error.to_string();
                assert!(text.contains("orime-mcap-cut"), "{text}");
            }
        }
    }
    assert_eq!(frames_before, 2 * STEPS, "only the index was cut off in the end");
    fs::remove_file(path).unwrap();
}

#[test]
fn other_files_are_refused_by_kind() {
    let path = fresh("kinds");
    for (content, part) in [
        (&b""[..], "an empty one"),
        (b"\x89MCAP", "first few bytes"),
        (b"#ROSBAG V2.0\n more", "ROS 1 bag"),
        (b"SQLite format 3\0 more", "SQLite"),
        (b"\x89PNG\r\n\x1a\n and more", "PNG"),
        (b"some text that is longer than any magic", "something else"),
    ] {
        fs::write(&path, content).unwrap();
        let error = McapRecording::open(&path).unwrap_err();
        assert!(matches!(error, ReadError::NotMcap { .. }), "{error}");
        assert!(error.to_string().contains(part), "{error}");
    }
    let error = McapRecording::open(Path::new("/nowhere/a.mcap")).unwrap_err();
    assert!(matches!(error, ReadError::File { .. }), "{error}");
    fs::remove_file(path).unwrap();
}

#[test]
fn recordings_without_frames_or_not_of_ours_are_refused() {
    // No frame at all.
    let path = fresh("none");
    Recorder::create(&path, "a set", &cameras()).unwrap().finish().unwrap();
    let error = McapRecording::open(&path).unwrap_err();
    assert!(matches!(error, ReadError::NothingLeft { .. }), "{error}");
    // Somebody else's file.
    let mut writer = mcap::Writer::new(io::Cursor::new(Vec::new())).unwrap();
    let channel = writer.add_channel(0, "/chatter", "json", &Default::default()).unwrap();
    let header = mcap::records::MessageHeader {
        channel_id: channel,
        sequence: 1,
        log_time: 1,
        publish_time: 1,
    };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    fs::write(&path, writer.into_inner().into_inner()).unwrap();
    let error = McapRecording::open(&path).unwrap_err();
    assert!(matches!(error, ReadError::NotOurs { .. }), "{error}");
    fs::remove_file(path).unwrap();
}

/// Copies a recording through the MCAP library, with some messages changed or left out.
fn rewritten(bytes: &[u8], keep: impl Fn(&mut mcap::Message<'_>) -> bool) -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(Some(mcap::Compression::Lz4));
    let mut writer = options.create(io::Cursor::new(Vec::new())).unwrap();
    for message in mcap::MessageStream::new(bytes).unwrap() {
        let mut message = message.unwrap();
        if keep(&mut message) {
            writer.write(&message).unwrap();
        }
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

#[test]
fn cameras_need_their_calibration_and_must_stay() {
    let (path, bytes) = whole("calibration");
    let open = |bytes: Vec<u8>| {
        fs::write(&path, bytes).unwrap();
        McapRecording::open(&path)
    };
    // Another program's arrangement of chunks reads as well.
    let mut recording = open(rewritten(&bytes, |_| true)).unwrap();
    assert!(recording.loss().is_none(), "{}", recording.loss());
    assert_eq!(check_content(&mut recording), 2 * STEPS);
    for topic in ["/camera/left/color/calibration", "/camera/left/depth/transform"] {
        let error = open(rewritten(&bytes, |message| message.channel.topic != topic)).unwrap_err();
        assert!(matches!(error, ReadError::Calibration { .. }), "{error}");
        assert!(error.to_string().contains("left") && error.to_string().contains("missing"));
    }
    let moved = rewritten(&bytes, |message| {
        if message.channel.topic == "/camera/right_hand/color/calibration" && message.sequence == 8
        {
            // The last bit of cx, which stands in K and in P.
            let cx = 9.4f64.to_le_bytes();
            let at = message.data.windows(8).position(|window| window == cx).unwrap();
            message.data.to_mut()[at] ^= 1;
        }
        true
    });
    let error = open(moved).unwrap_err().to_string();
    assert!(error.contains("changes at step 8") && error.contains("right hand"), "{error}");
    // Depth that stops early costs those frames, not the recording.
    let shorter = rewritten(&bytes, |message| {
        message.channel.topic != "/camera/left/depth/image" || message.sequence < 8
    });
    let mut recording = open(shorter).unwrap();
    assert_eq!(recording.loss().frames, 4);
    assert_eq!(check_content(&mut recording), 2 * STEPS - 4);
    fs::remove_file(path).unwrap();
}

#[test]
fn what_does_not_belong_is_refused_before_it_is_written() {
    let path = fresh("refused");
    let mut recorder = Recorder::create(&path, "a set", &cameras()).unwrap();
    let (rgb, depth) = pixels(0, 0);
    let frame = RgbdFrame { color_rgb: &rgb, depth_units: &depth };
    recorder.frame(4, 0, 1000, frame).unwrap();
    for (step, time_ns) in [(4, 2000), (3, 2000), (5, 1000), (5, 999), (1 << 32, 2000)] {
        let error = recorder.frame(step, 0, time_ns, frame).unwrap_err();
        assert!(matches!(error, RecordError::Order { .. }), "{error}");
    }
    let short = RgbdFrame { color_rgb: &rgb[3..], depth_units: &depth };
    assert!(matches!(recorder.frame(5, 0, 2000, short), Err(RecordError::Size { .. })));
    let nodes = recorder.sheet(5, 2000, SheetState::Truth, &grid(), &[[0.0; 3]]);
    assert!(matches!(nodes, Err(RecordError::Nodes { found: 1, expected: 12, .. })));
    recorder.frame(5, 0, 2000, frame).unwrap();
    recorder.finish().unwrap();
    // The other camera never delivered: it is known, its frames are missing.
    let mut recording = McapRecording::open(&path).unwrap();
    assert_eq!((recording.steps(), recording.loss().frames), (2, 2));
    assert_eq!(recording.cameras(), cameras());
    assert!(read(&mut recording, 1, 0).is_ok() && read(&mut recording, 1, 1).is_err());
    // Recordings are never overwritten.
    let error = Recorder::create(&path, "a set", &cameras()).err().unwrap();
    assert!(matches!(error, RecordError::Create { .. }), "{error}");
    fs::remove_file(path).unwrap();
}

/// A disk with so many bytes left.
struct SmallDisk {
    bytes: Arc<Mutex<Vec<u8>>>,
    limit: usize,
}

impl Write for SmallDisk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut stored = self.bytes.lock().unwrap();
        let room = self.limit - stored.len();
        if room == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let written = room.min(bytes.len());
        stored.extend_from_slice(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_an_error_and_leaves_a_readable_front() {
    let (whole_path, bytes) = whole("disk-whole");
    let path = fresh("disk");
    let mut frames_before = 0;
    for limit in (0..bytes.len()).step_by(211) {
        let stored = Arc::new(Mutex::new(Vec::new()));
        let disk = SmallDisk { bytes: stored.clone(), limit };
        let recorded =
            Recorder::to_writer(&path, Box::new(disk), "a set", &cameras()).and_then(record);
        let error = recorded.unwrap_err();
        assert!(matches!(error, RecordError::Write { .. }), "{limit} bytes: {error}");
        assert!(error.to_string().contains("orime-mcap-disk"), "{error}");
        // Nothing was written behind the place where the disk was full.
        let stored = stored.lock().unwrap();
        assert!(**stored == bytes[..stored.len()], "{limit} bytes");
        fs::write(&path, &*stored).unwrap();
        if let Ok(mut recording) = McapRecording::open(&path) {
            let frames = check_content(&mut recording);
            assert!(frames >= frames_before && recording.loss().end_missing);
            frames_before = frames;
        }
    }
    assert_eq!(frames_before, 2 * STEPS);
    fs::remove_file(path).unwrap();
    fs::remove_file(whole_path).unwrap();
}

#[test]
fn a_recorder_that_failed_stays_failed() {
    /// Fails once, then works again.
    struct Hiccup(Arc<Mutex<u32>>);
    impl Write for Hiccup {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let mut calls = self.0.lock().unwrap();
            *calls += 1;
            if *calls == 40 { Err(io::Error::other("hiccup")) } else { Ok(bytes.len()) }
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let calls = Arc::new(Mutex::new(0));
    let sink = Box::new(Hiccup(calls.clone()));
    let path = Path::new("hiccup.mcap");
    let mut recorder = Recorder::to_writer(path, sink, "a set", &cameras()).unwrap();
    let (rgb, depth) = pixels(0, 0);
    let frame = RgbdFrame { color_rgb: &rgb, depth_units: &depth };
    let results: Vec<bool> =
        (0..40).map(|step| recorder.frame(step, 0, step + 1, frame).is_ok()).collect();
    let first_failure = results.iter().position(|ok| !ok).unwrap();
    assert!(results[first_failure..].iter().all(|ok| !ok));
    assert!(recorder.finish().is_err());
    assert_eq!(*calls.lock().unwrap(), 40, "nothing is written after the failure");
}
