//! Substep XPBD of the sheet.
//!
//! Per substep of length `dt` (Macklin et al. 2019, "Small Steps": one iteration each):
//!
//! ```text
//! x° = x;  v ← v·e^(−drag·dt) + a·dt;  x ← x + v·dt
//! targets:   x ← x + (t − x)·r,  r = 1/(1 + 1/(ω²dt²)),  |(t − x)·r| ≤ a_max·dt²
//! grippers:  the held point goes a share of the way to its gripper
//! links, colour by colour, n = (x₂ − x₁)/|x₂ − x₁|, C = |x₂ − x₁| − d, α̃ = α/dt²:
//!     s = (C + γ n·[(x₂ − x₂°) − (x₁ − x₁°)]) / ((1 + γ)(w₁ + w₂) + α̃)
//!     x₁ ← x₁ + w₁ s n,   x₂ ← x₂ − w₂ s n
//! facets:    x ← x + k·(g − x), g = the facet's best rigid pose
//! table:     z ≥ height, and friction
//! v = (x − x°)/dt
//! ```
//!
//! Source: Macklin et al. 2016 (XPBD), equations 17 and 26. Deviation: the target springs are
//! scaled by mass (a frequency, not a stiffness), so that one setting fits any sheet; the paper's
//! Eq. (1) damps absolute motion and is not used (`../shared/paper/NOTES.md`).

use crate::effect::Effect;
use crate::grips::{Anchor, Grip};
use crate::links::{Colour, coloured, facets_of_node};
use crate::params::{PredictParams, SimulateConfig, SimulateParams};
use crate::passes;
use orime_creases::Folds;
use orime_geometry::SheetGrid;

/// What one step did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SimulateReport {
    /// Targets that were not finite and were left out.
    pub targets_rejected: u32,
}

/// Longest frame that is simulated at once; a longer pause is simulated as this one, seconds.
pub const FRAME_S_MAX: f64 = 0.1;
/// Shortest frame that is simulated; the state does not move over a shorter one, seconds.
pub const FRAME_S_MIN: f64 = 1e-4;
/// Length of a frame before any period is known, seconds.
pub const FRAME_S_NOMINAL: f64 = 1.0 / 30.0;
/// Most grippers that hold a sheet at a time.
pub const GRIPS_MAX: usize = 16;

/// Length of the frame that ends at `exposure_ns`, seconds: the time since the last exposure, and
/// [`FRAME_S_NOMINAL`] where there was none or the clock went backwards.
pub fn frame_s(before_ns: Option<u64>, exposure_ns: u64) -> f64 {
    let elapsed_ns = before_ns.and_then(|before| exposure_ns.checked_sub(before));
    elapsed_ns.map_or(FRAME_S_NOMINAL, |ns| ns as f64 * 1e-9)
}

/// A frame's length as it is simulated. NaN clamps to NaN; a frame of unknown length does not move
/// the sheet.
fn clamped_s(dt_s: f64) -> f64 {
    if dt_s.is_nan() { FRAME_S_MIN } else { dt_s.clamp(FRAME_S_MIN, FRAME_S_MAX) }
}

/// The sheet's mass points and springs.
#[derive(Debug, Clone)]
pub struct Simulator {
    params: SimulateParams,
    folds: Folds,
    facets_of_node: Vec<u32>,
    uv_m: Vec<[f64; 2]>,
    colours: Vec<Colour>,
    /// Inverse mass of a node, 1/kg; all nodes are equal.
    inverse_mass_per_kg: f32,
    /// Subtracted from every position inside, so that f32 keeps its digits far from the origin.
    origin_m: [f32; 3],
    x: Vec<[f32; 3]>,
    v: Vec<[f32; 3]>,
    before: Vec<[f32; 3]>,
    /// Smoothed motion from frame to frame, m/s.
    motion_m_per_s: Vec<[f32; 3]>,
    targets: Vec<(u32, f32, [f32; 3])>,
    anchors: Vec<Anchor>,
    substeps_done: u32,
    /// Holds the state while a prediction is made.
    kept: [Vec<[f32; 3]>; 2],
    world: Vec<[f32; 3]>,
    predicted: Vec<[f32; 3]>,
}

/// What pulls the nodes in a substep.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Pull {
    /// The targets, with capped force; velocity is kept from substep to substep.
    Targets,
    /// Each node's own extrapolated place; nothing moves on by itself.
    Hold,
}

