//! Cases of long runs, far places, momentum, creases that hold, and results that repeat.

use super::play::{FRAME_S, Scene, params, play, rms_m, simulator};
use super::shapes::{between, halved, line_at, square};
use super::solver::{flat, free, is_finite, kinetic, only};
use super::{Outcome, outcome};
use orime_creases::Folds;
use orime_geometry::SheetGrid;
use orime_geometry::nalgebra::Vector3;
use orime_simulate::{DampingKind, Effect, SimulateParams, Simulator};
use std::time::Instant;

/// Frames of a half fold that follows its targets.
fn fold(simulator: &mut Simulator, sheet: &SheetGrid, frames: usize, shift_m: f32) {
    let trust = vec![1.0; sheet.len()];
    for frame in 0..frames {
        let mut targets = halved(sheet, 1, (frame + 1) as f64 * FRAME_S, 1.0);
        targets.iter_mut().for_each(|p| p[0] += shift_m);
        simulator.step(FRAME_S, &targets, &trust, false);
    }
}

/// Case 14: the same fold far from the origin.
pub fn far_away(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let at = |shift_m: f32| {
        let mut start = flat(&sheet);
        start.iter_mut().for_each(|p| p[0] += shift_m);
        let mut simulator = simulator(&sheet, &SimulateParams::default(), Some(&start));
        fold(&mut simulator, &sheet, 40, shift_m);
        let home = |p: &[f32; 3]| [p[0] - shift_m, p[1], p[2]];
        simulator.positions_m().iter().map(home).collect::<Vec<_>>()
    };
    let origin = at(0.0);
    let compare = |shift_m: f32| {
        let off = rms_m(&at(shift_m), &origin, |_| true) / sheet.size_m[0];
        let name = format!("{shift_m} m from the origin");
        outcome(14, name, "rms ≤ 1e-4 of the side", format!("{off:.1e} of the side"), off <= 1e-4)
    };
    vec![compare(10.0), compare(1000.0)]
}

/// Case 15: a million substeps of a swinging sheet.
pub fn long_run(_seed: u64) -> Vec<Outcome> {
    let sheet = SheetGrid::new([0.21, 0.21], [9, 9]);
    let run = |damped: bool| {
        let mut effects = vec![Effect::Stretch, Effect::Shear, Effect::Bend, Effect::Gravity];
        effects.extend(damped.then_some(Effect::AirDrag));
        let mut params = only(&effects);
        params.substep_motion_m = 0.0;
        params.stretch.compliance_m_per_n = 1e-4;
        params.shear.compliance_m_per_n = 1e-4;
        params.air_drag.per_s = 0.5;
        let mut simulator = simulator(&sheet, &params, None);
        let held = |[u, _]: [f64; 2]| if u < 1e-9 { 0.0 } else { 1.0 };
        simulator.set_inverse_masses(&sheet.uv_m().map(held).collect::<Vec<_>>());
        let mut energies = Vec::new();
        for _ in 0..50_000 {
            let before = simulator.positions_m().to_vec();
            free(&mut simulator, 1, 1.0 / 60.0);
            let after = simulator.positions_m();
            let height: f64 = before.iter().zip(after).map(|(a, b)| f64::from(a[2] + b[2])).sum();
            let potential = 9.81 * 0.5 * height / sheet.len() as f64;
            energies.push(kinetic(&before, after, 1.0 / 60.0) + potential);
        }
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        let (first, last) = (mean(&energies[..500]), mean(&energies[49_500..]));
        // The scale: what the sheet can gain by falling.
        let grown = (last - first) / (9.81 * 0.21);
        let (name, most) = if damped { ("damped", 0.0) } else { ("undamped", 0.01) };
        let criterion = if damped { "energy does not grow" } else { "energy grows < 1 %" };
        let measured =
            format!("{:+.3} % of m·g·L, finite {}", 100.0 * grown, is_finite(&simulator));
        let passed = is_finite(&simulator) && grown <= most;
        outcome(15, format!("1e6 substeps, {name}"), criterion, measured, passed)
    };
    vec![run(false), run(true)]
}

