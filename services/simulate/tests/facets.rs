//! Facets, creases, grippers and prediction on exactly folded sheets.

use orime_creases::{Facet, Folds};
use orime_geometry::SheetGrid;
use orime_origami::{Sequence, Sheet};
use orime_simulate::{Effect, FacetsParams, Grip, SimulateParams, Simulator, TableParams};

const SIDE_M: f64 = 0.15;
const FRAME_S: f64 = 1.0 / 30.0;

fn sheet() -> SheetGrid {
    SheetGrid::new([SIDE_M; 2], [25, 25])
}

fn square_base() -> Sequence {
    Sequence::square_base(Sheet { size_m: [SIDE_M; 2], thickness_m: 1e-4 }).unwrap()
}

/// The nodes' true places at a step of the square base.
fn truth_m(sequence: &Sequence, step: f64) -> Vec<[f32; 3]> {
    let pose = sequence.pose(step / sequence.intervals() as f64);
    let place = |uv_m| sequence.position_m(&pose, uv_m).cast::<f32>().into();
    sheet().uv_m().map(place).collect()
}

fn true_folds(sequence: &Sequence) -> Folds {
    let facet = |f: &orime_origami::Facet| Facet { corners_m: f.corners_uv_m.clone() };
    Folds::from_facets(&sheet(), sequence.facets().iter().map(facet).collect())
}

fn simulator(params: &SimulateParams) -> Simulator {
    Simulator::new(&params.check().unwrap(), &sheet(), 0.08, None)
}

fn apart_m(a: [f32; 3], b: [f32; 3]) -> f64 {
    (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

fn mean_m(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| apart_m(*a, *b)).sum::<f64>() / a.len() as f64
}

fn max_m(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| apart_m(*a, *b)).fold(0.0, f64::max)
}

/// Largest relative change of an edge's length.
fn strain_max(x: &[[f32; 3]]) -> f64 {
    let strain = |([a, b], rest): ([u32; 2], f64)| {
        (apart_m(x[a as usize], x[b as usize]) / rest - 1.0).abs()
    };
    sheet().edges().into_iter().map(strain).fold(0.0, f64::max)
}

/// Standard normal numbers, the same on every machine.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    fn add_to(&mut self, x: &[[f32; 3]], sigma_m: f64) -> Vec<[f32; 3]> {
        x.iter().map(|x| x.map(|c| c + (sigma_m * self.normal()) as f32)).collect()
    }
}

#[test]
fn a_folded_pose_is_held_by_its_true_facets_without_strain() {
    let sequence = square_base();
    let free = vec![0.0; sheet().len()];
    for step in [60.0, 160.0, 220.0, 270.0, 350.0, 500.0, 580.0] {
        let truth = truth_m(&sequence, step);
        let drift_m = |folds: Option<&Folds>| {
            let mut simulator = simulator(&SimulateParams::default());
            if let Some(folds) = folds {
                simulator.set_folds(folds);
            }
            simulator.step(FRAME_S, &truth, &free, true);
            for _ in 0..60 {
                simulator.step(FRAME_S, &truth, &free, false);
            }
            (max_m(simulator.positions_m(), &truth), strain_max(simulator.positions_m()))
        };
        let (drift, strain) = drift_m(Some(&true_folds(&sequence)));
        // The truth's layers of finite thickness strain it by up to 0.12 % themselves.
        assert!(drift < 2e-4 && strain < 2e-3, "step {step}: {drift} m, strain {strain}");
        // Without facets and creases the skip links unfold the sheet: the test can fail.
        let (drift, _) = drift_m(None);
        assert!(drift > 1e-3, "step {step}: {drift} m without facets");
    }
}

#[test]
fn noisy_targets_end_nearer_to_the_truth_with_facets() {
    let sequence = square_base();
    let sure = vec![1.0; sheet().len()];
    let folds = true_folds(&sequence);
    let (truth, mut noise) = (truth_m(&sequence, 270.0), Noise(7));
    let mut with = simulator(&SimulateParams::default());
    let mut without = simulator(&SimulateParams {
        effects: SimulateParams::default()
            .effects
            .into_iter()
            .filter(|effect| *effect != Effect::Facets)
            .collect(),
        ..SimulateParams::default()
    });
    for simulator in [&mut with, &mut without] {
        simulator.set_folds(&folds);
        simulator.step(FRAME_S, &truth, &sure, true);
    }
    let [mut error_with_m, mut error_without_m, mut error_targets_m] = [0.0; 3];
    for _ in 0..30 {
        let targets = noise.add_to(&truth, 1e-3);
        with.step(FRAME_S, &targets, &sure, false);
        without.step(FRAME_S, &targets, &sure, false);
        error_with_m += mean_m(with.positions_m(), &truth) / 30.0;
        error_without_m += mean_m(without.positions_m(), &truth) / 30.0;
        error_targets_m += mean_m(&targets, &truth) / 30.0;
    }
    assert!(error_targets_m > 1.5e-3, "{error_targets_m}");
    assert!(
        error_with_m < 0.5 * error_without_m && error_with_m < 0.2 * error_targets_m,
        "{error_with_m} m with facets, {error_without_m} m without, targets {error_targets_m} m"
    );
}

