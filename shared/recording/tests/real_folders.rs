//! The shipped layouts against the real recordings, where those are at hand.

use std::path::{Path, PathBuf};

use orime_geometry::nalgebra::{Point3, Vector2};
use orime_geometry::{RgbdCamera, RgbdFrameMut};
use orime_recording::FolderRecording;

const REPOSITORY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// The recording, or `None` with a loud word where the data is absent.
fn open(name: &str) -> Option<FolderRecording> {
    let data = std::env::var_os("ORIME_DATA")
        .map_or_else(|| Path::new(REPOSITORY).join("../shared/data"), PathBuf::from);
    if !data.join(name).is_dir() {
        eprintln!("SKIPPED: no `{name}` under `{}`; set ORIME_DATA", data.display());
        return None;
    }
    let layout = Path::new(REPOSITORY).join(format!("tests/sets/layouts/{name}.toml"));
    Some(FolderRecording::open(&layout, Some(&data)).unwrap_or_else(|error| panic!("{error}")))
}

/// Reads into poisoned buffers.
fn read(recording: &mut FolderRecording, step: u64, camera: usize) -> (Vec<u8>, Vec<u16>) {
    let about = &recording.cameras()[camera];
    let mut rgb = vec![0xa5; 3 * about.color.pixels()];
    let mut depth = vec![0xdead; about.depth.pixels()];
    let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
    assert_eq!(recording.read(step, camera, frame).unwrap(), 0, "decoded in place");
    (rgb, depth)
}

#[test]
fn paper_desk_reads_whole_and_its_desk_is_where_it_should_be() {
    let Some(mut recording) = open("paper_desk") else { return };
    assert_eq!((recording.steps(), recording.cameras().len()), (16, 1));
    assert!(recording.cameras()[0].depth_is_registered());
    for step in 0..recording.steps() {
        let (rgb, depth) = read(&mut recording, step, 0);
        let mut seen: Vec<u16> = depth.iter().copied().filter(|raw| *raw > 0).collect();
        assert!(seen.len() > depth.len() / 2, "step {step}: {} returns", seen.len());
        seen.sort_unstable();
        let median_m = f64::from(seen[seen.len() / 2]) * 1e-3;
        assert!((0.3..1.5).contains(&median_m), "step {step}: median {median_m} m");
        assert!(!depth.contains(&0xdead) && rgb.chunks_exact(64).any(|c| c != [0xa5; 64]));
        // A photograph: its rows differ, down to the last one.
        let rows: Vec<&[u8]> = rgb.chunks_exact(3 * 640).collect();
        assert!(rows.windows(2).all(|pair| pair[0] != pair[1]), "step {step}");
    }
}

#[test]
fn three_cameras_share_one_world_and_keep_their_clocks() {
    let Some(mut recording) = open("three_cameras") else { return };
    assert_eq!((recording.steps(), recording.cameras().len()), (24, 3));
    for camera in 0..3 {
        let times: Vec<u64> = (0..24).map(|step| recording.exposure_ns(step, camera)).collect();
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]));
    }
    // meta.json: cameras 0 and 1 of event 0 are 17.551 ms apart, camera 0 later.
    let skew_ns = recording.exposure_ns(0, 0) - recording.exposure_ns(0, 1);
    assert!((17_540_000..17_560_000).contains(&skew_ns), "{skew_ns}");

    // Where two cameras see the same surface, its points must agree. Camera 2's calibration, and
    // (as a test that this test can fail) the same calibration the wrong way round.
    let depths = [0, 2].map(|camera| read(&mut recording, 5, camera).1);
    let (reference, other) = (&recording.cameras()[0], recording.cameras()[2].clone());
    let mut inverted = other.clone();
    inverted.world_from_color = other.world_from_color.inverse();
    let gaps = gaps_m(reference, &depths[0], &other, &depths[1]);
    assert!(gaps.len() > 5000, "{} common points", gaps.len());
    // The source's own calibration agrees to 2.7–8 mm on markers.
    let median_m = gaps[gaps.len() / 2];
    assert!(median_m < 0.005, "{median_m} m");
    assert!(gaps_m(reference, &depths[0], &inverted, &depths[1]).len() < 500);
}

/// How far points that `other` measured are from what `reference` measured along its rays,
/// sorted, metres; only those nearer than 50 mm, as the rest are different surfaces.
fn gaps_m(
    reference: &RgbdCamera,
    reference_depth: &[u16],
    other: &RgbdCamera,
    other_depth: &[u16],
) -> Vec<f64> {
    let mut gaps: Vec<f64> = points(other, other_depth)
        .filter_map(|world| {
            let seen = reference.world_from_depth().inverse_transform_point(&world);
            let pixel = reference.depth.project(&seen)?;
            let (x, y) = (pixel.x.round(), pixel.y.round());
            let inside = (0.0..640.0).contains(&x) && (0.0..480.0).contains(&y);
            let raw = inside.then(|| reference_depth[y as usize * 640 + x as usize])?;
            (raw > 0).then(|| (f64::from(raw) * reference.depth_m_per_unit - seen.z).abs())
        })
        .filter(|gap| *gap < 0.05)
        .collect();
    gaps.sort_by(f64::total_cmp);
    gaps
}

#[test]
fn cloth_swing_shows_cloth_where_depth_has_returns() {
    let Some(mut recording) = open("cloth_swing") else { return };
    assert_eq!((recording.steps(), recording.cameras().len()), (50, 1));
    for step in [0, 25, 49] {
        let (rgb, depth) = read(&mut recording, step, 0);
        let lit = |k: usize| rgb[3 * k..3 * k + 3].iter().any(|c| *c > 8);
        let seen: Vec<usize> = (0..depth.len()).filter(|k| depth[*k] > 0).collect();
        let coloured = seen.iter().filter(|k| lit(**k)).count();
        assert!(seen.len() > 5000, "step {step}: {} returns", seen.len());
        let share = coloured as f64 / seen.len() as f64;
        assert!(share > 0.95, "step {step}: {share:.3} of the returns have colour");
        // The cloth is some 0.6 m wide: so must its cloud be.
        let xs: Vec<f64> = points(&recording.cameras()[0], &depth).map(|p| p.x).collect();
        let low = xs.iter().copied().fold(f64::INFINITY, f64::min);
        let high = xs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        assert!((0.3..0.8).contains(&(high - low)), "step {step}: {} m wide", high - low);
    }
}

/// World points of every 7th return.
fn points<'a>(camera: &'a RgbdCamera, depth: &'a [u16]) -> impl Iterator<Item = Point3<f64>> + 'a {
    let width = camera.depth.width as usize;
    depth.iter().enumerate().step_by(7).filter(|(_, raw)| **raw > 0).map(move |(k, raw)| {
        let pixel = Vector2::new((k % width) as f64, (k / width) as f64);
        let z_m = f64::from(*raw) * camera.depth_m_per_unit;
        camera.world_from_depth() * Point3::from(camera.depth.ray(pixel) * z_m)
    })
}
