//! Pleats that close together: rigid panels that lean alternately to either side.
//!
//! With panel width w and fold angle θ at every crease, panel k rises (k even) or falls (k odd) by
//! θ/2: a distance s across it is s·cos(θ/2) along the table and s·sin(θ/2) up. Neighbours meet in
//! their crease only; the closed pack keeps three thicknesses between creases.

use std::f64::consts::PI;

use nalgebra::Vector3;

use crate::Timing;
use crate::facet::{Crease, Facet, FacetPose, Sheet};

/// The motion; creases along v.
#[derive(Debug, Clone)]
pub(crate) struct Accordion {
    length_m: f64,
    panels: usize,
    angle_max_rad: f64,
    timing: Timing,
}

impl Accordion {
    pub fn new(sheet: &Sheet, panels: usize) -> (Self, Vec<Facet>, Vec<Crease>) {
        let [length_m, b] = sheet.size_m;
        let width_m = length_m / panels as f64;
        let at = |k: usize| k as f64 * width_m;
        let facets = (0..panels).map(|k| Facet {
            corners_uv_m: vec![[at(k), 0.0], [at(k + 1), 0.0], [at(k + 1), b], [at(k), b]],
        });
        let creases = (1..panels)
            .map(|k| Crease { ends_uv_m: [[at(k), 0.0], [at(k), b]], facets: [k - 1, k] });
        let closed = (3.0 * sheet.thickness_m / width_m).clamp(0.03, 1.0);
        let timing = Timing { rest_before: 0.06, rest_after: 0.10 };
        let angle_max_rad = PI - 2.0 * closed.asin();
        let motion = Self { length_m, panels, angle_max_rad, timing };
        (motion, facets.collect(), creases.collect())
    }

    pub fn pose(&self, progress: f64, poses: &mut [FacetPose]) {
        let half = self.angle_max_rad * self.timing.done(progress) / 2.0;
        let (sin, cos) = half.sin_cos();
        let width_m = self.length_m / self.panels as f64;
        for (k, pose) in poses.iter_mut().enumerate() {
            // The sheet's middle stays where it is; even panels rise from the table.
            let start = k as f64 * width_m;
            let rise = if k % 2 == 0 { sin } else { -sin };
            let x = self.length_m / 2.0 * (1.0 - cos);
            let z = if k % 2 == 0 { 0.0 } else { width_m * sin } - rise * start;
            *pose = FacetPose {
                origin_m: Vector3::new(x, 0.0, z),
                along_u: Vector3::new(cos, 0.0, rise),
                along_v: Vector3::y(),
            };
        }
    }
}