#[test]
fn a_weak_facet_gives_way_and_a_strong_one_does_not() {
    // A bow of 10 mm height in a sheet of two facets, as cloth and as paper.
    let mut folds = Folds::flat(&sheet());
    folds.split(0, &orime_creases::Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
    let bow: Vec<[f32; 3]> = sheet()
        .uv_m()
        .map(|[u, v]| {
            let rise = 0.01 * (std::f64::consts::PI * v / SIDE_M).sin();
            [u as f32, v as f32, rise as f32]
        })
        .collect();
    let bent_m = |strength: f64| {
        let params = SimulateParams {
            facets: FacetsParams { strength, ..FacetsParams::default() },
            ..SimulateParams::default()
        };
        let mut simulator = simulator(&params);
        simulator.set_folds(&folds);
        simulator.step(FRAME_S, &sheet().flat_m(), &vec![0.0; sheet().len()], true);
        for _ in 0..30 {
            simulator.step(FRAME_S, &bow, &vec![1.0; sheet().len()], false);
        }
        (0..2).map(|f| simulator.folds().frame(f, simulator.positions_m()).residual_m).sum::<f64>()
    };
    let (cloth_m, paper_m) = (bent_m(0.005), bent_m(0.3));
    assert!(paper_m < 0.5 * cloth_m && cloth_m > 2e-3, "cloth {cloth_m} m, paper {paper_m} m");
}

#[test]
fn prediction_goes_on_with_the_motion_and_keeps_facets_rigid() {
    let sequence = square_base();
    let sure = vec![1.0; sheet().len()];
    let mut simulator = simulator(&SimulateParams::default());
    simulator.set_folds(&true_folds(&sequence));
    simulator.step(FRAME_S, &truth_m(&sequence, 130.0), &sure, true);
    for step in 131..150 {
        simulator.step(FRAME_S, &truth_m(&sequence, f64::from(step)), &sure, false);
    }
    let (before, next) = (simulator.positions_m().to_vec(), truth_m(&sequence, 150.0));
    let predicted = simulator.predict(FRAME_S).to_vec();
    assert_eq!(simulator.positions_m(), before, "the state is left as it is");
    let (stay_m, ahead_m) = (mean_m(&before, &next), mean_m(&predicted, &next));
    assert!(ahead_m < 0.6 * stay_m, "{ahead_m} m instead of {stay_m} m");
    // 1 % of an edge is 60 µm: what facets that meet in a crease disagree about.
    assert!(strain_max(&predicted) < 0.01, "{}", strain_max(&predicted));
    // And the step after a prediction is the step without it.
    let mut other = simulator.clone();
    other.predict(0.05);
    for simulator in [&mut simulator, &mut other] {
        simulator.step(FRAME_S, &next, &sure, false);
    }
    assert_eq!(simulator.positions_m(), other.positions_m());
}

#[test]
fn a_gripper_carries_the_sheet_and_only_while_it_holds() {
    let mut simulator = simulator(&SimulateParams::default());
    let start = sheet().flat_m();
    let free = vec![0.0; sheet().len()];
    simulator.step(FRAME_S, &start, &free, true);
    for frame in 1..=90 {
        let share = f64::from(frame.min(45)) / 45.0;
        let position_m = [-0.067 + 0.02 * share, 0.0, 0.05 * share];
        let off_the_sheet = Grip { uv_m: [1.0, 1.0], position_m: [0.0; 3] };
        simulator.set_grips(&[Grip { uv_m: [0.008, 0.075], position_m }, off_the_sheet]);
        simulator.step(FRAME_S, &start, &free, false);
    }
    let node = simulator.positions_m()[sheet().index(1, 12)];
    let expected = [-0.067 + 0.02 - 0.00175, 0.0, 0.05];
    assert!((0..3).all(|k| (node[k] - expected[k]).abs() < 2e-3), "{node:?}");
    let strain = strain_max(simulator.positions_m());
    assert!(strain < 0.02, "{strain}");
    simulator.set_grips(&[]);
    let before = simulator.positions_m().to_vec();
    for _ in 0..30 {
        simulator.step(FRAME_S, &before, &vec![1.0; sheet().len()], false);
    }
    assert!(max_m(simulator.positions_m(), &before) < 1e-3);
}

#[test]
fn a_prediction_goes_on_with_the_gripper() {
    let mut simulator = simulator(&SimulateParams::default());
    let free = vec![0.0; sheet().len()];
    simulator.step(FRAME_S, &sheet().flat_m(), &free, true);
    let held_m = |frame: u32| [-0.075, 0.0, 0.002 * f64::from(frame)];
    for frame in 1..=30 {
        simulator.set_grips(&[Grip { uv_m: [0.0, 0.075], position_m: held_m(frame) }]);
        simulator.step(FRAME_S, &sheet().flat_m(), &free, false);
    }
    let node = sheet().index(0, 12);
    let before = simulator.positions_m().to_vec();
    let ahead_m = f64::from(simulator.predict(FRAME_S)[node][2]) - held_m(30)[2];
    assert!(0.001 < ahead_m && ahead_m < 0.002, "{ahead_m} m of the gripper's 0.002 m");
    assert_eq!(simulator.positions_m(), before);
    // The gripper itself is where it was said to be.
    simulator.step(FRAME_S, &sheet().flat_m(), &free, false);
    let z_m = f64::from(simulator.positions_m()[node][2]);
    assert!((z_m - held_m(30)[2]).abs() < 5e-4, "{z_m} m");
}

#[test]
fn the_table_stops_what_falls_on_it_and_friction_what_slides() {
    let slide_m = |friction: f64| {
        let mut params = SimulateParams {
            table: TableParams { height_m: 0.02, friction, ..TableParams::default() },
            ..SimulateParams::default()
        };
        params.effects.extend([Effect::Table, Effect::Gravity]);
        let mut simulator = simulator(&params);
        let raised: Vec<[f32; 3]> = sheet().flat_m().iter().map(|x| [x[0], x[1], 0.05]).collect();
        let free = vec![0.0; sheet().len()];
        simulator.step(FRAME_S, &raised, &free, true);
        // Pushed sideways and down for a while, then left alone.
        let away: Vec<[f32; 3]> = raised.iter().map(|x| [x[0] + 0.05, x[1], -0.03]).collect();
        for frame in 0..40 {
            let push = if frame < 5 { 1.0 } else { 0.0 };
            simulator.step(FRAME_S, &away, &vec![push; sheet().len()], false);
            assert!(simulator.positions_m().iter().all(|x| x[2] >= 0.02 - 1e-6));
        }
        assert!(simulator.positions_m().iter().all(|x| x[2] < 0.021), "it lies on the table");
        let moved = |(x, raised): (&[f32; 3], &[f32; 3])| f64::from(x[0] - raised[0]);
        simulator.positions_m().iter().zip(&raised).map(moved).sum::<f64>() / raised.len() as f64
    };
    let (smooth_m, rough_m) = (slide_m(0.0), slide_m(0.8));
    assert!(rough_m < 0.7 * smooth_m, "{rough_m} m rough, {smooth_m} m smooth");
}

/// Largest strain while a gripper pulls 0.1 m away from a pinned edge, and where it gets to.
fn pulled_from_pinned(slip_strain: f64) -> [f64; 2] {
    let mut params = SimulateParams::default();
    params.grippers.strain_max = slip_strain;
    let mut simulator = simulator(&params);
    let free = vec![0.0; sheet().len()];
    simulator.step(FRAME_S, &sheet().flat_m(), &free, true);
    let pinned = |[u, _]: [f64; 2]| if u < 0.01 { 0.0 } else { 1.0 };
    assert!(simulator.set_inverse_masses(&sheet().uv_m().map(pinned).collect::<Vec<_>>()));
    let mut worst: f64 = 0.0;
    for frame in 1..=60 {
        let away_m = 0.1 * (f64::from(frame) / 30.0).min(1.0);
        let position_m = [0.075 + away_m, 0.0, 0.0];
        simulator.set_grips(&[Grip { uv_m: [0.15, 0.075], position_m }]);
        simulator.step(FRAME_S, &sheet().flat_m(), &free, false);
        worst = worst.max(strain_max(simulator.positions_m()));
    }
    let node = simulator.positions_m()[sheet().index(24, 12)];
    [worst, f64::from(node[0])]
}

#[test]
fn a_gripper_slips_where_paper_does_not_follow() {
    let [gentle, hard] = [0.1, 10.0].map(pulled_from_pinned);
    assert!(gentle[0] < 0.11 && gentle[1] < 0.085, "{gentle:?}");
    assert!(hard[0] > 3.0 * gentle[0], "{hard:?}");
}

#[test]
fn grippers_farther_apart_than_the_paper_between_them_meet_halfway() {
    let mut simulator = simulator(&SimulateParams::default());
    let free = vec![0.0; sheet().len()];
    simulator.step(FRAME_S, &sheet().flat_m(), &free, true);
    let grip = |u: f64, x: f64| Grip { uv_m: [u, 0.075], position_m: [x, 0.0, 0.0] };
    for _ in 0..30 {
        simulator.set_grips(&[grip(0.0, -0.080), grip(0.15, 0.100)]);
        simulator.step(FRAME_S, &sheet().flat_m(), &free, false);
    }
    let x = simulator.positions_m();
    let ends_m = [0, 24].map(|i| f64::from(x[sheet().index(i, 12)][0]));
    assert!((ends_m[0] + 0.065).abs() < 5e-4 && (ends_m[1] - 0.085).abs() < 5e-4, "{ends_m:?}");
    assert!(strain_max(simulator.positions_m()) < 0.01);
}