impl Simulator {
    /// A flat sheet at the origin, at rest. `rest_m`: template node positions whose link lengths
    /// are the rest lengths, where the sheet is not a flat rectangle.
    pub fn new(
        config: &SimulateConfig,
        sheet: &SheetGrid,
        density_kg_per_m2: f64,
        rest_m: Option<&[[f32; 3]]>,
    ) -> Self {
        let flat = sheet.flat_m();
        let rest = rest_m.unwrap_or(&flat);
        assert_eq!(rest.len(), sheet.len(), "one rest position per node");
        let params = config.params.clone();
        let node_kg = density_kg_per_m2 * sheet.size_m[0] * sheet.size_m[1] / sheet.len() as f64;
        let folds = Folds::flat(sheet);
        let zeros = vec![[0.0; 3]; rest.len()];
        Self {
            colours: coloured(sheet, &params.effects, params.bend.reach as usize, rest),
            params,
            facets_of_node: facets_of_node(&folds),
            uv_m: sheet.uv_m().collect(),
            folds,
            inverse_mass_per_kg: (1.0 / node_kg) as f32,
            origin_m: [0.0; 3],
            v: zeros.clone(),
            before: rest.to_vec(),
            motion_m_per_s: zeros,
            targets: Vec::with_capacity(rest.len()),
            anchors: Vec::with_capacity(GRIPS_MAX),
            substeps_done: 0,
            kept: [rest.to_vec(), rest.to_vec()],
            world: rest.to_vec(),
            predicted: rest.to_vec(),
            x: rest.to_vec(),
        }
    }

    /// What is known of the sheet's folds; angles and layer order are observed after every step.
    pub fn folds(&self) -> &Folds {
        &self.folds
    }

    /// Takes over facets and creases: links that cross a crease give way, and each facet is held
    /// together. Facets that are known already change nothing, neither angles nor order.
    pub fn set_folds(&mut self, folds: &Folds) {
        assert_eq!(folds.sheet(), self.folds.sheet(), "folds of another sheet");
        if folds.facets() == self.folds.facets() {
            return;
        }
        self.folds = folds.clone();
        self.facets_of_node = facets_of_node(folds);
        for colour in &mut self.colours {
            colour.cross(folds, &self.facets_of_node);
        }
    }

    /// The points that are held from now on, at most [`GRIPS_MAX`]; a point that is off the sheet
    /// or not finite is left out. Nothing holds the sheet unless `grippers` is among the effects.
    pub fn set_grips(&mut self, grips: &[Grip]) {
        self.anchors.clear();
        if self.has(Effect::Grippers) {
            let anchor = |grip| Anchor::new(grip, &self.folds, &self.facets_of_node, self.origin_m);
            self.anchors.extend(grips.iter().filter_map(anchor).take(GRIPS_MAX));
        }
    }

    /// Advances by `dt_s` towards the targets; `reset` takes them over as the new pose at once.
    ///
    /// Both slices have one entry per node; confidence 0 means no target for that node, 1 full
    /// trust. Targets or confidences that are not finite are left out and counted. `dt_s` is
    /// clamped to [`FRAME_S_MIN`] … [`FRAME_S_MAX`].
    pub fn step(
        &mut self,
        dt_s: f64,
        targets_m: &[[f32; 3]],
        confidence: &[f32],
        reset: bool,
    ) -> SimulateReport {
        let mut report = SimulateReport::default();
        self.targets.clear();
        let all_finite = targets_m.iter().flatten().all(|c| c.is_finite());
        if reset && all_finite && targets_m.len() == self.x.len() {
            self.take_over(targets_m);
        } else {
            if self.has(Effect::Track) {
                self.accept_targets(targets_m, confidence, &mut report);
            }
            self.kept[0].copy_from_slice(&self.x);
            let dt_s = clamped_s(dt_s);
            let substep_s = (dt_s / f64::from(self.params.substeps)) as f32;
            for _ in 0..self.params.substeps {
                self.substep(substep_s, Pull::Targets);
            }
            let per_s = 1.0 / dt_s as f32;
            for ((motion, x), before) in
                self.motion_m_per_s.iter_mut().zip(&self.x).zip(&self.kept[0])
            {
                *motion = [0, 1, 2].map(|k| 0.5 * motion[k] + 0.5 * (x[k] - before[k]) * per_s);
            }
        }
        to_world(&self.x, self.origin_m, &mut self.world);
        if self.folds.facets().len() > 1 {
            self.folds.observe(&self.world);
        }
        report
    }

    /// Where the nodes will be `dt_s` after the last step, world frame, metres: the last motion
    /// goes on for the most part, then grippers, links and facets are obeyed, every node being
    /// held softly. The state is left as it is.
    pub fn predict(&mut self, dt_s: f64) -> &[[f32; 3]] {
        let PredictParams { momentum, substeps, .. } = self.params.predict;
        let dt_s = clamped_s(dt_s);
        self.kept[0].copy_from_slice(&self.x);
        self.kept[1].copy_from_slice(&self.v);
        let ahead_s = (momentum * dt_s) as f32;
        self.targets.clear();
        for (node, (x, motion)) in self.x.iter_mut().zip(&self.motion_m_per_s).enumerate() {
            *x = [0, 1, 2].map(|axis| x[axis] + motion[axis] * ahead_s);
            self.targets.push((node as u32, 1.0, *x));
        }
        let done = self.substeps_done;
        for _ in 0..substeps {
            self.substep((dt_s / f64::from(substeps)) as f32, Pull::Hold);
        }
        self.substeps_done = done;
        to_world(&self.x, self.origin_m, &mut self.predicted);
        self.x.copy_from_slice(&self.kept[0]);
        self.v.copy_from_slice(&self.kept[1]);
        &self.predicted
    }

