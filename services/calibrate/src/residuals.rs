//! Residuals of corners and depths, and how each moves with every unknown.

use orime_geometry::nalgebra::{Isometry3, Point3, Rotation3, Vector3, Vector6};

use crate::observe::View;
use crate::square::corners_m;
use crate::unknowns::{Sigmas, TargetViews, Unknowns};

/// Noise of neighbouring depth pixels is correlated: all samples of a marker together count as
/// so many.
const DEPTHS_OF_A_MARKER: f64 = 4.0;

/// Most unknowns beside the target's pose that one residual moves with.
const ENTRIES_MAX: usize = 14;

/// One residual, in sigmas.
#[derive(Debug, Clone)]
pub struct Row {
    /// The residual.
    pub residual: f64,
    /// How much it counts.
    pub share: f64,
    /// Its derivative by the target's pose.
    pub target: Vector6<f64>,
    entries: [(usize, f64); ENTRIES_MAX],
    n_entries: usize,
}

impl Row {
    /// Its derivatives by the common unknowns.
    pub fn common(&self) -> &[(usize, f64)] {
        &self.entries[..self.n_entries]
    }

    fn new(residual: f64, share: f64) -> Self {
        let entries = [(0, 0.0); ENTRIES_MAX];
        Self { residual, share, target: Vector6::zeros(), entries, n_entries: 0 }
    }

    fn push(&mut self, place: Option<usize>, value: f64) {
        if let Some(place) = place {
            self.entries[self.n_entries] = (place, value);
            self.n_entries += 1;
        }
    }

    fn push_six(&mut self, first: Option<usize>, values: &Vector6<f64>) {
        for (k, value) in values.iter().enumerate() {
            self.push(first.map(|first| first + k), *value);
        }
    }
}

/// The transforms from a marker to a camera's colour frame.
struct Chain {
    color_from_target: Isometry3<f64>,
    target_from_marker: Isometry3<f64>,
    color_from_marker: Isometry3<f64>,
}

/// How a scalar of the image moves, if it moves by `slope · dp` with a point `p` of the marker
/// (colour frame) that turns and shifts with each frame of the chain.
struct Slopes {
    camera: Vector6<f64>,
    target: Vector6<f64>,
    marker: Vector6<f64>,
}

impl Chain {
    fn new(unknowns: &Unknowns, target: usize, marker: usize, camera: usize) -> Self {
        let color_from_target =
            unknowns.first_from_camera[camera].inverse() * unknowns.first_from_target[target];
        let target_from_marker = unknowns.target_from_marker[marker];
        let color_from_marker = color_from_target * target_from_marker;
        Self { color_from_target, target_from_marker, color_from_marker }
    }

    /// Slopes of a scalar with gradient `force` by the point `p` at marker coordinates `x`, and
    /// with gradient `torque` by a small turn of the marker about its own place, both in the
    /// colour frame.
    fn slopes(&self, x: &Point3<f64>, force: &Vector3<f64>, torque: &Vector3<f64>) -> Slopes {
        let in_frame = |rotation: &Rotation3<f64>, point: &Point3<f64>| -> Vector6<f64> {
            let (force, torque) = (rotation.inverse() * force, rotation.inverse() * torque);
            let turn = point.coords.cross(&force) + torque;
            Vector6::new(force.x, force.y, force.z, turn.x, turn.y, turn.z)
        };
        let identity = Rotation3::identity();
        Slopes {
            // The camera moves the other way.
            camera: -in_frame(&identity, &(self.color_from_marker * x)),
            target: in_frame(
                &self.color_from_target.rotation.to_rotation_matrix(),
                &(self.target_from_marker * x),
            ),
            marker: in_frame(&self.color_from_marker.rotation.to_rotation_matrix(), x),
        }
    }
}

/// Gives every residual of one target pose to `sink`, in a fixed order.
pub fn rows_of(
    unknowns: &Unknowns,
    target: usize,
    views: &TargetViews<'_>,
    sigmas: Sigmas,
    sink: &mut dyn FnMut(&Row),
) {
    for (marker, view) in &views.views {
        let chain = Chain::new(unknowns, target, *marker, view.camera);
        corner_rows(unknowns, *marker, view, &chain, sigmas, sink);
        depth_rows(unknowns, *marker, view, &chain, sigmas, sink);
    }
}

fn corner_rows(
    unknowns: &Unknowns,
    marker: usize,
    view: &View,
    chain: &Chain,
    sigmas: Sigmas,
    sink: &mut dyn FnMut(&Row),
) {
    let lens = &unknowns.lenses[view.camera].color;
    for (x, ray) in corners_m(unknowns.side_m).iter().zip(&view.rays) {
        let p = chain.color_from_marker * x;
        // Behind the camera there is no image: a large constant pushes such steps away.
        let depth_m = p.z.max(1e-3);
        for (axis, focal_px) in [lens.fx_px, lens.fy_px].into_iter().enumerate() {
            let scale = focal_px / sigmas.corner_px;
            let mut row = Row::new(scale * (p[axis] / depth_m - ray[axis]), 1.0);
            let mut force = Vector3::zeros();
            force[axis] = scale / depth_m;
            force.z = -scale * p[axis] / (depth_m * depth_m);
            let slopes = chain.slopes(x, &force, &Vector3::zeros());
            row.target = slopes.target;
            row.push_six(unknowns.common.cameras[view.camera], &slopes.camera);
            row.push_six(unknowns.common.markers[marker], &slopes.marker);
            sink(&row);
        }
    }
}

fn depth_rows(
    unknowns: &Unknowns,
    marker: usize,
    view: &View,
    chain: &Chain,
    sigmas: Sigmas,
    sink: &mut dyn FnMut(&Row),
) {
    let camera = view.camera;
    let (bias_m, scale) = (unknowns.bias_m[camera], unknowns.scale[camera]);
    let color_from_depth = &unknowns.lenses[camera].color_from_depth;
    let share = DEPTHS_OF_A_MARKER / view.depth.len().max(1) as f64;
    // The line of sight in the colour frame starts at the depth lens.
    let eye = color_from_depth.translation.vector;
    let normal = chain.color_from_marker * Vector3::z();
    let centre = chain.color_from_marker.translation.vector;
    for sample in &view.depth {
        let ray = color_from_depth * sample.ray;
        let slant = normal.dot(&ray);
        if slant.abs() < 1e-6 {
            continue;
        }
        let depth_m = normal.dot(&(centre - eye)) / slant;
        let residual = (sample.depth_m - scale * depth_m - bias_m) / sigmas.depth_m;
        let mut row = Row::new(residual, share);
        // dz = [n·dc + dn·(c − eye − z·ray)] / (n·ray)
        let factor = -scale / (sigmas.depth_m * slant);
        let lever = centre - eye - ray * depth_m;
        let force = normal * factor;
        let torque = normal.cross(&lever) * factor;
        let slopes = chain.slopes(&Point3::origin(), &force, &torque);
        row.target = slopes.target;
        row.push_six(unknowns.common.cameras[camera], &slopes.camera);
        row.push_six(unknowns.common.markers[marker], &slopes.marker);
        row.push(unknowns.common.bias[camera], -1.0 / sigmas.depth_m);
        row.push(unknowns.common.scale[camera], -depth_m / sigmas.depth_m);
        sink(&row);
    }
}
