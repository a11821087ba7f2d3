//! Plays a scene of targets through the simulator, with contact or without.

use crate::scores::folded::self_intersections;
use orime_contact::{ContactParams, SelfContact};
use orime_creases::{Facet, Folds};
use orime_geometry::SheetGrid;
use orime_geometry::nalgebra::Point3;
use orime_simulate::{ContactPass, Effect, Pulls, SimulateParams, Simulator, Taking};
use std::time::Instant;

/// Length of a frame, seconds.
pub const FRAME_S: f64 = 1.0 / 30.0;
/// Times that the net is cast per frame where there are facets.
const PASSES: u32 = 5;
/// Layers farther apart than this are not asked for their order, metres.
const NEAR_M: f64 = 10e-3;
/// Mass per area, kg/m².
pub const DENSITY: f64 = 0.08;

/// Targets that pull a sheet, frame by frame.
pub struct Scene<'a> {
    pub sheet: SheetGrid,
    /// Empty for a sheet without creases.
    pub facets: Vec<Facet>,
    pub thickness_m: f64,
    pub frames: usize,
    pub params: SimulateParams,
    /// Inverse masses; empty for all alike.
    pub mobility: Vec<f32>,
    /// Where the sheet begins; flat with u = x where `None`.
    pub start_m: Option<Vec<[f32; 3]>>,
    /// Targets and confidences of a frame.
    #[expect(clippy::type_complexity, reason = "one closure, written out once")]
    pub targets: Box<dyn Fn(usize) -> (Vec<[f32; 3]>, Vec<f32>) + 'a>,
    /// Whether contact works in a frame.
    pub contact: Box<dyn Fn(usize) -> bool + 'a>,
    /// Frames at the start in which targets show which facet lies on which side; later ones may go
    /// through.
    pub ordered_frames: usize,
}

/// What came of it.
#[derive(Debug, Clone, Default)]
pub struct Played {
    pub frames: usize,
    /// Frames in which the sheet crosses itself.
    pub crossing: Vec<usize>,
    /// Frames in which a facet is on the wrong side of another.
    pub flipped_in: Vec<usize>,
    /// Largest elongation of an edge, in all frames and in the last.
    pub stretch: f64,
    pub stretch_end: f64,
    /// Root mean square speed in the last five frames, m/s.
    pub speed_end_m_s: f64,
    /// Root mean square distance to the targets in the last frame, metres.
    pub error_end_m: f64,
    /// Pairs of facets on the wrong side of each other in the end.
    pub flipped: usize,
    /// Substeps in which the net shortened all ways, and in which it was not armed.
    pub net_shortened: u32,
    pub net_unarmed: u32,
    /// Substeps that contact refused, and the first frame with one: there the solver says that it
    /// stops.
    pub refused: u32,
    pub stopped: Option<usize>,
    /// Milliseconds per frame, ascending.
    pub ms: Vec<f64>,
    pub end_m: Vec<[f32; 3]>,
}

impl Played {
    /// Median and maximum of the time per frame, milliseconds.
    pub fn ms(&self) -> [f64; 2] {
        let at = |k: usize| self.ms.get(k).copied().unwrap_or(f64::NAN);
        [at(self.ms.len() / 2), at(self.ms.len().saturating_sub(1))]
    }

    fn hear_refused(&mut self, frame: usize, refused: u32) {
        self.refused += refused;
        if refused > 0 {
            self.stopped.get_or_insert(frame);
        }
    }

    /// The figures of a line.
    pub fn figures(&self) -> String {
        let [p50, max] = self.ms();
        format!(
            "{}/{} frames cross (first {:?}), {} pairs flipped, stretch {:.1} % (end {:.1}), end \
             {:.2} mm/s, error {:.2} mm, net shortened {} unarmed {}, refused {} (first {:?}), \
             {p50:.1}/{max:.1} ms",
            self.crossing.len(),
            self.frames,
            self.crossing.first(),
            self.flipped,
            100.0 * self.stretch,
            100.0 * self.stretch_end,
            1e3 * self.speed_end_m_s,
            1e3 * self.error_end_m,
            self.net_shortened,
            self.net_unarmed,
            self.refused,
            self.stopped,
        )
    }
}

/// The default effects and self-contact.
pub fn params() -> SimulateParams {
    let mut params = SimulateParams::default();
    if !params.effects.contains(&Effect::SelfContact) {
        params.effects.push(Effect::SelfContact);
    }
    params
}

