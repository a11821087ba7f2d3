//! The projection: rounds of finding contacts and sweeping over links and contacts.

use crate::candidates::Candidates;
use crate::edge_edge::{self, EdgeEdge, Sieve};
use crate::frames::Frames;
use crate::gap::Gaps;
use crate::mesh::Mesh;
use crate::near::Near;
use crate::node_triangle::{self, NodeTriangle};
use crate::order::Order;
use crate::params::{ContactConfig, ContactParams};
use crate::pose::{Opening, Pose};
use crate::push::Worst;
use crate::runs::{Room, Runs};
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
#[derive(Debug, Clone)]
pub struct FacetContact {
    params: ContactParams,
    topology: Topology,
    /// Inverse masses, relative to each other.
    mobility: Vec<f64>,
    x: Vec<Vector3<f64>>,
    candidates: Candidates,
    frames: Frames,
    sieve: Sieve,
    seen: Vec<u32>,
    poses: Vec<Pose>,
    openings: Vec<Opening>,
    near: Near,
    order: Order,
    node_triangle: Vec<NodeTriangle>,
    edge_edge: Vec<EdgeEdge>,
    spine: Vec<SpineContact>,
    node_triangle_runs: Runs,
    edge_edge_runs: Runs,
    local: Vec<[f64; 3]>,
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
            candidates: Candidates::default(),
            frames: Frames::default(),
            sieve: Sieve::default(),
            seen: vec![0; count],
            poses: Vec::new(),
            openings: Vec::new(),
            near: Near::new(),
            order: Order::new(),
            node_triangle: Vec::with_capacity(4 * count),
            edge_edge: Vec::with_capacity(4 * count),
            spine: Vec::with_capacity(count),
            node_triangle_runs: Runs::default(),
            edge_edge_runs: Runs::default(),
            local: vec![[0.0; 3]; count],
        }
    }

    /// Takes over new facets. [`FacetContact::project`] does so by itself when they change; this
    /// allocates, so a caller may choose when.
    pub fn refold(&mut self, folds: &Folds) {
        assert_eq!(folds.sheet(), &self.topology.mesh.sheet, "folds of another sheet");
        self.topology = Topology::new(self.topology.mesh.clone(), folds);
        self.candidates.renew(&self.topology);
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
            let first = self.solve(false, false);
            report.worst_gap_m = first.short_m;
            report.settled = first.unsettled == 0;
            let stretched = round < LINKED_ROUNDS && self.is_stretched();
            if report.settled && !stretched {
                break;
            }
            // Links stir up what is nearly settled: then every other round goes without.
            let linked = round < LINKED_ROUNDS || round % 2 == 0;
            self.sweep(linked, stretched, table_m);
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
        let Self { topology, poses, openings, near, frames, order, x, .. } = self;
        openings.clear();
        let creases = 0..topology.creases.len();
        openings.extend(creases.map(|crease| Opening::between(topology, crease, poses)));
        frames.look(topology, near, poses, x);
        near.find_overlaps(topology, frames);
        order.decide(topology, folds, near, openings);
        let gaps = Gaps { params: &self.params, topology, openings };
        let search = node_triangle::Search { gaps: &gaps, near, order, frames };
        search.find(&mut self.node_triangle);
        let search = edge_edge::Search { gaps: &gaps, near, order, poses, frames };
        search.find(&mut self.edge_edge, &mut self.candidates, &mut self.sieve);
        self.node_triangle_runs.part(&self.node_triangle, &self.frames, self.x.len());
        self.edge_edge_runs.part(&self.edge_edge, &self.frames, self.x.len());
        let x = &self.x;
        let search = spine::Search { gaps: &gaps, near, order, x };
        spine::find(&mut self.spine, &mut self.seen, &search);
    }

    /// Links and contacts, until neither undoes the other's work; then contacts alone, which are
    /// the last write.
    fn sweep(&mut self, linked: bool, stretched: bool, table_m: Option<f64>) {
        for sweep in 0..self.params.sweeps {
            if linked {
                self.topology.links.sweep(&mut self.x, &self.mobility, sweep % 2 == 1);
            }
            let worst = self.solve(sweep % 2 == 1, linked);
            let lifted = self.lift(table_m);
            if worst.unsettled == 0 && !stretched && !lifted {
                break;
            }
        }
        for sweep in 0..LAST_SWEEPS {
            let worst = self.solve(sweep % 2 == 1, false);
            if !self.lift(table_m) && worst.count == 0 {
                break;
            }
        }
    }

    /// One sweep over the contacts; `slid`: whether anything else has moved nodes since the last.
    fn solve(&mut self, reverse: bool, slid: bool) -> Worst {
        let Self { x, mobility, poses, local, .. } = self;
        let spacing_m = self.topology.mesh.spacing_max_m;
        let flat_m2 = node_triangle::FLAT * self.topology.mesh.double_area_m2;
        let mut worst = Worst::default();
        for contact in &self.spine {
            contact.solve(x, mobility, &mut worst);
        }
        let mut room = Room { x, mobility, poses, spacing_m, flat_m2, slid, local };
        self.edge_edge_runs.sweep(&self.edge_edge, false, &mut room, &mut worst);
        self.node_triangle_runs.sweep(&self.node_triangle, reverse, &mut room, &mut worst);
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

#[cfg(test)]
mod tests {
    use super::*;
    use orime_creases::Line;

    fn sheet() -> SheetGrid {
        SheetGrid::new([0.15, 0.15], [25, 25])
    }

    fn contact(params: ContactParams) -> FacetContact {
        FacetContact::new(&params.check().unwrap(), &sheet())
    }

    /// The sheet folded along u = 0.075 by an angle, the moving half shifted by `down_m`.
    fn book(degrees: f64, down_m: f64) -> Vec<[f32; 3]> {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let fold = |[u, v]: [f64; 2]| {
            let over = (u - 0.075f64).max(0.0);
            let down_m = down_m * (over / 0.01).min(1.0);
            [(u.min(0.075) + over * cos) as f32, v as f32, (over * sin - down_m) as f32]
        };
        sheet().uv_m().map(fold).collect()
    }

    fn folds() -> Folds {
        let mut folds = Folds::flat(&sheet());
        folds.split(0, &Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
        folds.observe(&book(120.0, 0.0));
        folds
    }

    #[test]
    fn nothing_near_means_nothing_done() {
        let mut contact = contact(ContactParams::default());
        for degrees in [0.0, 30.0, 85.0] {
            let before = book(degrees, 0.0);
            let mut x = before.clone();
            let report = contact.project(&mut x, &folds());
            assert_eq!((report.rounds, report.settled, x), (0, true, before));
        }
    }

    #[test]
    fn a_half_that_is_pushed_through_comes_back_on_its_side() {
        let mut contact = contact(ContactParams::default());
        let mut x = book(180.0, 5e-4);
        let report = contact.project(&mut x, &folds());
        assert!(report.settled && report.moved_m > 2e-4, "{report:?}");
        let sheet = sheet();
        for i in 14..25 {
            for j in 0..25 {
                let (low, high) = (x[sheet.index(24 - i, j)][2], x[sheet.index(i, j)][2]);
                assert!(high > low + 0.45e-4, "{high} over {low} at {i}, {j}");
            }
        }
        // Doing it again changes little, and an order that is not known does nothing.
        let report = contact.project(&mut x, &folds());
        assert!(report.rounds == 1 && report.moved_m < 5e-5, "{report:?}");
        let mut unknown = folds();
        unknown.set_order(0, 1, 0);
        unknown.set_order(1, 0, 0);
        let crossing = book(180.0, 5e-4);
        x.clone_from(&crossing);
        assert_eq!(contact.project(&mut x, &unknown).constraints, 0);
        assert_eq!(x, crossing);
    }

    #[test]
    fn results_repeat_bit_for_bit_and_do_not_know_what_was_before() {
        let (mut first, mut second) =
            (contact(ContactParams::default()), contact(ContactParams::default()));
        second.project(&mut book(178.0, 1e-3), &folds());
        let (mut a, mut b) = (book(180.0, 7e-4), book(180.0, 7e-4));
        assert_eq!(first.project(&mut a, &folds()), second.project(&mut b, &folds()));
        assert_eq!(a, b);
    }

    #[test]
    fn what_is_remembered_of_edges_changes_nothing() {
        let mut old = contact(ContactParams::default());
        let folds = folds();
        let mut found = [0; 2];
        // The upper half slides and sinks; lists last for some steps and are made anew at others.
        for step in 0..60 {
            let slid_m = 4e-5 * f64::from(step);
            let mut x = book(180.0 - 0.02 * f64::from(step % 7), 1e-4 * f64::from(step % 5));
            for (p, uv) in x.iter_mut().zip(sheet().uv_m()) {
                p[1] += (slid_m * (uv[0] - 0.075).max(0.0) / 0.075) as f32;
            }
            let mut fresh = x.clone();
            let report = old.project(&mut x, &folds);
            let expected = contact(ContactParams::default()).project(&mut fresh, &folds);
            assert_eq!((report, &x), (expected, &fresh), "step {step}");
            found[usize::from(report.moved_m > 0.0)] += 1;
        }
        assert!(found[1] > 20, "{found:?}: little was done, little was tested");
    }

    /// Where two segments of the plane cross, as shares of them, by their equations alone.
    fn crossing([a, b]: [[f64; 3]; 2], [c, d]: [[f64; 3]; 2]) -> Option<[f64; 2]> {
        let columns = nalgebra::Matrix2::new(b[0] - a[0], c[0] - d[0], b[1] - a[1], c[1] - d[1]);
        let sine = columns.determinant() / (columns.column(0).norm() * columns.column(1).norm());
        let at = columns.try_inverse()? * nalgebra::Vector2::new(c[0] - a[0], c[1] - a[1]);
        let on = at.iter().all(|at| (-0.001..=1.001).contains(at));
        (sine.abs() > 0.002 && on).then_some([at.x, at.y])
    }

    #[test]
    fn edges_that_meet_are_those_of_a_search_over_all() {
        use crate::runs::Contact;
        let mut contact = contact(ContactParams::default());
        let folds = folds();
        contact.refold(&folds);
        // Askew, so that edges cross off their ends, and partly through each other.
        for (x, ([a, b, c], [u, v])) in contact
            .x
            .iter_mut()
            .zip(book(179.0, 3e-4).into_iter().map(|p| p.map(f64::from)).zip(sheet().uv_m()))
        {
            let over = (u - 0.075).max(0.0);
            *x = Vector3::new(a + 0.05 * over, b + 0.04 * over, c + 2e-4 * (90.0 * v).sin());
        }
        contact.pose();
        assert!(contact.near.find_pairs(&contact.topology, &contact.poses));
        contact.find(&folds);
        let topology = &contact.topology;
        let mut all = Vec::new();
        for [f, g] in [[0, 1], [1, 0]] {
            let of = |facet: usize| {
                let edges = 0..topology.mesh.edges.len();
                edges.filter(move |e| topology.of_edge[*e] == 1 << facet)
            };
            let at = |edge: usize| {
                topology.mesh.edges[edge].map(|n| {
                    let ([u, v], h) = contact.poses[g].local_m(&contact.x[n as usize]);
                    [u, v, h]
                })
            };
            for (e, d) in of(f).flat_map(|e| of(g).map(move |d| (e, d))) {
                let ends = [e, d].map(|edge| topology.ends[edge]);
                let [p, q] = [e, d].map(|edge| topology.mesh.edges[edge]);
                // Inner edges meet inner ones once, and where a facet ends it meets all.
                let once = if ends[0] { f < g || !ends[1] } else { f < g && !ends[1] };
                if !once || p.iter().any(|n| q.contains(n)) {
                    continue;
                }
                let (mine, theirs) = (at(e), at(d));
                let Some([s, t]) = crossing(mine, theirs) else { continue };
                let height = |[a, b]: [[f64; 3]; 2], s: f64| a[2] + s * (b[2] - a[2]);
                let above_m =
                    f64::from(contact.order.sign(f, g)) * (height(mine, s) - height(theirs, t));
                if above_m <= if ends[0] { 2e-3 } else { 2.5e-4 } {
                    all.push([p[0], p[1], q[0], q[1]]);
                }
            }
        }
        let mut found: Vec<[u32; 4]> = contact.edge_edge.iter().map(Contact::nodes).collect();
        found.sort_unstable();
        all.sort_unstable();
        assert!(found.len() > 500, "{} contacts: little is tested", found.len());
        assert!(found == all, "{} found, {} there are", found.len(), all.len());
    }

    #[test]
    fn held_nodes_stay_and_the_table_bears() {
        let mut contact =
            contact(ContactParams { table_m: Some(-1e-4), ..ContactParams::default() });
        let mut mobility = vec![1.0; 625];
        mobility[..300].fill(0.0);
        contact.set_mobility(&mobility);
        let before = book(180.0, 5e-4);
        let mut x = before.clone();
        contact.project(&mut x, &folds());
        assert_eq!(x[..300], before[..300]);
        assert!(x[325..].iter().all(|p| p[2] >= -1.1e-4));
    }

    #[test]
    fn what_is_not_finite_is_left_alone() {
        let mut contact = contact(ContactParams::default());
        let mut x = book(180.0, 5e-4);
        x[77][1] = f32::NAN;
        let before = x.clone();
        assert_eq!(contact.project(&mut x, &folds()), ContactReport::default());
        assert!(
            x.iter()
                .flatten()
                .zip(before.iter().flatten())
                .all(|(a, b)| a.to_bits() == b.to_bits())
        );
        assert_eq!(contact.project(&mut x[..10], &folds()), ContactReport::default());
    }
}
