//! The solver: what a substep does, pass by pass, over structures of arrays.
//!
//! Per substep of length `dt` (Macklin et al. 2019, "Small Steps": one iteration each):
//!
//! ```text
//! x° = x;  v ← (v − g·dt)·e^(−drag·dt);  x ← x + v·dt                       (motion.rs)
//! track:     x ← x + (t − x)·r,  r = 1/(1 + 1/(c·ω²dt²)),  |(t − x)·r| ≤ a_max·dt²; with contact,
//!            r fades where links beside the node are stretched              (fade.rs)
//! grippers:  the held point goes a share of the way to its gripper          (grips.rs)
//! bend:      hinges and twists, where it is not skip links                  (plate.rs)
//! links:     colour by colour                                               (project.rs)
//! crease:    hinges turn towards their rest angle                           (crease.rs)
//! facets:    x ← x + k·(g − x), g = the facet's best rigid pose             (facets.rs)
//! contact:   whatever the caller's does
//! table:     z ≥ height, and friction                                       (motion.rs)
//! v ← v + (x − x̂)/dt, x̂ = x after inertia: (x − x°)/dt without its rounding
//! ```
//!
//! Source: Macklin et al. 2016 (XPBD), equations 17 and 26. Deviation: the target springs are
//! scaled by mass (a frequency, not a stiffness), so that one setting fits any sheet.

pub(crate) mod crease;
pub(crate) mod facets;
mod fade;
pub(crate) mod links;
mod motion;
mod plate;
mod project;
mod substep;

pub(crate) use plate::Stencils;
#[cfg(feature = "gpu")]
pub(crate) use project::COINCIDENT_M2;
pub(crate) use project::Damp;
pub(crate) use substep::{Hooks, Rates};

use crate::effect::Effect;
use crate::grips::Anchor;
use crate::params::{BendKind, CreaseKind, DampingKind, SimulateParams};
use crease::{Hinge, Plastic, PlasticLink};
use facets::{Away, FacetTable, FitFacet, Frame};
use links::{Colour, Seam, Wanted, coloured, facets_of_place};
use motion::Lowest;
use orime_creases::Folds;
use orime_geometry::SheetGrid;
use orime_lanes::{Field, Layout, Width, scatter};

/// What pulls the nodes: places and how much.
#[derive(Debug, Clone)]
pub(crate) struct Targets {
    /// Places, metres.
    pub at_m: [Field; 3],
    /// Confidence of each, 0 for none.
    pub confidence: Field,
    /// Share of the way in a substep, from the confidence.
    pub ratio: Field,
    /// The same, faded where links are stretched.
    pub faded: Field,
    /// How many pull.
    pub count: u32,
}

impl Targets {
    /// Nothing pulls.
    pub fn new(layout: Layout) -> Self {
        let [confidence, ratio, faded] = layout.fields();
        Self { at_m: layout.fields(), confidence, ratio, faded, count: 0 }
    }
}

/// The mass points, and what acts on them. An effect that is not named is `None` or empty.
#[derive(Debug, Clone)]
pub(crate) struct Solver {
    pub layout: Layout,
    pub width: Width,
    /// Positions, metres, relative to the simulator's origin.
    pub x: [Field; 3],
    /// Velocities, m/s.
    pub v: [Field; 3],
    /// Positions at the substep's start.
    pub before: [Field; 3],
    /// Positions after inertia.
    pub ahead: [Field; 3],
    /// Inverse masses in units of an ordinary node's, where not all are 1.
    pub weights: Option<Field>,
    /// Inverse mass of an ordinary node, 1/kg.
    pub inverse_mass_per_kg: f32,
    pub gravity_m_per_s2: Option<f32>,
    pub drag_per_s: Option<f32>,
    pub targets: Option<Targets>,
    pub anchors: Vec<Anchor>,
    pub colours: Vec<Colour>,
    /// Hinges and twists of a sheet that bends as a plate, in colours.
    pub plate: Vec<Stencils>,
    /// Its flexural rigidity, N·m.
    rigidity_n_m: f64,
    pub seams: Vec<Seam>,
    /// Compliances of stretch, shear and bend, m/N.
    pub compliance_m_per_n: [f32; 3],
    pub damping: Option<(Damp, f32)>,
    pub facet_table: Option<FacetTable>,
    pub hold_facets: Option<f32>,
    /// Share of that which each facet gets; 1 beyond the end.
    pub facet_shares: Vec<f32>,
    pub plastic: Option<Plastic>,
    pub hinges: Vec<Hinge>,
    pub plastic_links: Vec<PlasticLink>,
    is_paper_plastic: bool,
    yields_everywhere: bool,
    /// Height and friction of the table.
    pub table: Option<[f32; 2]>,
    pub has_contact: bool,
    /// Room for the moves of close links.
    pub moves: Vec<Field>,
    /// Substeps so far; facets are gone through forwards and backwards in turn.
    pub substeps: u32,
}

