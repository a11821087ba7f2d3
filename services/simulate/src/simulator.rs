//! Substep XPBD of the sheet.
//!
//! Per substep of length `dt` (Macklin et al. 2019, "Small Steps": one iteration each):
//!
//! ```text
//! x° = x;  v ← v·e^(−drag·dt) + a·dt;  x ← x + v·dt
//! targets:  x ← x + (t − x)·r,  r = 1/(1 + 1/(ω²dt²)),  |(t − x)·r| ≤ a_max·dt²
//! links, colour by colour, n = (x₂ − x₁)/|x₂ − x₁|, C = |x₂ − x₁| − d, α̃ = α/dt²:
//!     s = (C + γ n·[(x₂ − x₂°) − (x₁ − x₁°)]) / ((1 + γ)(w₁ + w₂) + α̃)
//!     x₁ ← x₁ + w₁ s n,   x₂ ← x₂ − w₂ s n
//! v = (x − x°)/dt
//! ```
//!
//! Source: Macklin et al. 2016 (XPBD), equations 17 and 26. Deviation: the target springs are
//! scaled by mass (a frequency, not a stiffness), so that one setting fits any sheet; the paper's
//! Eq. (1) damps absolute motion and is not used (`../shared/paper/NOTES.md`).

use crate::links::{Colour, coloured};
use crate::params::{SimulateConfig, SimulateParams};
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

/// Length of the frame that ends at `exposure_ns`, seconds: the time since the last exposure, and
/// [`FRAME_S_NOMINAL`] where there was none or the clock went backwards.
pub fn frame_s(before_ns: Option<u64>, exposure_ns: u64) -> f64 {
    let elapsed_ns = before_ns.and_then(|before| exposure_ns.checked_sub(before));
    elapsed_ns.map_or(FRAME_S_NOMINAL, |ns| ns as f64 * 1e-9)
}

/// The sheet's mass points and springs.
#[derive(Debug)]
pub struct Simulator {
    params: SimulateParams,
    colours: Vec<Colour>,
    /// Inverse mass of a node, 1/kg; all nodes are equal.
    inverse_mass_per_kg: f32,
    /// Subtracted from every position inside, so that f32 keeps its digits far from the origin.
    origin_m: [f32; 3],
    x: Vec<[f32; 3]>,
    v: Vec<[f32; 3]>,
    before: Vec<[f32; 3]>,
    targets: Vec<(u32, f32, [f32; 3])>,
    world: Vec<[f32; 3]>,
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
        let node_kg = density_kg_per_m2 * sheet.size_m[0] * sheet.size_m[1] / sheet.len() as f64;
        Self {
            params: config.params.clone(),
            colours: coloured(sheet, config.params.link_steps as usize, rest),
            inverse_mass_per_kg: (1.0 / node_kg) as f32,
            origin_m: [0.0; 3],
            v: vec![[0.0; 3]; rest.len()],
            before: rest.to_vec(),
            targets: Vec::with_capacity(rest.len()),
            world: rest.to_vec(),
            x: rest.to_vec(),
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
            self.accept_targets(targets_m, confidence, &mut report);
            // NaN clamps to NaN; a frame of unknown length does not move the sheet.
            let dt_s =
                if dt_s.is_nan() { FRAME_S_MIN } else { dt_s.clamp(FRAME_S_MIN, FRAME_S_MAX) };
            let substep_s = (dt_s / f64::from(self.params.substeps)) as f32;
            for _ in 0..self.params.substeps {
                self.substep(substep_s);
            }
        }
        for (world, x) in self.world.iter_mut().zip(&self.x) {
            *world = [0, 1, 2].map(|axis| x[axis] + self.origin_m[axis]);
        }
        report
    }

    /// Node positions, world frame, metres, index order of the sheet.
    pub fn positions_m(&self) -> &[[f32; 3]] {
        &self.world
    }

    fn take_over(&mut self, positions_m: &[[f32; 3]]) {
        self.origin_m = positions_m[positions_m.len() / 2];
        for (x, position) in self.x.iter_mut().zip(positions_m) {
            *x = [0, 1, 2].map(|axis| position[axis] - self.origin_m[axis]);
        }
        self.v.fill([0.0; 3]);
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

    fn substep(&mut self, dt_s: f32) {
        let keep = (-(self.params.drag_per_s as f32) * dt_s).exp();
        let fall = self.params.gravity_m_per_s2 as f32 * dt_s;
        for ((x, v), before) in self.x.iter_mut().zip(&mut self.v).zip(&mut self.before) {
            *before = *x;
            v[2] -= fall;
            for axis in 0..3 {
                v[axis] *= keep;
                x[axis] += v[axis] * dt_s;
            }
        }
        self.pull(dt_s);
        for colour in &self.colours {
            let compliance = if colour.is_stretch {
                self.params.stretch_compliance_m_per_n
            } else {
                self.params.bend_compliance_m_per_n
            };
            let gamma = self.params.damping_s as f32 / dt_s;
            let alpha = compliance as f32 / (dt_s * dt_s); // [1/kg]
            project(colour, self.inverse_mass_per_kg, alpha, gamma, &mut self.x, &self.before);
        }
        for ((x, v), before) in self.x.iter().zip(&mut self.v).zip(&self.before) {
            *v = [0, 1, 2].map(|axis| (x[axis] - before[axis]) / dt_s);
        }
    }

    /// Virtual zero-rest-length springs to the targets, with a capped acceleration.
    fn pull(&mut self, dt_s: f32) {
        let omega_dt = std::f32::consts::TAU * self.params.track_hz as f32 * dt_s;
        let move_max_m = self.params.track_acceleration_max_m_per_s2 as f32 * dt_s * dt_s;
        for (node, confidence, target) in &self.targets {
            let stiffness = omega_dt * omega_dt * confidence;
            let ratio = stiffness / (1.0 + stiffness);
            let x = &mut self.x[*node as usize];
            let offset = [0, 1, 2].map(|axis| (target[axis] - x[axis]) * ratio);
            let length = offset.iter().map(|c| c * c).sum::<f32>().sqrt();
            let cap = if length > move_max_m { move_max_m / length } else { 1.0 };
            for axis in 0..3 {
                x[axis] += offset[axis] * cap;
            }
        }
    }
}

