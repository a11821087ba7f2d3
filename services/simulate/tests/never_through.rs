//! The state never passes through itself, whatever its targets do.

use orime_contact::{ContactParams, GenericContact};
use orime_creases::CreaseMode;
use orime_geometry::SheetGrid;
use orime_origami::{Sequence, Sheet};
use orime_simulate::{Effect, SheetModel, SimulateParams};

const SIDE_M: f64 = 0.15;
const FRAME_S: f64 = 1.0 / 30.0;
/// Of the targets' waves, metres.
const WAVE_M: f64 = 1.5e-3;

/// Slow waves over the sheet, other ones in every frame.
fn wave_m(frame: u64, axis: usize, [u, v]: [f64; 2]) -> f64 {
    let phase = 2.4 * frame as f64 + 1.7 * axis as f64;
    let (a, b) = (30.0 + 11.0 * axis as f64, 47.0 - 9.0 * axis as f64);
    WAVE_M * (a * u + b * v + phase).sin() * (0.7 * phase).cos()
}

#[test]
fn targets_that_cross_make_no_state_that_does() {
    let sheet = SheetGrid::new([SIDE_M; 2], [25, 25]);
    let sequence = Sequence::square_base(Sheet { size_m: [SIDE_M; 2], thickness_m: 1e-4 }).unwrap();
    let config = SimulateParams::default().check().unwrap();
    let mut model = SheetModel::new(&config, &sheet, 0.08, None);
    let mut judge = GenericContact::new(&ContactParams::default().check().unwrap(), &sheet);
    let sure = vec![1.0; sheet.len()];
    let (mut crossing_targets, mut caught) = (0, 0);
    for frame in 0..300 {
        let pose = sequence.pose(frame as f64 / sequence.intervals() as f64);
        let place = |uv_m: [f64; 2]| {
            let p = sequence.position_m(&pose, uv_m);
            [0, 1, 2].map(|axis| (p[axis] + wave_m(frame, axis, uv_m)) as f32)
        };
        let targets: Vec<[f32; 3]> = sheet.uv_m().map(place).collect();
        let report = model.step(FRAME_S, &targets, &sure, frame == 0);
        crossing_targets += u32::from(judge.crossings(&targets) > 0);
        caught += u32::from(report.net.is_some_and(|net| net.blended > 0));
        assert!(report.net.is_none_or(|net| net.armed), "frame {frame}: {report:?}");
        assert_eq!(judge.crossings(model.positions_m()), 0, "frame {frame}: {report:?}");
    }
    assert!(model.folds().facets().len() > 3, "it was folded");
    assert!(crossing_targets > 100 && caught > 0, "{crossing_targets} crossed, {caught} caught");
}

#[test]
fn a_sheet_without_creases_does_not_pass_through_itself_either() {
    let sheet = SheetGrid::new([SIDE_M; 2], [25, 25]);
    let mut params = SimulateParams::default();
    params.folds.mode = CreaseMode::Off;
    let config = params.check().unwrap();
    let mut model = SheetModel::new(&config, &sheet, 0.08, None);
    let mut judge = GenericContact::new(&ContactParams::default().check().unwrap(), &sheet);
    let sure = vec![1.0; sheet.len()];
    // One side is rolled up, over the rest and through it.
    let rolled = |frame: u32, [u, v]: [f64; 2]| {
        let turn = 0.08 * f64::from(frame) * (u / SIDE_M).powi(2);
        let (sin, cos) = turn.sin_cos();
        [0.075 + (u - 0.075) * cos, v, (u - 0.075) * sin].map(|c| c as f32)
    };
    let (mut crossing_targets, mut caught) = (0, 0);
    for frame in 0..90 {
        let targets: Vec<[f32; 3]> = sheet.uv_m().map(|uv| rolled(frame, uv)).collect();
        let report = model.step(FRAME_S, &targets, &sure, frame == 0);
        crossing_targets += u32::from(judge.crossings(&targets) > 0);
        let is_caught = report.net.is_some_and(|net| net.blended > 0);
        caught += u32::from(is_caught);
        assert_eq!(report.slept.contains(Effect::SelfContact), !is_caught);
        assert_eq!(judge.crossings(model.positions_m()), 0, "frame {frame}: {report:?}");
    }
    assert_eq!(model.folds().facets().len(), 1);
    assert!(crossing_targets > 10 && caught > 0, "{crossing_targets} crossed, {caught} caught");
}
