//! What goes to the graphics processor with every frame, and what comes back.

use super::model::{Model, node};
use super::pieces::Piece;
use super::slots::Slot;
use crate::GRIPS_MAX;
use crate::grips::BESIDE;
use crate::solver::Solver;
use bytemuck::{Pod, Zeroable};
use orime_lanes::Field;

/// As `Hinge` in `crease.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Hinge {
    pub facets: [u32; 2],
    pub direction: [f32; 2],
    pub center_m: [f32; 2],
    pub inertia_m2: [f32; 2],
    pub angle_rad: f32,
    pub rest_rad: f32,
    pub yields_at_rad: f32,
    pub unused: u32,
}

/// As `Beside` in `grippers.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Beside {
    /// Both the same where there is no link: nothing stretches it.
    pub ends: [u32; 2],
    pub rest_m: f32,
    pub unused: u32,
}

/// As `Anchor` in `grippers.wgsl`; one that is not there has no weight.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Anchor {
    pub nodes: [u32; 4],
    pub weights: [f32; 4],
    pub position_m: [f32; 4],
    pub beside: [Beside; BESIDE],
}

/// Room for all that changes from frame to frame, sheet by sheet; empty for pieces that are not
/// there.
#[derive(Debug, Clone)]
pub(crate) struct Traffic {
    nodes: usize,
    /// Positions, metres, and the inverse mass.
    pub x: Vec<[f32; 4]>,
    /// Velocities, m/s, and nothing.
    pub v: Vec<[f32; 4]>,
    /// Where nodes are pulled to, metres, and the share of the way.
    targets: Vec<[f32; 4]>,
    /// Share of the way to its pose, per facet.
    pub strengths: Vec<f32>,
    pub hinges: Vec<Hinge>,
    pub anchors: Vec<Anchor>,
    /// Rest lengths of the links that yield, metres.
    pub rests_m: Vec<f32>,
}

impl Traffic {
    /// Room for that many sheets of a model.
    pub fn new(model: &Model, sheets: usize) -> Self {
        let with = |piece, each: usize| usize::from(model.pieces.contains(piece)) * each * sheets;
        let nodes = model.nodes as usize;
        Self {
            nodes,
            x: vec![[0.0; 4]; nodes * sheets],
            v: vec![[0.0; 4]; nodes * sheets],
            targets: vec![[0.0; 4]; with(Piece::Track, nodes)],
            strengths: vec![0.0; with(Piece::Facets, model.n_facets as usize)],
            hinges: vec![Hinge::zeroed(); with(Piece::Crease, model.n_hinges as usize)],
            anchors: vec![Anchor::zeroed(); with(Piece::Grippers, GRIPS_MAX)],
            rests_m: vec![0.0; with(Piece::Plastic, model.plastic_links.len())],
        }
    }

    /// Takes over the state of a sheet.
    pub fn fill(&mut self, sheet: usize, solver: &Solver) {
        let at = self.nodes * sheet..self.nodes * (sheet + 1);
        points(solver, &solver.x, solver.weights.as_ref(), 1.0, &mut self.x[at.clone()]);
        points(solver, &solver.v, None, 0.0, &mut self.v[at.clone()]);
        if let (Some(pulls), false) = (&solver.targets, self.targets.is_empty()) {
            let to = &mut self.targets[at];
            match pulls.count {
                0 => to.fill([0.0; 4]),
                _ => points(solver, &pulls.at_m, Some(&pulls.ratio), 0.0, to),
            }
        }
        let strength = solver.hold_facets.unwrap_or(0.0);
        let shares = solver.facet_shares.iter().copied().chain(std::iter::repeat(1.0));
        let sheets = self.sheets();
        for (to, share) in of(&mut self.strengths, sheet, sheets).iter_mut().zip(shares) {
            *to = strength * share;
        }
        self.fill_hinges(sheet, solver);
        self.fill_anchors(sheet, solver);
        let links = solver.plastic_links.iter();
        for (to, link) in of(&mut self.rests_m, sheet, sheets).iter_mut().zip(links) {
            *to = link.rest_now_m(&solver.colours);
        }
    }

    fn fill_hinges(&mut self, sheet: usize, solver: &Solver) {
        let sheets = self.sheets();
        for (to, hinge) in of(&mut self.hinges, sheet, sheets).iter_mut().zip(&solver.hinges) {
            *to = Hinge {
                facets: hinge.facets.map(|facet| facet as u32),
                direction: hinge.direction.map(|c| c as f32),
                center_m: hinge.center_m.map(|c| c as f32),
                inertia_m2: hinge.inertia_m2.map(|c| c as f32),
                angle_rad: hinge.angle_rad as f32,
                rest_rad: hinge.rest_rad as f32,
                yields_at_rad: hinge.yields_at_rad as f32,
                unused: 0,
            };
        }
    }

