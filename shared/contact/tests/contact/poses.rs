//! Exact folds, disturbed so that their layers cross, are free of crossings after one projection.

use super::scene::{SIDE_M, Scene, config, mean_distance_m, paper};
use orime_contact::{ContactReport, FacetContact};
use orime_evaluate::scores::folded::self_intersections;
use orime_origami::{FoldLine, Sequence, Timing};

/// What a run over a fold's steps came to.
#[derive(Debug, Default)]
struct Tally {
    poses: usize,
    crossing_before: usize,
    crossing_after: Vec<u64>,
    flipped: Vec<u64>,
    /// Mean over all poses and nodes, metres.
    moved_m: f64,
    /// Largest elongation of an edge of the grid.
    stretch_before: f64,
    stretch_after: f64,
    unsettled: usize,
}

fn run(sequence: Sequence, stride: usize, noise_m: f64, seed: u64) -> Tally {
    let mut scene = Scene::new(sequence);
    let triangles = scene.sheet.triangles();
    let mut contact = FacetContact::new(&config(), &scene.sheet);
    let mut tally = Tally::default();
    for step in 0..=scene.steps() {
        let truth = scene.truth_m(step);
        if step % stride as u64 != 0 {
            continue;
        }
        assert_eq!(self_intersections(&truth, &triangles), 0, "the truth crosses at {step}");
        let before = scene.noisy(&truth, noise_m, seed * 1000 + step);
        let mut after = before.clone();
        let ContactReport { settled, .. } = contact.project(&mut after, &scene.folds);
        tally.poses += 1;
        tally.unsettled += usize::from(!settled);
        tally.crossing_before += usize::from(self_intersections(&before, &triangles) > 0);
        if self_intersections(&after, &triangles) > 0 {
            tally.crossing_after.push(step);
        }
        if scene.has_flipped(&truth, &after) {
            tally.flipped.push(step);
        }
        tally.moved_m += mean_distance_m(&before, &after);
        tally.stretch_before = tally.stretch_before.max(scene.stretch(&before));
        tally.stretch_after = tally.stretch_after.max(scene.stretch(&after));
    }
    tally.moved_m /= tally.poses as f64;
    println!("{noise_m} m, seed {seed}: {tally:?}");
    tally
}

/// No crossing, no layer on the wrong side, little stretch and little movement.
fn check(sequence: &Sequence, stride: usize) {
    for seed in 1..=3 {
        let noise_m = 5e-4;
        let tally = run(sequence.clone(), stride, noise_m, seed);
        assert!(tally.crossing_before > 2, "the noise must make layers cross: {tally:?}");
        assert!(tally.crossing_after.is_empty(), "{tally:?}");
        assert!(tally.flipped.is_empty(), "{tally:?}");
        assert!(tally.stretch_after < 0.05, "{tally:?}");
        assert!(tally.moved_m < 0.5 * noise_m, "{tally:?}");
    }
}

#[test]
fn square_base() {
    check(&Sequence::square_base(paper()).unwrap(), 5);
}

#[test]
fn half_fold() {
    let line = FoldLine::book([SIDE_M; 2]);
    check(&Sequence::half_fold(paper(), line, Timing::default()).unwrap(), 1);
}

#[test]
fn gate_fold() {
    check(&Sequence::gate_fold(paper()).unwrap(), 2);
}

#[test]
fn blintz() {
    check(&Sequence::blintz(paper()).unwrap(), 3);
}

#[test]
fn accordion() {
    check(&Sequence::accordion(paper()).unwrap(), 2);
}

/// A crease off the grid's lines cuts triangles: they belong to both sides.
#[test]
fn a_crease_off_the_grid() {
    let line = FoldLine { point_m: [0.08, 0.07], angle_rad: 1.1 };
    check(&Sequence::half_fold(paper(), line, Timing::default()).unwrap(), 1);
}

/// Four times the noise, more than a tracker has: a few poses keep a crossing.
#[test]
fn two_millimetres_leave_few_crossings() {
    let tally = run(Sequence::square_base(paper()).unwrap(), 5, 2e-3, 1);
    assert!(tally.crossing_before > 90, "{tally:?}");
    assert!(20 * tally.crossing_after.len() < tally.crossing_before, "{tally:?}");
}
