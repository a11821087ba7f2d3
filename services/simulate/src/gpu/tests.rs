//! The graphics processor against its CPU twins. Without an adapter the tests say loudly that
//! nothing was compared.

use super::{GpuError, Model, Path, Sheets};
use crate::solver::{Hooks, Rates, Solver};
use crate::{Effect, SimulateParams};
use orime_creases::{Folds, Line};
use orime_geometry::SheetGrid;
use orime_lanes::{Layout, gather, scatter};

const SIDE_M: f64 = 0.15;

/// A solver with everything that both sides can do, in the middle of a fold.
fn solver(nodes: usize) -> (Solver, Folds) {
    let sheet = SheetGrid::new([SIDE_M; 2], [nodes, nodes]);
    let mut params = SimulateParams::default();
    params.effects.extend([Effect::Gravity, Effect::Table]);
    params.table.friction = 0.3;
    params.bend.reach = 4;
    let mut solver = Solver::new(&params, &sheet, 3e5, None);
    let mut folds = Folds::flat(&sheet);
    // One crease off the grid, with seams, and one along it.
    folds.split(0, &Line::through([0.072, 0.0], [0.081, SIDE_M]));
    folds.split(0, &Line::through([0.0, 0.075], [SIDE_M, 0.075]));
    solver.set_folds(&folds, false);
    assert!(nodes < 25 || !solver.seams.is_empty() && folds.facets().len() == 3);
    let bent = |[u, v]: [f64; 2]| {
        let wave = 1e-3 * (70.0 * u + 30.0 * v).sin();
        [u * 0.99, v * 1.01, 0.4 * (u - 0.075).max(0.0) + wave].map(|c| c as f32)
    };
    let bent: Vec<[f32; 3]> = sheet.uv_m().map(bent).collect();
    let layout = Layout::new(&sheet);
    scatter(layout, &bent, &mut solver.x);
    let masses: Vec<f32> = (0..sheet.len()).map(|n| if n == 7 { 0.0 } else { 1.0 }).collect();
    solver.set_weights(&masses);
    for (n, place) in layout.places().enumerate() {
        for axis in 0..3 {
            solver.v[axis].rows_mut()[place] = 0.1 * ((n * (axis + 2)) as f32).sin();
        }
    }
    if let Some(targets) = &mut solver.targets {
        for (n, place) in layout.places().enumerate() {
            for axis in 0..3 {
                let x = solver.x[axis].rows()[place];
                targets.at_m[axis].rows_mut()[place] = x + 2e-3 * (n as f32).cos();
            }
            targets.ratio.rows_mut()[place] = if n % 3 == 0 { 0.2 } else { 0.0 };
        }
        targets.count = sheet.len() as u32;
    }
    (solver, folds)
}

fn rates() -> Rates {
    Rates {
        dt_s: 1.0 / 600.0,
        keep: 0.98,
        way_max_m: 4e-4,
        strain_max: f32::INFINITY,
        grip: 0.8,
        grip_strain_max: 0.1,
        gamma_max: 0.5,
        table_m: 0.0,
        inertia: true,
        table_awake: true,
        contact_awake: false,
    }
}

fn on_cpu(solver: &mut Solver, folds: &Folds, substeps: u32) {
    let mut room = [Vec::new(), Vec::new()];
    let mut hooks = Hooks { contact: None, watch: None, room: &mut room, folds };
    for _ in 0..substeps {
        solver.substep(&rates(), None, &mut hooks);
    }
}

fn points(solver: &Solver) -> Vec<[f32; 3]> {
    let nodes = solver.layout.nodes[0] * solver.layout.nodes[1];
    let mut points = vec![[f32::NAN; 3]; nodes];
    gather(solver.layout, &solver.x, [0.0; 3], &mut points);
    points
}

/// Positions of every sheet after some substeps of this model on the graphics processor.
fn on_gpu(
    solver: &Solver,
    model: &Model,
    path: Path,
    sheets: u32,
    substeps: u32,
) -> Result<Vec<Vec<[f32; 3]>>, GpuError> {
    let layout = solver.layout;
    let nodes = layout.nodes[0] * layout.nodes[1];
    let fourth = |field: &orime_lanes::Field, place: usize| field.rows()[place];
    let four = |fields: &[orime_lanes::Field; 3], last: &dyn Fn(usize) -> f32| {
        let one = |place: usize| {
            let [x, y, z] = [0, 1, 2].map(|axis| fields[axis].rows()[place]);
            [x, y, z, last(place)]
        };
        let all: Vec<[f32; 4]> = layout.places().map(one).collect();
        all.repeat(sheets as usize)
    };
    let weights = solver.weights.as_ref();
    let mut x = four(&solver.x, &|place| weights.map_or(1.0, |w| fourth(w, place)));
    let mut v = four(&solver.v, &|_| 0.0);
    let targets = solver.targets.as_ref().expect("the scene tracks");
    let targets = four(&targets.at_m, &|place| fourth(&targets.ratio, place));
    let mut gpu = Sheets::new(model, nodes as u32, sheets, path)?;
    gpu.step(&model.frame(solver, &rates(), substeps), &targets, &mut x, &mut v)?;
    assert!(v.iter().flatten().all(|c| c.is_finite()), "a velocity was not written");
    let plain = |x: &[f32; 4]| [x[0], x[1], x[2]];
    Ok(x.chunks(nodes).map(|sheet| sheet.iter().map(plain).collect()).collect())
}

