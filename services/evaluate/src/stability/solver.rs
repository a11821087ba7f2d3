//! Cases of the solver alone: lengths, masses, time steps, nonsense.

use super::play::{FRAME_S, distance_m, rms_m, simulator, stretch};
use super::shapes::{between, line_at, square};
use super::{Outcome, Random, outcome};
use orime_creases::Folds;
use orime_geometry::SheetGrid;
use orime_simulate::{Effect, Grip, SimulateParams, Simulator};

/// Length of these cases' frames, seconds.
const SHORT_S: f64 = 1.0 / 60.0;

/// The default parameters with these effects.
pub fn only(effects: &[Effect]) -> SimulateParams {
    SimulateParams { effects: effects.to_vec(), ..SimulateParams::default() }
}

/// The flat sheet with u = x.
pub fn flat(sheet: &SheetGrid) -> Vec<[f32; 3]> {
    sheet.uv_m().map(|[u, v]| [u as f32, v as f32, 0.0]).collect()
}

/// Frames without targets.
pub fn free(simulator: &mut Simulator, frames: usize, dt_s: f64) {
    let nodes = simulator.positions_m().len();
    let none = (vec![[0.0; 3]; nodes], vec![0.0; nodes]);
    for _ in 0..frames {
        simulator.step(dt_s, &none.0, &none.1, false);
    }
}

pub fn is_finite(simulator: &Simulator) -> bool {
    simulator.positions_m().iter().flatten().all(|c| c.is_finite())
}

const HANGING: [Effect; 5] =
    [Effect::Stretch, Effect::Shear, Effect::Bend, Effect::AirDrag, Effect::Gravity];

/// Two corners are held.
fn corners(sheet: &SheetGrid) -> Vec<f32> {
    let mut mobility = vec![1.0; sheet.len()];
    mobility[0] = 0.0;
    mobility[sheet.index(0, sheet.nodes[1] - 1)] = 0.0;
    mobility
}

/// Case 1: a sheet without compliance hangs by two corners.
pub fn hangs(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let hang = |(substeps, most): (u32, f64)| {
        let mut params = SimulateParams { substeps, substep_motion_m: 0.0, ..only(&HANGING) };
        params.bend.reach = 4;
        params.bend.compliance_m_per_n = 0.0;
        let mut simulator = simulator(&sheet, &params, None);
        simulator.set_inverse_masses(&corners(&sheet));
        free(&mut simulator, 180, SHORT_S);
        let stretch = 100.0 * stretch(&sheet, simulator.positions_m());
        let criterion = format!("stretch ≤ {most} %");
        let measured = format!("{stretch:.2} %");
        outcome(1, format!("hang, {substeps} substeps"), &criterion, measured, stretch <= most)
    };
    [(20, 8.0), (40, 2.5), (80, 0.7)].map(hang).to_vec()
}

/// Case 2: nodes on one place, and neighbours without a distance.
pub fn coincident_nodes(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let recover = |name: &str, start: Vec<[f32; 3]>| {
        let mut simulator = simulator(&sheet, &SimulateParams::default(), Some(&start));
        free(&mut simulator, 30, FRAME_S);
        let strain = strain(&sheet, simulator.positions_m());
        let measured = format!("strain {:.2} % after 1 s", 100.0 * strain);
        let passed = is_finite(&simulator) && strain < 0.01;
        outcome(2, name, "finite, every edge within 1 % after 1 s", measured, passed)
    };
    let mut pair = flat(&sheet);
    pair[312] = pair[313];
    let mut many = flat(&sheet);
    let place = many[312];
    for k in [286, 287, 288, 311, 313, 336, 337, 338] {
        many[k] = place;
    }
    vec![recover("an edge of no length", pair), recover("nine nodes on one place", many)]
}

/// Largest relative change of an edge's length.
fn strain(sheet: &SheetGrid, x_m: &[[f32; 3]]) -> f64 {
    let edges = sheet.edges().into_iter();
    let change = edges.map(|([a, b], rest_m)| {
        (distance_m(x_m[a as usize], x_m[b as usize]) / rest_m - 1.0).abs()
    });
    change.fold(0.0, f64::max)
}

