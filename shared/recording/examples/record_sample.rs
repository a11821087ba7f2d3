//! Writes a small recording with every kind of message, for other programs to read:
//! `cargo run --release -p orime-recording --example record_sample -- OUT.mcap [STEPS]`
//!
//! Prints what is in it as JSON: counts, CRC-32 of each image, and the calibration.
//! `tests/mcap_clients.py` compares that with what other MCAP libraries read.

use std::f64::consts::PI;
use std::path::Path;

use orime_geometry::nalgebra::{Isometry3, UnitQuaternion, Vector3};
use orime_geometry::{CameraModel, ObservedPoint, RgbdCamera, RgbdFrame, SheetGrid};
use orime_recording::{Recorder, SheetState};
use serde_json::{Value, json};

fn main() {
    let mut arguments = std::env::args().skip(1);
    let out = arguments.next().expect("the first argument is the file to write");
    let steps = arguments.next().map_or(5, |steps| steps.parse().expect("STEPS is a number"));
    let cameras = cameras();
    let grid = SheetGrid::new([0.15, 0.21], [9, 7]);
    let mut recorder = Recorder::create(Path::new(&out), "sample", &cameras)
        .unwrap_or_else(|error| panic!("{error}"));
    let mut images = Vec::new();
    for step in 0..steps {
        // Cameras are 3 ms apart; the clock starts at half a minute.
        let time_ns = 30_000_000_000 + step * 33_333_333;
        for (index, camera) in cameras.iter().enumerate() {
            let (rgb, depth) = picture(step, index as u64, camera);
            let frame = RgbdFrame { color_rgb: &rgb, depth_units: &depth };
            let time_ns = time_ns + index as u64 * 3_000_000;
            recorder.frame(step, index, time_ns, frame).unwrap_or_else(|e| panic!("{e}"));
            images.push(json!({
                "camera": camera.name, "step": step, "time_ns": time_ns,
                "color_crc32": crc32fast::hash(&rgb),
                "depth_crc32": crc32fast::hash(bytemuck::cast_slice(&depth)),
            }));
        }
        let nodes_m: Vec<[f32; 3]> = grid
            .uv_m()
            .map(|[u, v]| [u, v, 0.02 * (20.0 * u + step as f64).sin()].map(|x| x as f32))
            .collect();
        let points: Vec<ObservedPoint> = nodes_m
            .iter()
            .map(|node| ObservedPoint {
                position_m: *node,
                normal: [0.0, 0.0, 1.0],
                camera: 1,
                pixels: 4.0,
            })
            .collect();
        recorder.cloud(step, time_ns, &points).unwrap_or_else(|e| panic!("{e}"));
        for state in [SheetState::Estimate, SheetState::Truth] {
            let written = recorder.sheet(step, time_ns, state, &grid, &nodes_m);
            written.unwrap_or_else(|e| panic!("{e}"));
        }
    }
    let recorded = recorder.finish().unwrap_or_else(|error| panic!("{error}"));
    let manifest = json!({
        "messages": recorded.messages, "bytes": recorded.bytes, "steps": steps,
        "nodes": grid.len(), "triangles": grid.triangles().len(), "images": images,
        "cameras": cameras.iter().map(described).collect::<Vec<_>>(),
    });
    println!("{manifest:#}");
}

/// Two cameras with distorted lenses of different sizes, turned about no axis of their own.
fn cameras() -> Vec<RgbdCamera> {
    let color = CameraModel {
        width: 640,
        height: 480,
        fx_px: 612.25,
        fy_px: 611.75,
        cx_px: 318.5,
        cy_px: 241.125,
        distortion: [0.11, -0.23, 0.0007, -0.0011, 0.06],
    };
    let depth = CameraModel { width: 480, height: 270, distortion: [0.0; 5], ..color.clone() };
    [("front", 0.1), ("rear left", 2.5)]
        .map(|(name, turn)| RgbdCamera {
            name: name.into(),
            color: color.clone(),
            depth: depth.clone(),
            color_from_depth: Isometry3::new(
                Vector3::new(0.015, -0.0002, 0.0003),
                Vector3::new(0.002, -0.003, 0.001),
            ),
            world_from_color: Isometry3::from_parts(
                Vector3::new(0.3 * turn, -0.2, 0.6).into(),
                UnitQuaternion::from_euler_angles(PI - 0.3, turn, 0.2 * turn),
            ),
            depth_m_per_unit: 0.00025,
        })
        .into()
}

/// A gradient that moves, with grain.
fn picture(step: u64, camera: u64, about: &RgbdCamera) -> (Vec<u8>, Vec<u16>) {
    let mut state = (step << 8 | camera).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut grain = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state >> 62
    };
    let columns = 3 * u64::from(about.color.width);
    let rgb = (0..3 * about.color.pixels() as u64)
        .map(|k| (k % columns / 8 + k / columns / 4 + 3 * step + grain()) as u8)
        .collect();
    let depth = (0..about.depth.pixels() as u64)
        .map(|k| if k % 97 == 0 { 0 } else { (2000 + k / 480 + 5 * step + grain()) as u16 })
        .collect();
    (rgb, depth)
}

fn described(camera: &RgbdCamera) -> Value {
    let lens = |lens: &CameraModel| {
        json!({
            "size": [lens.width, lens.height],
            "k": [lens.fx_px, 0.0, lens.cx_px, 0.0, lens.fy_px, lens.cy_px, 0.0, 0.0, 1.0],
            "d": lens.distortion,
        })
    };
    let transform = |transform: &Isometry3<f64>| {
        json!({
            "translation": transform.translation.vector.as_slice(),
            "rotation_xyzw": transform.rotation.coords.as_slice(),
        })
    };
    json!({
        "name": camera.name,
        "depth_m_per_unit": camera.depth_m_per_unit,
        "color": lens(&camera.color),
        "depth": lens(&camera.depth),
        "world_from_color": transform(&camera.world_from_color),
        "color_from_depth": transform(&camera.color_from_depth),
    })
}
