//! What the finders must reach on exact folds with noise.
//!
//! Source: `../shared/design/creases.md`, "What to reach". The seeds were not looked at.

use orime_creases::trial::{Noise, Scene, SceneKind, Score, Summary, score};
use orime_creases::{CreaseFinder, CreaseMode, CreaseParams};
use orime_geometry::SheetGrid;

/// Some small numbers and some that nobody would choose.
fn seeds() -> impl Iterator<Item = u64> {
    [1, 2].into_iter().chain((3..4).map(|k: u64| k.wrapping_mul(0x9E37_79B9_7F4A_7C15)))
}

fn sheet(side_m: f64) -> SheetGrid {
    SheetGrid::new([side_m; 2], [25; 2])
}

fn run_with(kind: SceneKind, params: &CreaseParams, side_m: f64, sigma_m: f64) -> Score {
    let scene = Scene::new(kind, &sheet(side_m), 1).unwrap();
    let mut finder = CreaseFinder::new(&params.check().unwrap(), &sheet(side_m));
    let mut noise = Noise::new(&sheet(side_m), sigma_m, 0.5, 5);
    score(&scene, &mut finder, &mut noise, |_, _| 1.0)
}

/// Fails with every goal that a kind of scene misses.
fn check(kind: fn(u64) -> SceneKind) {
    let config = CreaseParams::default().check().unwrap();
    for sigma_m in [2e-3, 4e-3] {
        let summary = Summary::run(kind, &config, &sheet(0.15), sigma_m, seeds()).unwrap();
        assert!(summary.goals().is_some(), "nothing is asked of {:?}", summary.kind);
        assert_eq!(summary.misses(), [""; 0], "{:?} with {sigma_m} m", summary.kind);
    }
}

#[test]
fn diagonal() {
    check(|_| SceneKind::Diagonal);
}

#[test]
fn book() {
    check(|_| SceneKind::Book);
}

#[test]
fn oblique() {
    check(|_| SceneKind::Oblique);
}

#[test]
fn second_half() {
    check(|_| SceneKind::SecondHalf);
}

#[test]
fn squash() {
    check(|_| SceneKind::Squash);
}

#[test]
fn accordion() {
    check(|_| SceneKind::Accordion);
}

#[test]
fn blintz() {
    check(|_| SceneKind::Blintz);
}

#[test]
fn waves_are_never_creased() {
    let config = CreaseParams::default().check().unwrap();
    for (sigma_m, first) in [(0.0, 1), (2e-3, 100), (4e-3, 200)] {
        let seeds = first..first + 10;
        let summary = Summary::run(SceneKind::Wave, &config, &sheet(0.15), sigma_m, seeds).unwrap();
        assert_eq!(summary.wrong_facets(), 0, "with {sigma_m} m");
    }
}

#[test]
fn the_wave_check_can_fail() {
    // A finder that takes anything for a crease.
    let params = CreaseParams {
        angle_min_deg: 5.0,
        angle_off_landmarks_deg: 5.0,
        bend_width: 8.0,
        evidence: 1.0,
        ..Default::default()
    };
    let score = run_with(SceneKind::Wave(1), &params, 0.15, 0.0);
    assert!(score.facets[1] > 1, "{score:?}");
}

#[test]
fn twice_the_sheet_is_the_same_with_unchanged_parameters() {
    for kind in [SceneKind::Oblique, SceneKind::Accordion] {
        let params = CreaseParams::default();
        let [small, large] = [1.0, 2.0].map(|k| run_with(kind, &params, 0.15 * k, 2e-3 * k));
        for (a, b) in small.found_deg.iter().zip(&large.found_deg) {
            assert!((a.unwrap() - b.unwrap()).abs() <= 3.0, "{a:?} and {b:?}");
        }
        assert_eq!(small.facets, large.facets);
    }
}

#[test]
fn the_paper_s_row_comes_out_as_it_was_measured() {
    let params = CreaseParams { mode: CreaseMode::Paper, ..Default::default() };
    let diagonal = run_with(SceneKind::Diagonal, &params, 0.15, 2e-3);
    assert!((44.0..60.0).contains(&diagonal.found_deg[0].unwrap()), "{diagonal:?}");
    assert!((0.005..0.05).contains(&diagonal.flips), "{diagonal:?}");
    // The lock keeps the second fold until it is nearly shut.
    let second = run_with(SceneKind::SecondHalf, &params, 0.15, 2e-3);
    assert!(second.found_deg[1].unwrap() > 150.0, "{second:?}");
    // An accordion is never seen.
    let accordion = run_with(SceneKind::Accordion, &params, 0.15, 2e-3);
    assert_eq!(accordion.facets, [1, 1]);
}

#[test]
fn hidden_and_missing_nodes_weigh_nothing() {
    let scene = Scene::new(SceneKind::Oblique, &sheet(0.15), 1).unwrap();
    let config = CreaseParams::default().check().unwrap();
    let mut finder = CreaseFinder::new(&config, &sheet(0.15));
    let mut noise = Noise::new(&sheet(0.15), 0.5e-3, 0.5, 5);
    let uv: Vec<[f64; 2]> = sheet(0.15).uv_m().collect();
    for exact_m in &scene.positions_m {
        let mut seen_m = noise.add(exact_m);
        let mut sure = vec![1.0; uv.len()];
        for (n, [u, v]) in uv.iter().enumerate() {
            // A third is hidden and said to be anywhere; some are missing altogether.
            if *u > 0.1 {
                (seen_m[n], sure[n]) = ([u.sin() as f32, 7.0, *v as f32], 0.0);
            }
            if n % 17 == 0 {
                seen_m[n] = [f32::NAN; 3];
            }
        }
        finder.step(&seen_m, &sure);
    }
    let [crease] = finder.folds().creases() else {
        panic!("one crease, not {:?}", finder.folds().creases())
    };
    let truth = scene.creases[0].ends_m;
    for end in truth {
        assert!(crease.line().side_m(end).abs() < 1.5e-3, "{crease:?} instead of {truth:?}");
    }
    // Nothing at all is seen.
    finder.step(&vec![[f32::NAN; 3]; uv.len()], &vec![0.0; uv.len()]);
    assert_eq!(finder.folds().creases().len(), 1);
    finder.reset();
    assert_eq!(finder.folds().facets().len(), 1);
}