    /// Node positions, world frame, metres, index order of the sheet.
    pub fn positions_m(&self) -> &[[f32; 3]] {
        &self.world
    }

    fn has(&self, effect: Effect) -> bool {
        self.params.effects.contains(&effect)
    }

    fn take_over(&mut self, positions_m: &[[f32; 3]]) {
        let before = self.origin_m;
        self.origin_m = positions_m[positions_m.len() / 2];
        for (x, position) in self.x.iter_mut().zip(positions_m) {
            *x = [0, 1, 2].map(|axis| position[axis] - self.origin_m[axis]);
        }
        for anchor in &mut self.anchors {
            let at = &mut anchor.position_m;
            *at = [0, 1, 2].map(|axis| at[axis] + before[axis] - self.origin_m[axis]);
        }
        self.v.fill([0.0; 3]);
        self.motion_m_per_s.fill([0.0; 3]);
    }

    fn accept_targets(
        &mut self,
        targets_m: &[[f32; 3]],
        confidence: &[f32],
        report: &mut SimulateReport,
    ) {
        for (node, (target, confidence)) in targets_m.iter().zip(confidence).enumerate() {
            if node >= self.x.len() || *confidence == 0.0 {
                continue;
            }
            if !(target.iter().all(|c| c.is_finite()) && *confidence > 0.0) {
                report.targets_rejected += 1;
                continue;
            }
            let local = [0, 1, 2].map(|axis| target[axis] - self.origin_m[axis]);
            self.targets.push((node as u32, confidence.min(1.0), local));
        }
    }

    fn substep(&mut self, dt_s: f32, pull: Pull) {
        let tracking = pull == Pull::Targets;
        self.before.copy_from_slice(&self.x);
        if tracking {
            self.drift(dt_s);
            passes::pull(&self.params.track, &self.targets, dt_s, &mut self.x);
        } else {
            passes::hold(self.params.predict.hold as f32, &self.targets, &mut self.x);
        }
        for anchor in &self.anchors {
            anchor.pull(&mut self.x, self.params.grippers.strength as f32);
        }
        self.project(dt_s);
        if self.has(Effect::Facets) && self.folds.facets().len() > 1 {
            let strength = self.params.facets.strength;
            let forward = self.substeps_done.is_multiple_of(2);
            passes::hold_facets(&self.folds, strength, forward, &self.uv_m, &mut self.x);
        }
        if self.has(Effect::Table) {
            let height_m = self.params.table.height_m as f32 - self.origin_m[2];
            let friction = self.params.table.friction as f32;
            passes::rest_on_table(height_m, friction, &self.before, &mut self.x);
        }
        self.substeps_done = self.substeps_done.wrapping_add(1);
        if tracking {
            for ((x, v), before) in self.x.iter().zip(&mut self.v).zip(&self.before) {
                *v = [0, 1, 2].map(|axis| (x[axis] - before[axis]) / dt_s);
            }
        }
    }

    /// Free motion: gravity, air, inertia.
    fn drift(&mut self, dt_s: f32) {
        let drag_per_s = if self.has(Effect::AirDrag) { self.params.air_drag.per_s } else { 0.0 };
        let keep = (-(drag_per_s as f32) * dt_s).exp();
        let gravity = self.params.gravity.acceleration_m_per_s2 as f32;
        let fall = if self.has(Effect::Gravity) { gravity * dt_s } else { 0.0 };
        for (x, v) in self.x.iter_mut().zip(&mut self.v) {
            v[2] -= fall;
            for axis in 0..3 {
                v[axis] *= keep;
                x[axis] += v[axis] * dt_s;
            }
        }
    }

    /// Links, colour by colour.
    fn project(&mut self, dt_s: f32) {
        let damping_s = if self.has(Effect::Damping) { self.params.damping.time_s } else { 0.0 };
        let gamma = damping_s as f32 / dt_s;
        for colour in &self.colours {
            let compliance = match colour.effect {
                Effect::Stretch => self.params.stretch.compliance_m_per_n,
                Effect::Shear => self.params.shear.compliance_m_per_n,
                _ => self.params.bend.compliance_m_per_n,
            };
            let alpha = compliance as f32 / (dt_s * dt_s); // [1/kg]
            let weight = self.inverse_mass_per_kg;
            passes::project(colour, weight, alpha, gamma, &mut self.x, &self.before);
        }
    }
}

fn to_world(x: &[[f32; 3]], origin_m: [f32; 3], world: &mut [[f32; 3]]) {
    for (world, x) in world.iter_mut().zip(x) {
        *world = [0, 1, 2].map(|axis| x[axis] + origin_m[axis]);
    }
}

#[cfg(test)]
mod tests;