/// A simulator of this scene.
pub fn simulator(
    sheet: &SheetGrid,
    params: &SimulateParams,
    start_m: Option<&[[f32; 3]]>,
) -> Simulator {
    let config = params.check().expect("the suite's parameters pass");
    let mut simulator = Simulator::new(&config, sheet, DENSITY, None);
    let flat: Vec<[f32; 3]> = sheet.uv_m().map(|[u, v]| [u as f32, v as f32, 0.0]).collect();
    let start = start_m.unwrap_or(&flat);
    simulator.step(FRAME_S, start, &vec![1.0; sheet.len()], true);
    simulator
}

/// Largest elongation of an edge of the grid.
pub fn stretch(sheet: &SheetGrid, x_m: &[[f32; 3]]) -> f64 {
    let elongation = |([a, b], rest_m): ([u32; 2], f64)| {
        distance_m(x_m[a as usize], x_m[b as usize]) / rest_m - 1.0
    };
    sheet.edges().into_iter().map(elongation).fold(0.0, f64::max)
}

/// Distance of two points, metres.
pub fn distance_m(a_m: [f32; 3], b_m: [f32; 3]) -> f64 {
    (0..3).map(|k| f64::from(a_m[k] - b_m[k]).powi(2)).sum::<f64>().sqrt()
}

