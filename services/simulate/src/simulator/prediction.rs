//! Where the sheet will be.

use super::{Simulator, clamped_s};
use crate::grips::Anchor;
use crate::params::PredictParams;
use crate::solver::{Hooks, Rates, Targets};
use orime_lanes::{Field, Layout, gather};

/// Room for predictions; made by the first one.
#[derive(Debug, Clone)]
pub(super) struct Prediction {
    /// The state, while the solver has the prediction.
    kept: [[Field; 3]; 2],
    anchors: Vec<Anchor>,
    /// Each node's own extrapolated place.
    places: Targets,
    /// How far each goes, metres.
    ways: Vec<[f32; 3]>,
    world: Vec<[f32; 3]>,
}

impl Prediction {
    fn new(layout: Layout) -> Self {
        Self {
            kept: [layout.fields(), layout.fields()],
            anchors: Vec::new(),
            places: Targets::new(layout),
            ways: Vec::new(),
            world: vec![[0.0; 3]; layout.nodes[0] * layout.nodes[1]],
        }
    }
}

impl Simulator {
    /// Where the nodes will be `dt_s` after the last step, world frame, metres: the last motion
    /// goes on for the most part, a gripper's with that of the point that it holds; then grippers,
    /// links and facets are obeyed, every node being held softly. The state is left as it is.
    pub fn predict(&mut self, dt_s: f64) -> &[[f32; 3]] {
        let PredictParams { momentum, hold, substeps, .. } = self.params.predict;
        let (dt_s, layout) = (clamped_s(dt_s), self.solver.layout);
        let mut room = self.prediction.take().unwrap_or_else(|| Box::new(Prediction::new(layout)));
        for (kept, now) in room.kept.iter_mut().zip([&self.solver.x, &self.solver.v]) {
            kept.clone_from(now);
        }
        room.places.count = layout.size() as u32;
        self.momentum.ways(momentum * dt_s, &self.folds, &self.world, &mut room.ways);
        self.hold_pinned(&mut room.ways);
        for (place, way) in layout.places().zip(&room.ways) {
            room.places.ratio.rows_mut()[place] = hold as f32;
            for (axis, way) in way.iter().enumerate() {
                let x = &mut self.solver.x[axis].rows_mut()[place];
                *x += way;
                room.places.at_m[axis].rows_mut()[place] = *x;
            }
        }
        room.anchors.clone_from(&self.solver.anchors);
        for anchor in &mut self.solver.anchors {
            let [from, to] = [&room.kept[0], &self.solver.x].map(|x| anchor.held_m(x));
            for axis in 0..3 {
                anchor.position_m[axis] += to[axis] - from[axis];
            }
        }
        let rates = Rates {
            dt_s: (dt_s / f64::from(substeps)) as f32,
            keep: 1.0,
            way_max_m: f32::MAX,
            strain_max: f32::INFINITY,
            grip: self.params.grippers.strength as f32,
            grip_strain_max: self.params.grippers.strain_max as f32,
            gamma_max: 0.5,
            table_m: self.solver.table.map_or(0.0, |[height_m, _]| height_m - self.origin_m[2]),
            inertia: false,
            table_awake: true,
            contact_awake: false,
        };
        let (done, hinges) = (self.solver.substeps, std::mem::take(&mut self.solver.hinges));
        let mut hooks =
            Hooks { contact: None, watch: None, room: &mut self.points, folds: &self.folds };
        for _ in 0..substeps {
            self.solver.substep(&rates, Some(&room.places), &mut hooks);
        }
        (self.solver.substeps, self.solver.hinges) = (done, hinges);
        gather(layout, &self.solver.x, self.origin_m, &mut room.world);
        self.solver.x.clone_from(&room.kept[0]);
        self.solver.v.clone_from(&room.kept[1]);
        self.solver.anchors.clone_from(&room.anchors);
        &self.prediction.insert(room).world
    }

    /// What is pinned goes nowhere.
    fn hold_pinned(&self, ways: &mut [[f32; 3]]) {
        let Some(weights) = &self.solver.weights else { return };
        for (place, way) in self.solver.layout.places().zip(ways) {
            if weights.rows()[place] == 0.0 {
                *way = [0.0; 3];
            }
        }
    }
}
