//! What the cameras see of the markers: corners in the colour image, depth inside the corners.
//!
//! A camera's transfer curve and sharpening move the borders between ink and paper, and with them
//! the sides of a marker's black square: taken for its size, the square puts the marker too far
//! away, and depth seems short. So the corners are those of the marker's grid
//! ([`orime_markers::fit_grid`]), which that motion does not touch. Markers whose own grid says
//! nothing (seen at a slant, small) have their square moved back by what their camera's others say.

use std::collections::BTreeMap;

use orime_capture::FrameSource;
use orime_geometry::nalgebra::{Isometry3, Point3, Vector2, Vector3};
use orime_geometry::{CameraModel, RgbdCamera, RgbdFrameMut};
use orime_markers::{
    Detector, Dictionary, GreyImage, GridFit, Marker, fit_grid, grey_from_rgb, moved_outwards,
};

use crate::fit::median;
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

/// So many grids of a camera say how far it moves borders.
const GRIDS_MIN: usize = 3;

/// Where a view's corners are from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CornersBy {
    /// The marker's own grid.
    Grid,
    /// Its black square, moved back by its camera's border shift.
    MovedSquare,
    /// Its black square as it looks: its camera's border shift is not known.
    Square,
}

/// How far a camera moves the borders between ink and paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BorderShift {
    /// Towards the ink, median over the markers whose grid says it, pixels.
    pub shift_px: f64,
    /// Median of what each of these is uncertain by (one sigma), pixels.
    pub sigma_px: f64,
}

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
    /// Where the corners are from.
    pub corners_by: CornersBy,
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
    /// Per camera; `None` where too few markers' grids say it.
    pub border_shift: Vec<Option<BorderShift>>,
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
    let border_shift = (0..cameras.len()).map(|camera| border_shift(&sights, camera)).collect();
    let mut seen = Observations { cameras, side_m, steps, views: vec![], border_shift, unreadable };
    seen.views = sights.into_iter().filter_map(|sight| settled(sight, &seen)).collect();
    seen
}

/// A view beside what it was made of.
struct Sight {
    view: View,
    /// Corners of the black square.
    square_px: [[f64; 2]; 4],
    grid: Option<GridFit>,
}

/// What the camera's markers say together; of an even number the lower middle.
fn border_shift(sights: &[Sight], camera: usize) -> Option<BorderShift> {
    let grids = sights.iter().filter(|s| s.view.camera == camera).filter_map(|s| s.grid);
    let (mut shifts, mut sigmas): (Vec<f64>, Vec<f64>) =
        grids.map(|grid| (grid.shift_px, grid.shift_sigma_px)).unzip();
    if shifts.len() < GRIDS_MIN {
        return None;
    }
    Some(BorderShift { shift_px: median(&mut shifts)?, sigma_px: median(&mut sigmas)? })
}

/// The view with its square moved by its camera's border shift, if it has no grid of its own.
fn settled(sight: Sight, seen: &Observations) -> Option<View> {
    let Sight { mut view, square_px, grid } = sight;
    let Some(shift) = seen.border_shift[view.camera].filter(|_| grid.is_none()) else {
        return Some(view);
    };
    let lens = &seen.cameras[view.camera].color;
    let corners_px = moved_outwards(&square_px, shift.shift_px);
    view.poses = poses(lens, &corners_px, view.side_m)?;
    view.rays = rays(lens, &corners_px);
    view.corners_by = CornersBy::MovedSquare;
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
    /// A marker by its grid, or by its square as it looks.
    fn sight(
        &self,
        image: GreyImage<'_>,
        dictionary: &Dictionary,
        marker: &Marker,
    ) -> Option<Sight> {
        let grid = fit_grid(image, dictionary, marker).ok();
        let corners_px = grid.map_or(marker.corners_px, |grid| grid.corners_px);
        let lens = &self.camera.color;
        let poses = poses(lens, &corners_px, self.side_m)?;
        let best = &poses[0].camera_from_marker;
        let view = View {
            camera: self.index,
            step: self.step,
            id: marker.id,
            side_m: self.side_m,
            rays: rays(lens, &corners_px),
            corners_by: if grid.is_some() { CornersBy::Grid } else { CornersBy::Square },
            depth: depth_inside(self.camera, best, self.side_m, self.depth_units),
            poses,
        };
        Some(Sight { view, square_px: marker.corners_px, grid })
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