/// Projects one colour of distance links; the module's head has the equation.
fn project(
    colour: &Colour,
    weight_per_kg: f32,
    alpha_per_kg: f32,
    gamma: f32,
    x: &mut [[f32; 3]],
    before: &[[f32; 3]],
) {
    let denominator = (1.0 + gamma) * 2.0 * weight_per_kg + alpha_per_kg;
    for ([a, b], rest_m) in colour.ends.iter().zip(&colour.rest_m) {
        let (a, b) = (*a as usize, *b as usize);
        let (xa, xb, oa, ob) = (x[a], x[b], before[a], before[b]);
        let d = [xb[0] - xa[0], xb[1] - xa[1], xb[2] - xa[2]];
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        if length < 1e-9 {
            continue; // Coincident nodes have no direction; their other links part them.
        }
        let closing = d[0] * ((xb[0] - ob[0]) - (xa[0] - oa[0]))
            + d[1] * ((xb[1] - ob[1]) - (xa[1] - oa[1]))
            + d[2] * ((xb[2] - ob[2]) - (xa[2] - oa[2]));
        let violation = length - rest_m;
        let s = (violation + gamma * closing / length) / denominator; // [kg m]
        let scale = weight_per_kg * s / length;
        for axis in 0..3 {
            x[a][axis] = xa[axis] + scale * d[axis];
            x[b][axis] = xb[axis] - scale * d[axis];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn simulator(params: SimulateParams) -> (Simulator, SheetGrid) {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        (Simulator::new(&params.check().unwrap(), &sheet, 0.08, None), sheet)
    }

    fn strain_max(x: &[[f32; 3]], sheet: &SheetGrid) -> f64 {
        let strain = |([a, b], rest): ([u32; 2], f64)| {
            let (a, b) = (x[a as usize], x[b as usize]);
            let squared: f64 = (0..3).map(|k| f64::from(b[k] - a[k]).powi(2)).sum();
            (squared.sqrt() / rest - 1.0).abs()
        };
        sheet.edges().into_iter().map(strain).fold(0.0, f64::max)
    }

    #[test]
    fn a_sheet_hung_by_two_corners_stretches_less_with_more_substeps() {
        let mut last = f64::INFINITY;
        // design/simulate.md, fact 1, allows 6.5 and 1.9 % at 20 and 40 substeps a 1/60 s frame.
        for (substeps, strain_allowed) in [(20, 0.08), (40, 0.025)] {
            let (mut simulator, sheet) = simulator(SimulateParams {
                substeps,
                link_steps: 4,
                bend_compliance_m_per_n: 0.0,
                track_hz: 10_000.0,
                track_acceleration_max_m_per_s2: 1e6,
                drag_per_s: 1.0,
                gravity_m_per_s2: 9.81,
                ..SimulateParams::default()
            });
            let targets = sheet.flat_m();
            let mut confidence = vec![0.0; sheet.len()];
            confidence[0] = 1.0;
            confidence[sheet.index(0, 24)] = 1.0;
            let mut worst: f64 = 0.0;
            for _ in 0..60 {
                simulator.step(1.0 / 60.0, &targets, &confidence, false);
                worst = worst.max(strain_max(simulator.positions_m(), &sheet));
            }
            assert!(worst < strain_allowed && worst < last, "{substeps} substeps: {worst}");
            last = worst;
        }
    }

    #[test]
    fn damping_takes_no_momentum_from_free_flight() {
        let (mut simulator, sheet) =
            simulator(SimulateParams { drag_per_s: 0.0, damping_s: 0.01, ..Default::default() });
        simulator.v.fill([0.3, -0.1, 0.2]);
        let none = vec![0.0; sheet.len()];
        let start = simulator.positions_m().to_vec();
        for _ in 0..30 {
            simulator.step(1.0 / 30.0, &start, &none, false);
        }
        let travelled = [0, 1, 2].map(|axis| {
            (0..sheet.len())
                .map(|n| f64::from(simulator.positions_m()[n][axis] - start[n][axis]))
                .sum::<f64>()
                / sheet.len() as f64
        });
        for (travelled, expected) in travelled.into_iter().zip([0.3, -0.1, 0.2]) {
            assert!((travelled - expected).abs() < 1e-4, "{travelled} instead of {expected}");
        }
    }

    #[test]
    fn targets_are_reached_and_nonsense_is_rejected() {
        let (mut simulator, sheet) = simulator(SimulateParams::default());
        let mut targets: Vec<[f32; 3]> =
            sheet.flat_m().iter().map(|p| [p[0] + 0.005, p[1], p[2] + 0.003]).collect();
        targets[7] = [f32::NAN, 0.0, 0.0];
        let mut confidence = vec![1.0; sheet.len()];
        confidence[9] = f32::NAN;
        let mut report = SimulateReport::default();
        for _ in 0..30 {
            report = simulator.step(1.0 / 30.0, &targets, &confidence, false);
        }
        assert_eq!(report.targets_rejected, 2);
        for (x, target) in simulator.positions_m().iter().zip(&targets) {
            if target[0].is_finite() {
                assert!((0..3).all(|axis| (x[axis] - target[axis]).abs() < 1e-4));
            }
        }
        assert!(simulator.positions_m().iter().flatten().all(|c| c.is_finite()));
    }

    #[test]
    fn reset_takes_a_pose_over_at_once_even_far_from_the_origin() {
        let (mut simulator, sheet) = simulator(SimulateParams::default());
        let pose: Vec<[f32; 3]> =
            sheet.flat_m().iter().map(|p| [p[0] + 1000.0, p[1], p[2]]).collect();
        simulator.step(1.0 / 30.0, &pose, &vec![1.0; sheet.len()], true);
        assert_eq!(simulator.positions_m(), pose);
        // A pose with a hole in it is no pose: the state is kept.
        let mut broken = sheet.flat_m();
        broken[3][1] = f32::INFINITY;
        simulator.step(1.0 / 30.0, &broken, &vec![0.0; sheet.len()], true);
        assert!(simulator.positions_m().iter().all(|p| (p[0] - 1000.0).abs() < 0.1));
    }

    #[test]
    fn frames_last_from_exposure_to_exposure() {
        assert_eq!(frame_s(None, 5), FRAME_S_NOMINAL);
        assert_eq!(frame_s(Some(1_000_000_000), 1_020_000_000), 0.02);
        assert_eq!(frame_s(Some(7), 3), FRAME_S_NOMINAL);
    }

    #[test]
    fn odd_frame_lengths_never_blow_up() {
        let (mut simulator, sheet) = simulator(SimulateParams::default());
        let targets: Vec<[f32; 3]> = sheet.flat_m().iter().map(|p| [p[1], p[0], 0.2]).collect();
        let confidence = vec![1.0; sheet.len()];
        for dt_s in [1.0 / 30.0, 5.0, 0.0, -1.0, f64::NAN, 1.0 / 300.0, 0.3, f64::INFINITY] {
            simulator.step(dt_s, &targets, &confidence, false);
            assert!(simulator.positions_m().iter().flatten().all(|c| c.abs() < 1.0));
        }
    }
}
