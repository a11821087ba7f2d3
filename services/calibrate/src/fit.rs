//! From what was seen to poses and depth errors.

use std::collections::BTreeMap;

use orime_capture::TargetKind;
use orime_geometry::nalgebra::Isometry3;

use crate::bundle::{Termination, adjust};
use crate::observe::{Observations, View, plane_depth_m};
use crate::start::{Layout, TargetKey, layout, target_key};
use crate::unknowns::{Common, Sigmas, TargetViews, Unknowns};

/// Scatter that the first round expects; the second takes what the first has left.
const FIRST_SIGMAS: Sigmas = Sigmas { corner_px: 0.3, depth_m: 0.003 };
/// Bounds of what the second round takes: lenses and prints are not better, views not worse.
const CORNER_PX: [f64; 2] = [0.05, 1.0];
const DEPTH_M: [f64; 2] = [0.0005, 0.01];
/// A depth scale is told from a bias only if true depths span at least this factor.
const SCALE_SPAN_MIN: f64 = 1.8;
/// Least depth samples of a camera for a bias, and least views of depth.
const DEPTH_VIEWS_MIN: usize = 3;

/// Why nothing could be calibrated; every message says what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// No chain of shared views leads to a camera.
    #[error(
        "camera `{camera}` shares {shared} view(s) of the markers with the others: move the target \
         so that it is seen by `{camera}` and another camera at once, in at least 3 frame sets"
    )]
    Unconnected {
        /// The camera.
        camera: String,
        /// Frame sets in which it and any other camera see a marker.
        shared: usize,
    },
    /// There are no markers.
    #[error(
        "no marker of `{dictionary}` was found in {steps} frame set(s): is \
         `capture.calibration.dictionary` that of the print?"
    )]
    NoMarker {
        /// The dictionary.
        dictionary: String,
        /// Frame sets that were searched.
        steps: u64,
    },
}

/// How one camera's depth errs.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct DepthError {
    /// Measured = `scale` · true + `bias_m`, metres.
    pub bias_m: f64,
    /// See `bias_m`; exactly 1 where the depths seen do not span enough to tell it from a bias.
    pub scale: f64,
    /// Median of measured − true at the depths seen, metres.
    pub offset_m: f64,
    /// Median depth of the samples, metres.
    pub at_m: f64,
    /// Median distance of the corrected samples from the surface, metres.
    pub spread_m: f64,
    /// Markers with depth.
    pub views: usize,
}

/// What was found.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Maps each camera's colour frame into that of camera 0.
    pub first_from_camera: Vec<Isometry3<f64>>,
    /// Maps each marker into the target.
    pub target_from_marker: BTreeMap<u32, Isometry3<f64>>,
    /// Maps the target into camera 0.
    pub first_from_target: BTreeMap<TargetKey, Isometry3<f64>>,
    /// Per camera; `None` where it saw too little depth on markers.
    pub depth: Vec<Option<DepthError>>,
    /// Per camera: median distance of corners from where the fit puts them, pixels.
    pub corner_px: Vec<f64>,
    /// How the last round ended.
    pub termination: Termination,
}

/// Fits to the frame sets that `takes` accepts.
pub fn fit(
    seen: &Observations,
    kind: TargetKind,
    takes: impl Fn(u64) -> bool,
) -> Result<Fit, FitError> {
    let mut part = seen.clone();
    part.views.retain(|view| takes(view.step));
    let start = layout(&part, kind);
    let mut problem = Problem::new(&part, kind, &start)?;
    let targets = problem.targets();
    adjust(&mut problem.unknowns, &targets, FIRST_SIGMAS);
    let sigmas = problem.scatter();
    let termination = adjust(&mut problem.unknowns, &targets, sigmas);
    Ok(problem.result(termination))
}

/// An adjustment with the names of its parts.
struct Problem<'a> {
    seen: &'a Observations,
    kind: TargetKind,
    markers: Vec<u32>,
    keys: Vec<TargetKey>,
    unknowns: Unknowns,
}

