//! Prints the markers of images and their grids as JSON, one line an image:
//! `cargo run --release -p orime-markers --example detect -- DICT IMAGE...`
//!
//! DICT is the name of a predefined dictionary or the path of a YAML file. `--repeat N` first
//! detects N times and states the median time. The environment's `ORIME_MARKERS_PARAMS` may hold
//! parameters as JSON.

use std::env;
use std::error::Error;
use std::fs;
use std::path::Path;
use std::time::Instant;

use orime_markers::{
    Detector, DetectorParams, Dictionary, GreyImage, GridFit, GridRefusal, Marker, fit_grid,
    grey_from_rgb,
};
use orime_recording::ImageReader;
use serde_json::json;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = env::args().skip(1).collect();
    let mut repeat = 1_usize;
    if arguments.first().is_some_and(|first| first == "--repeat") && arguments.len() > 1 {
        repeat = arguments[1].parse::<usize>()?.max(1);
        arguments.drain(..2);
    }
    let [name, images @ ..] = &arguments[..] else {
        return Err("usage: detect [--repeat N] DICT IMAGE...".into());
    };
    let dictionary = if Path::new(name).is_file() {
        Dictionary::from_yaml(&fs::read_to_string(name)?)?
    } else {
        Dictionary::predefined(name)?
    };
    // For trials: parameters as JSON.
    let params = match env::var("ORIME_MARKERS_PARAMS") {
        Ok(text) => serde_json::from_str(&text)?,
        Err(_) => DetectorParams::default(),
    };
    let config = params.check().map_err(|problems| format!("{problems:?}"))?;
    let mut detector = Detector::new(&config, dictionary);
    let mut reader = ImageReader::new();
    for image in images {
        let path = Path::new(image);
        let [width, height] = reader.size_px(path)?;
        let mut rgb = vec![0; 3 * width as usize * height as usize];
        reader.color(path, [width, height], &mut rgb)?;
        let mut times_ms = Vec::with_capacity(repeat);
        for _ in 0..repeat {
            let start = Instant::now();
            detector.detect_rgb(width as usize, height as usize, &rgb)?;
            times_ms.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times_ms.sort_by(f64::total_cmp);
        let markers = detector.detect_rgb(width as usize, height as usize, &rgb)?;
        let markers = markers.to_vec();
        let mut grey = Vec::new();
        grey_from_rgb(width as usize, height as usize, &rgb, &mut grey)?;
        let grey = GreyImage::new(width as usize, height as usize, &grey)?;
        let start = Instant::now();
        let grids: Vec<_> =
            markers.iter().map(|m| fit_grid(grey, detector.dictionary(), m)).collect();
        let grid_us = start.elapsed().as_secs_f64() * 1e6;
        let list: Vec<_> = markers.iter().zip(&grids).map(|(m, grid)| entry(m, grid)).collect();
        println!(
            "{}",
            json!({
                "image": image, "ms": times_ms[repeat / 2], "grid_us": grid_us, "markers": list
            })
        );
    }
    Ok(())
}

fn entry(marker: &Marker, grid: &Result<GridFit, GridRefusal>) -> serde_json::Value {
    let grid = match grid {
        Ok(fit) => json!({
            "corners_px": fit.corners_px,
            "corner_sigma_px": fit.corner_sigma_px,
            "shift_px": fit.shift_px,
            "shift_sigma_px": fit.shift_sigma_px,
            "borders": fit.borders,
            "rms_px": fit.rms_px,
        }),
        Err(refusal) => json!({"refused": refusal.to_string()}),
    };
    json!({
        "id": marker.id, "corners_px": marker.corners_px, "corrected": marker.corrected_bits,
        "grid": grid
    })
}