/// Root mean square distance of nodes that count, metres.
pub fn rms_m(a_m: &[[f32; 3]], b_m: &[[f32; 3]], counts: impl Fn(usize) -> bool) -> f64 {
    let nodes = (0..a_m.len()).filter(|n| counts(*n));
    let (sum, count) = nodes
        .fold((0.0, 0), |(sum, count), n| (sum + distance_m(a_m[n], b_m[n]).powi(2), count + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

/// Contact, simulator and, where there are creases, what the targets make of the facets.
fn set_up(scene: &Scene<'_>) -> (SelfContact, Simulator, Option<Folds>) {
    let sheet = &scene.sheet;
    let table = scene.params.effects.contains(&Effect::Table);
    // Contact works relative to the node in the middle of the pose that was taken over.
    let origin_m = scene.start_m.as_ref().map_or(0.0, |x| f64::from(x[x.len() / 2][2]));
    let table_m = table.then_some(scene.params.table.height_m - origin_m);
    let contact =
        ContactParams { thickness_m: scene.thickness_m, table_m, ..ContactParams::default() };
    let mut contact = SelfContact::new(&contact.check().expect("they pass"), sheet);
    let mut simulator = simulator(sheet, &scene.params, scene.start_m.as_deref());
    if !scene.mobility.is_empty() {
        contact.set_mobility(&scene.mobility);
        assert!(simulator.set_inverse_masses(&scene.mobility));
    }
    let wanted =
        (!scene.facets.is_empty()).then(|| Folds::from_facets(sheet, scene.facets.clone()));
    if let Some(folds) = &wanted {
        simulator.set_folds(folds);
    }
    (contact, simulator, wanted)
}

/// Plays a scene.
pub fn play(scene: &Scene<'_>) -> Played {
    let sheet = &scene.sheet;
    let (mut contact, mut simulator, mut wanted) = set_up(scene);
    let triangles = sheet.triangles();
    let (mut last_m, mut was_on) = (Vec::new(), false);
    let mut played = Played { frames: scene.frames, ..Played::default() };
    for frame in 0..scene.frames {
        let (targets_m, confidence) = (scene.targets)(frame);
        if let Some(folds) = wanted.as_mut().filter(|_| frame < scene.ordered_frames) {
            folds.observe(&targets_m);
        }
        let before = simulator.positions_m().to_vec();
        let started = Instant::now();
        let mut substep = 0u32;
        let mut pass = |pass: ContactPass<'_>| {
            // The net a few times a frame, and in its last substep; it spans what lies between.
            let substeps = (FRAME_S / pass.dt_s).round() as u32;
            if last_m.is_empty() || substep == 0 && !was_on {
                // What begins tangled is untangled by its layer order; only then the net holds it.
                last_m = pass.before_m.to_vec();
                contact.project(pass.before_m, &mut last_m, pass.folds);
            }
            substep += 1;
            let done = contact.project(pass.before_m, pass.x_m, pass.folds);
            *pass.holds = done.holds;
            if !done.holds {
                return;
            }
            // Between facets their order sees to most; a sheet of one needs the net all the time.
            let every = if pass.folds.facets().len() > 1 { (substeps / PASSES).max(1) } else { 1 };
            if !substep.is_multiple_of(every) && substep != substeps {
                return;
            }
            let net = contact.truncate(&last_m, pass.x_m, pass.folds);
            // A net that lets nobody move holds a sheet that has to rest first.
            *pass.holds = net.share > 0.0;
            last_m.copy_from_slice(pass.x_m);
            played.net_shortened += u32::from(net.share < 1.0);
            played.net_unarmed += u32::from(!net.armed);
        };
        let on = (scene.contact)(frame);
        let contact: Option<&mut dyn FnMut(ContactPass<'_>)> =
            if on { Some(&mut pass) } else { None };
        let mut taking = Taking { contact, watch: None };
        let pulls = Pulls { targets_m: &targets_m, confidence: &confidence };
        let report = simulator.step_with(FRAME_S, pulls, false, &mut taking);
        played.hear_refused(frame, report.refused);
        was_on = on;
        played.ms.push(started.elapsed().as_secs_f64() * 1e3);
        let now = simulator.positions_m();
        if self_intersections(now, &triangles) > 0 {
            played.crossing.push(frame);
        }
        if wanted.as_ref().is_some_and(|folds| flipped(folds, now) > 0) {
            played.flipped_in.push(frame);
        }
        played.stretch_end = stretch(sheet, now);
        played.stretch = played.stretch.max(played.stretch_end);
        if frame + 5 >= scene.frames {
            let speed = rms_m(&before, now, |_| true) / FRAME_S;
            played.speed_end_m_s = played.speed_end_m_s.max(speed);
        }
        played.error_end_m = rms_m(now, &targets_m, |n| confidence[n] > 0.0);
    }
    played.end_m = simulator.positions_m().to_vec();
    played.flipped = wanted.map_or(0, |folds| flipped(&folds, &played.end_m));
    played.ms.sort_by(f64::total_cmp);
    played
}

/// Pairs of facets of which the one lies on another side of the other than the targets say.
fn flipped(wanted: &Folds, x_m: &[[f32; 3]]) -> usize {
    let count = wanted.facets().len();
    let frames: Vec<_> = (0..count).map(|f| wanted.frame(f, x_m)).collect();
    let mut wrong = 0;
    for f in 0..count {
        for g in (0..count).filter(|g| *g != f) {
            let local = |n: usize| {
                let d = Point3::from(x_m[n].map(f64::from)) - frames[g].center_m;
                let [u, v] = frames[g].center_uv_m;
                ([u + d.dot(&frames[g].u), v + d.dot(&frames[g].v)], d.dot(&frames[g].normal))
            };
            let over = wanted.members(f).iter().map(|n| local(*n as usize));
            let inside = over.filter(|(uv, _)| wanted.facets()[g].inside_m(*uv) > 2e-3);
            // Over the facet as it is, not over its best plane: it may bulge by more than the gap.
            let height_m = |(uv, height_m): ([f64; 2], f64)| {
                height_m - between_nodes(wanted.sheet(), uv, |n| local(n).1)
            };
            let near = inside.map(height_m).filter(|height_m| height_m.abs() < NEAR_M);
            let (sum_m, nodes) = near.fold((0.0, 0), |(sum, n), height| (sum + height, n + 1));
            wrong += usize::from(nodes > 5 && sum_m * f64::from(wanted.order(f, g)) < 0.0);
        }
    }
    wrong
}

/// Bilinear interpolation of a value per node at a material point, which lies on the sheet.
fn between_nodes(sheet: &SheetGrid, uv_m: [f64; 2], value: impl Fn(usize) -> f64) -> f64 {
    let at = [0, 1].map(|axis| uv_m[axis] / sheet.spacing_m()[axis]);
    let [i, j] = [0, 1].map(|axis| (at[axis] as usize).min(sheet.nodes[axis] - 2));
    let [s, t] = [at[0] - i as f64, at[1] - j as f64];
    let row = |i: usize| (1.0 - t) * value(sheet.index(i, j)) + t * value(sheet.index(i, j + 1));
    (1.0 - s) * row(i) + s * row(i + 1)
}
