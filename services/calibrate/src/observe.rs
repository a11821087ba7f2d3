//! What the cameras see of the markers: corners in the colour image, depth inside the corners.
//!
//! A camera's transfer curve and sharpening move the borders between ink and paper, and with them
//! the sides of a marker's black square: taken for its size, the square puts the marker too far
//! away, and depth seems short. So squares are moved back by what the markers' grids say
//! ([`crate::border_shift`]).

use std::collections::BTreeMap;

use orime_capture::FrameSource;
use orime_geometry::nalgebra::{Isometry3, Point3, Vector2, Vector3};
use orime_geometry::{CameraModel, RgbdCamera, RgbdFrameMut};
use orime_markers::{
    Detector, Dictionary, GreyImage, Marker, fit_grid, grey_from_rgb, moved_outwards,
};

use crate::border_shift::{BorderShift, GridShift, border_shift};
use crate::square::{SquarePose, square_poses};

/// Depth is sampled on a grid of this many places along each side of a marker.
const GRID: usize = 7;
/// Of the marker's side, the part that is sampled: near the border depth mixes with what is behind.
const SAMPLED_SHARE: f64 = 0.7;
/// A marker's depth counts if at least this share of its samples has one near the corners' pose.
const DEPTH_SHARE_MIN: f64 = 0.5;
/// Farther from the corners' pose depth is of something else, metres.
const DEPTH_ERROR_MAX_M: f64 = 0.04;
/// Corners farther than this from every pose of a square are no square's, pixels.
const RMS_MAX_PX: f64 = 2.0;

/// One depth value inside a marker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthSample {
    /// Line of sight of the depth pixel in the depth camera's frame, z = 1.
    pub ray: Vector3<f64>,
    /// Measured depth along z, metres.
    pub depth_m: f64,
}

/// One marker in one image.
#[derive(Debug, Clone)]
pub struct View {
    /// Which camera.
    pub camera: usize,
    /// Which frame set.
    pub step: u64,
    /// Which marker.
    pub id: u32,
    /// Side of the marker, metres.
    pub side_m: f64,
    /// Its corners as viewing rays at z = 1, free of distortion, in the detector's order.
    pub rays: [Vector2<f64>; 4],
    /// Poses that explain the corners, the better one first; at least one.
    pub poses: Vec<SquarePose>,
    /// Depth inside it; empty where the camera measured none that can be used.
    pub depth: Vec<DepthSample>,
}

/// What all cameras saw.
#[derive(Debug, Clone)]
pub struct Observations {
    /// The cameras, as the source calibrates them.
    pub cameras: Vec<RgbdCamera>,
    /// Side of every marker, metres.
    pub side_m: f64,
    /// Frame sets that were looked at.
    pub steps: u64,
    /// Every marker of every image.
    pub views: Vec<View>,
    /// What the markers' squares were moved back by; `None` where too few grids say it: then the
    /// squares are as they look.
    pub border_shift: Option<BorderShift>,
    /// Frames that could not be read.
    pub unreadable: u64,
}

/// Looks at up to `steps_max` frame sets of a source, evenly over it.
pub fn observe(
    source: &mut dyn FrameSource,
    detector: &mut Detector,
    side_m: f64,
    steps_max: u64,
) -> Observations {
    let cameras = source.cameras().to_vec();
    let all = source.steps().unwrap_or(steps_max);
    let steps = all.min(steps_max);
    let dictionary = detector.dictionary().clone();
    let (mut sights, mut unreadable, mut grey) = (vec![], 0, vec![]);
    for k in 0..steps {
        let step = k * all / steps;
        for (index, camera) in cameras.iter().enumerate() {
            let mut color_rgb = vec![0; 3 * camera.color.pixels()];
            let mut depth_units = vec![0; camera.depth.pixels()];
            let frame = RgbdFrameMut { color_rgb: &mut color_rgb, depth_units: &mut depth_units };
            if source.read(step, index, frame).is_err() {
                unreadable += 1;
                continue;
            }
            let [width, height] = [camera.color.width, camera.color.height].map(|n| n as usize);
            let image = grey_from_rgb(width, height, &color_rgb, &mut grey)
                .and_then(|()| GreyImage::new(width, height, &grey));
            let Ok(image) = image else {
                unreadable += 1;
                continue;
            };
            let eye = Eye { camera, index, step, side_m, depth_units: &depth_units };
            let found = unique(detector.detect(image));
            sights.extend(found.filter_map(|marker| eye.sight(image, &dictionary, marker)));
        }
    }
    let grids: Vec<GridShift> = sights.iter().filter_map(|sight| sight.grid).collect();
    let border_shift = border_shift(&grids, cameras.len());
    let mut seen = Observations { cameras, side_m, steps, views: vec![], border_shift, unreadable };
    seen.views = sights.into_iter().filter_map(|sight| settled(sight, &seen)).collect();
    seen
}

