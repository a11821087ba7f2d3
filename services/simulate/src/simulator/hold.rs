//! Where the sheet is held, in step with its origin, its folds and its prediction.

use super::Simulator;
use crate::effect::Effect;
use crate::grips::{Anchor, Grip, within_reach};

/// Most grippers that hold a sheet at a time.
pub const GRIPS_MAX: usize = 16;

impl Simulator {
    /// The points that are held from now on, at most [`GRIPS_MAX`]; a point that is off the sheet
    /// or not finite is left out. Grippers that a flat sheet does not reach between meet halfway.
    /// Nothing holds the sheet unless `grippers` is among the effects.
    pub fn set_grips(&mut self, grips: &[Grip]) {
        let grips = &grips[..grips.len().min(GRIPS_MAX)];
        if !self.has(Effect::Grippers) || self.grips == grips {
            return;
        }
        self.grips.clear();
        self.grips.extend_from_slice(grips);
        self.renew_anchors();
        self.rest.wake();
    }

    /// Ties the held points to nodes of their facets.
    pub(super) fn renew_anchors(&mut self) {
        let usable = self.grips.iter().filter(|grip| grip.is_on(self.folds.sheet()));
        self.held.clear();
        self.held.extend(usable);
        if self.is_flat_at_rest {
            within_reach(&mut self.held);
        }
        let colours = &self.solver.colours;
        let anchor = |grip| {
            let anchor = Anchor::new(grip, &self.folds, &self.facets_of_place, self.origin_m)?;
            Some(anchor.tie(colours))
        };
        self.solver.anchors.clear();
        self.solver.anchors.extend(self.held.iter().filter_map(anchor));
    }

    /// Goes with an origin that has moved by that much, metres.
    pub(super) fn shift_anchors(&mut self, shift_m: [f32; 3]) {
        for anchor in &mut self.solver.anchors {
            anchor.position_m = [0, 1, 2].map(|axis| anchor.position_m[axis] - shift_m[axis]);
        }
    }
}
