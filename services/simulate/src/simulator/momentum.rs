//! How the sheet goes on by itself: every facet as a rigid body, and its nodes in what they do
//! besides.
//!
//! ```text
//! newer = c + R·(older − c°) + rest     R, c° → c: a facet's rigid motion in one of the last steps
//! ω, v, r: means of R's rotation vector, of c − c° and of rest, per second, each turned with the
//!          facet since;  t = momentum · ahead
//! way = R(ω(t + step)/2)·v·t + R(ωt)·(now − c) − (now − c) + r·t
//! ```
//!
//! Straight lines would be off by r·φ² for what turns by φ in a frame, 4 mm for a stack that is
//! turned over in three quarters of a second. Means of three steps, and less than all of them:
//! of facets that nobody sees nothing else ends what noise began.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use orime_creases::{FacetFrame, Folds};

/// Weights of the last steps, newest first.
const WEIGHTS: [f64; 3] = [0.5, 0.25, 0.25];

/// A state that was, and how long it lasted.
#[derive(Debug, Clone, Default)]
struct Past {
    positions_m: Vec<[f32; 3]>,
    dt_s: f64,
}

/// The states before the present one.
#[derive(Debug, Clone, Default)]
pub(super) struct Momentum {
    /// Newest first.
    past: [Past; WEIGHTS.len()],
    /// How many there are.
    count: usize,
    /// Of every facet.
    motions: Vec<Motion>,
}

/// A facet's rigid motion in one of the last steps.
#[derive(Debug, Clone, Copy, Default)]
struct Step {
    older_m: Vector3<f64>,
    newer_m: Vector3<f64>,
    turn: Rotation3<f64>,
    /// The facet's turn since.
    to_now: Rotation3<f64>,
    /// Weight over the step's length.
    weight_per_s: f64,
}

/// A facet's motions, and how they go on.
#[derive(Debug, Clone, Copy, Default)]
struct Motion {
    now_m: Vector3<f64>,
    turn_ahead: Rotation3<f64>,
    way_ahead_m: Vector3<f64>,
    steps: [Step; WEIGHTS.len()],
}

impl Motion {
    /// Of a facet with these nodes, for `ahead_s`.
    fn of(members: &[u32], folds: &Folds, past: &[Past], world: &[[f32; 3]], ahead_s: f64) -> Self {
        let mut motion = Self::default();
        let total: f64 = WEIGHTS[..past.len()].iter().sum();
        let place = |x: &[[f32; 3]]| {
            let frame = FacetFrame::fit(folds.sheet(), members, x);
            let axes = Matrix3::from_columns(&[frame.u, frame.v, frame.normal]);
            (Rotation3::from_matrix_unchecked(axes), frame.center_m.coords)
        };
        let (now, now_m) = place(world);
        let (mut newer, mut newer_m) = (now, now_m);
        let (mut turn_per_s, mut way_per_s) = (Vector3::zeros(), Vector3::zeros());
        for ((step, past), weight) in motion.steps.iter_mut().zip(past).zip(WEIGHTS) {
            let (older, older_m) = place(&past.positions_m);
            let weight_per_s = weight / (total * past.dt_s);
            let (turn, to_now) = (newer * older.inverse(), now * newer.inverse());
            // By way of a quaternion: the trace of no turn may exceed 3 by rounding, which has no
            // arc cosine.
            turn_per_s += UnitQuaternion::from_rotation_matrix(&turn).scaled_axis() * weight_per_s;
            way_per_s += to_now * (newer_m - older_m) * weight_per_s;
            *step = Step { older_m, newer_m, turn, to_now, weight_per_s };
            (newer, newer_m) = (older, older_m);
        }
        let chord = Rotation3::new(turn_per_s * (0.5 * (ahead_s + past[0].dt_s)));
        motion.now_m = now_m;
        motion.turn_ahead = Rotation3::new(turn_per_s * ahead_s);
        motion.way_ahead_m = chord * way_per_s * ahead_s;
        motion
    }

    /// How far a node goes, metres. `at`: where it is, and where it was, newest first.
    fn way_m(&self, at: impl Fn(usize) -> Vector3<f64>, count: usize, ahead_s: f64) -> [f32; 3] {
        let arm_m = at(0) - self.now_m;
        let mut way_m = self.way_ahead_m + self.turn_ahead * arm_m - arm_m;
        for (k, step) in self.steps[..count].iter().enumerate() {
            let rest_m = at(k) - step.newer_m - step.turn * (at(k + 1) - step.older_m);
            way_m += step.to_now * rest_m * (step.weight_per_s * ahead_s);
        }
        way_m.cast::<f32>().into()
    }
}

