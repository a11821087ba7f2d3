//! The generic contact and its net on shapes that know no facets.

use super::scene::{SIDE_M, Scene, config, mean_distance_m, paper};
use nalgebra::{Isometry3, Point3, Vector3};
use orime_contact::GenericContact;
use orime_evaluate::scores::folded::self_intersections;
use orime_geometry::SheetGrid;
use orime_origami::{FoldLine, Sequence, Timing};
use proptest::prelude::*;

fn small() -> SheetGrid {
    SheetGrid::new([0.1, 0.08], [11, 9])
}

/// The sheet bent by three waves of these sizes.
fn bent(sheet: &SheetGrid, waves: &[[f64; 5]]) -> Vec<[f32; 3]> {
    let at = |[u, v]: [f64; 2]| {
        let mut p = [u, v, 0.0];
        for (k, [size_m, a, b, phase, other]) in waves.iter().enumerate() {
            p[2 - k % 3] += size_m * (a * u + b * v + phase).sin();
            p[(2 - k % 3 + 1) % 3] += 0.3 * size_m * (b * u - a * v + other).cos();
        }
        p.map(|c| c as f32)
    };
    sheet.uv_m().map(at).collect()
}

fn waves() -> impl Strategy<Value = Vec<[f64; 5]>> {
    prop::collection::vec([0.0..0.06, -60.0..60.0, -60.0..60.0, -3.0..3.0, -3.0..3.0f64], 3..=3)
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 48,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// From a flat sheet through a chain of wild poses nothing ever passes through anything.
    #[test]
    fn the_net_holds_whatever_it_is_asked_for(poses in prop::collection::vec(waves(), 4)) {
        let sheet = small();
        let triangles = sheet.triangles();
        let mut contact = GenericContact::new(&config(), &sheet);
        let mut from = bent(&sheet, &[]);
        for pose in &poses {
            let mut x = bent(&sheet, pose);
            let report = contact.truncate(&from, &mut x);
            prop_assert!(report.armed);
            prop_assert_eq!(self_intersections(&x, &triangles), 0);
            from = x;
        }
    }

    /// Our own count of crossings is the judge's.
    #[test]
    fn crossings_are_the_judges(pose in waves()) {
        let sheet = small();
        let x = bent(&sheet, &pose);
        let mut contact = GenericContact::new(&config(), &sheet);
        prop_assert_eq!(contact.crossings(&x), self_intersections(&x, &sheet.triangles()));
    }

    /// What is not finite never comes out.
    #[test]
    fn nonsense_in_is_no_nonsense_out(
        places in prop::collection::vec((0usize..99, 0usize..3, prop::num::f32::ANY), 1..5)
    ) {
        let sheet = small();
        let mut contact = GenericContact::new(&config(), &sheet);
        let from = bent(&sheet, &[]);
        let mut x = from.clone();
        for (node, axis, value) in places {
            x[node][axis] = value;
        }
        contact.begin_step(&from);
        contact.project(&mut x.clone());
        contact.truncate(&from, &mut x);
        prop_assert!(x.iter().flatten().all(|c| c.is_finite()));
    }
}

#[test]
fn a_flap_that_is_pulled_through_stops_above_and_goes_home_alone() {
    let line = FoldLine::book([SIDE_M; 2]);
    let mut scene = Scene::new(Sequence::half_fold(paper(), line, Timing::default()).unwrap());
    let triangles = scene.sheet.triangles();
    let mut contact = GenericContact::new(&config(), &scene.sheet);
    let from = scene.truth_m(95);
    let moving = scene.folds.members(1).to_vec();
    let mut through = from.clone();
    for n in &moving {
        through[*n as usize][2] -= 0.02;
    }
    assert!(self_intersections(&through, &triangles) > 0 || through[0][2] < from[300][2]);
    let mut x = through.clone();
    let report = contact.truncate(&from, &mut x);
    assert!(report.armed && report.blended > 0, "{report:?}");
    assert_eq!(self_intersections(&x, &triangles), 0);
    assert!(!scene.has_flipped(&from, &x));
    // The way back is free, and a motion of all is.
    let mut back = from.clone();
    assert_eq!(contact.truncate(&x.clone(), &mut back).share, 1.0);
    let mut together: Vec<[f32; 3]> = from.iter().map(|p| [p[0], p[1] + 0.3, p[2]]).collect();
    let wanted = together.clone();
    contact.truncate(&from, &mut together);
    assert!(mean_distance_m(&together, &wanted) < 1e-6);
}

#[test]
fn a_corner_that_pokes_through_is_said_and_untangled() {
    let line = FoldLine::book([SIDE_M; 2]);
    let mut scene = Scene::new(Sequence::half_fold(paper(), line, Timing::default()).unwrap());
    let truth = scene.truth_m(112);
    let mut contact = GenericContact::new(&config(), &scene.sheet);
    // The flap's corner pokes through the lower layer, off its nodes.
    let mut tangled = truth.clone();
    let corner = |n: &u32| n % 25 < 2 && scene.folds.members(1).contains(n);
    let tip = (0..625).filter(corner).min_by_key(|n| (n / 25).min(24 - n / 25)).unwrap();
    for n in [tip, tip + 1] {
        let p = &mut tangled[n as usize];
        *p = [p[0] + 1e-3, p[1] + 1e-3, -2e-3];
    }
    let mut x = tangled.clone();
    assert!(!contact.truncate(&tangled, &mut x).armed);
    let report = contact.untangle(&mut x);
    assert!(report.crossings_before > 0 && report.crossings_after == 0, "{report:?}");
    assert_eq!(self_intersections(&x, &scene.sheet.triangles()), 0);
    assert!(mean_distance_m(&x, &tangled) < 1e-4);
    assert!(contact.truncate(&x.clone(), &mut truth.clone()).armed);
}