/// Case 3: every other node is a million times as heavy.
pub fn mass_ratio(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let mut simulator = simulator(&sheet, &only(&HANGING), None);
    let mut mobility: Vec<f32> =
        (0..sheet.len()).map(|n| if n % 2 == 0 { 1.0 } else { 1e-6 }).collect();
    for (own, corner) in mobility.iter_mut().zip(corners(&sheet)) {
        *own *= corner;
    }
    simulator.set_inverse_masses(&mobility);
    free(&mut simulator, 120, FRAME_S);
    let far = simulator.positions_m().iter().flatten().fold(0f32, |a, c| a.max(c.abs()));
    let passed = is_finite(&simulator) && far < 1.0;
    let measured = format!("finite {}, farthest {far:.2} m", is_finite(&simulator));
    vec![outcome(3, "mass ratio 1e6", "finite, within 1 m after 4 s", measured, passed)]
}

/// Case 4: all or some masses are infinite.
pub fn infinite_masses(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let held = |name: &str, mobility: Vec<f32>| {
        let mut params = SimulateParams::default();
        params.effects.push(Effect::Gravity);
        let mut simulator = simulator(&sheet, &params, None);
        simulator.set_inverse_masses(&mobility);
        let before = simulator.positions_m().to_vec();
        let targets: Vec<[f32; 3]> = before.iter().map(|p| [p[0], p[1], 0.1]).collect();
        for _ in 0..60 {
            simulator.step(FRAME_S, &targets, &vec![1.0; sheet.len()], false);
        }
        let after = simulator.positions_m();
        let moved = (0..sheet.len()).filter(|n| {
            mobility[*n] == 0.0 && before[*n].map(f32::to_bits) != after[*n].map(f32::to_bits)
        });
        let farthest_m = moved.clone().map(|n| distance_m(before[n], after[n])).fold(0.0, f64::max);
        let moved = moved.count();
        let measured = format!("{moved} held nodes moved, at most {farthest_m:.1e} m");
        let passed = moved == 0 && is_finite(&simulator);
        outcome(4, name, "held nodes keep their bits, all finite", measured, passed)
    };
    let some = (0..sheet.len()).map(|n| if n % 7 == 0 { 0.0 } else { 1.0 }).collect();
    vec![held("all masses infinite", vec![0.0; sheet.len()]), held("some masses infinite", some)]
}

/// Kinetic energy of the motion over a frame, joules per kilogram and node.
pub fn kinetic(before: &[[f32; 3]], after: &[[f32; 3]], dt_s: f64) -> f64 {
    0.5 * (rms_m(before, after, |_| true) / dt_s).powi(2)
}

/// Case 5: one substep of 33 ms.
pub fn one_substep(seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let mut random = Random(seed);
    let params = SimulateParams {
        substeps: 1,
        substep_motion_m: 0.0,
        ..only(&[Effect::Stretch, Effect::Shear, Effect::Bend, Effect::Damping])
    };
    let mut start = flat(&sheet);
    start.iter_mut().flatten().for_each(|c| *c += 5e-4 * random.symmetric() as f32);
    let mut simulator = simulator(&sheet, &params, Some(&start));
    let mut energies = Vec::new();
    for _ in 0..300 {
        let before = simulator.positions_m().to_vec();
        free(&mut simulator, 1, FRAME_S);
        energies.push(kinetic(&before, simulator.positions_m(), FRAME_S));
    }
    let most = |part: &[f64]| part.iter().copied().fold(0.0, f64::max);
    let (first, last) = (most(&energies[..20]), most(&energies[280..]));
    let passed = is_finite(&simulator) && last <= first;
    let measured = format!("kinetic energy {first:.2e} at first, {last:.2e} J/kg at last");
    vec![outcome(5, "one substep of 33 ms", "finite, energy does not grow", measured, passed)]
}

/// Case 6: frames of very different length, and a pause.
pub fn pauses(seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let mut random = Random(seed);
    let mut simulator = simulator(&sheet, &SimulateParams::default(), None);
    let mut targets = flat(&sheet);
    targets.iter_mut().for_each(|p| p[2] += 0.01);
    let confidence = vec![1.0; sheet.len()];
    let (mut spike_m_s, mut worst_m) = (0f64, 0f64);
    for frame in 0..200 {
        let dt_s = if frame == 120 { 5.0 } else { FRAME_S * 10f64.powf(random.symmetric()) };
        let before = simulator.positions_m().to_vec();
        simulator.step(dt_s, &targets, &confidence, false);
        if frame > 60 {
            let moved = rms_m(&before, simulator.positions_m(), |_| true);
            spike_m_s = spike_m_s.max(moved / dt_s.min(0.1));
            worst_m = worst_m.max(rms_m(simulator.positions_m(), &targets, |_| true));
        }
    }
    let passed = spike_m_s < 1e-3 && worst_m < 1e-4;
    let measured = format!("{:.3} mm/s, {:.4} mm off", 1e3 * spike_m_s, 1e3 * worst_m);
    let criterion = "at rest on its targets: < 1 mm/s and < 0.1 mm throughout";
    vec![outcome(6, "dt × 0.1 … 10, a pause of 5 s", criterion, measured, passed)]
}

