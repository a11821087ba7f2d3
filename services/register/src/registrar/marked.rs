//! Registering a printed sheet by its recognised points.

use super::{Observation, RegisterReport, Registrar, Tracking};

/// Fewest seen nodes by which the sheet is followed; fewer still pull.
const NODES_MIN: usize = 4;

/// Least share of the seen nodes that must be near their prediction.
const AGREEMENT_MIN: f32 = 0.5;

impl Registrar {
    /// As [`Registrar::register`], from features alone: only nodes that are seen get a target.
    pub(super) fn register_marked(
        &mut self,
        observed: &Observation<'_>,
        predicted_m: Option<&[[f32; 3]]>,
        targets_m: &mut [[f32; 3]],
        confidence: &mut [f32],
    ) -> RegisterReport {
        let Observation { features, cameras, .. } = observed;
        confidence.fill(0.0);
        let known = predicted_m.filter(|x| self.has_pose && x.len() == self.sheet.len());
        if let Some(state) = known {
            self.nodes_m.clear();
            self.nodes_m.extend_from_slice(state);
        }
        let fused = self.fusion.fuse(features, cameras, known.map(|_| &self.nodes_m[..]));
        let mut report = RegisterReport {
            sigma_m: fused.spread_m,
            inlier_ratio: fused.used_ratio,
            points_rejected: fused.rejected,
            tracking: Tracking::Tracking,
            ..RegisterReport::default()
        };
        let seen = self.fusion.nodes.len();
        if known.is_none() || self.fusion.agreement(&self.nodes_m) < AGREEMENT_MIN {
            // Fused without a prediction: it may be what was wrong.
            self.fusion.fuse(features, cameras, None);
            match self.fusion.pose() {
                Some(pose) => {
                    self.nodes_m = pose;
                    report.reset = true;
                }
                None if known.is_some() => report.tracking = Tracking::Lost,
                None => {
                    report.tracking = Tracking::Searching;
                    return report;
                }
            }
        } else if seen < NODES_MIN {
            report.tracking = Tracking::Coasting;
        }
        self.has_pose = true;
        if report.reset {
            targets_m[..self.nodes_m.len()].copy_from_slice(&self.nodes_m);
            confidence[..self.nodes_m.len()].fill(1.0);
        } else {
            for fused in &self.fusion.nodes {
                targets_m[fused.node] = fused.position_m;
                confidence[fused.node] = 1.0;
            }
            if let Some(state) = known.filter(|_| self.params.carry_hidden > 0.0) {
                let carry = self.params.carry_hidden as f32;
                self.fusion.carry(state, carry, targets_m, confidence);
            }
        }
        report
    }
}