#[test]
fn layers_that_are_too_near_part_to_the_thickness_and_friction_holds_them() {
    // Two layers 20 µm apart, of which the upper one slides.
    let sheet = SheetGrid::new([0.1, 0.04], [11, 5]);
    let layers = |slid: f64| -> Vec<[f32; 3]> {
        let fold = |[u, v]: [f64; 2]| {
            if u < 0.055 { [u, v, 0.0] } else { [0.103 - u + slid, v + 0.001, 2e-5] }
        };
        sheet.uv_m().map(|uv| fold(uv).map(|c| c as f32)).collect()
    };
    let from = layers(0.0);
    let mut contact = GenericContact::new(&config(), &sheet);
    let mut x = layers(1e-5);
    for _ in 0..40 {
        contact.begin_step(&x.clone());
        contact.project(&mut x);
    }
    let mean = |range: std::ops::Range<usize>, axis: usize, x: &[[f32; 3]]| {
        range.clone().map(|n| f64::from(x[n][axis])).sum::<f64>() / range.len() as f64
    };
    let apart_m = mean(35..55, 2, &x) - mean(5..25, 2, &x);
    assert!((0.6e-4..1.2e-4).contains(&apart_m), "{apart_m}");
    // One step with friction slides less than one without.
    let slid_m = |friction: f64| {
        let params = orime_contact::ContactParams { friction, ..Default::default() };
        let mut contact = GenericContact::new(&params.check().unwrap(), &sheet);
        contact.begin_step(&from);
        let mut x = layers(1e-5);
        contact.project(&mut x);
        mean(35..55, 0, &x) - mean(35..55, 0, &from) - mean(5..25, 0, &x) + mean(5..25, 0, &from)
    };
    let (free, held) = (slid_m(0.0), slid_m(1.0));
    assert!((free - 1e-5).abs() < 2e-6 && held < 0.5 * free, "{free} {held}");
}

/// A corner of a shut flap pokes through the lower layer, by this much.
fn poking(scene: &mut Scene, deep_m: f32) -> Vec<[f32; 3]> {
    let mut x = scene.truth_m(112);
    let corner = |n: &u32| n % 25 < 2 && scene.folds.members(1).contains(n);
    let tip = (0..625).filter(corner).min_by_key(|n| (n / 25).min(24 - n / 25)).unwrap();
    for n in [tip, tip + 1] {
        let p = x[n as usize];
        x[n as usize] = [p[0] + 1e-3, p[1] + 1e-3, -deep_m];
    }
    x
}

#[test]
fn what_is_caught_does_not_poke_through_by_the_last_bits_either() {
    // Two layers 20 µm apart; one node of the upper one this far under the lower one.
    let sheet = SheetGrid::new([0.1, 0.04], [11, 5]);
    let poking = |deep_m: f64| -> Vec<[f32; 3]> {
        let fold = |(n, [u, v]): (usize, [f64; 2])| {
            let over = [0.103 - u, v + 0.001, if n == 8 * 5 + 2 { -deep_m } else { 2e-5 }];
            if u < 0.055 { [u, v, 0.0] } else { over }
        };
        sheet.uv_m().enumerate().map(|node| fold(node).map(|c| c as f32)).collect()
    };
    let mut contact = GenericContact::new(&config(), &sheet);
    let barely = poking(4e-7);
    assert_eq!(contact.crossings(&barely), 0, "nobody counts that");
    let from = poking(-1e-5);
    let mut x = barely.clone();
    assert!(contact.catch(&from, &mut x).blended > 0, "but the net does");
    let mut again = x.clone();
    assert_eq!(contact.catch(&from, &mut again).pairs, 0, "nothing is left of it");
    assert_eq!(again, x);
    assert!(mean_distance_m(&x, &barely) < 1e-6);
}

#[test]
fn a_stack_that_turns_takes_along_what_is_held_back() {
    let line = FoldLine::book([SIDE_M; 2]);
    let mut scene = Scene::new(Sequence::half_fold(paper(), line, Timing::default()).unwrap());
    let from = scene.truth_m(112);
    let through = poking(&mut scene, 3e-3);
    let mut contact = GenericContact::new(&config(), &scene.sheet);
    let mut still = through.clone();
    assert!(contact.catch(&from, &mut still).blended > 0);
    let motion = Isometry3::new(Vector3::new(0.1, 0.0, 0.05), Vector3::new(0.2, 0.5, -0.3));
    let moved = |x: &[[f32; 3]]| -> Vec<[f32; 3]> {
        x.iter().map(|p| (motion * Point3::from(*p).cast::<f64>()).cast::<f32>().into()).collect()
    };
    let mut turned = moved(&through);
    assert!(contact.catch(&from, &mut turned).blended > 0);
    assert_eq!(self_intersections(&turned, &scene.sheet.triangles()), 0);
    let apart_m = mean_distance_m(&turned, &moved(&still));
    assert!(apart_m < 1e-6, "{apart_m} m from the same in a stack that lies");
}
