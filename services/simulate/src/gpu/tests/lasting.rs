//! What the CPU keeps over a thousand substeps, the graphics processor keeps.

use super::*;

/// Frames, and substeps of each: more than go in one submission.
const FRAMES: u32 = 20;
const SUBSTEPS: u32 = 50;

/// Root mean square of the edges' strain.
fn strain(solver: &Solver, folds: &Folds) -> f64 {
    let x = points(solver);
    let edge = |([a, b], rest): ([u32; 2], f64)| {
        let (a, b) = (x[a as usize], x[b as usize]);
        let squared: f64 = (0..3).map(|k| f64::from(b[k] - a[k]).powi(2)).sum();
        (squared.sqrt() / rest - 1.0).powi(2)
    };
    let edges = folds.sheet().edges();
    (edges.iter().copied().map(edge).sum::<f64>() / edges.len() as f64).sqrt()
}

fn middle_m(solver: &Solver) -> [f64; 3] {
    let x = points(solver);
    [0, 1, 2].map(|k| x.iter().map(|x| f64::from(x[k])).sum::<f64>() / x.len() as f64)
}

/// Root mean square of the second differences along u and v: how much the sheet is bent, metres.
fn bend_m(solver: &Solver) -> f64 {
    let (x, [n_u, n_v]) = (points(solver), solver.layout.nodes);
    let squared = |a: usize, b: usize, c: usize| -> f64 {
        (0..3).map(|k| f64::from(x[a][k] - 2.0 * x[b][k] + x[c][k]).powi(2)).sum()
    };
    let inner = (1..n_u - 1).flat_map(|i| (1..n_v - 1).map(move |j| i * n_v + j));
    let each = inner.map(|n| squared(n - n_v, n, n + n_v) + squared(n - 1, n, n + 1));
    (each.sum::<f64>() / x.len() as f64).sqrt()
}

/// Mean strain of the plastic links' rest lengths against the uncreased sheet.
fn yielded(solver: &Solver) -> f64 {
    let strain = |link: &crate::solver::crease::PlasticLink| {
        f64::from(link.rest_now_m(&solver.colours) / link.rest_m - 1.0).abs()
    };
    let links = &solver.plastic_links;
    links.iter().map(strain).sum::<f64>() / links.len().max(1) as f64
}

/// Distance of each held point from its gripper, metres.
fn slips_m(solver: &Solver) -> Vec<f64> {
    let slip = |anchor: &crate::grips::Anchor| {
        let held = anchor.held_m(&solver.x);
        let squared = |k: usize| f64::from(held[k] - anchor.position_m[k]).powi(2);
        (0..3).map(squared).sum::<f64>().sqrt()
    };
    solver.anchors.iter().map(slip).collect()
}

/// A quantity is what it is on the CPU to a tenth, which two runs that differ in rounding keep over
/// a thousand substeps.
fn is_like(found: f64, expected: f64, least: f64) -> bool {
    (found - expected).abs() < 0.1 * expected.abs() + least
}

#[test]
fn a_thousand_substeps_keep_what_the_cpu_keeps() {
    for scene in Scene::ALL {
        let (start, folds) = solver(25, scene);
        let model = model(&start);
        let mut twin = start.clone();
        (0..FRAMES).for_each(|_| on_cpu(&mut twin, &folds, SUBSTEPS));
        for path in PATHS {
            let Some(mut sheets) = unless_absent(Sheets::new(&model, 1, path)) else { return };
            let mut found = [start.clone()];
            for _ in 0..FRAMES {
                on_gpu(&mut sheets, &model, &mut found, SUBSTEPS);
                for hinge in &found[0].hinges {
                    let elastic_rad = (hinge.angle_rad - hinge.rest_rad).abs();
                    assert!(elastic_rad <= hinge.yields_at_rad + APART_RAD, "{hinge:?}");
                }
            }
            check(&format!("{scene:?}, {path:?}"), &start, &found[0], &twin, &folds);
        }
    }
}

fn check(what: &str, start: &Solver, found: &Solver, twin: &Solver, folds: &Folds) {
    let x = points(found);
    assert!(x.iter().flatten().all(|c| c.is_finite()), "{what}");
    assert_eq!(x[7], points(start)[7], "{what}: a pinned node stays");
    let pinned_m = x[7][2];
    let low_m = x.iter().map(|x| x[2]).filter(|z| *z != pinned_m).fold(f32::INFINITY, f32::min);
    assert!(low_m >= 0.0 || start.table.is_none(), "{what}: {low_m} m, below the table");
    let (a, b) = (middle_m(found), middle_m(twin));
    assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-3 * SIDE_M), "{what}: {a:?} {b:?}");
    let (a, b) = (strain(found, folds), strain(twin, folds));
    assert!(is_like(a, b, 1e-4), "{what}: strain {a}, on the CPU {b}");
    let (a, b) = (bend_m(found), bend_m(twin));
    assert!(is_like(a, b, 1e-3 * SIDE_M / 24.0), "{what}: bent by {a} m, on the CPU {b} m");
    let (a, b) = (yielded(found), yielded(twin));
    assert!(is_like(a, b, 0.0) || b == 0.0, "{what}: yielded by {a}, on the CPU {b}");
    assert!(found.plastic_links.is_empty() || b > 1e-3, "{what}: nothing yields");
    for (a, b) in slips_m(found).into_iter().zip(slips_m(twin)) {
        assert!(is_like(a, b, 1e-4), "{what}: slips by {a} m, on the CPU {b} m");
    }
    for (a, b) in found.hinges.iter().zip(&twin.hinges) {
        assert!((a.angle_rad - b.angle_rad).abs() < 0.01, "{what}: {a:?}, on the CPU {b:?}");
        assert!((a.rest_rad - b.rest_rad).abs() < 0.01, "{what}: {a:?}, on the CPU {b:?}");
    }
}
