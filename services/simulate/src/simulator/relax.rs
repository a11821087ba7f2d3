//! What moves the nodes from outside strains links; time must not turn that strain into velocity.

use super::Simulator;
use crate::solver::{Hooks, Rates};

/// A correction that moves no node farther than this strains nothing that matters, metres.
const STRAINS_M: f32 = 5e-4;

/// Passes over links and facets without time. A substep of 0.4 ms would make 30 m/s of 12 mm.
const PASSES: u32 = 8;

impl Simulator {
    /// Puts the nodes where something else than the solver wants them, as a part of the last step.
    /// Velocities are kept.
    pub fn correct(&mut self, positions_m: &[[f32; 3]]) {
        let nodes = self.solver.layout.places().zip(positions_m).enumerate();
        for (node, (place, to)) in nodes {
            for (axis, to) in to.iter().enumerate() {
                self.is_strained |= (to - self.world[node][axis]).abs() > STRAINS_M;
                self.solver.x[axis].rows_mut()[place] = to - self.origin_m[axis];
                self.world[node][axis] = *to;
            }
        }
        self.folds.observe(&self.world);
    }

    /// Obeys links and facets before the next substep, without time and without targets, where a
    /// correction strained them.
    pub(super) fn relax(&mut self, rates: &Rates) {
        if !std::mem::take(&mut self.is_strained) {
            return;
        }
        let still = Rates { inertia: false, contact_awake: false, ..*rates };
        let (done, hinges) = (self.solver.substeps, std::mem::take(&mut self.solver.hinges));
        let targets = self.solver.targets.take();
        let mut hooks =
            Hooks { contact: None, watch: None, room: &mut self.points, folds: &self.folds };
        for _ in 0..PASSES {
            self.solver.substep(&still, None, &mut hooks);
        }
        self.solver.targets = targets;
        (self.solver.substeps, self.solver.hinges) = (done, hinges);
    }
}
