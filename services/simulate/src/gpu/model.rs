//! What the graphics processor is told of a solver.

use crate::solver::{Damp, Rates, Solver};
use bytemuck::{Pod, Zeroable};
use orime_lanes::LANES;

/// As `Frame` in `passes.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Frame {
    pub nodes: u32,
    pub colours: u32,
    pub substeps: u32,
    pub facets: u32,
    pub dt_s: f32,
    pub keep: f32,
    pub fall_m_per_s: f32,
    pub way_max_m: f32,
    pub gamma: f32,
    pub strength: f32,
    pub table_m: f32,
    pub friction: f32,
    pub has_table: u32,
    pub first_substep: u32,
    pub close_m2: f32,
    pub per_s: f32,
}

/// As `Link` in `passes.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct Link {
    pub ends: [u32; 2],
    /// Below zero for a seam.
    pub rest_m: f32,
    /// Compliance times an ordinary node's mass, s²: α̃ = softness/dt².
    pub softness_s2: f32,
}

/// Links in colours, and facets.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Model {
    pub links: Vec<Link>,
    /// First link of each colour, and the first that is not of it.
    pub ranges: Vec<[u32; 2]>,
    pub facets: Vec<[f32; 4]>,
    pub n_facets: u32,
}

impl Model {
    /// The model of a solver.
    pub fn new(solver: &Solver) -> Self {
        let mut model = Self::default();
        for colour in &solver.colours {
            let from = model.links.len() as u32;
            let softness_s2 = solver.alpha(colour.effect, 1.0);
            for (at, chunk) in colour.chunks.iter().enumerate() {
                for lane in (0..LANES).filter(|lane| chunk.bits >> lane & 1 == 1) {
                    let first = chunk.first as usize + lane;
                    let ends = [first, first + colour.offset].map(|n| node(solver, n));
                    model.links.push(Link {
                        ends,
                        rest_m: colour.rest_m.of(at, lane),
                        softness_s2,
                    });
                }
            }
            model.ranges.push([from, model.links.len() as u32]);
        }
        model.add_seams(solver);
        model.add_facets(solver);
        model
    }

    /// Seams go one after the other on the CPU: here each in the first colour after all earlier
    /// ones that share a node with it.
    fn add_seams(&mut self, solver: &Solver) {
        let softness_s2 = solver.alpha(crate::Effect::Stretch, 1.0);
        let mut colours: Vec<Vec<Link>> = Vec::new();
        for seam in &solver.seams {
            let ends = seam.ends.map(|n| node(solver, n as usize));
            let shares = |link: &Link| ends.iter().any(|end| link.ends.contains(end));
            let last = colours.iter().rposition(|colour| colour.iter().any(shares));
            let at = last.map_or(0, |last| last + 1);
            if at == colours.len() {
                colours.push(Vec::new());
            }
            colours[at].push(Link { ends, rest_m: -seam.rest_m, softness_s2 });
        }
        for colour in colours {
            let from = self.links.len() as u32;
            self.links.extend(colour);
            self.ranges.push([from, self.links.len() as u32]);
        }
    }

    fn add_facets(&mut self, solver: &Solver) {
        let table = solver.facet_table.as_ref().filter(|_| solver.hold_facets.is_some());
        let Some(table) = table.filter(|table| table.facets.len() > 1) else { return };
        self.n_facets = table.facets.len() as u32;
        let mut from = self.n_facets;
        for facet in &table.facets {
            self.facets.push([f32::from_bits(from), f32::from_bits(facet.count), 0.0, 0.0]);
            from += facet.count;
        }
        for facet in &table.facets {
            for (first, bits) in &facet.spans {
                for lane in (0..LANES).filter(|lane| bits >> lane & 1 == 1) {
                    let place = *first as usize + lane;
                    let [u, v] = [0, 1].map(|k| table.uv_m[k].rows()[place] - facet.center_uv_m[k]);
                    self.facets.push([f32::from_bits(node(solver, place)), u, v, 0.0]);
                }
            }
        }
    }

    /// What changes from frame to frame.
    pub fn frame(&self, solver: &Solver, rates: &Rates, substeps: u32) -> Frame {
        let damping_s = match solver.damping {
            Some((Damp::Xpbd, time_s)) => time_s,
            _ => 0.0,
        };
        Frame {
            nodes: (solver.layout.nodes[0] * solver.layout.nodes[1]) as u32,
            colours: self.ranges.len() as u32,
            substeps,
            facets: self.n_facets,
            dt_s: rates.dt_s,
            keep: rates.keep,
            fall_m_per_s: solver.gravity_m_per_s2.unwrap_or(0.0) * rates.dt_s,
            way_max_m: rates.way_max_m,
            gamma: damping_s / rates.dt_s,
            strength: solver.hold_facets.unwrap_or(0.0),
            table_m: rates.table_m,
            friction: solver.table.map_or(0.0, |[_, friction]| friction),
            has_table: u32::from(solver.table.is_some() && rates.table_awake),
            first_substep: solver.substeps,
            close_m2: crate::solver::COINCIDENT_M2,
            per_s: 1.0 / rates.dt_s,
        }
    }
}

/// Index of the node at a place.
fn node(solver: &Solver, place: usize) -> u32 {
    let layout = solver.layout;
    (place / layout.stride * layout.nodes[1] + place % layout.stride) as u32
}