/// The result, or `None` where there is no adapter, which is said loudly.
fn unless_absent<T>(result: Result<T, GpuError>) -> Option<T> {
    match result {
        Ok(value) => Some(value),
        Err(GpuError::NoAdapter(why)) => {
            eprintln!("SKIPPED, NOTHING WAS COMPARED: no Vulkan adapter ({why})");
            eprintln!("on Debian, install mesa-vulkan-drivers");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Largest difference of a coordinate; infinite for what is not a number.
fn apart_m(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let difference = |(a, b): (&f32, &f32)| {
        let difference = (f64::from(*a) - f64::from(*b)).abs();
        if difference.is_nan() { f64::INFINITY } else { difference }
    };
    a.iter().flatten().zip(b.iter().flatten()).map(difference).fold(0.0, f64::max)
}

const PATHS: [Path; 2] = [Path::OneWorkgroup, Path::Apart];

#[test]
fn one_substep_agrees_with_the_cpu() {
    for nodes in [7, 25, 40] {
        let (start, folds) = solver(nodes);
        let model = Model::new(&start);
        let mut twin = start.clone();
        on_cpu(&mut twin, &folds, 1);
        let moved_m = apart_m(&points(&twin), &points(&start));
        assert!(moved_m > 1e-4, "{moved_m} m: a substep that does nothing compares nothing");
        for path in PATHS {
            let Some(found) = unless_absent(on_gpu(&start, &model, path, 1, 1)) else { return };
            let apart_m = apart_m(&found[0], &points(&twin));
            assert!(apart_m <= 1e-6 * SIDE_M, "{nodes} nodes, {path:?}: {apart_m} m");
        }
    }
}

#[test]
fn the_comparison_can_fail() {
    let (start, folds) = solver(25);
    let mut twin = start.clone();
    on_cpu(&mut twin, &folds, 1);
    let whole = Model::new(&start);
    type Damage = fn(&mut Model);
    let damages: [Damage; 4] = [
        |model| model.ranges[9] = [0, 0],
        |model| model.n_facets = 0,
        |model| model.links[700].rest_m *= 1.01,
        |model| {
            model.ranges.pop(); // The last seams.
        },
    ];
    for (k, damage) in damages.into_iter().enumerate() {
        for path in PATHS {
            let mut model = whole.clone();
            damage(&mut model);
            let Some(found) = unless_absent(on_gpu(&start, &model, path, 1, 1)) else { return };
            let apart_m = apart_m(&found[0], &points(&twin));
            assert!(apart_m > 1e-6 * SIDE_M, "damage {k}, {path:?}: only {apart_m} m");
        }
    }
    assert_eq!(apart_m(&[[f32::NAN; 3]], &[[0.0; 3]]), f64::INFINITY, "poison is seen");
}

#[test]
fn a_thousand_substeps_keep_what_the_cpu_keeps() {
    let (start, folds) = solver(25);
    let model = Model::new(&start);
    let mut twin = start.clone();
    on_cpu(&mut twin, &folds, 1000);
    let sheet = folds.sheet();
    let strain = |x: &[[f32; 3]]| {
        let edge = |([a, b], rest): ([u32; 2], f64)| {
            let (a, b) = (x[a as usize], x[b as usize]);
            let squared: f64 = (0..3).map(|k| f64::from(b[k] - a[k]).powi(2)).sum();
            (squared.sqrt() / rest - 1.0).powi(2)
        };
        let edges = sheet.edges();
        (edges.iter().copied().map(edge).sum::<f64>() / edges.len() as f64).sqrt()
    };
    let middle = |x: &[[f32; 3]]| {
        [0, 1, 2].map(|k| x.iter().map(|x| f64::from(x[k])).sum::<f64>() / x.len() as f64)
    };
    let expected = points(&twin);
    for path in PATHS {
        let Some(found) = unless_absent(on_gpu(&start, &model, path, 1, 1000)) else { return };
        let found = &found[0];
        assert!(found.iter().flatten().all(|c| c.is_finite()));
        assert_eq!(found[7], points(&start)[7], "a pinned node stays");
        let low_m = found.iter().map(|x| x[2]).fold(f32::INFINITY, f32::min);
        assert!(low_m >= 0.0, "{path:?}: {low_m} m, below the table");
        let (a, b) = (middle(found), middle(&expected));
        assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-3 * SIDE_M), "{path:?}: {a:?} {b:?}");
        let (a, b) = (strain(found), strain(&expected));
        assert!((a - b).abs() < 0.1 * b + 1e-4, "{path:?}: strain {a}, on the CPU {b}");
    }
}

#[test]
fn every_sheet_of_a_batch_is_the_sheet_alone() {
    let (start, _) = solver(13);
    let model = Model::new(&start);
    let alone = on_gpu(&start, &model, Path::OneWorkgroup, 1, 20);
    let Some(alone) = unless_absent(alone) else { return };
    let batch = on_gpu(&start, &model, Path::OneWorkgroup, 64, 20).unwrap();
    assert_eq!(batch.len(), 64);
    assert!(batch.iter().all(|sheet| *sheet == alone[0]));
}

#[test]
fn layouts_are_those_of_the_kernels() {
    let source = include_str!("passes.wgsl");
    let fields = |name: &str| -> Vec<String> {
        let body = source.split(&format!("struct {name} {{")).nth(1).unwrap();
        let body = body.split('}').next().unwrap();
        let names = body.split(',').filter_map(|field| field.split(':').next());
        names.map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect()
    };
    let frame = format!("{:?}", Model::default().frame(&solver(7).0, &rates(), 1));
    let link = "ends rest_m softness_s2";
    let in_rust: Vec<String> = frame
        .trim_start_matches("Frame { ")
        .split(", ")
        .filter_map(|field| field.split(':').next().map(|name| name.trim().to_owned()))
        .collect();
    assert_eq!(in_rust, fields("Frame"));
    assert_eq!(fields("Link").join(" "), link);
    assert_eq!(size_of::<super::model::Frame>(), 4 * in_rust.len());
    assert_eq!(size_of::<super::model::Link>(), 16);
}
