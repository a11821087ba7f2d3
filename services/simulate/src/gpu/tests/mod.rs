//! The graphics processor against its CPU twins. Without an adapter the tests say loudly that
//! nothing was compared.

mod failing;
mod lasting;
mod scenes;

use super::model::{Frame, Link, PlasticLink, StencilColour};
use super::traffic::{Anchor, Beside, Hinge};
use super::{GpuError, Model, Path, Piece, Sheets};
use crate::solver::{Hooks, Solver};
use bytemuck::Zeroable;
use orime_creases::Folds;
use orime_lanes::gather;
use scenes::{SIDE_M, Scene, rates, solver};

/// Largest difference in place that one substep may make: a millionth of the sheet's side.
const APART_M: f64 = 1e-6 * SIDE_M;
/// The same of an angle: what moves the far side of the sheet as much.
const APART_RAD: f64 = 1e-6;

/// A frame of that many substeps here.
fn on_cpu(solver: &mut Solver, folds: &Folds, substeps: u32) {
    let mut room = [Vec::new(), Vec::new()];
    let mut hooks = Hooks { contact: None, watch: None, room: &mut room, folds };
    solver.yield_creases();
    for _ in 0..substeps {
        solver.substep(&rates(), None, &mut hooks);
    }
}

/// The model of a scene, grippers awake where something is held.
fn model(solver: &Solver) -> Model {
    let mut model = Model::new(solver);
    if !solver.anchors.is_empty() {
        model.pieces.insert(Piece::Grippers);
    }
    model
}

/// A frame of that many substeps on the graphics processor, of all sheets alike; the solver that
/// each becomes.
fn on_gpu(sheets: &mut Sheets, model: &Model, solvers: &mut [Solver], substeps: u32) {
    let frame = model.frame(&solvers[0], &rates(), substeps);
    for (sheet, solver) in solvers.iter().enumerate() {
        sheets.traffic.fill(sheet, solver);
    }
    if let Err(error) = sheets.step(&frame) {
        panic!("{error}");
    }
    for (sheet, solver) in solvers.iter_mut().enumerate() {
        sheets.traffic.give_back(sheet, solver);
        let all = solver.v.iter().flat_map(|v| solver.layout.places().map(|place| v.rows()[place]));
        assert!(all.into_iter().all(f32::is_finite), "a velocity was not written");
        solver.substeps = solver.substeps.wrapping_add(substeps);
    }
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

fn points(solver: &Solver) -> Vec<[f32; 3]> {
    let nodes = solver.layout.nodes[0] * solver.layout.nodes[1];
    let mut points = vec![[f32::NAN; 3]; nodes];
    gather(solver.layout, &solver.x, [0.0; 3], &mut points);
    points
}

/// Largest difference of these; infinite for what is not a number.
fn apart(a: impl Iterator<Item = f64>, b: impl Iterator<Item = f64>) -> f64 {
    let difference = |(a, b): (f64, f64)| {
        let difference = (a - b).abs();
        if difference.is_nan() { f64::INFINITY } else { difference }
    };
    a.zip(b).map(difference).fold(0.0, f64::max)
}

/// How far two solvers are apart.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Apart {
    /// Largest difference of a coordinate, or of a link's rest length, metres.
    m: f64,
    /// Largest difference of a hinge's angle, rest angle or elastic range, radians.
    rad: f64,
}

impl Apart {
    fn of(a: &Solver, b: &Solver) -> Self {
        let places = |solver: &Solver| points(solver).into_iter().flatten().map(f64::from);
        let rests = |solver: &Solver| {
            let each = solver.plastic_links.iter().map(|link| link.rest_now_m(&solver.colours));
            each.map(f64::from).collect::<Vec<_>>().into_iter()
        };
        let angles = |solver: &Solver| {
            let all = |hinge: &crate::solver::crease::Hinge| {
                [hinge.angle_rad, hinge.rest_rad, hinge.yields_at_rad]
            };
            solver.hinges.iter().flat_map(all).collect::<Vec<_>>().into_iter()
        };
        let m = apart(places(a), places(b)).max(apart(rests(a), rests(b)));
        Self { m, rad: apart(angles(a), angles(b)) }
    }

    fn is_rounding(self) -> bool {
        self.m <= APART_M && self.rad <= APART_RAD
    }
}

const PATHS: [Path; 2] = [Path::OneWorkgroup, Path::Apart];

#[test]
fn one_substep_agrees_with_the_cpu() {
    for scene in Scene::ALL {
        for nodes in [7, 25, 40] {
            let (start, folds) = solver(nodes, scene);
            let model = model(&start);
            let mut twin = start.clone();
            on_cpu(&mut twin, &folds, 1);
            let moved = Apart::of(&twin, &start);
            assert!(moved.m > 1e-4, "{moved:?}: a substep that does nothing compares nothing");
            assert!(start.hinges.is_empty() || moved.rad > 0.05, "{scene:?}: hinges rest");
            for path in PATHS {
                let Some(mut sheets) = unless_absent(Sheets::new(&model, 1, path)) else { return };
                let mut found = [start.clone()];
                on_gpu(&mut sheets, &model, &mut found, 1);
                let apart = Apart::of(&found[0], &twin);
                assert!(apart.is_rounding(), "{scene:?}, {nodes} nodes, {path:?}: {apart:?}");
            }
        }
    }
}