impl<'a> Problem<'a> {
    fn new(seen: &'a Observations, kind: TargetKind, start: &Layout) -> Result<Self, FitError> {
        let cameras: Option<Vec<_>> = start.first_from_camera.iter().copied().collect();
        let cameras = cameras.ok_or_else(|| unconnected(seen, start))?;
        let markers: Vec<u32> = start.target_from_marker.keys().copied().collect();
        let keys: Vec<TargetKey> = start.first_from_target.keys().copied().collect();
        let n = cameras.len();
        let has_depth: Vec<bool> =
            (0..n).map(|c| depth_views(seen, c).count() >= DEPTH_VIEWS_MIN).collect();
        let has_scale: Vec<bool> = (0..n).map(|c| has_depth[c] && spans_enough(seen, c)).collect();
        // The first camera is the frame of all; the root marker is the target's.
        let cameras_free: Vec<bool> = (0..n).map(|c| c > 0).collect();
        let markers_free: Vec<bool> = markers
            .iter()
            .map(|id| {
                kind == TargetKind::Rigid && start.target_from_marker[id] != Isometry3::identity()
            })
            .collect();
        let unknowns = Unknowns {
            lenses: seen.cameras.clone(),
            side_m: seen.side_m,
            first_from_camera: cameras,
            target_from_marker: markers.iter().map(|id| start.target_from_marker[id]).collect(),
            first_from_target: keys.iter().map(|key| start.first_from_target[key]).collect(),
            bias_m: vec![0.0; n],
            scale: vec![1.0; n],
            common: Common::new(&cameras_free, &markers_free, &has_depth, &has_scale),
        };
        Ok(Self { seen, kind, markers, keys, unknowns })
    }

    /// The views, by target pose and in a fixed order; those of unplaced markers are left out.
    fn targets(&self) -> Vec<TargetViews<'a>> {
        let of_key = |key: &TargetKey| {
            let views = self.seen.views.iter().filter(|v| target_key(self.kind, v) == *key);
            let placed = views.filter_map(|v| Some((self.markers.binary_search(&v.id).ok()?, v)));
            TargetViews { views: placed.collect() }
        };
        self.keys.iter().map(of_key).collect()
    }

    /// Every view with where its marker lies in its camera.
    fn placed(&self) -> Vec<(&'a View, Isometry3<f64>)> {
        let targets = self.targets();
        let unknowns = &self.unknowns;
        let each = targets.iter().zip(&unknowns.first_from_target).flat_map(|(target, pose)| {
            target.views.iter().map(move |(marker, view)| {
                let camera = unknowns.first_from_camera[view.camera].inverse();
                (*view, camera * pose * unknowns.target_from_marker[*marker])
            })
        });
        each.collect()
    }

    /// Scatter of what the fit has left, robustly.
    fn scatter(&self) -> Sigmas {
        let placed = self.placed();
        let mut corners: Vec<f64> = placed
            .iter()
            .flat_map(|(view, pose)| corner_errors_px(&self.seen.cameras, view, pose))
            .collect();
        let mut depths: Vec<f64> = placed
            .iter()
            .flat_map(|(view, pose)| {
                let errors = depth_errors(&self.seen.cameras, view, pose);
                let (bias, scale) =
                    (self.unknowns.bias_m[view.camera], self.unknowns.scale[view.camera]);
                errors.map(move |(measured, expected)| (measured - scale * expected - bias).abs())
            })
            .collect();
        // Of a two-dimensional and of a one-dimensional normal distribution.
        let corner_px = median(&mut corners).unwrap_or(0.0) / 1.1774;
        let depth_m = median(&mut depths).unwrap_or(0.0) * 1.4826;
        Sigmas {
            corner_px: corner_px.clamp(CORNER_PX[0], CORNER_PX[1]),
            depth_m: depth_m.clamp(DEPTH_M[0], DEPTH_M[1]),
        }
    }

    fn result(self, termination: Termination) -> Fit {
        let placed = self.placed();
        let cameras = 0..self.seen.cameras.len();
        let corner_px = cameras.clone().map(|camera| {
            let of_camera = placed.iter().filter(|(view, _)| view.camera == camera);
            let mut errors: Vec<f64> = of_camera
                .flat_map(|(view, pose)| corner_errors_px(&self.seen.cameras, view, pose))
                .collect();
            median(&mut errors).unwrap_or(f64::NAN)
        });
        let depth = cameras.clone().map(|camera| {
            self.unknowns.common.bias[camera]?;
            self.depth_error(camera, &placed)
        });
        Fit {
            corner_px: corner_px.collect(),
            depth: depth.collect(),
            first_from_camera: self.unknowns.first_from_camera,
            target_from_marker: self
                .markers
                .iter()
                .copied()
                .zip(self.unknowns.target_from_marker)
                .collect(),
            first_from_target: self
                .keys
                .iter()
                .copied()
                .zip(self.unknowns.first_from_target)
                .collect(),
            termination,
        }
    }

    fn depth_error(&self, camera: usize, placed: &[(&View, Isometry3<f64>)]) -> Option<DepthError> {
        let (bias_m, scale) = (self.unknowns.bias_m[camera], self.unknowns.scale[camera]);
        let (mut offsets, mut depths, mut spreads, mut views) = (vec![], vec![], vec![], 0);
        for (view, pose) in placed.iter().filter(|(view, _)| view.camera == camera) {
            views += usize::from(!view.depth.is_empty());
            for (measured_m, true_m) in depth_errors(&self.seen.cameras, view, pose) {
                offsets.push(measured_m - true_m);
                depths.push(true_m);
                spreads.push((measured_m - scale * true_m - bias_m).abs());
            }
        }
        Some(DepthError {
            bias_m,
            scale,
            offset_m: median(&mut offsets)?,
            at_m: median(&mut depths)?,
            spread_m: median(&mut spreads)?,
            views,
        })
    }
}

