//! Sheets in the middle of a fold, one per kind of effect.

use crate::grips::{Anchor, Grip};
use crate::params::{BendKind, CreaseKind, DampingKind};
use crate::solver::links::facets_of_place;
use crate::solver::{Rates, Solver};
use crate::{Effect, SimulateParams};
use orime_creases::{Folds, Line};
use orime_geometry::SheetGrid;
use orime_lanes::{Layout, scatter};

pub(super) const SIDE_M: f64 = 0.15;

/// What acts beside links, facets, targets, gravity and the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scene {
    /// Not even those: weight alone.
    Bare,
    /// Nothing.
    Links,
    /// Hinges and facets, one of which is a single row of nodes.
    Thin,
    /// Sixteen facets and the hinges between them.
    Many,
    /// Hinges of creases that yield and harden.
    Creases,
    /// Two grippers, one of which slips, on creases that are hinges as well.
    Grippers,
    /// Facets that give way, each as much as it does.
    Shares,
    /// A thin plate.
    Plate,
    /// The paper's plasticity and damping.
    Paper,
    /// Plasticity of all links.
    Everywhere,
}

impl Scene {
    pub const ALL: [Self; 10] = [
        Self::Bare,
        Self::Links,
        Self::Thin,
        Self::Many,
        Self::Creases,
        Self::Grippers,
        Self::Shares,
        Self::Plate,
        Self::Paper,
        Self::Everywhere,
    ];

    fn params(self) -> SimulateParams {
        let mut params = SimulateParams::default();
        params.effects.extend([Effect::Gravity, Effect::Table]);
        params.table.friction = 0.3;
        params.bend.reach = 4;
        params.crease.hardening = 0.5;
        params.crease.yield_strain = 0.002;
        match self {
            Self::Bare => params.effects = vec![Effect::Gravity],
            Self::Links | Self::Shares => {}
            Self::Creases | Self::Grippers | Self::Thin | Self::Many => {
                params.effects.push(Effect::Crease)
            }
            Self::Plate => params.bend.kind = BendKind::Hinge,
            Self::Paper => {
                params.effects.push(Effect::Crease);
                params.crease.kind = CreaseKind::Paper;
                params.damping.kind = DampingKind::Paper;
            }
            Self::Everywhere => {
                params.effects.push(Effect::Crease);
                params.crease.kind = CreaseKind::Everywhere;
            }
        }
        params
    }
}

/// The solver of a scene.
pub(super) fn solver(nodes: usize, scene: Scene) -> (Solver, Folds) {
    let sheet = SheetGrid::new([SIDE_M; 2], [nodes, nodes]);
    let mut solver = Solver::new(&scene.params(), &sheet, 3e5, None);
    let mut folds = Folds::flat(&sheet);
    crease(&mut folds, scene);
    solver.set_folds(&folds, false);
    assert!(nodes < 25 || !solver.seams.is_empty() || scene == Scene::Bare);
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
    if scene == Scene::Grippers {
        // One beside a pinned node, and one too far away to be followed.
        hold(&mut solver, &folds, &[([0.003, 0.047], 0.002), ([0.146, 0.101], 0.04)]);
    }
    if scene == Scene::Shares {
        solver.facet_shares = vec![0.3, 0.9]; // The third gets all.
    }
    (solver, folds)
}

/// The creases of a scene.
fn crease(folds: &mut Folds, scene: Scene) {
    let ([n_u, _], [h_u, _]) = (folds.sheet().nodes, folds.sheet().spacing_m());
    let mut split = |ends: [[f64; 2]; 2]| {
        for facet in 0..folds.facets().len() {
            folds.split(facet, &Line::through(ends[0], ends[1]));
        }
    };
    match scene {
        Scene::Many => {
            for u in [0.25, 0.5, 0.75].map(|share| share * SIDE_M) {
                split([[u, 0.0], [u, SIDE_M]]);
            }
            for v in [0.27, 0.52, 0.77].map(|share| share * SIDE_M) {
                split([[0.0, v], [SIDE_M, v]]);
            }
            assert!(n_u < 25 || folds.facets().len() == 16);
        }
        Scene::Thin => {
            split([[0.55 * h_u, 0.0], [0.55 * h_u, SIDE_M]]);
            assert!((0..2).any(|facet| folds.members(facet).len() == n_u));
        }
        _ => {
            // One crease off the grid, with seams, and one along it on one side.
            folds.split(0, &Line::through([0.072, 0.0], [0.081, SIDE_M]));
            folds.split(0, &Line::through([0.0, 0.075], [SIDE_M, 0.075]));
            assert!(n_u < 25 || folds.facets().len() == 3);
        }
    }
}

/// Holds material points so far above the flat sheet, metres.
fn hold(solver: &mut Solver, folds: &Folds, points: &[([f64; 2], f64)]) {
    let facets = facets_of_place(solver.layout, folds);
    for (uv_m, above_m) in points {
        let [u, v] = *uv_m;
        let grip = Grip { uv_m: *uv_m, position_m: [u, v, above_m + 0.4 * (u - 0.075).max(0.0)] };
        let anchor = Anchor::new(&grip, folds, &facets, [0.0; 3]).expect("it is on the sheet");
        solver.anchors.push(anchor.tie(&solver.colours));
    }
}

pub(super) fn rates() -> Rates {
    Rates {
        dt_s: 1.0 / 600.0,
        keep: 0.98,
        way_max_m: 4e-4,
        strain_max: f32::INFINITY,
        grip: 0.8,
        grip_strain_max: 0.1,
        gamma_max: 0.25, // Below what is set: the limit is in force.
        table_m: 0.0,
        inertia: true,
        table_awake: true,
        contact_awake: false,
    }
}
