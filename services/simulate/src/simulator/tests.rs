//! The simulator as a whole.

use super::*;
use crate::params::{AirDragParams, BendParams, DampingParams};

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

const HUNG: [Effect; 5] =
    [Effect::Stretch, Effect::Shear, Effect::Bend, Effect::Gravity, Effect::AirDrag];

/// Largest stretch in motion, and when settled, of an inextensible sheet pinned by two corners.
fn hung(substeps: u32) -> [f64; 2] {
    let params = SimulateParams {
        substeps,
        effects: HUNG.to_vec(),
        bend: BendParams { reach: 4, compliance_m_per_n: 0.0, ..BendParams::default() },
        air_drag: AirDragParams { per_s: 3.0 },
        ..SimulateParams::default()
    };
    let sheet = SheetGrid::new([0.21, 0.21], [25, 25]);
    let mut simulator = Simulator::new(&params.check().unwrap(), &sheet, 0.08, None);
    let mut masses = vec![1.0; sheet.len()];
    (masses[0], masses[24]) = (0.0, 0.0);
    assert!(simulator.set_inverse_masses(&masses));
    let (start, free) = (sheet.flat_m(), vec![0.0; sheet.len()]);
    let mut worst: f64 = 0.0;
    for _ in 0..300 {
        simulator.step(1.0 / 60.0, &start, &free, false);
        worst = worst.max(strain_max(simulator.positions_m(), &sheet));
    }
    assert_eq!(simulator.positions_m()[0], start[0], "pinned");
    assert_eq!(simulator.positions_m()[24], start[24], "pinned");
    [worst, strain_max(simulator.positions_m(), &sheet)]
}

#[test]
fn a_hung_sheet_stretches_less_with_more_substeps() {
    // Settled: design/simulate.md, fact 1. In motion: its hard case 1.
    let rows =
        [(5, 63.0, 100.0), (10, 17.0, 30.0), (20, 6.5, 8.0), (40, 1.9, 2.5), (80, 0.48, 0.7)];
    let mut last = f64::INFINITY;
    for (substeps, settled_max, moving_max) in rows {
        let [moving, settled] = hung(substeps).map(|strain| 100.0 * strain);
        assert!(
            settled < settled_max && moving < moving_max && settled < last,
            "{substeps} substeps: {settled} % settled, {moving} % in motion"
        );
        last = settled;
    }
}

#[test]
fn damping_takes_no_momentum_from_free_flight() {
    let (mut simulator, sheet) = simulator(SimulateParams {
        air_drag: AirDragParams { per_s: 0.0 },
        damping: DampingParams { time_s: 0.01, ..DampingParams::default() },
        ..SimulateParams::default()
    });
    for (v, speed) in simulator.solver.v.iter_mut().zip([0.3, -0.1, 0.2]) {
        v.rows_mut().fill(speed);
    }
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
    let pose: Vec<[f32; 3]> = sheet.flat_m().iter().map(|p| [p[0] + 1000.0, p[1], p[2]]).collect();
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

#[test]
fn every_width_of_vectors_gives_the_same_bits() {
    use orime_lanes::Width;
    let run = |width: Width| {
        let mut params = SimulateParams::default();
        params.effects.extend([Effect::Crease, Effect::Table, Effect::Gravity]);
        params.table.height_m = -0.002;
        let (mut simulator, sheet) = simulator(params);
        simulator.solver.width = width;
        let mut folds = Folds::flat(&sheet);
        let line = orime_creases::Line::through([0.08, 0.0], [0.06, 0.15]);
        folds.split(0, &line).unwrap();
        simulator.set_folds(&folds);
        for frame in 0..10 {
            let bend = 0.3 * frame as f32;
            let target: Vec<[f32; 3]> =
                sheet.flat_m().iter().map(|x| [x[0], x[1], bend * x[0].max(0.0)]).collect();
            simulator.step(1.0 / 30.0, &target, &vec![0.9; sheet.len()], false);
        }
        simulator.positions_m().to_vec()
    };
    let portable = run(Width::Portable);
    for width in Width::available() {
        assert_eq!(run(width), portable, "{width:?}");
    }
}

#[test]
fn a_refused_substep_leaves_the_sheet_at_rest_where_it_was() {
    let (mut simulator, sheet) = simulator(SimulateParams::default());
    let bent: Vec<[f32; 3]> =
        sheet.flat_m().iter().map(|p| [p[0], p[1], 5.0 * p[0] * p[0]]).collect();
    let trust = vec![1.0; sheet.len()];
    let step = |simulator: &mut Simulator, from: u32| {
        let mut passes = 0;
        let mut contact = |pass: ContactPass<'_>| {
            passes += 1;
            *pass.holds = passes < from;
        };
        let pulls = Pulls { targets_m: &bent, confidence: &trust };
        let mut taking = Taking { contact: Some(&mut contact), watch: None };
        simulator.step_with(1.0 / 30.0, pulls, false, &mut taking)
    };
    let free = step(&mut simulator, u32::MAX);
    assert!(free.refused == 0 && free.substeps >= 20, "{free:?}");
    let before = simulator.positions_m().to_vec();
    // Three in a row end the frame.
    let report = step(&mut simulator, 1);
    assert_eq!((report.refused, report.substeps), (3, 3));
    assert_eq!(simulator.positions_m(), before);
    assert!(simulator.solver.v.iter().all(|v| v.rows().iter().all(|v| *v == 0.0)));
    let report = step(&mut simulator, 5);
    assert_eq!((report.refused, report.substeps), (3, 7));
    assert!(simulator.positions_m() != before, "four were made");
}

#[test]
fn what_a_correction_strains_is_no_motion() {
    let (mut simulator, sheet) = simulator(SimulateParams::default());
    let (flat, free) = (sheet.flat_m(), vec![0.0; sheet.len()]);
    simulator.step(1.0 / 30.0, &flat, &free, true);
    let mut pulled = flat.clone();
    // A corner and an edge, as contact moves them.
    for node in [0, 1, 25, 299, 300, 301] {
        pulled[node][2] += 0.012;
    }
    simulator.correct(&pulled);
    let before = simulator.positions_m().to_vec();
    let mut moved_m: f32 = 0.0;
    for _ in 0..4 {
        simulator.step(1.0 / 30.0, &flat, &free, false);
        let nodes = simulator.positions_m().iter().zip(&before).enumerate();
        let others = nodes.filter(|(node, _)| flat[*node] == pulled[*node]);
        let way = |(a, b): (&[f32; 3], &[f32; 3])| {
            (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>().sqrt()
        };
        let sum_m: f32 = others.map(|(_, pair)| way(pair)).sum();
        moved_m = moved_m.max(sum_m / sheet.len() as f32);
    }
    // Without that it is 0.44 mm.
    assert!(moved_m < 2.5e-4, "the rest moves by {moved_m} m");
}