/// Linear momentum and spin about the centre, per node: m/s and m²/s.
fn momentum(before: &[[f32; 3]], after: &[[f32; 3]]) -> [Vector3<f64>; 2] {
    let points = |x: &[[f32; 3]]| -> Vec<Vector3<f64>> {
        x.iter().map(|p| Vector3::from(p.map(f64::from))).collect()
    };
    let (a, b) = (points(before), points(after));
    let count = a.len() as f64;
    let centre = |x: &[Vector3<f64>]| x.iter().sum::<Vector3<f64>>() / count;
    let (ca, cb) = (centre(&a), centre(&b));
    let linear = (cb - ca) / FRAME_S;
    let spin = a.iter().zip(&b).map(|(p, q)| ((p + q) / 2.0 - (ca + cb) / 2.0).cross(&(q - p)));
    [linear, spin.sum::<Vector3<f64>>() / (FRAME_S * count)]
}

/// Case 16: the sheet is thrown and spins, with its links damped.
pub fn free_flight(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let params =
        only(&[Effect::Stretch, Effect::Shear, Effect::Bend, Effect::Damping, Effect::Track]);
    let mut simulator = simulator(&sheet, &params, None);
    let trust = vec![1.0; sheet.len()];
    for frame in 0..30 {
        let time_s = (f64::from(frame) + 1.0) * FRAME_S;
        let (sin, cos) = (2.0 * time_s).sin_cos();
        let place = |[u, v]: [f64; 2]| {
            let (x, y) = (u - 0.105, v - 0.105);
            [x * cos - y * sin + 0.5 * time_s, x * sin + y * cos, 0.3 * time_s].map(|c| c as f32)
        };
        simulator.step(FRAME_S, &sheet.uv_m().map(place).collect::<Vec<_>>(), &trust, false);
    }
    let mut measure = || {
        let before = simulator.positions_m().to_vec();
        free(&mut simulator, 1, FRAME_S);
        momentum(&before, simulator.positions_m())
    };
    measure();
    let [linear, spin] = measure();
    let (mut drift, mut gain) = (0f64, 0f64);
    for _ in 0..100 {
        let [now, turning] = measure();
        drift = drift.max((now - linear).norm() / linear.norm());
        gain = gain.max(turning.norm() / spin.norm() - 1.0);
    }
    let passed = drift < 1e-5 && gain < 1e-3;
    let measured = format!("momentum drifts {drift:.1e}, spin grows {gain:+.1e} of themselves");
    let criterion = "momentum to 1e-5, spin never grows (1e-3)";
    vec![outcome(16, "free flight and spin, damped links", criterion, measured, passed)]
}

/// Case 17: damping from none to far beyond the limit of the paper's form.
pub fn damping(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let run = |kind: DampingKind, gamma: f64| {
        let mut params = SimulateParams { substep_motion_m: 0.0, ..SimulateParams::default() };
        params.damping.kind = kind;
        params.damping.time_s = (gamma * FRAME_S / 20.0).min(1.0);
        let Ok(config) = params.check() else { return "refused".to_owned() };
        let mut simulator = Simulator::new(&config, &sheet, super::play::DENSITY, None);
        simulator.step(FRAME_S, &flat(&sheet), &vec![1.0; sheet.len()], true);
        fold(&mut simulator, &sheet, 30, 0.0);
        let far = simulator.positions_m().iter().flatten().fold(0f32, |a, c| a.max(c.abs()));
        if is_finite(&simulator) && far < 0.5 { "stable".into() } else { format!("{far} m away") }
    };
    let each = |gamma: f64| {
        let [xpbd, paper] = [DampingKind::Xpbd, DampingKind::Paper].map(|kind| run(kind, gamma));
        let passed = xpbd == "stable" && (paper == "stable" || paper == "refused");
        let measured = format!("xpbd {xpbd}, paper {paper}");
        let criterion = "stable, or refused when the set is read";
        outcome(17, format!("damping γ = {gamma}"), criterion, measured, passed)
    };
    [0.0, 0.1, 1.0, 10.0, 100.0].map(each).to_vec()
}