    fn fill_anchors(&mut self, sheet: usize, solver: &Solver) {
        let sheets = self.sheets();
        let room = of(&mut self.anchors, sheet, sheets);
        room.fill(Anchor::zeroed());
        for (to, anchor) in room.iter_mut().zip(&solver.anchors) {
            let [x, y, z] = anchor.position_m;
            *to = Anchor {
                nodes: anchor.places.map(|place| node(solver, place as usize)),
                weights: anchor.weights,
                position_m: [x, y, z, 0.0],
                beside: anchor.beside.map(|(ends, rest_m)| match rest_m.is_finite() {
                    true => Beside {
                        ends: ends.map(|place| node(solver, place as usize)),
                        rest_m,
                        unused: 0,
                    },
                    false => Beside::zeroed(),
                }),
            };
        }
    }

    /// Hands a sheet's state back.
    pub fn give_back(&self, sheet: usize, solver: &mut Solver) {
        let (layout, sheets) = (solver.layout, self.sheets());
        let at = self.nodes * sheet..self.nodes * (sheet + 1);
        for (fields, points) in [(&mut solver.x, &self.x), (&mut solver.v, &self.v)] {
            for (axis, field) in fields.iter_mut().enumerate() {
                let rows = field.rows_mut();
                for (place, point) in layout.places().zip(&points[at.clone()]) {
                    rows[place] = point[axis];
                }
            }
        }
        let each = self.hinges.len() / sheets;
        for (hinge, from) in solver.hinges.iter_mut().zip(&self.hinges[each * sheet..]) {
            hinge.angle_rad = f64::from(from.angle_rad);
            hinge.rest_rad = f64::from(from.rest_rad);
            hinge.yields_at_rad = f64::from(from.yields_at_rad);
        }
        let each = self.rests_m.len() / sheets;
        for (link, from_m) in solver.plastic_links.iter().zip(&self.rests_m[each * sheet..]) {
            if let Some(rest_m) = link.rest_mut(&mut solver.colours) {
                *rest_m = *from_m;
            }
        }
    }

    /// What goes to a buffer; `None` for those that nothing goes to.
    pub fn bytes(&self, slot: Slot) -> Option<&[u8]> {
        match slot {
            Slot::X => Some(bytemuck::cast_slice(&self.x)),
            Slot::V => Some(bytemuck::cast_slice(&self.v)),
            Slot::Targets => Some(bytemuck::cast_slice(&self.targets)),
            Slot::Strengths => Some(bytemuck::cast_slice(&self.strengths)),
            Slot::Hinges => Some(bytemuck::cast_slice(&self.hinges)),
            Slot::Anchors => Some(bytemuck::cast_slice(&self.anchors)),
            Slot::Rests => Some(bytemuck::cast_slice(&self.rests_m)),
            _ => None,
        }
    }

    /// Room for what comes back from a buffer; none for those that nothing comes from.
    pub fn back(&mut self, slot: Slot) -> &mut [u8] {
        match slot {
            Slot::X => bytemuck::cast_slice_mut(&mut self.x),
            Slot::V => bytemuck::cast_slice_mut(&mut self.v),
            Slot::Hinges => bytemuck::cast_slice_mut(&mut self.hinges),
            Slot::Rests => bytemuck::cast_slice_mut(&mut self.rests_m),
            _ => &mut [],
        }
    }

    fn sheets(&self) -> usize {
        self.x.len() / self.nodes
    }
}

/// A sheet's part of what all sheets have.
fn of<T>(all: &mut [T], sheet: usize, sheets: usize) -> &mut [T] {
    let each = all.len() / sheets;
    &mut all[each * sheet..each * (sheet + 1)]
}

fn points(
    solver: &Solver,
    fields: &[Field; 3],
    fourth: Option<&Field>,
    otherwise: f32,
    points: &mut [[f32; 4]],
) {
    let [x, y, z] = fields.each_ref().map(|field| field.rows());
    let fourth = fourth.map(Field::rows);
    for (place, point) in solver.layout.places().zip(points) {
        *point = [x[place], y[place], z[place], fourth.map_or(otherwise, |w| w[place])];
    }
}