fn depth_views(seen: &Observations, camera: usize) -> impl Iterator<Item = &View> {
    seen.views.iter().filter(move |view| view.camera == camera && !view.depth.is_empty())
}

fn spans_enough(seen: &Observations, camera: usize) -> bool {
    let depths = depth_views(seen, camera).flat_map(|view| view.depth.iter().map(|s| s.depth_m));
    let mut depths: Vec<f64> = depths.collect();
    depths.sort_by(f64::total_cmp);
    let at = |share: f64| depths[((depths.len() - 1) as f64 * share) as usize];
    !depths.is_empty() && at(0.95) >= SCALE_SPAN_MIN * at(0.05)
}

fn unconnected(seen: &Observations, start: &Layout) -> FitError {
    let lost = start.first_from_camera.iter().position(Option::is_none).unwrap_or(0);
    let steps = |wanted: &dyn Fn(usize) -> bool| -> std::collections::BTreeSet<u64> {
        seen.views.iter().filter(|v| wanted(v.camera)).map(|v| v.step).collect()
    };
    let shared = steps(&|camera| camera == lost).intersection(&steps(&|c| c != lost)).count();
    FitError::Unconnected { camera: seen.cameras[lost].name.clone(), shared }
}

/// Distances of a view's corners from where a pose puts them, pixels.
fn corner_errors_px(
    cameras: &[orime_geometry::RgbdCamera],
    view: &View,
    camera_from_marker: &Isometry3<f64>,
) -> impl Iterator<Item = f64> {
    let lens = &cameras[view.camera].color;
    let focal_px = [lens.fx_px, lens.fy_px];
    let pose = *camera_from_marker;
    let rays = view.rays;
    let corners = crate::square::corners_m(view.side_m);
    corners.into_iter().zip(rays).map(move |(corner, ray)| {
        let p = pose * corner;
        let d = p.coords.xy() / p.z - ray;
        (d.x * focal_px[0]).hypot(d.y * focal_px[1])
    })
}

/// Measured and expected depth of a view's samples, metres.
fn depth_errors(
    cameras: &[orime_geometry::RgbdCamera],
    view: &View,
    camera_from_marker: &Isometry3<f64>,
) -> impl Iterator<Item = (f64, f64)> {
    let pose = cameras[view.camera].color_from_depth.inverse() * camera_from_marker;
    view.depth.iter().map(move |sample| (sample.depth_m, plane_depth_m(&pose, &sample.ray)))
}

/// The middle value (of an even count the lower one), `None` of nothing.
pub fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len().checked_sub(1)? / 2).copied()
}
