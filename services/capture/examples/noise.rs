//! Depth noise of the rendered cameras on a plane, and of a real one beside it:
//! `cargo run --release -p orime-capture --no-default-features --example noise`
//!
//! The real plane is the desk of `paper_desk` under `$ORIME_DATA` (or `../shared/data`).

use std::path::{Path, PathBuf};

use orime_capture::{CaptureParams, SourceKind, open};
use orime_geometry::{RgbdFrameMut, SheetGrid};

#[path = "../tests/plane/mod.rs"]
mod plane;

fn main() {
    println!("camera         z/m   sigma/mm  D415/mm  length/px  correlation at 1 2 3 4 5 12 px");
    for z_m in [0.3, 0.5, 0.8] {
        let patches = plane::rendered(z_m, 24);
        let expected_mm = (0.39f64.powi(2) + (2.8 * z_m * z_m).powi(2)).sqrt();
        print(&format!("rendered D415  {z_m:.2}"), &plane::measure(&patches), Some(expected_mm));
    }
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let data = std::env::var_os("ORIME_DATA")
        .map_or_else(|| repository.join("../shared/data"), PathBuf::from);
    if !data.join("paper_desk").is_dir() {
        println!("paper_desk: SKIPPED, not found under {}", data.display());
        return;
    }
    let mut params = CaptureParams { source: SourceKind::Folder, ..CaptureParams::default() };
    let layout = repository.join("tests/sets/layouts/paper_desk.toml");
    params.folder.layout = layout.to_string_lossy().into_owned();
    params.folder.data_dir = Some(data.to_string_lossy().into_owned());
    let config = params.check().expect("the parameters are right");
    let mut source = open(&config, &SheetGrid::new([0.21, 0.297], [5, 5])).expect("it opens");
    let about = source.cameras()[0].clone();
    let (width, height) = (about.depth.width as usize, about.depth.height as usize);
    let mut patches = Vec::new();
    for step in 0..source.steps().expect("the recording ends") {
        let mut rgb = vec![0; 3 * about.color.pixels()];
        let mut units = vec![0; about.depth.pixels()];
        let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut units };
        source.read(step, 0, frame).expect("the frame is whole");
        patches.extend(plane::flat(&units, [width, height], about.depth_m_per_unit));
    }
    let z_m = patches.iter().map(|p| p.mean_m).sum::<f64>() / patches.len() as f64;
    print(&format!("real Xtion     {z_m:.2}"), &plane::measure(&patches), None);
    println!("({} flat patches of paper_desk; vision.md: 0.80 mm at 0.5 m)", patches.len());
}

fn print(name: &str, noise: &plane::Figures, expected_mm: Option<f64>) {
    let correlation = [1, 2, 3, 4, 5, 12].map(|lag| format!("{:.2}", noise.correlation[lag]));
    let expected = expected_mm.map_or("      -".to_owned(), |mm| format!("{mm:7.2}"));
    println!(
        "{name}  {:8.2}  {expected}  {:9.1}  {}",
        noise.sigma_m * 1e3,
        noise.length_px,
        correlation.join(" ")
    );
}
