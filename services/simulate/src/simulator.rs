//! The sheet over time: frames of several substeps, folds, grips, prediction.

mod batch;
#[cfg(feature = "gpu")]
mod graphics;
mod hold;
mod momentum;
mod prediction;
mod relax;
mod rest;

use crate::contact::{ContactPass, Part};
use crate::effect::{Effect, Effects};
use crate::grips::Grip;
use crate::params::{SimulateConfig, SimulateParams};
use crate::place::{is_inverse_mass, is_place};
use crate::solver::links::{Colour, facets_of_place};
use crate::solver::{Hooks, Rates, Solver, Stencils, Targets};
pub use batch::Batch;
#[cfg(feature = "gpu")]
pub use graphics::Chosen;
pub use hold::GRIPS_MAX;
use momentum::Momentum;
use orime_creases::Folds;
use orime_geometry::SheetGrid;
use prediction::Prediction;
use rest::Rest;

/// What one step did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SimulateReport {
    /// Targets that were not finite and were left out.
    pub targets_rejected: u32,
    /// Substeps that were made; 0 where the sheet slept, or a pose was taken over.
    pub substeps: u32,
    /// How many of them contact refused: layers could not be parted, and the sheet stayed there.
    pub refused: u32,
    /// Effects that the scene names and that proved idle in this step: nothing was paid for them.
    pub slept: Effects,
    /// Whether the paper's damping was held down to where it does not diverge.
    pub damping_limited: bool,
}

/// Longest frame that is simulated at once; a longer pause is simulated as this one, seconds.
pub const FRAME_S_MAX: f64 = 0.1;
/// Shortest frame that is simulated; the state does not move over a shorter one, seconds.
pub const FRAME_S_MIN: f64 = 1e-4;
/// Length of a frame before any period is known, seconds.
pub const FRAME_S_NOMINAL: f64 = 1.0 / 30.0;
/// The origin follows when the sheet's middle is further away than this, metres.
const ORIGIN_APART_M: f32 = 0.25;
/// A frame ends after so many refused substeps in a row: from rest, facets gone through forwards
/// and backwards, the next one would be refused as well.
const REFUSED_MAX: u32 = 3;
/// Most times as many substeps as set that a frame with much motion gets.
const SUBSTEPS_TIMES_MAX: u32 = 4;

/// Length of the frame that ends at `exposure_ns`, seconds: the time since the last exposure, and
/// [`FRAME_S_NOMINAL`] where there was none or the clock went backwards.
pub fn frame_s(before_ns: Option<u64>, exposure_ns: u64) -> f64 {
    let elapsed_ns = before_ns.and_then(|before| exposure_ns.checked_sub(before));
    elapsed_ns.map_or(FRAME_S_NOMINAL, |ns| ns as f64 * 1e-9)
}

/// A frame's length as it is simulated. A frame of unknown length does not move the sheet.
fn clamped_s(dt_s: f64) -> f64 {
    if dt_s.is_nan() { FRAME_S_MIN } else { dt_s.clamp(FRAME_S_MIN, FRAME_S_MAX) }
}

/// The targets of a step; both slices have one entry per node.
#[derive(Debug, Clone, Copy)]
pub struct Pulls<'a> {
    /// Where the nodes should be, world frame, metres.
    pub targets_m: &'a [[f32; 3]],
    /// 0 for no target, 1 for full trust.
    pub confidence: &'a [f32],
}

/// How a caller takes part in a step.
#[derive(Default)]
pub struct Taking<'a> {
    /// Runs in every substep if `self_contact` is among the effects and layers may touch.
    pub contact: Option<&'a mut dyn FnMut(ContactPass<'_>)>,
    /// Is told after each pass what it was.
    pub watch: Option<&'a mut dyn FnMut(Part)>,
}