#[test]
fn every_sheet_of_a_batch_is_the_sheet_alone() {
    for scene in [Scene::Grippers, Scene::Shares, Scene::Paper] {
        let (start, _) = solver(13, scene);
        let mut other = start.clone();
        // Sheets differ in their states.
        other.x[2].rows_mut().iter_mut().for_each(|z| *z *= 1.5);
        other.facet_shares.iter_mut().for_each(|share| *share *= 0.5);
        other.anchors.truncate(1);
        let model = model(&start);
        let alone = |solver: &Solver| {
            let mut found = [solver.clone()];
            let mut sheets = Sheets::new(&model, 1, Path::OneWorkgroup)?;
            on_gpu(&mut sheets, &model, &mut found, 20);
            let [found] = found;
            Ok(found)
        };
        let Some(expected) = unless_absent(alone(&start)) else { return };
        let expected = [expected, alone(&other).expect("the first one was there")];
        assert!(Apart::of(&expected[0], &expected[1]).m > 1e-4, "{scene:?}: they are alike");
        let mut batch: Vec<Solver> = (0..64).map(|k| [&start, &other][k % 2].clone()).collect();
        let mut sheets = Sheets::new(&model, 64, Path::OneWorkgroup).expect("as above");
        on_gpu(&mut sheets, &model, &mut batch, 20);
        for (k, found) in batch.iter().enumerate() {
            let apart = Apart::of(found, &expected[k % 2]);
            assert_eq!(apart, Apart { m: 0.0, rad: 0.0 }, "{scene:?}, sheet {k}");
        }
    }
}

#[test]
fn repeating_a_frame_repeats_every_bit() {
    for scene in Scene::ALL {
        let (start, _) = solver(25, scene);
        let model = model(&start);
        for path in PATHS {
            let Some(mut sheets) = unless_absent(Sheets::new(&model, 1, path)) else { return };
            let [mut first, mut again] = [[start.clone()], [start.clone()]];
            on_gpu(&mut sheets, &model, &mut first, 40);
            on_gpu(&mut sheets, &model, &mut again, 40);
            assert_eq!(Apart::of(&first[0], &again[0]), Apart { m: 0.0, rad: 0.0 }, "{scene:?}");
        }
    }
}

#[test]
fn layouts_are_those_of_the_kernels() {
    let sources = concat!(
        include_str!("../passes.wgsl"),
        include_str!("../crease.wgsl"),
        include_str!("../grippers.wgsl"),
        include_str!("../plate.wgsl"),
        include_str!("../plastic.wgsl"),
    );
    let fields = |name: &str| -> Vec<String> {
        let body = sources.split(&format!("struct {name} {{")).nth(1).unwrap();
        let body = body.split('}').next().unwrap();
        let names = body.split(", ").flat_map(|part| part.split(",\n"));
        let names = names.filter_map(|field| field.split_once(':'));
        names.map(|(name, _)| name.trim().to_owned()).collect()
    };
    fn zero<T: Zeroable>() -> T {
        T::zeroed()
    }
    let check = |name: &str, printed: String, bytes: [usize; 2]| {
        let inner = printed.split_once('{').unwrap().1;
        // What is nested has a layout of its own.
        let (mut depth, mut outer) = (0, String::new());
        for letter in inner.chars() {
            depth += i32::from("[{".contains(letter)) - i32::from("]}".contains(letter));
            if depth == 0 {
                outer.push(letter);
            }
        }
        let names = outer.split(',').filter_map(|field| field.split_once(':'));
        let names: Vec<_> = names.map(|(name, _)| name.trim().to_owned()).collect();
        assert_eq!(names, fields(name), "{name}");
        assert_eq!(bytes[0], bytes[1], "{name} has other bytes");
    };
    let frame: Frame = zero();
    check("Frame", format!("{frame:?}"), [size_of::<Frame>(), 4 * fields("Frame").len()]);
    let link: Link = zero();
    check("Link", format!("{link:?}"), [size_of::<Link>(), 16]);
    let hinge: Hinge = zero();
    check("Hinge", format!("{hinge:?}"), [size_of::<Hinge>(), 48]);
    let beside: Beside = zero();
    check("Beside", format!("{beside:?}"), [size_of::<Beside>(), 16]);
    let anchor: Anchor = zero();
    check("Anchor", format!("{anchor:?}"), [size_of::<Anchor>(), 48 + 16 * 16]);
    let colour: StencilColour = zero();
    check("StencilColour", format!("{colour:?}"), [size_of::<StencilColour>(), 32]);
    let link: PlasticLink = zero();
    check("PlasticLink", format!("{link:?}"), [size_of::<PlasticLink>(), 16]);
}
