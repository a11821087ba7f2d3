//! What the graphics processor is told of a solver.

use super::pieces::{Piece, Pieces};
use super::slots::Slot;
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
    pub first_substep: u32,
    pub dt_s: f32,
    pub per_s: f32,
    pub keep: f32,
    pub fall_m_per_s: f32,
    pub way_max_m: f32,
    pub close_m2: f32,
    pub gamma: f32,
    /// Whether these are the frame's first substeps.
    pub is_first: u32,
    pub table_m: f32,
    pub friction: f32,
    pub has_table: u32,
    pub facets: u32,
    /// Most that any of the sheets has.
    pub anchors: u32,
    pub grip: f32,
    pub grip_strain_max: f32,
    pub stencil_colours: u32,
    pub hinges: u32,
    pub stiffness: f32,
    pub hardening: f32,
    pub plastic_links: u32,
    /// Elastic range of a link, as a strain.
    pub yields_at: f32,
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

/// As `StencilColour` in `plate.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct StencilColour {
    pub factors: [f32; 4],
    pub range: [u32; 2],
    pub softness_s2: f32,
    pub unused: u32,
}

/// As `PlasticLink` in `plastic.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub(crate) struct PlasticLink {
    pub ends: [u32; 2],
    /// Rest length of the uncreased sheet, metres.
    pub rest_m: f32,
    pub unused: u32,
}

/// What stays the same until the folds change.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Model {
    pub pieces: Pieces,
    pub nodes: u32,
    pub links: Vec<Link>,
    /// First link of each colour, and the first that is not of it.
    pub ranges: Vec<[u32; 2]>,
    pub facets: Vec<[f32; 4]>,
    /// Facets that are held.
    pub n_facets: u32,
    pub n_hinges: u32,
    /// Nodes of the plate's hinges and twists.
    pub stencils: Vec<[u32; 4]>,
    pub stencil_colours: Vec<StencilColour>,
    /// Which of the plastic links each link is; their number for none.
    pub rest_of_link: Vec<u32>,
    pub plastic_links: Vec<PlasticLink>,
}

impl Model {
    /// The model of a solver. [`Piece::Grippers`] is left to whoever sees that something is held.
    pub fn new(solver: &Solver) -> Self {
        let nodes = (solver.layout.nodes[0] * solver.layout.nodes[1]) as u32;
        let mut model = Self { nodes, ..Self::default() };
        model.add_plastic(solver);
        model.add_links(solver);
        model.add_seams(solver);
        model.add_facets(solver);
        model.add_plate(solver);
        let damps = |damp| solver.damping.is_some_and(|(own, _)| own == damp);
        let pieces = [
            (Piece::Track, solver.targets.is_some()),
            (Piece::Plate, !model.stencils.is_empty()),
            (Piece::Xpbd, damps(Damp::Xpbd)),
            (Piece::Paper, damps(Damp::Paper)),
            (Piece::Plastic, !model.plastic_links.is_empty()),
            (Piece::Fit, !model.facets.is_empty()),
            (Piece::Crease, model.n_hinges > 0),
            (Piece::Facets, model.n_facets > 0),
            (Piece::Table, solver.table.is_some()),
        ];
        let there = pieces.into_iter().filter(|(_, is_there)| *is_there);
        model.pieces = there.map(|(piece, _)| piece).collect();
        model
    }

    fn add_plastic(&mut self, solver: &Solver) {
        let link = |link: &crate::solver::crease::PlasticLink| PlasticLink {
            ends: link.ends.map(|place| node(solver, place as usize)),
            rest_m: link.rest_m,
            unused: 0,
        };
        self.plastic_links = solver.plastic_links.iter().map(link).collect();
    }

    fn add_links(&mut self, solver: &Solver) {
        let none = self.plastic_links.len() as u32;
        // They come in the order of the links.
        let mut plastic = (0..).zip(self.plastic_links.clone()).peekable();
        for colour in &solver.colours {
            let from = self.links.len() as u32;
            let softness_s2 = solver.alpha(colour.effect, 1.0);
            for (at, chunk) in colour.chunks.iter().enumerate() {
                for lane in (0..LANES).filter(|lane| chunk.bits >> lane & 1 == 1) {
                    let first = chunk.first as usize + lane;
                    let ends = [first, first + colour.offset].map(|n| node(solver, n));
                    let own = plastic.next_if(|(_, link)| link.ends == ends);
                    // What yields is the same model at any length that it has come to.
                    let rest_m = own.map_or(colour.rest_m.of(at, lane), |(_, link)| link.rest_m);
                    self.links.push(Link { ends, rest_m, softness_s2 });
                    self.rest_of_link.push(own.map_or(none, |(own, _)| own));
                }
            }
            self.ranges.push([from, self.links.len() as u32]);
        }
        assert!(plastic.peek().is_none(), "every plastic link is a link");
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
        self.rest_of_link.resize(self.links.len(), self.plastic_links.len() as u32);
    }