/// The sheet's mass points and springs.
#[derive(Debug, Clone)]
pub struct Simulator {
    params: SimulateParams,
    folds: Folds,
    solver: Solver,
    /// The facets of each place, a bit per facet.
    facets_of_place: Vec<u32>,
    /// Subtracted from every position inside, so that f32 keeps its digits far from the origin.
    origin_m: [f32; 3],
    momentum: Momentum,
    world: Vec<[f32; 3]>,
    /// Whether lengths at rest are those of the flat grid.
    is_flat_at_rest: bool,
    /// What holds the sheet.
    grips: Vec<Grip>,
    /// Those of them that can, where the sheet lets them.
    held: Vec<Grip>,
    rest: Rest,
    /// Whether a correction has strained it since the last step.
    is_strained: bool,
    /// Usual length of a frame, seconds; 0 before the first.
    period_s: f64,
    prediction: Option<Box<Prediction>>,
    #[cfg(feature = "gpu")]
    graphics: Option<Box<graphics::Graphics>>,
    /// Room for contact.
    points: [Vec<[f32; 3]>; 2],
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
        let world = rest_m.map_or_else(|| sheet.flat_m(), <[_]>::to_vec);
        assert_eq!(world.len(), sheet.len(), "one rest position per node");
        let params = config.params.clone();
        let node_kg = density_kg_per_m2 * sheet.size_m[0] * sheet.size_m[1] / sheet.len() as f64;
        let folds = Folds::flat(sheet);
        let solver = Solver::new(&params, sheet, (1.0 / node_kg) as f32, rest_m);
        let points = if solver.has_contact { world.len() } else { 0 };
        let mut simulator = Self {
            facets_of_place: facets_of_place(solver.layout, &folds),
            origin_m: [0.0; 3],
            momentum: Momentum::default(),
            is_flat_at_rest: rest_m.is_none(),
            grips: Vec::new(),
            held: Vec::new(),
            rest: Rest::default(),
            is_strained: false,
            period_s: 0.0,
            prediction: None,
            #[cfg(feature = "gpu")]
            graphics: None,
            points: [(); 2].map(|()| vec![[0.0; 3]; points]),
            params,
            folds,
            solver,
            world,
        };
        simulator.solver.set_folds(&simulator.folds, false);
        simulator
    }

    /// Sets inverse masses per node in units of an ordinary one's, index order. 0 pins a node,
    /// 1 is ordinary; nothing else than 0 and 1e-6 to 1e6 is taken.
    pub fn set_inverse_masses(&mut self, weights: &[f32]) -> bool {
        let good = weights.len() == self.world.len()
            && weights.iter().all(|weight| is_inverse_mass(*weight));
        if good {
            self.solver.set_weights(weights);
            self.rest.wake();
        }
        good
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
        if folds.facets().len() > 1 {
            self.folds.observe(&self.world);
        }
        self.facets_of_place = facets_of_place(self.solver.layout, folds);
        self.solver.set_folds(&self.folds, true);
        self.renew_anchors();
        #[cfg(feature = "gpu")]
        self.renew_graphics();
        self.rest.wake();
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
        self.step_with(dt_s, Pulls { targets_m, confidence }, reset, &mut Taking::default())
    }

    /// The same as [`Simulator::step`], with a caller who takes part.
    pub fn step_with(
        &mut self,
        dt_s: f64,
        pulls: Pulls<'_>,
        reset: bool,
        taking: &mut Taking<'_>,
    ) -> SimulateReport {
        let mut report = SimulateReport::default();
        if reset && pulls.is_pose_of(self.world.len()) {
            self.take_over(pulls.targets_m);
            return report;
        }
        let dt_s = clamped_s(dt_s);
        self.recenter();
        self.accept_targets(pulls, &mut report);
        if self.rest.sleeps(dt_s, pulls) {
            report.slept = self.params.effects.iter().copied().collect();
            return report;
        }
        self.advance(dt_s, taking, &mut report);
        report
    }

    /// How much of `facets.strength` each facet gets, 0 … 1; facets beyond the end get all of it.
    pub fn set_facet_shares(&mut self, shares: &[f32]) {
        self.solver.facet_shares.clear();
        self.solver.facet_shares.extend_from_slice(shares);
    }

    /// Node positions, world frame, metres, index order of the sheet.
    pub fn positions_m(&self) -> &[[f32; 3]] {
        &self.world
    }

    /// Links, or hinges and twists, of an effect and their colours; none for what is neither.
    pub fn links(&self, effect: Effect) -> [usize; 2] {
        let colours = self.solver.colours.iter().filter(|colour| colour.effect == effect);
        let plate = self.solver.plate.iter().filter(|_| effect == Effect::Bend);
        let counts = colours.map(Colour::count).chain(plate.map(Stencils::count));
        counts.fold([0, 0], |[links, n], count| [links + count, n + 1])
    }

    /// Bytes that an effect takes; `None` for the nodes themselves.
    pub fn bytes(&self, effect: Option<Effect>) -> usize {
        self.solver.bytes(effect)
    }

    /// Whether the scene asks for the graphics processor and for nothing else.
    pub fn wants_gpu(&self) -> bool {
        self.params.backend == crate::Backend::Gpu
    }

    fn has(&self, effect: Effect) -> bool {
        self.params.effects.contains(&effect)
    }

    fn take_over(&mut self, positions_m: &[[f32; 3]]) {
        let before = self.origin_m;
        self.origin_m = positions_m[positions_m.len() / 2];
        let origin_m = self.origin_m;
        // Differences first: f32 has few digits left for both together.
        for ((place, x), world) in self.solver.layout.places().zip(positions_m).zip(&mut self.world)
        {
            for axis in 0..3 {
                self.solver.x[axis].rows_mut()[place] = x[axis] - origin_m[axis];
            }
            *world = *x;
        }
        self.shift_anchors([0, 1, 2].map(|axis| origin_m[axis] - before[axis]));
        for v in &mut self.solver.v {
            v.rows_mut().fill(0.0);
        }
        self.momentum.forget();
        self.is_strained = false;
        self.rest.wake();
        if self.folds.facets().len() > 1 {
            self.folds.observe(&self.world);
            self.solver.set_folds(&self.folds, false);
        }
    }

    /// Moves the origin after a sheet that travels. No digit is lost: the shift is a multiple of
    /// 1/64 m, and the positions become smaller.
    fn recenter(&mut self) {
        let middle = self.solver.layout.place(self.world.len() / 2);
        let mut shifts_m = [0.0; 3];
        for (axis, x) in self.solver.x.iter_mut().enumerate() {
            let shift_m = (x.rows()[middle] * 64.0).trunc() / 64.0;
            if shift_m.abs() > ORIGIN_APART_M {
                x.rows_mut().iter_mut().for_each(|x| *x -= shift_m);
                self.origin_m[axis] += shift_m;
                shifts_m[axis] = shift_m;
            }
        }
        self.shift_anchors(shifts_m);
    }

    fn accept_targets(&mut self, pulls: Pulls<'_>, report: &mut SimulateReport) {
        let Some(targets) = &mut self.solver.targets else { return };
        let confidence = targets.confidence.rows_mut();
        confidence.fill(0.0);
        targets.count = 0;
        let weights = self.solver.weights.as_ref();
        let places = self.solver.layout.places();
        for (place, (target, trust)) in places.zip(pulls.targets_m.iter().zip(pulls.confidence)) {
            if *trust == 0.0 || weights.is_some_and(|w| w.rows()[place] == 0.0) {
                continue;
            }
            if !(is_place(target) && *trust > 0.0 && trust.is_finite()) {
                report.targets_rejected += 1;
                continue;
            }
            confidence[place] = trust.min(1.0);
            targets.count += 1;
            for (at_m, (target, origin)) in
                targets.at_m.iter_mut().zip(target.iter().zip(self.origin_m))
            {
                at_m.rows_mut()[place] = target - origin;
            }
        }
    }

    /// Substeps, and all that is done once a frame.
    fn advance(&mut self, dt_s: f64, taking: &mut Taking<'_>, report: &mut SimulateReport) {
        report.substeps = self.substeps(dt_s);
        let rates = self.begin(dt_s, report);
        self.relax(&rates);
        let Taking { contact, watch } = taking;
        #[cfg(feature = "gpu")]
        let elsewhere = self.advance_on_gpu(&rates, report.substeps, contact.is_some(), watch);
        #[cfg(not(feature = "gpu"))]
        let elsewhere = false;
        if !elsewhere {
            self.solver.yield_creases();
            let mut hooks = Hooks {
                contact: contact.as_deref_mut(),
                watch: watch.as_deref_mut(),
                room: &mut self.points,
                folds: &self.folds,
            };
            let mut refused = 0;
            for made in 0..report.substeps {
                let holds = self.solver.substep(&rates, None, &mut hooks);
                refused = if holds { 0 } else { refused + 1 };
                report.refused += u32::from(!holds);
                report.substeps = made + 1;
                if refused == REFUSED_MAX {
                    break;
                }
            }
        }
        self.finish(dt_s);
    }

    /// What is done before a frame's substeps; the report says how many.
    fn begin(&mut self, dt_s: f64, report: &mut SimulateReport) -> Rates {
        let rates = self.rates(dt_s, report);
        self.set_ratios(rates.dt_s);
        rates
    }

    /// What is done after a frame's substeps.
    fn finish(&mut self, dt_s: f64) {
        self.momentum.note(dt_s, &self.world);
        let mut moved_m: f32 = 0.0;
        let [x, y, z] = self.solver.x.each_ref().map(|field| field.rows());
        let weights = self.solver.weights.as_ref();
        for (place, world) in self.solver.layout.places().zip(&mut self.world) {
            if weights.is_some_and(|w| w.rows()[place] == 0.0) {
                continue; // What is pinned keeps its bits: the origin's rounding moves nothing.
            }
            let now = [x[place], y[place], z[place]];
            for axis in 0..3 {
                let now = now[axis] + self.origin_m[axis];
                let way = now - world[axis];
                moved_m = moved_m.max(way.abs());
                world[axis] = now;
            }
        }
        self.rest.note(moved_m);
        if self.folds.facets().len() > 1 {
            self.folds.observe(&self.world);
        }
    }

    /// Substeps of this frame, by its length and by how far the targets are away.
    fn substeps(&mut self, dt_s: f64) -> u32 {
        let set = self.params.substeps;
        // Substeps keep their length over frames that jitter: every change of it turns strain
        // into velocity.
        let usual_s = if self.period_s > 0.0 { self.period_s } else { dt_s };
        self.period_s = usual_s + 0.1 * (dt_s.clamp(0.25 * usual_s, 4.0 * usual_s) - usual_s);
        let times = self.times();
        let wanted = (f64::from(set) * dt_s / usual_s).round();
        (wanted.clamp(1.0, f64::from(set * SUBSTEPS_TIMES_MAX)) as u32 * times)
            .clamp(1, set * SUBSTEPS_TIMES_MAX)
    }

    /// How many times the usual substeps the targets' distance asks for.
    fn times(&self) -> u32 {
        let motion_m = self.params.substep_motion_m * f64::from(self.params.substeps);
        let targets = self.solver.targets.as_ref().filter(|targets| targets.count > 0);
        let Some(targets) = targets.filter(|_| motion_m > 0.0) else { return 1 };
        let confidence = targets.confidence.rows();
        let mut squared_m2 = 0f64;
        for place in self.solver.layout.places().filter(|place| confidence[*place] > 0.0) {
            let way =
                |axis: usize| targets.at_m[axis].rows()[place] - self.solver.x[axis].rows()[place];
            squared_m2 += (0..3).map(|axis| f64::from(way(axis)).powi(2)).sum::<f64>();
        }
        // Over all nodes: a few that are held hard say nothing of the sheet's motion.
        let distance_m = 2.0 * (squared_m2 / self.world.len() as f64).sqrt();
        match distance_m / motion_m {
            near if near <= 1.0 => 1,
            far if far <= 2.0 => 2,
            _ => SUBSTEPS_TIMES_MAX,
        }
    }

    /// What all substeps of the frame share, and which effects sleep.
    fn rates(&self, dt_s: f64, report: &mut SimulateReport) -> Rates {
        let dt_s = (dt_s / f64::from(report.substeps)) as f32;
        let solver = &self.solver;
        let drag_per_s = solver.drag_per_s.unwrap_or(0.0);
        let acceleration_max = self.params.track.acceleration_max_m_per_s2 as f32;
        let table_m = solver.table.map_or(0.0, |[height_m, _]| height_m - self.origin_m[2]);
        let gamma_max = self.gamma_max(dt_s);
        report.damping_limited = solver.damping.is_some_and(|(damp, time_s)| {
            damp == crate::solver::Damp::Paper && time_s / dt_s > gamma_max
        });
        let frame_s = dt_s * report.substeps as f32;
        let table_awake = solver.table.is_some() && self.table_is_near(table_m, frame_s);
        let contact_awake = solver.has_contact && !self.is_flat();
        let one_facet = self.folds.facets().len() < 2;
        let idle = |effect: Effect| match effect {
            Effect::Facets => one_facet,
            Effect::Crease => solver.hinges.is_empty() && solver.plastic_links.is_empty(),
            Effect::Grippers => solver.anchors.is_empty(),
            Effect::Track => solver.targets.as_ref().is_none_or(|targets| targets.count == 0),
            Effect::Table => !table_awake,
            Effect::SelfContact => !contact_awake,
            _ => false,
        };
        report.slept = self.params.effects.iter().copied().filter(|effect| idle(*effect)).collect();
        Rates {
            dt_s,
            keep: (-drag_per_s * dt_s).exp(),
            way_max_m: acceleration_max * dt_s * dt_s,
            strain_max: self.params.track.strain_max as f32,
            grip: self.params.grippers.strength as f32,
            grip_strain_max: self.params.grippers.strain_max as f32,
            gamma_max,
            table_m,
            inertia: true,
            table_awake,
            contact_awake,
        }
    }

    /// γ above which the paper's damping diverges: ½ + 2α̃m of the stiffest link.
    fn gamma_max(&self, dt_s: f32) -> f32 {
        let alphas = self.solver.colours.iter().map(|c| self.solver.alpha(c.effect, dt_s));
        0.5 + 2.0 * alphas.fold(f32::INFINITY, f32::min).min(1e6)
    }

    /// Shares of the way to the targets in a substep of this length.
    fn set_ratios(&mut self, dt_s: f32) {
        let Some(targets) = &mut self.solver.targets else { return };
        let omega_dt = std::f32::consts::TAU * self.params.track.frequency_hz as f32 * dt_s;
        let Targets { confidence, ratio, .. } = targets;
        for (ratio, confidence) in ratio.rows_mut().iter_mut().zip(confidence.rows()) {
            let stiffness = omega_dt * omega_dt * confidence;
            *ratio = stiffness / (1.0 + stiffness);
        }
    }
}

#[cfg(test)]
mod tests;