impl Solver {
    /// The solver of these effects, at rest in its rest shape.
    pub fn new(
        params: &SimulateParams,
        sheet: &SheetGrid,
        inverse_mass_per_kg: f32,
        rest_m: Option<&[[f32; 3]]>,
    ) -> Self {
        let layout = Layout::new(sheet);
        let has = |effect| params.effects.contains(&effect);
        let named = |effect, value: f64| (has(effect) && value != 0.0).then_some(value as f32);
        let is_paper_plastic = has(Effect::Crease) && params.crease.kind != CreaseKind::Hinge;
        let yields_everywhere = params.crease.kind == CreaseKind::Everywhere;
        let is_plate = has(Effect::Bend) && params.bend.kind == BendKind::Hinge;
        let no_link = |effect: &Effect| is_plate && *effect == Effect::Bend;
        let effects: Vec<Effect> =
            params.effects.iter().copied().filter(|effect| !no_link(effect)).collect();
        let wanted = Wanted {
            effects: &effects,
            reach: params.bend.reach as usize,
            rest_m,
            each: is_paper_plastic,
        };
        let colours = coloured(sheet, &wanted);
        let damping = named(Effect::Damping, params.damping.time_s).map(|time_s| {
            let kind = params.damping.kind;
            (if kind == DampingKind::Paper { Damp::Paper } else { Damp::Xpbd }, time_s)
        });
        let hold_facets = named(Effect::Facets, params.facets.strength);
        let hinges = has(Effect::Crease) && params.crease.kind == CreaseKind::Hinge;
        let mut solver = Self {
            layout,
            width: Width::available()[0],
            x: layout.fields(),
            v: layout.fields(),
            before: layout.fields(),
            ahead: layout.fields(),
            weights: None,
            inverse_mass_per_kg,
            gravity_m_per_s2: named(Effect::Gravity, params.gravity.acceleration_m_per_s2),
            drag_per_s: named(Effect::AirDrag, params.air_drag.per_s),
            targets: has(Effect::Track).then(|| Targets::new(layout)),
            anchors: Vec::new(),
            seams: Vec::new(),
            compliance_m_per_n: [
                params.stretch.compliance_m_per_n as f32,
                params.shear.compliance_m_per_n as f32,
                params.bend.compliance_m_per_n as f32,
            ],
            damping,
            facet_table: (hold_facets.is_some() || hinges || has(Effect::SelfContact))
                .then(|| FacetTable::new(sheet)),
            hold_facets,
            facet_shares: Vec::new(),
            plastic: has(Effect::Crease).then(|| params.crease.plastic()),
            hinges: Vec::new(),
            plastic_links: Vec::new(),
            is_paper_plastic,
            yields_everywhere,
            table: has(Effect::Table)
                .then_some([params.table.height_m as f32, params.table.friction as f32]),
            has_contact: has(Effect::SelfContact),
            moves: Vec::new(),
            colours,
            plate: if is_plate { plate::plate(sheet) } else { Vec::new() },
            rigidity_n_m: params.bend.rigidity_n_m,
            substeps: 0,
        };
        solver.make_room();
        scatter(layout, rest_m.unwrap_or(&sheet.flat_m()), &mut solver.x);
        solver
    }

    /// Inverse masses per node in units of an ordinary one's, index order; 0 pins a node.
    pub fn set_weights(&mut self, weights: &[f32]) {
        let mut field = self.layout.field();
        for (place, weight) in self.layout.places().zip(weights) {
            field.rows_mut()[place] = *weight;
        }
        self.weights = Some(field);
        self.make_room();
    }

    fn make_room(&mut self) {
        let lopsided =
            self.weights.is_some() || self.damping.is_some_and(|(damp, _)| damp == Damp::Paper);
        let close = self.colours.iter().any(Colour::is_close);
        let fields = usize::from(close) * if lopsided { 6 } else { 3 };
        self.moves.resize_with(fields, || self.layout.field());
    }

