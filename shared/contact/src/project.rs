//! The projection: rounds of finding contacts and sweeping over links and contacts.

use crate::edge_edge::{self, EdgeEdge};
use crate::gap::Gaps;
use crate::links;
use crate::mesh::Mesh;
use crate::near::Near;
use crate::node_triangle::{self, NodeTriangle};
use crate::order::Order;
use crate::params::{ContactConfig, ContactParams};
use crate::pose::{Opening, Pose};
use crate::push::Worst;
use crate::spine::{self, SpineContact};
use crate::topology::Topology;
use nalgebra::Vector3;
use orime_creases::Folds;
use orime_geometry::SheetGrid;

/// Sweeps over the contacts alone at a round's end: the last write to the positions.
const LAST_SWEEPS: u32 = 3;
/// A settled sheet with an edge that is longer than this gets another round, up to
/// [`LINKED_ROUNDS`].
const STRETCH_MAX: f64 = 0.03;
/// Rounds that all sweep over links, too.
const LINKED_ROUNDS: u32 = 4;

/// What a projection did. Not settling is a result, not an error.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ContactReport {
    /// Times that contacts were sought; 0 where no facet is near another.
    pub rounds: u32,
    /// Contacts that were found in the last round.
    pub constraints: u32,
    /// Largest shortfall of a gap in the last sweep, before it was mended, metres.
    pub worst_gap_m: f64,
    /// Whether every contact kept at least half its gap in the last sweep.
    pub settled: bool,
    /// Farthest that a node was moved, metres.
    pub moved_m: f64,
}

/// Keeps the layers of a folded sheet apart by the order of its facets.
#[derive(Debug)]
pub struct FacetContact {
    params: ContactParams,
    topology: Topology,
    /// Inverse masses, relative to each other.
    mobility: Vec<f64>,
    x: Vec<Vector3<f64>>,
    local: Vec<[f64; 3]>,
    seen: Vec<u32>,
    poses: Vec<Pose>,
    openings: Vec<Opening>,
    near: Near,
    order: Order,
    node_triangle: Vec<NodeTriangle>,
    edge_edge: Vec<EdgeEdge>,
    spine: Vec<SpineContact>,
}

impl FacetContact {
    /// For a sheet that is not folded yet.
    pub fn new(config: &ContactConfig, sheet: &SheetGrid) -> Self {
        let count = sheet.len();
        Self {
            params: config.params.clone(),
            topology: Topology::new(Mesh::new(sheet), &Folds::flat(sheet)),
            mobility: vec![1.0; count],
            x: vec![Vector3::zeros(); count],
            local: vec![[0.0; 3]; count],
            seen: vec![0; count],
            poses: Vec::new(),
            openings: Vec::new(),
            near: Near::new(),
            order: Order::new(),
            node_triangle: Vec::with_capacity(4 * count),
            edge_edge: Vec::with_capacity(4 * count),
            spine: Vec::with_capacity(count),
        }
    }

    /// Takes over new facets. [`FacetContact::project`] does so by itself when they change; this
    /// allocates, so a caller may choose when.
    pub fn refold(&mut self, folds: &Folds) {
        assert_eq!(folds.sheet(), &self.topology.mesh.sheet, "folds of another sheet");
        self.topology = Topology::new(self.topology.mesh.clone(), folds);
        self.poses.reserve(self.topology.facets.len());
        self.openings.reserve(self.topology.creases.len());
    }

    /// Inverse masses, relative to each other; 0 holds a node. All 1 at first.
    pub fn set_mobility(&mut self, mobility: &[f32]) {
        for (own, mobility) in self.mobility.iter_mut().zip(mobility) {
            let usable = mobility.is_finite() && *mobility >= 0.0;
            *own = if usable { f64::from(*mobility) } else { 0.0 };
        }
    }

    /// Moves the nodes so that no layer lies in another. Positions in metres, one per node, any
    /// frame in which the table, if there is one, is at a fixed z. Positions that are not finite
    /// are left as they are, all of them.
    ///
    /// The order of two facets is taken from `folds`; pairs without one are not kept apart.
    pub fn project(&mut self, positions_m: &mut [[f32; 3]], folds: &Folds) -> ContactReport {
        if self.topology.shape != folds.facets() {
            self.refold(folds);
        }
        let is_usable = positions_m.len() == self.x.len()
            && positions_m.iter().flatten().all(|c| c.is_finite());
        if !is_usable {
            return ContactReport::default();
        }
        let origin = Vector3::from(positions_m[0]).cast::<f64>();
        for (x, position) in self.x.iter_mut().zip(positions_m.iter()) {
            *x = Vector3::from(*position).cast::<f64>() - origin;
        }
        let table_m = self.params.table_m.map(|z| z - origin.z);
        let mut report = self.rounds(folds, table_m);
        if report.rounds > 0 {
            for (x, position) in self.x.iter().zip(positions_m.iter_mut()) {
                let moved = (x + origin).cast::<f32>();
                let step = moved - Vector3::from(*position);
                report.moved_m = report.moved_m.max(f64::from(step.norm()));
                *position = moved.into();
            }
        }
        report
    }

