//! Which edges of one facet may cross which of another, remembered while they hardly move.
//!
//! A list holds every two edges that are nearer to each other, in the second facet's frame, than
//! twice [`MARGIN`]; while no node has gone farther than the margin there, no other two can cross.
//! So what is found does not depend on what is remembered.

use crate::frames::ordered;
use crate::topology::Topology;

/// How far nodes may go in the other facet's frame before a list is made anew, spacings.
const MARGIN: f64 = 0.3;

/// An edge of the first facet and the edges of the second that may cross it, as slots of
/// [`Topology`], ascending.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row<'a> {
    pub edge: u32,
    pub others: &'a [u32],
}

/// The list of a pair of facets.
#[derive(Debug, Clone, Default)]
struct List {
    /// (u, v) in the second facet's frame when the list was made: the nodes that the first reaches,
    /// then those of the second, metres. Empty where there is no list.
    made_m: Vec<[f64; 2]>,
    /// Whether it has the first facet's inner edges.
    inside: bool,
    /// Edges of the first facet, and where their others end.
    edges: Vec<(u32, u32)>,
    /// Slots of the second facet's.
    others: Vec<u32>,
}

/// The lists of all pairs.
#[derive(Debug, Clone, Default)]
pub(crate) struct Candidates {
    lists: Vec<List>,
    facets: usize,
}

impl Candidates {
    /// Forgets all lists.
    pub fn renew(&mut self, topology: &Topology) {
        self.facets = topology.facets.len();
        self.lists.clear();
        self.lists.resize_with(self.facets * self.facets, List::default);
    }

    /// The edges of `f` that may meet edges of `g`, where `local` is (u, v, height) over `g`.
    /// `inside`: not only where `f` ends.
    pub fn of(
        &mut self,
        topology: &Topology,
        local: &[[f64; 3]],
        [f, g]: [usize; 2],
        inside: bool,
    ) -> impl Iterator<Item = Row<'_>> {
        let list = &mut self.lists[f * self.facets + g];
        let margin_m = MARGIN * topology.mesh.spacing_max_m;
        if list.moved_m(topology, [f, g], local) > margin_m || inside && !list.inside {
            list.make(topology, [f, g], inside, local);
        }
        let starts = std::iter::once(0).chain(list.edges.iter().map(|(_, end)| *end as usize));
        let rows = list.edges.iter().zip(starts).map(|((edge, end), start)| Row {
            edge: *edge,
            others: &list.others[start..*end as usize],
        });
        rows.filter(move |row| inside || topology.ends[row.edge as usize])
    }
}

impl List {
    /// How far, metres, any node that both facets reach went from where it was. Infinite where
    /// there is no list.
    fn moved_m(&self, topology: &Topology, facets: [usize; 2], local: &[[f64; 3]]) -> f64 {
        let mut moved_m = if self.made_m.is_empty() { f64::INFINITY } else { 0f64 };
        let nodes = facets.into_iter().flat_map(|facet| &topology.facets[facet].reached);
        for (node, [a, b]) in nodes.zip(&self.made_m) {
            let [u, v, _] = local[*node as usize];
            moved_m = ordered(moved_m, ordered((u - a).abs(), (v - b).abs())[1])[1];
        }
        moved_m
    }

    fn make(&mut self, topology: &Topology, [f, g]: [usize; 2], inside: bool, local: &[[f64; 3]]) {
        let [own, other] = [f, g].map(|facet| &topology.facets[facet]);
        let nodes = own.reached.iter().chain(&other.reached);
        self.made_m.clear();
        self.made_m.extend(nodes.map(|n| [local[*n as usize][0], local[*n as usize][1]]));
        self.inside = inside;
        self.edges.clear();
        self.others.clear();
        // How far nodes of `g` are from where they are in its material.
        let slack_m = other.reached.iter().fold(0f64, |slack_m, n| {
            let ([u, v], [a, b, _]) = (topology.mesh.uv_m[*n as usize], local[*n as usize]);
            slack_m.max((u - a).abs()).max((v - b).abs())
        });
        let inner = if inside { &own.interior[..] } else { &[] };
        for edge in own.boundary.iter().chain(inner) {
            self.make_row(topology, [f, g], *edge, slack_m, local);
        }
    }