    fn add_facets(&mut self, solver: &Solver) {
        let table = solver.facet_table.as_ref().filter(|table| table.facets.len() > 1);
        let Some(table) = table else { return };
        let n_facets = table.facets.len() as u32;
        self.n_facets = if solver.hold_facets.is_some() { n_facets } else { 0 };
        self.n_hinges = solver.hinges.len() as u32;
        if self.n_facets + self.n_hinges == 0 {
            return;
        }
        let mut from = n_facets;
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

    fn add_plate(&mut self, solver: &Solver) {
        for colour in &solver.plate {
            let from = self.stencils.len() as u32;
            let softness_s2 = solver.plate_alpha(colour, 1.0);
            // Without rigidity it does nothing, and α̃ has no number.
            if softness_s2.is_finite() {
                let nodes = |places: [usize; 4]| places.map(|place| node(solver, place));
                self.stencils.extend(colour.acting().map(nodes));
                let range = [from, self.stencils.len() as u32];
                let factors = colour.factors;
                self.stencil_colours.push(StencilColour { factors, range, softness_s2, unused: 0 });
            }
        }
    }

    /// What a buffer is filled with once; `None` for those that change.
    pub fn bytes(&self, slot: Slot) -> Option<&[u8]> {
        match slot {
            Slot::Links => Some(bytemuck::cast_slice(&self.links)),
            Slot::Ranges => Some(bytemuck::cast_slice(&self.ranges)),
            Slot::Facets => Some(bytemuck::cast_slice(&self.facets)),
            Slot::Stencils => Some(bytemuck::cast_slice(&self.stencils)),
            Slot::StencilColours => Some(bytemuck::cast_slice(&self.stencil_colours)),
            Slot::RestOfLink => Some(bytemuck::cast_slice(&self.rest_of_link)),
            Slot::PlasticLinks => Some(bytemuck::cast_slice(&self.plastic_links)),
            _ => None,
        }
    }

    /// Facets that there are: the first one's members begin behind all headers.
    fn headers(&self) -> usize {
        self.facets.first().map_or(0, |facet| facet[0].to_bits() as usize)
    }

    /// Most rounds that a substep's loops make in one workgroup of that many invocations.
    pub fn rounds(&self, width: u32) -> u32 {
        let over = |count: u32| count.div_ceil(width) + 1;
        let colours = self.ranges.iter().chain(self.stencil_colours.iter().map(|c| &c.range));
        let links: u32 = colours.map(|[from, to]| over(to - from) + 1).sum();
        // To sum up takes a round per halving of the workgroup, and once through the nodes.
        let largest = self.facets.iter().map(|facet| facet[1].to_bits()).take(self.headers());
        let through = over(largest.max().unwrap_or(0));
        let fit = width.ilog2() + through;
        let facets = self.n_facets * (fit + through + 1);
        let hinges = self.n_hinges * 2 * (fit + through + 1);
        let grips = crate::GRIPS_MAX * (crate::grips::BESIDE + 1);
        links
            + facets
            + hinges
            + 2 * over(self.nodes)
            + grips as u32
            + over(self.plastic_links.len() as u32)
    }

    /// What changes from frame to frame.
    pub fn frame(&self, solver: &Solver, rates: &Rates, substeps: u32) -> Frame {
        let gamma = match solver.damping {
            Some((Damp::Xpbd, time_s)) => time_s / rates.dt_s,
            Some((Damp::Paper, time_s)) => (time_s / rates.dt_s).min(rates.gamma_max),
            _ => 0.0,
        };
        let plastic = |of: fn(&crate::solver::crease::Plastic) -> f64| {
            solver.plastic.as_ref().map_or(0.0, of) as f32
        };
        Frame {
            nodes: self.nodes,
            colours: self.ranges.len() as u32,
            substeps,
            first_substep: solver.substeps,
            dt_s: rates.dt_s,
            per_s: 1.0 / rates.dt_s,
            keep: rates.keep,
            fall_m_per_s: solver.gravity_m_per_s2.unwrap_or(0.0) * rates.dt_s,
            way_max_m: rates.way_max_m,
            close_m2: crate::solver::COINCIDENT_M2,
            gamma,
            is_first: 1,
            table_m: rates.table_m,
            friction: solver.table.map_or(0.0, |[_, friction]| friction),
            has_table: u32::from(solver.table.is_some() && rates.table_awake),
            facets: self.n_facets,
            anchors: solver.anchors.len() as u32,
            grip: rates.grip,
            grip_strain_max: rates.grip_strain_max,
            stencil_colours: self.stencil_colours.len() as u32,
            hinges: self.n_hinges,
            stiffness: plastic(|plastic| plastic.stiffness),
            hardening: plastic(|plastic| plastic.hardening),
            plastic_links: self.plastic_links.len() as u32,
            yields_at: plastic(|plastic| plastic.yields_at),
        }
    }
}

/// Index of the node at a place.
pub(super) fn node(solver: &Solver, place: usize) -> u32 {
    let layout = solver.layout;
    (place / layout.stride * layout.nodes[1] + place % layout.stride) as u32
}
