//! How the sheet goes on by itself: every facet as a rigid body, and its nodes by a share of what
//! they did besides.
//!
//! ```text
//! now = c + R·(before − c°) + rest      R, c° → c: the facet's rigid motion in the last step
//! way = a·k·R^{(1+k)/2}(c − c°) + R^k·(now − c) − (now − c) + b·k·rest,   k = ahead/step
//! ```
//!
//! Straight lines would be off by r·φ² for what turns by φ in a frame, 4 mm for a stack that is
//! turned over in three quarters of a second.

use crate::params::PredictParams;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use orime_creases::{FacetFrame, Folds};

/// The state before the present one.
#[derive(Debug, Clone, Default)]
pub(super) struct Momentum {
    before_m: Vec<[f32; 3]>,
    /// How long ago it was, seconds; 0 where there is none.
    dt_s: f64,
    /// Of every facet.
    motions: Vec<Motion>,
}

/// A facet's rigid motion in the last step, and how it goes on.
#[derive(Debug, Clone, Copy)]
struct Motion {
    before_m: Vector3<f64>,
    now_m: Vector3<f64>,
    turn: Rotation3<f64>,
    turn_ahead: Rotation3<f64>,
    way_ahead_m: Vector3<f64>,
}

impl Motion {
    fn between([before, now]: [FacetFrame; 2], ahead: f64) -> Self {
        let axes = |f: &FacetFrame| Matrix3::from_columns(&[f.u, f.v, f.normal]);
        let turn = Rotation3::from_matrix_unchecked(axes(&now) * axes(&before).transpose());
        // By way of a quaternion: the trace of no turn may exceed 3 by rounding, which has no arc
        // cosine.
        let angle_rad = UnitQuaternion::from_rotation_matrix(&turn).scaled_axis();
        let [before_m, now_m] = [before, now].map(|frame| frame.center_m.coords);
        let chord = Rotation3::new(angle_rad * (0.5 * (1.0 + ahead)));
        Self {
            before_m,
            now_m,
            turn,
            turn_ahead: Rotation3::new(angle_rad * ahead),
            way_ahead_m: chord * (now_m - before_m) * ahead,
        }
    }

    /// Where a node goes as a part of the facet, and what it did besides, metres.
    fn of(&self, before_m: Vector3<f64>, now_m: Vector3<f64>) -> [Vector3<f64>; 2] {
        let arm_m = now_m - self.now_m;
        let rest_m = arm_m - self.turn * (before_m - self.before_m);
        [self.way_ahead_m + self.turn_ahead * arm_m - arm_m, rest_m]
    }
}

impl Momentum {
    /// Takes in the state that is about to be left, for `dt_s`.
    pub fn note(&mut self, dt_s: f64, world: &[[f32; 3]]) {
        self.before_m.clear();
        self.before_m.extend_from_slice(world);
        self.dt_s = dt_s;
    }

    /// Nothing moves.
    pub fn forget(&mut self) {
        self.dt_s = 0.0;
    }

    /// How far the nodes go in `ahead_s`, metres; `world`: where they are.
    pub fn ways(
        &mut self,
        ahead_s: f64,
        params: &PredictParams,
        folds: &Folds,
        world: &[[f32; 3]],
        ways: &mut Vec<[f32; 3]>,
    ) {
        ways.clear();
        if self.dt_s <= 0.0 {
            ways.resize(world.len(), [0.0; 3]);
            return;
        }
        let ahead = ahead_s / self.dt_s;
        let states = [&self.before_m, world];
        self.motions.clear();
        self.motions.extend((0..folds.facets().len()).map(|facet| {
            let members = folds.members(facet);
            let frames = states.map(|x| FacetFrame::fit(folds.sheet(), members, x));
            Motion::between(frames, params.momentum * ahead)
        }));
        let nodes = self.before_m.iter().zip(world).zip(folds.facet_of_node());
        ways.extend(nodes.map(|((before, now), facet)| {
            let [before, now] = [before, now].map(|x| Vector3::from(*x).cast::<f64>());
            let [rigid, rest] = self.motions[usize::from(*facet)].of(before, now);
            let way = rigid + rest * (params.bend_momentum * ahead);
            <[f32; 3]>::from(way.cast::<f32>())
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
        let params = PredictParams::default();
        let [before, now] = [0.0, 0.3].map(|angle| turned(&sheet, angle));
        let mut momentum = Momentum::default();
        let mut ways = Vec::new();
        momentum.ways(0.1, &params, &folds, &now, &mut ways);
        assert!(ways.iter().flatten().all(|c| *c == 0.0), "nothing is known of how it moves");
        momentum.note(0.1, &before);
        for (ahead_s, angle) in [(0.1, 0.6), (0.05, 0.45), (0.0, 0.3)] {
            momentum.ways(ahead_s, &params, &folds, &now, &mut ways);
            let off_m = now.iter().zip(&ways).zip(turned(&sheet, angle)).map(|((x, way), to)| {
                (0..3).map(|k| (x[k] + way[k] - to[k]).powi(2)).sum::<f32>().sqrt()
            });
            // A straight line would be 15 mm off.
            let off_m = off_m.fold(0f32, f32::max);
            assert!(off_m < 2e-4, "{off_m} m off at {ahead_s} s");
        }
        momentum.forget();
        momentum.ways(0.1, &params, &folds, &now, &mut ways);
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
            momentum.ways(0.1, &PredictParams::default(), &folds, &now, &mut ways);
            assert!(ways.iter().flatten().all(|c| c.abs() < 0.01), "{angle_rad} rad");
        }
    }

    #[test]
    fn of_what_bends_half_goes_on() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let flat = sheet.flat_m();
        let wave = |x: &[f32; 3]| [x[0], x[1], x[2] + 0.001 * (84.0 * x[0]).sin()];
        let waved: Vec<[f32; 3]> = flat.iter().map(wave).collect();
        let mut momentum = Momentum::default();
        momentum.note(0.1, &flat);
        let (mut ways, folds) = (Vec::new(), Folds::flat(&sheet));
        momentum.ways(0.1, &PredictParams::default(), &folds, &waved, &mut ways);
        for (way, (from, to)) in ways.iter().zip(flat.iter().zip(&waved)) {
            // A sine of two waves has next to no slope as a whole.
            assert!((way[2] - 0.5 * (to[2] - from[2])).abs() < 2.5e-4, "{way:?}");
        }
    }
}