/// A view by its square as it looks, beside what else the image says of it.
struct Sight {
    view: View,
    square_px: [[f64; 2]; 4],
    grid: Option<GridShift>,
}

/// The view by its square moved back by its camera's border shift.
fn settled(sight: Sight, seen: &Observations) -> Option<View> {
    let Sight { mut view, square_px, .. } = sight;
    let Some(shift) = &seen.border_shift else { return Some(view) };
    let lens = &seen.cameras[view.camera].color;
    let corners_px = moved_outwards(&square_px, shift.used_px[view.camera]);
    view.poses = poses(lens, &corners_px, view.side_m)?;
    view.rays = rays(lens, &corners_px);
    Some(view)
}

/// Markers whose number occurs once: of two that bear it, nobody can say which is which.
fn unique(markers: &[Marker]) -> impl Iterator<Item = &Marker> {
    let mut count = BTreeMap::new();
    for marker in markers {
        *count.entry(marker.id).or_insert(0) += 1;
    }
    markers.iter().filter(move |marker| count[&marker.id] == 1)
}

/// One camera at one instant.
struct Eye<'a> {
    camera: &'a RgbdCamera,
    index: usize,
    step: u64,
    side_m: f64,
    depth_units: &'a [u16],
}

impl Eye<'_> {
    fn sight(
        &self,
        image: GreyImage<'_>,
        dictionary: &Dictionary,
        marker: &Marker,
    ) -> Option<Sight> {
        let (lens, square_px) = (&self.camera.color, marker.corners_px);
        let poses = poses(lens, &square_px, self.side_m)?;
        let best = &poses[0].camera_from_marker;
        let view = View {
            camera: self.index,
            step: self.step,
            id: marker.id,
            side_m: self.side_m,
            rays: rays(lens, &square_px),
            depth: depth_inside(self.camera, best, self.side_m, self.depth_units),
            poses,
        };
        let grid = fit_grid(image, dictionary, marker).ok().map(|fit| GridShift {
            camera: self.index,
            id: marker.id,
            shift_px: fit.shift_px,
            side_px: fit.side_px(),
        });
        Some(Sight { view, square_px, grid })
    }
}

/// Corners as viewing rays at z = 1.
fn rays(lens: &CameraModel, corners_px: &[[f64; 2]; 4]) -> [Vector2<f64>; 4] {
    corners_px.map(|px| lens.ray(Vector2::from(px)).xy())
}

/// Poses that explain the corners, at least one.
fn poses(lens: &CameraModel, corners_px: &[[f64; 2]; 4], side_m: f64) -> Option<Vec<SquarePose>> {
    let mut poses = square_poses(lens, corners_px, side_m);
    poses.retain(|pose| pose.rms_px < RMS_MAX_PX);
    (!poses.is_empty()).then_some(poses)
}

/// Depth at a grid of places inside the marker, seen by the depth camera; nothing if too few of
/// them are near where the corners say that the marker is.
fn depth_inside(
    camera: &RgbdCamera,
    color_from_marker: &Isometry3<f64>,
    side_m: f64,
    depth_units: &[u16],
) -> Vec<DepthSample> {
    let depth_from_marker = camera.color_from_depth.inverse() * color_from_marker;
    let lens = &camera.depth;
    let mut samples = Vec::with_capacity(GRID * GRID);
    for k in 0..GRID * GRID {
        let share = |n: usize| (n as f64 / (GRID - 1) as f64 - 0.5) * SAMPLED_SHARE;
        let place = Point3::new(share(k % GRID) * side_m, share(k / GRID) * side_m, 0.0);
        let Some(px) = lens.project(&(depth_from_marker * place)) else { continue };
        let (x, y) = (px.x.round(), px.y.round());
        let inside =
            0.0 <= x && x < f64::from(lens.width) && 0.0 <= y && y < f64::from(lens.height);
        if !inside {
            continue;
        }
        let raw = depth_units[y as usize * lens.width as usize + x as usize];
        let depth_m = f64::from(raw) * camera.depth_m_per_unit;
        let ray = lens.ray(Vector2::new(x, y));
        let expected_m = plane_depth_m(&depth_from_marker, &ray);
        if raw > 0 && (depth_m - expected_m).abs() < DEPTH_ERROR_MAX_M {
            samples.push(DepthSample { ray, depth_m });
        }
    }
    if (samples.len() as f64) < DEPTH_SHARE_MIN * (GRID * GRID) as f64 {
        samples.clear();
    }
    samples
}

/// Depth along z at which a line of sight (z = 1) meets the marker's plane, metres.
pub fn plane_depth_m(camera_from_marker: &Isometry3<f64>, ray: &Vector3<f64>) -> f64 {
    let normal = camera_from_marker * Vector3::z();
    normal.dot(&camera_from_marker.translation.vector) / normal.dot(ray)
}