/// Case 19: folded to 180° and let go.
pub fn fold_and_release(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let mut params = SimulateParams::default();
    params.effects.push(Effect::Crease);
    let mut simulator = simulator(&sheet, &params, None);
    let half = line_at(&sheet, 0.5);
    simulator.set_folds(&Folds::from_facets(&sheet, between(&sheet, &[half], &[])));
    fold(&mut simulator, &sheet, 60, 0.0);
    let angle = |s: &Simulator| s.folds().creases()[0].angle_rad.to_degrees().abs();
    let folded = angle(&simulator);
    free(&mut simulator, 100, FRAME_S);
    let released = angle(&simulator);
    free(&mut simulator, 5000, FRAME_S);
    let late = angle(&simulator);
    let passed = (released - folded).abs() <= 5.0 && (late - released).abs() < 0.5;
    let measured =
        format!("{folded:.1}° folded, {released:.1}° released, {late:.1}° 1e5 substeps later");
    let criterion = "released within 5° of the fold, then within 0.5°";
    vec![outcome(19, "fold to 180° and release", criterion, measured, passed)]
}

/// Case 21: ten runs, one after the other and at once, with contact.
pub fn threads(_seed: u64) -> Vec<Outcome> {
    let run = || {
        let sheet = square(25);
        let (half, shape) = (line_at(&sheet, 0.5), sheet.clone());
        let trust = vec![1.0; sheet.len()];
        let scene = Scene {
            facets: between(&sheet, &[half], &[]),
            thickness_m: 1e-4,
            frames: 40,
            params: params(),
            mobility: Vec::new(),
            start_m: None,
            targets: Box::new(move |frame| {
                (halved(&shape, 1, (frame + 1) as f64 * FRAME_S, 1.0), trust.clone())
            }),
            contact: Box::new(|_| true),
            ordered_frames: usize::MAX,
            sheet,
        };
        play(&scene).end_m.iter().flatten().map(|c| c.to_bits()).collect::<Vec<u32>>()
    };
    let first = run();
    let at_once: Vec<Vec<u32>> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(run)).collect();
        threads.into_iter().filter_map(|thread| thread.join().ok()).collect()
    });
    let later: Vec<Vec<u32>> = (0..5).map(|_| run()).collect();
    let equal = at_once.iter().chain(&later).filter(|bits| **bits == first).count();
    let measured = format!("{} of 10 runs equal", equal + 1);
    vec![outcome(21, "ten runs, four of them at once", "all bits equal", measured, equal == 9)]
}

/// Case 22: an effect that has nothing to do changes nothing and costs nothing.
pub fn effects_off(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let trust = vec![1.0; sheet.len()];
    let wave = |p: &[f32; 3]| [p[0], p[1], 0.02 * (40.0 * p[0]).sin()];
    let targets: Vec<[f32; 3]> = flat(&sheet).iter().map(wave).collect();
    let with = |effects: &[Effect]| {
        let mut params = only(effects);
        params.substep_motion_m = 0.0;
        params.table.height_m = -10.0;
        simulator(&sheet, &params, None)
    };
    let base = [Effect::Stretch, Effect::Shear, Effect::Bend, Effect::Track];
    let idle =
        [Effect::Crease, Effect::Table, Effect::Facets, Effect::Grippers, Effect::SelfContact];
    let each = |effect: Effect| {
        let effects: Vec<Effect> = base.iter().copied().chain([effect]).collect();
        // Frame by frame in turn, for what else the machine does slows both; and several of each,
        // for now and then one is slower than its like in all its frames, by up to a third.
        let mut pairs: Vec<_> = (0..6).map(|_| [with(&base), with(&effects)]).collect();
        let mut least_s = [f64::INFINITY; 2];
        for frame in 0..60usize {
            // Targets that move keep the sheet awake.
            let shift = 1e-4 * (frame % 7) as f32;
            let moved: Vec<[f32; 3]> = targets.iter().map(|p| [p[0] + shift, p[1], p[2]]).collect();
            for pair in &mut pairs {
                for (simulator, least_s) in pair.iter_mut().zip(&mut least_s) {
                    let started = Instant::now();
                    simulator.step(FRAME_S, &moved, &trust, false);
                    *least_s = least_s.min(started.elapsed().as_secs_f64());
                }
            }
        }
        let equal = pairs.iter().all(|[base, with]| base.positions_m() == with.positions_m());
        let ratio = least_s[1] / least_s[0];
        let measured = format!("bits equal {equal}, cost × {ratio:.2}");
        let criterion = "bits equal to the scene without it, cost within 10 % (least of 360)";
        let passed = equal && ratio < 1.1;
        outcome(22, format!("`{}` idle", effect.name()), criterion, measured, passed)
    };
    idle.map(each).to_vec()
}
