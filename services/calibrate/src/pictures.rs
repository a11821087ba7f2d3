//! Pictures that prove a calibration: one camera's cloud in another's image, markers where the fit
//! puts them.

use std::path::Path;

use orime_capture::FrameSource;
use orime_evaluate::picture::Canvas;
use orime_geometry::nalgebra::{Isometry3, Point3, Vector2};
use orime_geometry::{RgbdCamera, RgbdFrameMut};

use crate::command::CommandError;
use crate::fit::Fit;
use crate::observe::Observations;
use crate::square::corners_m;

/// A picture that was drawn.
#[derive(Debug, Clone)]
pub struct Picture {
    /// File name inside the folder.
    pub file: String,
    /// What it shows.
    pub caption: String,
}

/// How bright the image under a cloud is left.
const DIMMED: f64 = 0.45;
/// Colours of the cloud from near to far, metres.
const RANGE_M: [f64; 2] = [0.2, 1.2];
/// Markers' outlines.
const OUTLINE: [u8; 3] = [0, 255, 80];

struct Frame {
    color_rgb: Vec<u8>,
    depth_units: Vec<u16>,
}

/// Draws every pair of cameras at the frame set with the most markers, both ways.
pub fn draw(
    source: &mut dyn FrameSource,
    seen: &Observations,
    calibrated: &[RgbdCamera],
    found: &Fit,
    folder: &Path,
) -> Result<Vec<Picture>, CommandError> {
    let count = |step: &u64| seen.views.iter().filter(|view| view.step == *step).count();
    let steps = seen.views.iter().map(|view| view.step);
    let Some(step) = steps.max_by_key(|step| (count(step), std::cmp::Reverse(*step))) else {
        return Ok(Vec::new());
    };
    let frames: Vec<Option<Frame>> =
        (0..seen.cameras.len()).map(|camera| read(source, step, camera)).collect();
    let mut pictures = Vec::new();
    for (a, cloud) in frames.iter().enumerate() {
        for (b, image) in frames.iter().enumerate().filter(|(b, _)| *b != a) {
            let (Some(cloud), Some(image)) = (cloud, image) else { continue };
            let old = panel([&seen.cameras[a], &seen.cameras[b]], cloud, image);
            let mut new = panel([&calibrated[a], &calibrated[b]], cloud, image);
            outlines(&mut new, seen, found, step, b);
            let (from, into) = (&seen.cameras[a].name, &seen.cameras[b].name);
            let file = format!("cloud_of_{from}_in_{into}.png");
            let caption = format!("Cloud of {from} in the image of {into}, frame set {step}");
            let path = folder.join(&file);
            beside(&old, &new).save(&path).map_err(|error| CommandError::Write {
                path: path.clone(),
                message: error.to_string(),
            })?;
            pictures.push(Picture { file, caption });
        }
    }
    Ok(pictures)
}

fn read(source: &mut dyn FrameSource, step: u64, camera: usize) -> Option<Frame> {
    let about = &source.cameras()[camera];
    let mut frame = Frame {
        color_rgb: vec![0; 3 * about.color.pixels()],
        depth_units: vec![0; about.depth.pixels()],
    };
    let into =
        RgbdFrameMut { color_rgb: &mut frame.color_rgb, depth_units: &mut frame.depth_units };
    source.read(step, camera, into).is_ok().then_some(frame)
}

/// One camera's cloud in the dimmed image of another.
fn panel([from, into]: [&RgbdCamera; 2], cloud: &Frame, image: &Frame) -> Canvas {
    let (width, height) = (into.color.width as usize, into.color.height as usize);
    let dimmed: Vec<u8> = image.color_rgb.iter().map(|c| (f64::from(*c) * DIMMED) as u8).collect();
    let mut canvas = Canvas::from_rgb(width, height, &dimmed);
    let into_from_cloud = into.world_from_color.inverse() * from.world_from_depth();
    let mut nearest = vec![f64::INFINITY; width * height];
    for (k, raw) in cloud.depth_units.iter().enumerate().filter(|(_, raw)| **raw > 0) {
        let columns = from.depth.width as usize;
        let px = Vector2::new((k % columns) as f64, (k / columns) as f64);
        let point = from.depth.ray(px) * (f64::from(*raw) * from.depth_m_per_unit);
        let point = into_from_cloud * Point3::from(point);
        let Some(px) = into.color.project(&point) else { continue };
        let (x, y) = (px.x.round(), px.y.round());
        if 0.0 <= x && x < width as f64 && 0.0 <= y && y < height as f64 {
            let at = y as usize * width + x as usize;
            if point.z < nearest[at] {
                nearest[at] = point.z;
                canvas.set(x as i64, y as i64, color_of(point.z));
            }
        }
    }
    canvas
}

/// Markers of `camera`'s image where the fit puts them.
fn outlines(canvas: &mut Canvas, seen: &Observations, found: &Fit, step: u64, camera: usize) {
    let lens = &seen.cameras[camera].color;
    let to_camera: Isometry3<f64> = found.first_from_camera[camera].inverse();
    for view in seen.views.iter().filter(|v| v.step == step && v.camera == camera) {
        let keys = [(step, None), (step, Some(view.id))];
        let target = keys.iter().find_map(|key| found.first_from_target.get(key));
        let (Some(target), Some(marker)) = (target, found.target_from_marker.get(&view.id)) else {
            continue;
        };
        let pose = to_camera * target * marker;
        let corners = corners_m(view.side_m).map(|c| lens.project(&(pose * c)));
        for k in 0..4 {
            if let (Some(a), Some(b)) = (corners[k], corners[(k + 1) % 4]) {
                canvas.line(a.into(), b.into(), OUTLINE, 0.9);
            }
        }
    }
}

/// From red (near) over yellow and green to blue (far).
fn color_of(depth_m: f64) -> [u8; 3] {
    let share = ((depth_m - RANGE_M[0]) / (RANGE_M[1] - RANGE_M[0])).clamp(0.0, 1.0);
    let ramp = |centre: f64| ((1.5 - (share * 4.0 - centre).abs()).clamp(0.0, 1.0) * 255.0) as u8;
    [ramp(0.5), ramp(1.8), ramp(3.5)]
}

fn beside(left: &Canvas, right: &Canvas) -> Canvas {
    let mut both = Canvas::new(left.width + right.width, left.height.max(right.height), [0; 3]);
    for (canvas, offset) in [(left, 0), (right, left.width)] {
        for y in 0..canvas.height {
            for x in 0..canvas.width {
                both.set((offset + x) as i64, y as i64, canvas.get(x, y));
            }
        }
    }
    both
}