    fn make_row(
        &mut self,
        topology: &Topology,
        [f, g]: [usize; 2],
        edge: u32,
        slack_m: f64,
        local: &[[f64; 3]],
    ) {
        let mesh = &topology.mesh;
        let ends = mesh.edges[edge as usize];
        if is_on_crease(topology, ends, g) {
            return;
        }
        // Twice the way of a node, and what of an edge counts beyond its ends.
        let margin_m = (2.0 * MARGIN + 0.01) * mesh.spacing_max_m;
        let [a, b] = ends.map(|n| local[n as usize]);
        let low = [0, 1].map(|axis| a[axis].min(b[axis]) - margin_m);
        let high = [0, 1].map(|axis| a[axis].max(b[axis]) + margin_m);
        let (from, to) =
            (mesh.cell(low.map(|low| low - slack_m)), mesh.cell(high.map(|high| high + slack_m)));
        let [rows, columns] = mesh.sheet.nodes;
        let before = self.others.len();
        let is_own_end = topology.ends[edge as usize];
        // Edges that reach into these cells start at their corners.
        for i in from[0]..=(to[0] + 1).min(rows - 1) {
            let first = mesh.sheet.index(i, from[1]);
            let last = mesh.sheet.index(i, (to[1] + 1).min(columns - 1));
            for other in mesh.edges_from[first]..mesh.edges_from[last + 1] {
                let of_other = topology.of_edge[other as usize];
                let is_end = topology.ends[other as usize];
                // Two boundaries are met from both sides: once is enough. A boundary has met all.
                let twice = if is_own_end { f > g && is_end } else { is_end };
                if twice || of_other >> g & 1 == 0 || of_other >> f & 1 == 1 {
                    continue;
                }
                let others = mesh.edges[other as usize];
                let [c, d] = others.map(|n| local[n as usize]);
                let touch = ends.iter().any(|n| others.contains(n));
                if !touch
                    && !are_apart([a, b], [c, d], margin_m)
                    && !is_on_crease(topology, others, f)
                {
                    self.others.push(topology.slot(other, g) as u32);
                }
            }
        }
        if self.others.len() > before {
            self.edges.push((edge, self.others.len() as u32));
        }
    }
}

/// Whether two segments of the plane are too far from each other to cross when no end has gone
/// farther than half of `margin_m` along either axis: an axis, or one across either of them, parts
/// them.
fn are_apart([a, b]: [[f64; 3]; 2], [c, d]: [[f64; 3]; 2], margin_m: f64) -> bool {
    let parted = |[x, y]: [f64; 2], wide_m: f64| {
        let [a, b, c, d] = [a, b, c, d].map(|p| x * p[0] + y * p[1]);
        a.max(b) + wide_m < c.min(d) || c.max(d) + wide_m < a.min(b)
    };
    let across = |p: [f64; 3], q: [f64; 3]| [p[1] - q[1], q[0] - p[0]];
    let by_either = |axis: [f64; 2]| {
        let wide_m =
            std::f64::consts::SQRT_2 * margin_m * (axis[0] * axis[0] + axis[1] * axis[1]).sqrt();
        parted(axis, wide_m)
    };
    parted([1.0, 0.0], margin_m)
        || parted([0.0, 1.0], margin_m)
        || by_either(across(a, b))
        || by_either(across(c, d))
}

/// Whether both ends belong to `facet` too: then they lie on the common crease.
fn is_on_crease(topology: &Topology, ends: [u32; 2], facet: usize) -> bool {
    ends.iter().all(|n| topology.of_node[*n as usize] >> facet & 1 == 1)
}
