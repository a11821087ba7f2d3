//! Writes frames of a source as PNG files, for people to look at:
//! `cargo run --release -p orime-capture --no-default-features --example show -- OUT [SET] [STEP…]`
//!
//! `OUT` is a folder that exists; `SET` a TOML file with a `[capture]` section (or `-` for the
//! defaults); default steps are eight over the whole source. Depth is written as grey, bright
//! near.

use std::fs::File;
use std::path::Path;

use orime_capture::{CaptureParams, open};
use orime_geometry::{RgbdFrameMut, SheetGrid};

fn main() {
    let mut arguments = std::env::args().skip(1);
    let out = arguments.next().expect("the first argument is the folder to write to");
    let params = match arguments.next() {
        Some(set) if set != "-" => {
            let text = std::fs::read_to_string(&set).expect("the set file is readable");
            let set: toml::Table = text.parse().expect("the set file is TOML");
            let capture = set.get("capture").expect("the set has a [capture] section").clone();
            capture.try_into().expect("the [capture] section is right")
        }
        _ => CaptureParams::default(),
    };
    let config = params.check().expect("the [capture] section is right");
    let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
    let mut source = open(&config, &sheet).unwrap_or_else(|error| panic!("{error}"));
    let mut steps: Vec<u64> =
        arguments.map(|step| step.parse().expect("steps are whole numbers")).collect();
    if steps.is_empty() {
        let last = source.steps().unwrap_or(240) - 1;
        steps = (0..8).map(|k| k * last / 7).collect();
    }
    for step in steps {
        for camera in 0..source.cameras().len() {
            let about = source.cameras()[camera].clone();
            let mut rgb = vec![0; 3 * about.color.pixels()];
            let mut depth = vec![0; about.depth.pixels()];
            let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut depth };
            source.read(step, camera, frame).expect("the frame is whole");
            let stem = Path::new(&out).join(format!("{}_{step:04}", about.name));
            let stem = stem.display();
            let size = [about.color.width, about.color.height];
            write_png(&format!("{stem}_color.png"), size, png::ColorType::Rgb, &rgb);
            let grey: Vec<u8> = depth
                .iter()
                .map(|raw| f64::from(*raw) * about.depth_m_per_unit)
                .map(
                    |z_m| if z_m > 0.0 { (255.0 * (1.2 - z_m)).clamp(1.0, 255.0) as u8 } else { 0 },
                )
                .collect();
            let size = [about.depth.width, about.depth.height];
            write_png(&format!("{stem}_depth.png"), size, png::ColorType::Grayscale, &grey);
        }
    }
}

fn write_png(path: &str, [width, height]: [u32; 2], color: png::ColorType, bytes: &[u8]) {
    let mut encoder =
        png::Encoder::new(File::create(path).expect("OUT is writable"), width, height);
    encoder.set_color(color);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().and_then(|mut w| w.write_image_data(bytes)).expect("OUT is writable");
}