/// Case 8: targets, confidences and masses that are not finite.
pub fn not_finite(seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let mut random = Random(seed);
    let mut targets = flat(&sheet);
    targets.iter_mut().flatten().for_each(|c| *c += 2e-3 * random.symmetric() as f32);
    let run = |poison: bool| {
        let (mut targets, mut confidence) = (targets.clone(), vec![1.0f32; sheet.len()]);
        for (k, bad) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
            confidence[100 + k] = if poison { 1.0 } else { 0.0 };
            targets[100 + k][k] = if poison { bad } else { 0.0 };
            confidence[200 + k] = if poison { bad } else { 0.0 };
        }
        let mut simulator = simulator(&sheet, &SimulateParams::default(), None);
        let mut rejected = 0;
        let taken = poison && simulator.set_inverse_masses(&vec![f32::NAN; sheet.len()]);
        for _ in 0..10 {
            rejected = simulator.step(FRAME_S, &targets, &confidence, false).targets_rejected;
        }
        (simulator.positions_m().to_vec(), rejected, taken)
    };
    let ((poisoned, rejected, taken), (clean, ..)) = (run(true), run(false));
    let untouched = poisoned.iter().flatten().all(|c| c.is_finite())
        && rms_m(&poisoned, &clean, |_| true) < 1e-6;
    let passed = untouched && rejected == 6 && !taken;
    let measured =
        format!("{rejected} rejected, state untouched {untouched}, NaN masses taken {taken}");
    let criterion = "rejected and counted, state as without them, masses refused";
    vec![outcome(8, "NaN and infinities in targets, trust, masses", criterion, measured, passed)]
}

/// Case 9: triangles without an area, creases between them.
pub fn degenerate_triangles(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let half = line_at(&sheet, 0.5);
    let mut params = SimulateParams::default();
    params.effects.push(Effect::Crease);
    let mut line = flat(&sheet);
    line.iter_mut().for_each(|p| p[1] = 0.0);
    let mut simulator = simulator(&sheet, &params, Some(&line));
    simulator.set_folds(&Folds::from_facets(&sheet, between(&sheet, &[half], &[])));
    free(&mut simulator, 30, FRAME_S);
    let finite = is_finite(&simulator);
    let targets = flat(&sheet);
    for _ in 0..60 {
        simulator.step(FRAME_S, &targets, &vec![1.0; sheet.len()], false);
    }
    let error_m = rms_m(simulator.positions_m(), &targets, |_| true);
    let measured = format!("finite {finite}, {:.2} mm from flat targets after 2 s", 1e3 * error_m);
    let passed = finite && is_finite(&simulator) && error_m < 1e-3;
    vec![outcome(9, "all nodes on a line", "finite, and flat again within 2 s", measured, passed)]
}

/// Case 13: two grippers pull apart.
pub fn grippers_apart(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let [a, b] = sheet.size_m;
    let mut simulator = simulator(&sheet, &SimulateParams::default(), None);
    let grip = |u: f64, x: f64| Grip { uv_m: [u, b / 2.0], position_m: [x, b / 2.0, 0.0] };
    let mut worst = 0f64;
    for frame in 0..120 {
        let away = 0.05 * (f64::from(frame) / 60.0).min(1.0);
        simulator.set_grips(&[grip(0.0, -away), grip(a, a + away)]);
        free(&mut simulator, 1, FRAME_S);
        worst = worst.max(stretch(&sheet, simulator.positions_m()));
    }
    let x = simulator.positions_m();
    let mirrored = (0..25).flat_map(|i| (0..25).map(move |j| [i, j])).map(|[i, j]| {
        let (p, q) = (x[sheet.index(i, j)], x[sheet.index(24 - i, j)]);
        f64::from(p[0] + q[0]) - a
    });
    let lopsided_m = mirrored.map(f64::abs).fold(0.0, f64::max);
    let passed = is_finite(&simulator) && lopsided_m < 1e-3 && worst < 0.24;
    let measured = format!("{:.3} mm lopsided, stretch {:.1} %", 1e3 * lopsided_m, 100.0 * worst);
    let criterion =
        "symmetric within 1 mm, stretch below half of the 48 % asked for: the force is capped";
    vec![outcome(13, "grippers 100 mm too far apart", criterion, measured, passed)]
}
