//! The hard cases of `../shared/design/simulate.md`, by their numbers there.

use orime_creases::{Folds, Line};
use orime_geometry::SheetGrid;
use orime_simulate::{
    AirDragParams, BendParams, CreaseKind, CreaseParams, DampingKind, DampingParams, Effect,
    SimulateParams, Simulator, TableParams, TrackParams,
};

const FRAME_S: f64 = 1.0 / 30.0;

fn sheet() -> SheetGrid {
    SheetGrid::new([0.15; 2], [25, 25])
}

fn simulator(params: &SimulateParams) -> Simulator {
    Simulator::new(&params.check().unwrap(), &sheet(), 0.08, None)
}

fn with(effects: &[Effect]) -> SimulateParams {
    SimulateParams { effects: effects.to_vec(), ..SimulateParams::default() }
}

const LINKS: [Effect; 3] = [Effect::Stretch, Effect::Shear, Effect::Bend];

fn free() -> Vec<f32> {
    vec![0.0; sheet().len()]
}

fn all_finite(simulator: &Simulator) -> bool {
    simulator.positions_m().iter().flatten().all(|c| c.is_finite())
}

fn apart_m(a: &[f32; 3], b: &[f32; 3]) -> f64 {
    (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

fn strain_max(x: &[[f32; 3]]) -> f64 {
    let strain = |([a, b], rest): ([u32; 2], f64)| {
        (apart_m(&x[a as usize], &x[b as usize]) / rest - 1.0).abs()
    };
    sheet().edges().into_iter().map(strain).fold(0.0, f64::max)
}

fn middle_m(x: &[[f32; 3]]) -> [f64; 3] {
    [0, 1, 2].map(|k| x.iter().map(|x| f64::from(x[k])).sum::<f64>() / x.len() as f64)
}

#[test]
fn case_2_nodes_in_one_place_part_again() {
    let mut simulator = simulator(&with(&[LINKS.as_slice(), &[Effect::AirDrag]].concat()));
    let mut pose = sheet().flat_m();
    for n in [301, 325, 326] {
        pose[n] = pose[300];
    }
    simulator.step(FRAME_S, &pose, &free(), true);
    for _ in 0..30 {
        simulator.step(FRAME_S, &pose, &free(), false);
        assert!(all_finite(&simulator));
    }
    assert!(strain_max(simulator.positions_m()) < 0.05);
}

#[test]
fn case_3_masses_may_differ_a_millionfold() {
    let mut params = with(&[LINKS.as_slice(), &[Effect::Gravity, Effect::AirDrag]].concat());
    params.bend = BendParams { reach: 4, compliance_m_per_n: 0.0, ..BendParams::default() };
    let mut simulator = simulator(&params);
    let mut masses: Vec<f32> = (0..sheet().len()).map(|n| [1.0, 1e-6][n % 2]).collect();
    (masses[0], masses[24]) = (0.0, 0.0);
    assert!(simulator.set_inverse_masses(&masses));
    for _ in 0..60 {
        simulator.step(1.0 / 60.0, &sheet().flat_m(), &free(), false);
        let reach = simulator.positions_m().iter().flatten().fold(0f32, |a, b| a.max(b.abs()));
        assert!(all_finite(&simulator) && reach < 1.0, "{reach} m");
    }
}

#[test]
fn case_4_what_is_pinned_stays_to_the_bit() {
    let mut params = SimulateParams::default();
    params.effects.push(Effect::Gravity);
    let mut simulator = simulator(&params);
    let mut folds = Folds::flat(&sheet());
    folds.split(0, &Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
    simulator.set_folds(&folds);
    let start: Vec<[f32; 3]> =
        sheet().flat_m().iter().map(|x| [x[0] + 0.31, x[1] - 0.2, x[2] + 0.7]).collect();
    simulator.step(FRAME_S, &start, &free(), true);
    let masses: Vec<f32> = (0..sheet().len()).map(|n| f32::from(u8::from(n % 3 != 0))).collect();
    assert!(simulator.set_inverse_masses(&masses));
    let pulled: Vec<[f32; 3]> = start.iter().map(|x| [x[0], x[1] + 0.01, x[2] + 0.02]).collect();
    for _ in 0..20 {
        simulator.step(FRAME_S, &pulled, &vec![1.0; sheet().len()], false);
    }
    let moved = |n: usize| apart_m(&simulator.positions_m()[n], &start[n]);
    assert!((0..sheet().len()).step_by(3).all(|n| moved(n) == 0.0));
    assert!(moved(1) > 1e-4, "the others move");
    assert!(simulator.set_inverse_masses(&free()));
    let before = simulator.positions_m().to_vec();
    simulator.step(FRAME_S, &pulled, &vec![1.0; sheet().len()], false);
    assert_eq!(simulator.positions_m(), before);
}

/// A sheet pinned by two corners, in frames of these lengths: its greatest reach and speed in the
/// first and in the second half.
fn hung_in(substeps: u32, frames_s: impl Iterator<Item = f64>) -> [[f64; 2]; 2] {
    let mut params = with(&[LINKS.as_slice(), &[Effect::Gravity, Effect::AirDrag]].concat());
    params.substeps = substeps;
    let mut simulator = simulator(&params);
    let mut masses = vec![1.0; sheet().len()];
    (masses[0], masses[24]) = (0.0, 0.0);
    assert!(simulator.set_inverse_masses(&masses));
    let mut before = simulator.positions_m().to_vec();
    let mut halves = [[0f64; 2]; 2];
    for (frame, dt_s) in frames_s.take(180).enumerate() {
        simulator.step(dt_s, &before, &free(), false);
        let way = simulator.positions_m().iter().zip(&before).map(|(a, b)| apart_m(a, b));
        let speed = way.fold(0.0, f64::max) / dt_s.clamp(1e-4, 0.1);
        before = simulator.positions_m().to_vec();
        let reach = before.iter().map(|x| apart_m(x, &[0.0; 3])).fold(0.0, f64::max);
        let half = &mut halves[frame / 90];
        *half = [half[0].max(reach), half[1].max(speed)];
    }
    halves
}

#[test]
fn case_5_one_substep_a_frame_stays_bounded() {
    let [[reach_m, speed], [reach_later_m, speed_later]] = hung_in(1, std::iter::repeat(FRAME_S));
    assert!(reach_m < 10.0 && reach_later_m <= 1.05 * reach_m, "{reach_m} {reach_later_m} m");
    assert!(speed_later <= 1.05 * speed, "{speed} {speed_later} m/s");
}

#[test]
fn case_6_uneven_frames_and_pauses_make_no_spikes() {
    let frames = [1.0, 0.1, 10.0, 3.0, 0.1, 0.1, 7.0, 150.0, 1.0].map(|times| times * FRAME_S);
    let halves = hung_in(20, frames.into_iter().cycle());
    // A fall by the sheet's length reaches 1.7 m/s.
    for [reach_m, speed] in halves {
        assert!(reach_m < 0.5 && speed < 6.0, "{reach_m} m, {speed} m/s");
    }
}

#[test]
fn case_8_nonsense_is_refused() {
    let mut simulator = simulator(&SimulateParams::default());
    let mut masses = vec![1.0; sheet().len()];
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        masses[3] = bad;
        assert!(!simulator.set_inverse_masses(&masses));
    }
    assert!(!simulator.set_inverse_masses(&[1.0]));
    let mut targets = sheet().flat_m();
    targets[5][1] = f32::NEG_INFINITY;
    let report = simulator.step(FRAME_S, &targets, &vec![1.0; sheet().len()], false);
    assert_eq!(report.targets_rejected, 1);
    assert!(all_finite(&simulator));
}

#[test]
fn case_14_far_from_the_origin_is_as_near_it() {
    let run = |offset_m: [f32; 3]| {
        let mut params = SimulateParams::default();
        params.effects.push(Effect::Gravity);
        let mut simulator = simulator(&params);
        let moved = |rise: f32| -> Vec<[f32; 3]> {
            let place = |x: &[f32; 3]| {
                let lift = rise * (20.0 * x[0]).cos();
                [x[0] + offset_m[0], x[1] + offset_m[1], x[2] + lift + offset_m[2]]
            };
            sheet().flat_m().iter().map(place).collect()
        };
        simulator.step(FRAME_S, &moved(0.0), &free(), true);
        for _ in 0..20 {
            simulator.step(FRAME_S, &moved(0.01), &vec![0.7; sheet().len()], false);
        }
        let middle = middle_m(simulator.positions_m());
        let local = |x: &[f32; 3]| [0, 1, 2].map(|k| (f64::from(x[k]) - middle[k]) as f32);
        simulator.positions_m().iter().map(local).collect::<Vec<_>>()
    };
    let near = run([0.0; 3]);
    // One f32 step at 10 m is 1 µm, at 1 km 61 µm: targets and positions carry it.
    for (offset_m, allowed_m) in [([6.0, -6.0, 5.0], 1.5e-5), ([1000.0, 0.0, 0.0], 2e-4)] {
        let far = run(offset_m);
        let worst = near.iter().zip(&far).map(|(a, b)| apart_m(a, b)).fold(0.0, f64::max);
        assert!(worst < allowed_m, "{offset_m:?}: {worst} m");
    }
}

/// Σ squared way of a frame over nodes, in the first and last hundred of `frames`, m².
fn unrest_m2(effects: &[Effect], frames: usize) -> [f64; 2] {
    let grid = SheetGrid::new([0.05; 2], [7, 7]);
    let mut params = with(effects);
    params.stretch.compliance_m_per_n = 1.0;
    params.shear.compliance_m_per_n = 1.0;
    let mut simulator = Simulator::new(&params.check().unwrap(), &grid, 0.08, None);
    let wavy: Vec<[f32; 3]> =
        grid.flat_m().iter().map(|x| [x[0] * 1.02, x[1], 0.003 * (90.0 * x[0]).sin()]).collect();
    let none = vec![0.0; grid.len()];
    simulator.step(FRAME_S, &wavy, &none, true);
    let mut before = simulator.positions_m().to_vec();
    let mut unrest = [0.0; 2];
    for frame in 0..frames {
        simulator.step(FRAME_S, &wavy, &none, false);
        let now = simulator.positions_m();
        let squared: f64 = now.iter().zip(&before).map(|(a, b)| apart_m(a, b).powi(2)).sum();
        if frame < 100 {
            unrest[0] += squared;
        } else if frame >= frames - 100 {
            unrest[1] += squared;
        }
        before = now.to_vec();
    }
    unrest
}

#[test]
fn a_sheet_that_travels_keeps_its_digits() {
    let mut params = with(&[LINKS.as_slice(), &[Effect::Gravity]].concat());
    params.gravity.acceleration_m_per_s2 = 1.0;
    let mut simulator = simulator(&params);
    for _ in 0..300 {
        simulator.step(FRAME_S, &sheet().flat_m(), &free(), false);
    }
    // Ten seconds: 50 m further down the links are as long as they were, to f32 at 50 m.
    assert!((middle_m(simulator.positions_m())[2] + 50.0).abs() < 0.1);
    let flat = |x: &[f32; 3]| [x[0], x[1], 0.0];
    let shape: Vec<[f32; 3]> = simulator.positions_m().iter().map(flat).collect();
    let worst = shape.iter().zip(sheet().flat_m()).map(|(a, b)| apart_m(a, &b));
    assert!(worst.fold(0.0, f64::max) < 1e-5);
}

#[test]
fn case_15_a_million_substeps_gain_no_energy() {
    let [early, late] = unrest_m2(&LINKS, 50_000);
    assert!(early > 1e-5 && late < 1.01 * early, "undamped: {early} m², then {late} m²");
    let [early, late] = unrest_m2(&[LINKS.as_slice(), &[Effect::Damping]].concat(), 50_000);
    // What is left is the turning of the sheet as a whole.
    assert!(late < 0.2 * early, "damped: {early} m², then {late} m²");
}

/// A flying and spinning sheet, seconds after some start.
fn spinning(t_s: f64) -> Vec<[f32; 3]> {
    let (sine, cosine) = (3.0 * t_s).sin_cos();
    let place = |x: &[f32; 3]| {
        let (x, y) = (f64::from(x[0]), f64::from(x[1]));
        [x * cosine - y * sine + 0.2 * t_s, x * sine + y * cosine - 0.1 * t_s, 0.1 * t_s]
            .map(|c| c as f32)
    };
    sheet().flat_m().iter().map(place).collect()
}

/// Σ (x − x̄) × way about z.
fn spin(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let (middle_a, middle_b) = (middle_m(a), middle_m(b));
    let each = |(a, b): (&[f32; 3], &[f32; 3])| {
        let [x, y] = [0, 1].map(|k| f64::from(a[k]) - middle_a[k]);
        let [u, v] = [0, 1].map(|k| f64::from(b[k]) - middle_b[k]);
        x * (v - y) - y * (u - x)
    };
    a.iter().zip(b).map(each).sum()
}

#[test]
fn case_16_free_flight_and_spin_are_free() {
    let mut params = with(&[LINKS.as_slice(), &[Effect::Damping, Effect::Track]].concat());
    params.damping = DampingParams { kind: DampingKind::Xpbd, time_s: 0.01 };
    params.track =
        TrackParams { frequency_hz: 6.0, acceleration_max_m_per_s2: 1e6, ..TrackParams::default() };
    let mut simulator = simulator(&params);
    simulator.step(FRAME_S, &spinning(0.0), &free(), true);
    for frame in 1..=30 {
        let sure = vec![1.0; sheet().len()];
        simulator.step(FRAME_S, &spinning(FRAME_S * f64::from(frame)), &sure, false);
    }
    let mut poses = vec![simulator.positions_m().to_vec()];
    for _ in 0..60 {
        simulator.step(FRAME_S, &spinning(0.0), &free(), false);
        poses.push(simulator.positions_m().to_vec());
    }
    let way = |from: usize, to: usize| {
        let (a, b) = (middle_m(&poses[from]), middle_m(&poses[to]));
        [0, 1, 2].map(|k| (b[k] - a[k]) / (to - from) as f64)
    };
    let (first, last) = (way(0, 30), way(30, 60));
    let speed = (0..3).map(|k| first[k].powi(2)).sum::<f64>().sqrt();
    assert!(speed > 1e-3, "it flies: {speed} m a frame");
    // 5e-5 m/s in a second: f32 positions round every move of every link, which adds up at random.
    let allowed_m = 5e-5 * FRAME_S;
    assert!((0..3).all(|k| (first[k] - last[k]).abs() < allowed_m), "{first:?} {last:?}");
    let (early, late) = (spin(&poses[0], &poses[1]), spin(&poses[59], &poses[60]));
    assert!(early > 1e-3 && late < 1.001 * early && late > 0.9 * early, "{early} {late}");
}

#[test]
fn case_17_any_damping_is_stable() {
    for time_s in [0.0, 1e-4, 1e-3, 0.01, 0.1, 1.0] {
        let mut params = SimulateParams::default();
        params.damping.time_s = time_s;
        params.effects.push(Effect::Gravity);
        let mut simulator = simulator(&params);
        let bow: Vec<[f32; 3]> = sheet()
            .flat_m()
            .iter()
            .map(|x| [x[0] * 0.9, x[1], 0.02 * (20.0 * x[0]).cos()])
            .collect();
        for _ in 0..60 {
            simulator.step(FRAME_S, &bow, &vec![1.0; sheet().len()], false);
        }
        let worst = simulator.positions_m().iter().zip(&bow).map(|(a, b)| apart_m(a, b));
        assert!(worst.fold(0.0, f64::max) < 0.03, "{time_s} s");
    }
}

#[test]
fn the_paper_s_damping_slows_free_flight_and_ours_does_not() {
    let kept = |kind: DampingKind| {
        let mut params = with(&[LINKS.as_slice(), &[Effect::Damping, Effect::Gravity]].concat());
        params.damping = DampingParams { kind, time_s: 2e-5 };
        let mut simulator = simulator(&params);
        for _ in 0..15 {
            simulator.step(FRAME_S, &sheet().flat_m(), &free(), false);
        }
        // A free fall of half a second, upright to none of the links: tilted.
        middle_m(simulator.positions_m())[2]
    };
    let tilted = |kind: DampingKind| {
        let mut params = with(&[LINKS.as_slice(), &[Effect::Damping, Effect::Gravity]].concat());
        params.damping = DampingParams { kind, time_s: 2e-5 };
        let mut simulator = simulator(&params);
        let upright: Vec<[f32; 3]> = sheet().flat_m().iter().map(|x| [0.0, x[0], x[1]]).collect();
        simulator.step(FRAME_S, &upright, &free(), true);
        for _ in 0..15 {
            simulator.step(FRAME_S, &upright, &free(), false);
        }
        middle_m(simulator.positions_m())[2]
    };
    // 15 frames: half a second, 1.23 m of free fall.
    let fall_m = -0.5 * 9.81 * 0.25;
    assert!((kept(DampingKind::Xpbd) / fall_m - 1.0).abs() < 0.01);
    assert!((tilted(DampingKind::Xpbd) / fall_m - 1.0).abs() < 0.01);
    assert!(tilted(DampingKind::Paper) / fall_m < 0.9, "{}", tilted(DampingKind::Paper));
}

fn folded(angle_rad: f64) -> Vec<[f32; 3]> {
    let fold = |[u, v]: [f64; 2]| {
        let over = (u - 0.075).max(0.0);
        let x = u.min(0.075) + over * angle_rad.cos();
        [x as f32, v as f32, (over * angle_rad.sin()) as f32]
    };
    sheet().uv_m().map(fold).collect()
}

/// Folds to `angle_deg` in two seconds, lets go, and returns the angle a second later and after
/// `later` more frames, degrees.
fn fold_and_release(params: &SimulateParams, angle_deg: f64, later: usize) -> [f64; 2] {
    let mut simulator = simulator(params);
    let mut folds = Folds::flat(&sheet());
    folds.split(0, &Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
    simulator.set_folds(&folds);
    simulator.step(FRAME_S, &folded(0.0), &free(), true);
    for frame in 1..=60 {
        let angle_rad = (angle_deg / 60.0 * f64::from(frame)).to_radians();
        simulator.step(FRAME_S, &folded(angle_rad), &vec![1.0; sheet().len()], false);
    }
    let degrees =
        |simulator: &Simulator| simulator.folds().creases()[0].angle_rad.abs().to_degrees();
    for _ in 0..30 {
        simulator.step(FRAME_S, &folded(0.0), &free(), false);
    }
    let soon = degrees(&simulator);
    for _ in 0..later {
        simulator.step(FRAME_S, &folded(0.0), &free(), false);
    }
    [soon, degrees(&simulator)]
}

#[test]
fn case_19_a_crease_stays_folded_when_released() {
    let mut params = SimulateParams::default();
    params.effects.push(Effect::Crease);
    // 5000 frames of 20 substeps are 1e5.
    let [soon, later] = fold_and_release(&params, 180.0, 5000);
    assert!((soon - 180.0).abs() < 5.0 && (later - soon).abs() < 0.5, "{soon}°, then {later}°");
    // A crease that cannot yield springs back: the test can fail.
    params.crease.yield_rad = 3.5;
    let [soon, _] = fold_and_release(&params, 180.0, 30);
    assert!(soon < 90.0, "{soon}°");
}

#[test]
fn the_paper_s_plasticity_keeps_a_fold_and_elastic_links_do_not() {
    let kept = |kind: CreaseKind, yield_strain: f64| {
        let crease = CreaseParams { kind, yield_strain, ..Default::default() };
        let mut params = SimulateParams { crease, ..SimulateParams::default() };
        params.bend = BendParams { reach: 4, compliance_m_per_n: 0.01, ..BendParams::default() };
        params.air_drag.per_s = 1.0;
        params.effects.retain(|effect| *effect != Effect::Facets);
        params.effects.push(Effect::Crease);
        fold_and_release(&params, 120.0, 300)[1]
    };
    for kind in [CreaseKind::Paper, CreaseKind::Everywhere] {
        let (soft, hard) = (kept(kind, 0.02), kept(kind, 1.0));
        // At 180° a skip link has no length and no direction left: hence not further than 120°.
        assert!(soft > 70.0 && hard < 20.0, "{kind:?}: {soft}° plastic, {hard}° elastic");
    }
}

#[test]
fn case_20_a_sheet_slammed_on_a_table_does_not_go_through() {
    let mut params = with(&[LINKS.as_slice(), &[Effect::Gravity, Effect::Table]].concat());
    params.table = TableParams { friction: 0.3, ..TableParams::default() };
    // 12.8 m/s² more than gravity would give over 1 m: 5 m/s at the table.
    params.gravity.acceleration_m_per_s2 = 12.5;
    let mut simulator = simulator(&params);
    let high: Vec<[f32; 3]> =
        sheet().flat_m().iter().map(|x| [x[0], 0.8 * x[1], 1.0 + 0.6 * x[1].abs()]).collect();
    simulator.step(FRAME_S, &high, &free(), true);
    let mut slept = 0;
    for _ in 0..60 {
        let report = simulator.step(FRAME_S, &high, &free(), false);
        slept += u32::from(report.slept.contains(Effect::Table));
        let lowest = simulator.positions_m().iter().map(|x| x[2]).fold(f32::INFINITY, f32::min);
        assert!(lowest >= -1e-7, "{lowest} m");
        assert!(all_finite(&simulator));
    }
    assert!((5..15).contains(&slept), "the table slept {slept} frames of the fall");
}

#[test]
fn case_21_ten_runs_are_one() {
    let run = || {
        let mut params = SimulateParams::default();
        params.effects.extend([Effect::Crease, Effect::Table, Effect::Gravity]);
        let mut simulator = simulator(&params);
        let mut folds = Folds::flat(&sheet());
        folds.split(0, &Line::through([0.08, 0.0], [0.06, 0.15])).unwrap();
        simulator.set_folds(&folds);
        for frame in 0..20 {
            let target = folded(0.03 * f64::from(frame));
            simulator.step(FRAME_S, &target, &vec![0.9; sheet().len()], false);
        }
        simulator.positions_m().to_vec()
    };
    let first = run();
    assert!((0..9).all(|_| run() == first));
}

#[test]
fn case_22_an_effect_that_is_off_changes_no_bit() {
    let targets = folded(0.4);
    let run = |params: &SimulateParams| {
        let mut simulator = simulator(params);
        simulator.step(FRAME_S, &folded(0.0), &free(), true);
        for _ in 0..10 {
            simulator.step(FRAME_S, &targets, &vec![0.8; sheet().len()], false);
        }
        simulator.positions_m().to_vec()
    };
    let base = with(&[LINKS.as_slice(), &[Effect::Track]].concat());
    let expected = run(&base);
    for effect in Effect::ALL.into_iter().filter(|effect| !base.effects.contains(effect)) {
        let mut params = base.clone();
        params.effects.push(effect);
        params.gravity.acceleration_m_per_s2 = 0.0;
        params.air_drag = AirDragParams { per_s: 0.0 };
        params.damping.time_s = 0.0;
        params.table.height_m = -1.0;
        assert_eq!(run(&params), expected, "{effect:?} is named and idle");
        params.gravity.acceleration_m_per_s2 = 9.0;
        params.air_drag.per_s = 5.0;
        params.damping.time_s = 0.001;
        params.table.height_m = 0.001;
        let awake = [Effect::Gravity, Effect::AirDrag, Effect::Damping, Effect::Table];
        assert_eq!(run(&params) != expected, awake.contains(&effect), "{effect:?} awake");
    }
}

#[test]
fn a_sheet_at_rest_sleeps_until_something_pulls() {
    let mut params = SimulateParams::default();
    params.effects.extend([Effect::Table, Effect::Gravity]);
    let mut simulator = simulator(&params);
    let start: Vec<[f32; 3]> = sheet().flat_m().iter().map(|x| [x[0], x[1], 0.01]).collect();
    simulator.step(FRAME_S, &start, &free(), true);
    let mut slept_at = None;
    for frame in 0..100 {
        let report = simulator.step(FRAME_S, &start, &free(), false);
        if report.substeps == 0 && slept_at.is_none() {
            slept_at = Some(frame);
            assert!(params.effects.iter().all(|effect| report.slept.contains(*effect)));
        }
    }
    assert!(slept_at.is_some_and(|frame| (5..80).contains(&frame)), "{slept_at:?}");
    let before = simulator.positions_m().to_vec();
    let report = simulator.step(FRAME_S, &start, &vec![1.0; sheet().len()], false);
    assert!(report.substeps > 0 && simulator.positions_m() != before, "it wakes");
}