    fn rounds(&mut self, folds: &Folds, table_m: Option<f64>) -> ContactReport {
        let mut report = ContactReport { settled: true, ..ContactReport::default() };
        for round in 0..self.params.rounds {
            self.pose();
            if !self.near.find_pairs(&self.topology, &self.poses) {
                report.rounds += u32::from(self.lift(table_m));
                return ContactReport { settled: true, ..report };
            }
            self.find(folds);
            let found = self.node_triangle.len() + self.edge_edge.len() + self.spine.len();
            report.constraints = found as u32;
            report.rounds = round + 1;
            let first = self.solve(false);
            report.worst_gap_m = first.short_m;
            report.settled = first.unsettled == 0;
            let may_stay = round == 0 || round >= LINKED_ROUNDS || !self.is_stretched();
            if report.settled && may_stay {
                break;
            }
            // Links stir up what is nearly settled: then every other round goes without.
            self.sweep(round < LINKED_ROUNDS || round % 2 == 0, table_m);
        }
        report
    }

    /// Whether contacts have pulled an edge too long.
    fn is_stretched(&self) -> bool {
        let mesh = &self.topology.mesh;
        mesh.edges.iter().zip(&mesh.rest_m).any(|([a, b], rest_m)| {
            let d = self.x[*b as usize] - self.x[*a as usize];
            d.norm_squared() > ((1.0 + STRETCH_MAX) * rest_m).powi(2)
        })
    }

    fn pose(&mut self) {
        self.poses.clear();
        self.poses.extend(self.topology.facets.iter().map(|facet| Pose::fit(facet, &self.x)));
    }

    /// Fills the lists of contacts.
    fn find(&mut self, folds: &Folds) {
        let Self { topology, poses, openings, near, order, x, .. } = self;
        openings.clear();
        let creases = 0..topology.creases.len();
        openings.extend(creases.map(|crease| Opening::between(topology, crease, poses)));
        near.find_overlaps(topology, poses, x);
        order.decide(topology, folds, near, openings);
        let gaps = Gaps { params: &self.params, topology, openings };
        node_triangle::find(&mut self.node_triangle, &gaps, near, order, poses, x);
        edge_edge::find(&mut self.edge_edge, &mut self.local, &gaps, near, order, poses, x);
        let search = spine::Search { gaps: &gaps, near, order, x };
        spine::find(&mut self.spine, &mut self.seen, &search);
    }

    /// Links and contacts, then contacts alone, which are the last write.
    fn sweep(&mut self, linked: bool, table_m: Option<f64>) {
        for sweep in 0..self.params.sweeps {
            if linked {
                links::sweep(&self.topology, &mut self.x, &self.mobility, sweep % 2 == 1);
            }
            self.solve(sweep % 2 == 1);
            self.lift(table_m);
        }
        for sweep in 0..LAST_SWEEPS {
            self.solve(sweep % 2 == 1);
            self.lift(table_m);
        }
    }

    /// One sweep over the contacts.
    fn solve(&mut self, reverse: bool) -> Worst {
        let Self { x, mobility, poses, .. } = self;
        let flat_m2 = 1e-5 * self.topology.mesh.double_area_m2();
        let mut worst = Worst::default();
        for contact in &self.spine {
            contact.solve(x, mobility, &mut worst);
        }
        for contact in &self.edge_edge {
            contact.solve(x, mobility, poses, flat_m2, &mut worst);
        }
        let count = self.node_triangle.len();
        for at in 0..count {
            let contact = &self.node_triangle[if reverse { count - 1 - at } else { at }];
            contact.solve(x, mobility, poses, flat_m2, &mut worst);
        }
        worst
    }

    /// Lifts what is below the table. Whether anything was.
    fn lift(&mut self, table_m: Option<f64>) -> bool {
        let Some(table_m) = table_m else { return false };
        let mut lifted = false;
        for (x, mobility) in self.x.iter_mut().zip(&self.mobility) {
            if x.z < table_m && *mobility > 0.0 {
                x.z = table_m;
                lifted = true;
            }
        }
        lifted
    }
}
