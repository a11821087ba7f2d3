//! The simulator as a whole.

use super::*;
use crate::params::{AirDragParams, BendParams, DampingParams, TrackParams};

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

const HUNG: [Effect; 7] = [
    Effect::Stretch,
    Effect::Shear,
    Effect::Bend,
    Effect::Damping,
    Effect::Gravity,
    Effect::AirDrag,
    Effect::Track,
];

#[test]
fn a_sheet_hung_by_two_corners_stretches_less_with_more_substeps() {
    let mut last = f64::INFINITY;
    // design/simulate.md, fact 1, allows 6.5 and 1.9 % at 20 and 40 substeps a 1/60 s frame.
    for (substeps, strain_allowed) in [(20, 0.08), (40, 0.025)] {
        let (mut simulator, sheet) = simulator(SimulateParams {
            substeps,
            effects: HUNG.to_vec(),
            bend: BendParams { reach: 4, compliance_m_per_n: 0.0 },
            track: TrackParams { frequency_hz: 10_000.0, acceleration_max_m_per_s2: 1e6 },
            air_drag: AirDragParams { per_s: 1.0 },
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