#[test]
fn a_plan_is_seen_earlier_and_lies_where_it_was_planned() {
    let plain = CreaseParams::default();
    let line = Scene::new(SceneKind::Oblique, &sheet(0.15), 1).unwrap().creases[0].ends_m;
    let planned = CreaseParams { plan: vec![line], ..plain.clone() };
    let [plain, planned] = [plain, planned].map(|p| run_with(SceneKind::Oblique, &p, 0.15, 1e-3));
    assert!(planned.found_deg[0].unwrap() < plain.found_deg[0].unwrap(), "{planned:?} {plain:?}");
    assert!(planned.line_m < 1e-9 && planned.facets == [2, 2], "{planned:?}");
    // A plan that nobody follows does nothing.
    let elsewhere = CreaseParams { plan: vec![[[0.0, 0.04], [0.15, 0.03]]], ..Default::default() };
    let other = run_with(SceneKind::Oblique, &elsewhere, 0.15, 1e-3);
    assert!(other.facets == [2, 2] && other.line_deg < 1.0, "{other:?}");
}

#[test]
fn snapping_puts_the_square_base_on_its_landmarks() {
    let params = CreaseParams { snap: 0.3, ..Default::default() };
    let snapped = run_with(SceneKind::Squash, &params, 0.15, 2e-3);
    assert!(snapped.line_m < 0.05e-3 && snapped.facets == [6, 6], "{snapped:?}");
    // What is no landmark stays where it is.
    let oblique = run_with(SceneKind::Oblique, &params, 0.15, 2e-3);
    assert!(oblique.line_m < 0.5e-3, "{oblique:?}");
}

#[test]
fn a_fold_that_never_was_is_undone_and_a_real_one_stays() {
    let config = CreaseParams::default().check().unwrap();
    let bent = |angle_deg: f64| -> Vec<[f32; 3]> {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let place = |[u, v]: [f64; 2]| {
            let over = (u - 0.06).max(0.0);
            [(u.min(0.06) + over * cos) as f32, v as f32, (over * sin) as f32]
        };
        sheet(0.15).uv_m().map(place).collect()
    };
    for (most_deg, left) in [(40.0, 1), (60.0, 2)] {
        let mut finder = CreaseFinder::new(&config, &sheet(0.15));
        let sure = vec![1.0; sheet(0.15).len()];
        let angles = [vec![most_deg; 10], vec![0.0; 30]].concat();
        for (step, angle_deg) in angles.into_iter().enumerate() {
            finder.step(&bent(angle_deg), &sure);
            assert!(step != 9 || finder.folds().facets().len() == 2, "{most_deg} degrees");
        }
        assert_eq!(finder.folds().facets().len(), left, "after {most_deg} degrees");
    }
}

#[test]
fn a_fold_that_never_was_is_undone_although_others_came_beside_it() {
    let config = CreaseParams::default().check().unwrap();
    // A corner bends up, and lies flat again while the sheet is folded along u = 0.1 m.
    let bent = |corner_deg: f64, fold_deg: f64| -> Vec<[f32; 3]> {
        let place = |[u, v]: [f64; 2]| {
            let beyond = (0.06 - u - v).max(0.0) / 2f64.sqrt();
            let (sin, cos) = corner_deg.to_radians().sin_cos();
            let back = beyond * (1.0 - cos) / 2f64.sqrt();
            let over = (u - 0.1).max(0.0);
            let (fold_sin, fold_cos) = fold_deg.to_radians().sin_cos();
            let z = beyond * sin + over * fold_sin;
            [(u + back - over * (1.0 - fold_cos)) as f32, (v + back) as f32, z as f32]
        };
        sheet(0.15).uv_m().map(place).collect()
    };
    let mut finder = CreaseFinder::new(&config, &sheet(0.15));
    let sure = vec![1.0; sheet(0.15).len()];
    (0..10).for_each(|_| _ = finder.step(&bent(40.0, 0.0), &sure));
    assert_eq!(finder.folds().facets().len(), 2, "the corner");
    (0..10).for_each(|_| _ = finder.step(&bent(20.0, 90.0), &sure));
    assert_eq!(finder.folds().facets().len(), 3, "and the fold");
    (0..60).for_each(|_| _ = finder.step(&bent(0.0, 90.0), &sure));
    assert_eq!(finder.folds().facets().len(), 2, "the fold alone");
    let crease = finder.folds().creases()[0];
    assert!(crease.ends_m.iter().all(|end| (end[0] - 0.1).abs() < 1e-3), "{crease:?}");
}

#[test]
fn equal_input_gives_equal_bits() {
    let scene = Scene::new(SceneKind::Blintz, &sheet(0.15), 1).unwrap();
    let config = CreaseParams::default().check().unwrap();
    let [a, b] = [(); 2].map(|()| {
        let mut finder = CreaseFinder::new(&config, &sheet(0.15));
        let mut noise = Noise::new(&sheet(0.15), 2e-3, 0.5, 9);
        score(&scene, &mut finder, &mut noise, |_, _| 1.0);
        finder.folds().clone()
    });
    assert_eq!(a, b);
    assert_eq!(a.facets().len(), 5);
}