    /// Takes over facets and creases.
    pub fn set_folds(&mut self, folds: &Folds, keep_creases: bool) {
        let facets = facets_of_place(self.layout, folds);
        self.seams.clear();
        for colour in &mut self.colours {
            colour.cross(&facets, self.is_paper_plastic, &mut self.seams);
        }
        for stencils in &mut self.plate {
            stencils.cross(&facets);
        }
        if let Some(table) = &mut self.facet_table {
            table.set(self.layout, folds);
        }
        let Some(plastic) = self.plastic else { return };
        if self.yields_everywhere {
            if self.plastic_links.is_empty() {
                // As if no two places shared a facet.
                let apart = vec![0; facets.len()];
                self.plastic_links = crease::plastic_links(&mut self.colours, &apart, &[]);
            }
        } else if self.is_paper_plastic {
            let links = crease::plastic_links(&mut self.colours, &facets, &self.plastic_links);
            self.plastic_links = links;
        } else {
            let known = if keep_creases { &self.hinges[..] } else { &[] };
            self.hinges = Hinge::all(folds, &plastic, known);
        }
    }

    /// Lets what is plastic by the frame yield.
    pub fn yield_creases(&mut self) {
        if let (Some(plastic), false) = (&self.plastic, self.plastic_links.is_empty()) {
            crease::yield_links(&self.plastic_links, plastic, &self.x, &mut self.colours);
        }
    }

    /// Lowest height that a node, or what pulls it, comes to within `ahead_s` of free motion,
    /// metres.
    pub fn lowest_m(&self, ahead_s: f32) -> f32 {
        let targets = self.targets.as_ref().filter(|targets| targets.count > 0);
        let mut lowest_m = f32::INFINITY;
        self.width.run(Lowest {
            len: self.len(),
            z: &self.x[2],
            v_z: &self.v[2],
            ahead_s,
            targets: targets.map(|targets| (&targets.at_m[2], &targets.confidence)),
            lowest_m: &mut lowest_m,
        });
        let fall_m_per_s2 = self.gravity_m_per_s2.unwrap_or(0.0).abs();
        let held = self.anchors.iter().map(|anchor| anchor.position_m[2]);
        held.fold(lowest_m, f32::min) - fall_m_per_s2 * ahead_s * ahead_s
    }

    /// How far the nodes are at most from one flat, unstretched sheet through the first facet,
    /// metres; infinite where no facets are kept.
    pub fn unflat_m(&self) -> f32 {
        let Some(table) = self.facet_table.as_ref() else { return f32::INFINITY };
        let Some(first) = table.facets.first() else { return f32::INFINITY };
        let (uv_m, x) = (&table.uv_m, &self.x);
        let mut frame = Frame { center_m: [0.0; 3], u: [0.0; 3], v: [0.0; 3] };
        self.width.run(FitFacet { nodes: first, uv_m, x, frame: &mut frame });
        let (center_uv_m, mut worst_m2) = (first.center_uv_m, 0.0);
        for nodes in &table.facets {
            let (frame, worst_m2) = (&frame, &mut worst_m2);
            self.width.run(Away { nodes, center_uv_m, uv_m, frame, x, worst_m2 });
        }
        worst_m2.sqrt()
    }

    /// Numbers of a field that passes go through.
    pub fn len(&self) -> usize {
        self.layout.size()
    }

    /// Bytes that an effect takes, or, for `None`, the nodes.
    pub fn bytes(&self, effect: Option<Effect>) -> usize {
        let fields = |fields: &[Field]| fields.iter().map(Field::bytes).sum::<usize>();
        let colours = |effect| {
            let of = self.colours.iter().filter(|colour| colour.effect == effect);
            of.map(Colour::bytes).sum::<usize>()
        };
        match effect {
            None => {
                let nodes = [&self.x, &self.v, &self.before, &self.ahead];
                nodes.into_iter().map(|f| fields(f)).sum::<usize>()
                    + fields(&self.moves)
                    + self.weights.as_ref().map_or(0, Field::bytes)
            }
            Some(Effect::Stretch) => colours(Effect::Stretch) + size_of_val(&self.seams[..]),
            Some(Effect::Shear) => colours(Effect::Shear),
            Some(Effect::Bend) => {
                colours(Effect::Bend) + self.plate.iter().map(Stencils::bytes).sum::<usize>()
            }
            Some(Effect::Crease) => {
                size_of_val(&self.hinges[..]) + size_of_val(&self.plastic_links[..])
            }
            Some(Effect::Facets) => self.facet_table.as_ref().map_or(0, FacetTable::bytes),
            Some(Effect::Grippers) => size_of_val(&self.anchors[..]),
            Some(Effect::Track) => self.targets.as_ref().map_or(0, |targets| {
                fields(&targets.at_m)
                    + [&targets.confidence, &targets.ratio, &targets.faded]
                        .map(Field::bytes)
                        .iter()
                        .sum::<usize>()
            }),
            Some(_) => 0,
        }
    }
}
