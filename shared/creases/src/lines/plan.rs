//! Lines that are about to be folded: where bending is seen at one, it is a crease at once.

use super::LineFinder;
use super::candidates::{bends, noise_m2};
use super::hinge::{Hinge, Window};
use crate::folds::Folds;
use crate::line::Line;

/// Share of the smallest fold angle at which a planned crease is freed.
const ANGLE_SHARE: f64 = 0.5;
/// Standard errors by which its angle must differ from zero.
const ERRORS_MIN: f64 = 4.0;
/// How much likelier a smooth bend may be than the planned kink.
const AGAINST_MAX: f64 = 2.0;
/// A line is the planned one where so near: radians, spacings.
const SAME: (f64, f64) = (0.2, 1.5);
/// Where along a planned line facets are looked for.
pub(super) const SAMPLES: [f64; 4] = [0.125, 0.375, 0.625, 0.875];
/// How far a fit looks on both sides, spacings.
const REACH: f64 = 6.0;

impl LineFinder {
    /// The planned line that a line is, if any.
    pub(super) fn planned(&self, line: &Line, middle_m: [f64; 2]) -> Option<Line> {
        let near = |planned: &&Line| {
            let (p, q) = (planned.direction, line.direction);
            (p[0] * q[1] - p[1] * q[0]).abs() < SAME.0
                && planned.side_m(middle_m).abs() < SAME.1 * self.nodes.h_m
        };
        self.config.plan.iter().find(near).copied()
    }

    /// Puts these lines in place of those beside the config's. What was seen at a line that stays
    /// counts on.
    pub(crate) fn set_plan(&mut self, lines: &[[[f64; 2]; 2]]) {
        let Self { config, plan_hits, planned_first, .. } = self;
        if config.params.plan[*planned_first..] == *lines {
            return;
        }
        let before = config.params.plan.split_off(*planned_first);
        let hits_before = plan_hits.split_off(*planned_first);
        config.plan.truncate(*planned_first);
        for ends_m in lines {
            let same = before.iter().position(|other| other == ends_m);
            config.params.plan.push(*ends_m);
            config.plan.push(Line::through(ends_m[0], ends_m[1]));
            plan_hits.push(same.map_or([0; SAMPLES.len()], |at| hits_before[at]));
        }
    }

    /// Splits facets along planned lines that bend; true where the folds changed.
    pub(super) fn follow_plan(&mut self, folds: &mut Folds) -> bool {
        let mut changed = false;
        for number in 0..self.config.plan.len() {
            for (sample, share) in SAMPLES.into_iter().enumerate() {
                let [a, b] = self.config.params.plan[number];
                let at = [0, 1].map(|k| a[k] + share * (b[k] - a[k]));
                let facet = folds.facet_at(at);
                let line = self.config.plan[number];
                let hinge = self.planned_fold(folds, facet, &line, at);
                let hits = &mut self.plan_hits[number][sample];
                *hits = if hinge.is_some() { *hits + 1 } else { 0 };
                if let Some(hinge) = hinge
                    && *hits >= self.config.params.hits
                {
                    changed |= self.split(folds, facet, &hinge, true);
                }
            }
        }
        changed
    }

    /// The fold at a planned line, where the facet has one and is not parted there yet.
    fn planned_fold(
        &mut self,
        folds: &Folds,
        facet: usize,
        line: &Line,
        at: [f64; 2],
    ) -> Option<Hinge> {
        let h_m = self.nodes.h_m;
        let is_known = |crease: &crate::folds::Crease| {
            let (p, q) = (crease.line().direction, line.direction);
            (p[0] * q[1] - p[1] * q[0]).abs() < SAME.0
                && crease.line().side_m(at).abs() < SAME.1 * h_m
        };
        let near = folds.creases().iter().filter(|crease| crease.facets.contains(&facet));
        if near.clone().any(is_known) || !self.is_wide(folds, facet, line) {
            return None;
        }
        let piece = &folds.facets()[facet].corners_m;
        let window = Window { line: *line, reach_m: [REACH * h_m; 2], piece };
        let bends = bends(&self.config.params, h_m);
        let members = self.members[facet].iter().copied();
        let hinge = self.judge.fitter.fit(&self.nodes, members, window, 0, bends)?;
        let noise_m2 = noise_m2(&hinge, h_m);
        let least_rad = ANGLE_SHARE * self.config.params.angle_min_deg.to_radians();
        let folded = hinge.angle_rad > least_rad.max(ERRORS_MIN * hinge.error_rad(noise_m2));
        (folded && hinge.evidence(noise_m2) > -AGAINST_MAX).then_some(hinge)
    }
}
