//! Known creases measured again, and shown where they are.

use super::candidates::bends;
use super::hinge::{Bends, Window};
use super::{LineFinder, UNDO};
use crate::folds::{Crease, Folds};
use crate::line::Line;

/// A published line follows its estimate where their distance in the sheet exceeds this, spacings.
const PUBLISH: f64 = 0.06;
/// How far the measurement of a crease looks on both sides, spacings.
const REACH: f64 = 4.0;
/// Creases whose line is measured in one step.
const MEASURED_MAX: usize = 3;

impl LineFinder {
    /// Measures the lines of some creases, and moves those that are clearly elsewhere.
    pub(super) fn measure(&mut self, folds: &mut Folds) -> bool {
        let count = folds.creases().len();
        for _ in 0..count.min(MEASURED_MAX) {
            self.next_crease = (self.next_crease + 1) % count;
            let [f, g] = folds.creases()[self.next_crease].facets;
            if let Some(cut) = self.tree.between(f, g) {
                self.measure_crease(folds, cut, f, g);
            }
        }
        count > 0 && folds.creases().iter().any(|c| self.is_off(c)) && self.publish(folds)
    }

    /// Whether a crease is shown clearly elsewhere than it is.
    fn is_off(&self, crease: &Crease) -> bool {
        let [f, g] = crease.facets;
        let Some(cut) = self.tree.between(f, g) else { return false };
        let estimate = &self.tree.cuts[cut].estimate;
        let (best, h_m) = (estimate.best(), self.nodes.h_m);
        let far = |end: &[f64; 2]| {
            let snap_m = self.config.params.snap * h_m + self.unsure_m(estimate, *end);
            let landmark_m = if estimate.at_landmarks { snap_m } else { 0.0 };
            best.side_m(*end).abs() > PUBLISH * h_m + landmark_m
        };
        !estimate.fixed && crease.ends_m.iter().any(far)
    }

    fn measure_crease(&mut self, folds: &Folds, cut: usize, f: usize, g: usize) {
        let h_m = self.nodes.h_m;
        let line = self.tree.cuts[cut].estimate.best();
        let members = [f, g].map(|facet| &self.members[facet]);
        let mut reach_m = [0.0f64; 2];
        for n in members.into_iter().flatten() {
            let side_m = line.side_m(self.nodes.uv_m[*n as usize]);
            let reach = &mut reach_m[usize::from(side_m > 0.0)];
            *reach = reach.max(side_m.abs() + 0.01 * h_m);
        }
        let Some(ends_m) = folds.creases().iter().find(|c| c.facets == [f, g]).map(|c| c.ends_m)
        else {
            return;
        };
        let piece = strip(ends_m, 4.0 * h_m);
        let window = Window { line, reach_m: reach_m.map(|r| r.min(REACH * h_m)), piece: &piece };
        let both = members[0].iter().chain(members[1]).copied();
        // Rivals have lost already.
        let angle_rad = f64::INFINITY;
        let bends = Bends { angle_rad, ..bends(&self.config.params, h_m) };
        let Some(hinge) = self.judge.fitter.fit(&self.nodes, both, window, 2, bends) else {
            return;
        };
        let known = &mut self.tree.cuts[cut];
        known.angle_max_rad = known.angle_max_rad.max(hinge.angle_rad);
        let flat = hinge.angle_rad < UNDO.1.to_radians();
        known.unfolded = if flat { known.unfolded + 1 } else { 0 };
        if !flat && hinge.narrow_m2 < hinge.smooth_m2 {
            known.estimate.measure(&hinge, h_m);
        }
    }

    /// Puts all published lines where the estimates are.
    fn publish(&mut self, folds: &mut Folds) -> bool {
        for cut in 0..self.tree.cuts.len() {
            let estimate = self.tree.cuts[cut].estimate;
            let piece = self.tree.piece(cut).filter(|_| !estimate.fixed);
            let snapped = piece.and_then(|p| self.at_landmarks(&estimate, &p, folds.facets()));
            let best = if estimate.fixed { estimate.line } else { estimate.best() };
            self.tree.cuts[cut]
                .estimate
                .publish(snapped.map_or(best, |(line, _)| line), snapped.is_some());
        }
        let Some(facets) = self.tree.facets() else {
            self.tree.cuts.iter_mut().for_each(|cut| cut.estimate.withdraw());
            return false;
        };
        let same: Vec<usize> = (0..facets.len()).collect();
        folds.retile(facets, &same);
        self.list_members(folds);
        true
    }
}

/// A rectangle along a crease, `2 · half_m` wide.
fn strip([a, b]: [[f64; 2]; 2], half_m: f64) -> [[f64; 2]; 4] {
    let d = Line::through(a, b).direction;
    let at = |p: [f64; 2], sign: f64| [p[0] - sign * half_m * d[1], p[1] + sign * half_m * d[0]];
    [at(a, -1.0), at(b, -1.0), at(b, 1.0), at(a, 1.0)]
}