impl Momentum {
    /// Takes in the state that is about to be left, after `dt_s`.
    pub fn note(&mut self, dt_s: f64, world: &[[f32; 3]]) {
        self.past.rotate_right(1);
        self.past[0].positions_m.clear();
        self.past[0].positions_m.extend_from_slice(world);
        self.past[0].dt_s = dt_s;
        self.count = (self.count + 1).min(WEIGHTS.len());
    }

    /// Nothing moves.
    pub fn forget(&mut self) {
        self.count = 0;
    }

    /// How far the nodes go in `ahead_s` of undamped motion, metres; `world`: where they are.
    pub fn ways(
        &mut self,
        ahead_s: f64,
        folds: &Folds,
        world: &[[f32; 3]],
        ways: &mut Vec<[f32; 3]>,
    ) {
        ways.clear();
        let Self { past, count, motions } = self;
        let past = &past[..*count];
        if past.is_empty() {
            ways.resize(world.len(), [0.0; 3]);
            return;
        }
        let facets = 0..folds.facets().len();
        motions.clear();
        motions.extend(
            facets.map(|facet| Motion::of(folds.members(facet), folds, past, world, ahead_s)),
        );
        ways.extend(folds.facet_of_node().iter().enumerate().map(|(node, facet)| {
            let at = |k: usize| {
                let x = if k == 0 { world[node] } else { past[k - 1].positions_m[node] };
                Vector3::from(x).cast::<f64>()
            };
            motions[usize::from(*facet)].way_m(at, past.len(), ahead_s)
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_creases::Line;
    use orime_geometry::SheetGrid;

    /// The sheet folded upright along its middle, turned by so many radians about an axis far off.
    fn turned(sheet: &SheetGrid, angle_rad: f64) -> Vec<[f32; 3]> {
        let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), angle_rad);
        let place = |[u, v]: [f64; 2]| {
            let over = (u - 0.075).max(0.0);
            (turn * Vector3::new(u - over + 0.1, v, over)).cast::<f32>().into()
        };
        sheet.uv_m().map(place).collect()
    }

    #[test]
    fn a_folded_sheet_that_turns_goes_on_turning() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let mut folds = Folds::flat(&sheet);
        folds.split(0, &Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
        let [before, now] = [0.0, 0.3].map(|angle| turned(&sheet, angle));
        let mut momentum = Momentum::default();
        let mut ways = Vec::new();
        momentum.ways(0.1, &folds, &now, &mut ways);
        assert!(ways.iter().flatten().all(|c| *c == 0.0), "nothing is known of how it moves");
        momentum.note(0.1, &before);
        for (ahead_s, angle) in [(0.1, 0.6), (0.05, 0.45), (0.0, 0.3)] {
            momentum.ways(ahead_s, &folds, &now, &mut ways);
            let off_m = now.iter().zip(&ways).zip(turned(&sheet, angle)).map(|((x, way), to)| {
                (0..3).map(|k| (x[k] + way[k] - to[k]).powi(2)).sum::<f32>().sqrt()
            });
            // A straight line would be 15 mm off.
            let off_m = off_m.fold(0f32, f32::max);
            assert!(off_m < 2e-4, "{off_m} m off at {ahead_s} s");
        }
        momentum.forget();
        momentum.ways(0.1, &folds, &now, &mut ways);
        assert!(ways.iter().flatten().all(|c| *c == 0.0));
    }

    #[test]
    fn what_hardly_turns_has_a_finite_way() {
        let sheet = SheetGrid::new([0.15, 0.15], [13, 13]);
        let folds = Folds::flat(&sheet);
        let mut ways = Vec::new();
        for k in 0..200 {
            let angle_rad = 1e-9 * f64::from(k * k * k);
            let [before, now] = [0.3, 0.3 + angle_rad].map(|angle| turned(&sheet, angle));
            let mut momentum = Momentum::default();
            momentum.note(0.1, &before);
            momentum.ways(0.1, &folds, &now, &mut ways);
            assert!(ways.iter().flatten().all(|c| c.abs() < 0.01), "{angle_rad} rad");
        }
    }

    #[test]
    fn what_bends_goes_on_bending() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let flat = sheet.flat_m();
        let wave = |x: &[f32; 3]| [x[0], x[1], x[2] + 0.001 * (84.0 * x[0]).sin()];
        let waved: Vec<[f32; 3]> = flat.iter().map(wave).collect();
        let mut momentum = Momentum::default();
        momentum.note(0.1, &flat);
        let (mut ways, folds) = (Vec::new(), Folds::flat(&sheet));
        momentum.ways(0.1, &folds, &waved, &mut ways);
        for (way, (from, to)) in ways.iter().zip(flat.iter().zip(&waved)) {
            // A sine of two waves has next to no slope as a whole.
            assert!((way[2] - (to[2] - from[2])).abs() < 5e-4, "{way:?}");
        }
    }
}
