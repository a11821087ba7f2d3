//! How well cameras agree on frame sets that the fit has not seen.

use std::collections::BTreeMap;

use orime_capture::TargetKind;
use orime_geometry::RgbdCamera;
use orime_geometry::nalgebra::{Isometry3, Point3};

use crate::fit::{DepthError, Fit, FitError, fit, median};
use crate::observe::{Observations, View, plane_depth_m};

/// Frame sets are dealt to so many parts; each is scored by a fit to the others.
pub const PARTS: u64 = 6;

/// How two cameras agree on the same marker, in frame sets left out of the fit.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PairAgreement {
    /// Names of the two cameras.
    pub cameras: [String; 2],
    /// Markers seen by both at once.
    pub markers: usize,
    /// Median distance between where the one and where the other sees a marker's centre, by
    /// corners and the marker's size, under the new calibration, millimetres.
    pub marker_agreement_mm_median: Option<f64>,
    /// The same under the calibration that the source came with.
    pub source_agreement_mm_median: Option<f64>,
    /// Markers for which both have depth.
    pub depth_markers: usize,
    /// Median distance by direction and corrected depth, under the new calibration, millimetres.
    pub depth_agreement_mm_median: Option<f64>,
    /// The same with depth as it is, under the calibration that the source came with.
    pub source_depth_agreement_mm_median: Option<f64>,
}

#[derive(Default)]
struct Distances {
    new_mm: Vec<f64>,
    source_mm: Vec<f64>,
    depth_mm: Vec<f64>,
    source_depth_mm: Vec<f64>,
}

/// Fits to all parts but one, scores that one, for every part in turn.
pub fn left_out(seen: &Observations, kind: TargetKind) -> Result<Vec<PairAgreement>, FitError> {
    let n = seen.cameras.len();
    let mut steps: Vec<u64> = seen.views.iter().map(|view| view.step).collect();
    steps.sort_unstable();
    steps.dedup();
    let part_of: BTreeMap<u64, u64> =
        steps.iter().enumerate().map(|(k, step)| (*step, k as u64 % PARTS)).collect();
    let mut all: BTreeMap<(usize, usize), Distances> = BTreeMap::new();
    for a in 0..n {
        (a + 1..n).for_each(|b| drop(all.insert((a, b), Distances::default())));
    }
    for part in 0..PARTS.min(steps.len() as u64) {
        let fit = fit(seen, kind, |step| part_of[&step] != part)?;
        let views: Vec<&View> = seen.views.iter().filter(|v| part_of[&v.step] == part).collect();
        for (k, a) in views.iter().enumerate() {
            for b in &views[k + 1..] {
                if a.step == b.step && a.id == b.id && a.camera != b.camera {
                    let (a, b) = if a.camera < b.camera { (a, b) } else { (b, a) };
                    let pair = all.entry((a.camera, b.camera)).or_default();
                    measure(seen, &fit, a, b, pair);
                }
            }
        }
    }
    let name = |k: usize| seen.cameras[k].name.clone();
    let agreements = all.into_iter().map(|((a, b), mut d)| PairAgreement {
        cameras: [name(a), name(b)],
        markers: d.new_mm.len(),
        depth_markers: d.depth_mm.len(),
        marker_agreement_mm_median: median(&mut d.new_mm),
        source_agreement_mm_median: median(&mut d.source_mm),
        depth_agreement_mm_median: median(&mut d.depth_mm),
        source_depth_agreement_mm_median: median(&mut d.source_depth_mm),
    });
    Ok(agreements.collect())
}

fn measure(seen: &Observations, fit: &Fit, a: &View, b: &View, out: &mut Distances) {
    let pair = [a, b];
    let distance_mm = |[x, y]: [Point3<f64>; 2]| (x - y).norm() * 1e3;
    let new = |view: &View| fit.first_from_camera[view.camera];
    let source = |view: &View| seen.cameras[view.camera].world_from_color;
    let corners = |pose: &dyn Fn(&View) -> Isometry3<f64>| {
        distance_mm(pair.map(|view| pose(view) * centre(view)))
    };
    out.new_mm.push(corners(&new));
    out.source_mm.push(corners(&source));
    let by_depth = |pose: &dyn Fn(&View) -> Isometry3<f64>, corrected: bool| {
        let [x, y] = pair.map(|view| {
            let error = fit.depth[view.camera].filter(|_| corrected);
            Some(pose(view) * centre_by_depth(&seen.cameras[view.camera], view, error)?)
        });
        Some(distance_mm([x?, y?]))
    };
    out.depth_mm.extend(by_depth(&new, true));
    out.source_depth_mm.extend(by_depth(&source, false));
}

/// Where the camera alone sees the marker's centre, by its corners and size; colour frame.
fn centre(view: &View) -> Point3<f64> {
    Point3::from(view.poses[0].camera_from_marker.translation.vector)
}

/// Where the camera alone sees it by the direction of its corners and the depth inside them.
fn centre_by_depth(
    camera: &RgbdCamera,
    view: &View,
    error: Option<DepthError>,
) -> Option<Point3<f64>> {
    let pose = camera.color_from_depth.inverse() * view.poses[0].camera_from_marker;
    let (bias_m, scale) = error.map_or((0.0, 1.0), |e| (e.bias_m, e.scale));
    let mut ratios: Vec<f64> = view
        .depth
        .iter()
        .map(|s| (s.depth_m - bias_m) / scale / plane_depth_m(&pose, &s.ray))
        .collect();
    let ratio = median(&mut ratios)?;
    Some(camera.color_from_depth * Point3::from(pose.translation.vector * ratio))
}
