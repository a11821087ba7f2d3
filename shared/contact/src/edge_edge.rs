//! Edges of one facet against edges of another, along the facet's normal.
//!
//! Where facets are flat, the edges where one of them ends are enough; where they bend, ridges
//! meet too.

use crate::gap::Gaps;
use crate::near::Near;
use crate::order::Order;
use crate::pose::Pose;
use crate::push::{Worst, weighted_push};
use crate::topology::Topology;
use nalgebra::Vector3;

/// Edges farther than this from the other facet's plane, on one side, are no contact, metres.
const REACH_M: f64 = 3e-3;
/// A crossing this far outside of an edge still counts, as a share of it.
const OUTSIDE: f64 = 1e-3;
/// Edges whose directions differ by a smaller sine are parallel.
const PARALLEL: f64 = 2e-3;
/// The same in the solver, where the lengths are at most some spacings.
const PARALLEL_SOLVED: f64 = 2e-5;

/// Facets with normals nearer than this lie on each other like a stack (60°).
const STACKED_COSINE: f64 = 0.5;
/// Edges that are farther apart than this in the right order are no contact, metres: where one
/// facet ends, and inside of both.
const CLEAR_M: f64 = 2e-3;
const CLEAR_INSIDE_M: f64 = 2.5e-4;

/// Two edges, of which the first has to stay on one side of the second.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EdgeEdge {
    nodes: [u32; 4],
    facet: u8,
    sign: f64,
    gap_m: f64,
}

/// A pair of facets as seen from the second one's plane.
struct Pair<'a> {
    gaps: &'a Gaps<'a>,
    near: &'a Near,
    order: &'a Order,
    f: usize,
    g: usize,
}

/// Fills `found` with the contacts of a round. `local`: room for one position per node.
pub(crate) fn find(
    found: &mut Vec<EdgeEdge>,
    local: &mut [[f64; 3]],
    gaps: &Gaps,
    near: &Near,
    order: &Order,
    poses: &[Pose],
    x: &[Vector3<f64>],
) {
    found.clear();
    for at in 0..near.pairs.len() {
        let [f, g] = near.pairs[at].map(usize::from);
        for (f, g) in [(f, g), (g, f)] {
            if order.sign(f, g) == 0 {
                continue;
            }
            let slack_m = to_plane(gaps.topology, &poses[g], [f, g], x, local);
            let pair = Pair { gaps, near, order, f, g };
            for edge in &gaps.topology.facets[f].boundary {
                pair.against(*edge, slack_m, local, found);
            }
            if f < g && poses[f].normal.dot(&poses[g].normal).abs() > STACKED_COSINE {
                for edge in &gaps.topology.facets[f].interior {
                    pair.against(*edge, slack_m, local, found);
                }
            }
        }
    }
}

/// (u, v, height) over facet `g` for the nodes of both; how far those of `g` are from where they
/// are in its material, metres.
fn to_plane(
    topology: &Topology,
    pose: &Pose,
    facets: [usize; 2],
    x: &[Vector3<f64>],
    local: &mut [[f64; 3]],
) -> f64 {
    let mut slack_m = 0f64;
    for facet in facets {
        for (node, _) in &topology.facets[facet].core {
            let ([u, v], height) = pose.local_m(&x[*node as usize]);
            local[*node as usize] = [u, v, height];
        }
        // The edges at the boundary have ends outside.
        for edge in &topology.facets[facet].boundary {
            for node in topology.mesh.edges[*edge as usize] {
                let ([u, v], height) = pose.local_m(&x[node as usize]);
                local[node as usize] = [u, v, height];
            }
        }
    }
    for (node, _) in &topology.facets[facets[1]].core {
        let ([u, v], [a, b, _]) = (topology.mesh.uv_m[*node as usize], local[*node as usize]);
        slack_m = slack_m.max((u - a).abs()).max((v - b).abs());
    }
    slack_m
}

/// Where two segments cross in the plane, as shares of their lengths.
fn crossing([a, b]: [[f64; 3]; 2], [c, d]: [[f64; 3]; 2]) -> Option<[f64; 2]> {
    let (e, f) = ([b[0] - a[0], b[1] - a[1]], [d[0] - c[0], d[1] - c[1]]);
    let det = e[0] * f[1] - e[1] * f[0];
    let squares = (e[0] * e[0] + e[1] * e[1]) * (f[0] * f[0] + f[1] * f[1]);
    if det.is_nan() || det * det <= PARALLEL * PARALLEL * squares {
        return None;
    }
    let from = [c[0] - a[0], c[1] - a[1]];
    let at_e = (from[0] * f[1] - from[1] * f[0]) / det;
    let at_f = (from[0] * e[1] - from[1] * e[0]) / det;
    let on = -OUTSIDE..=1.0 + OUTSIDE;
    (on.contains(&at_e) && on.contains(&at_f)).then_some([at_e, at_f])
}

impl Pair<'_> {
    /// The contacts of one boundary edge of `f` with all edges of `g`.
    fn against(&self, edge: u32, slack_m: f64, local: &[[f64; 3]], found: &mut Vec<EdgeEdge>) {
        let topology = self.gaps.topology;
        let [p, q] = topology.mesh.edges[edge as usize];
        let [a, b] = [p, q].map(|n| local[n as usize]);
        if self.is_on_crease([p, q], self.g)
            || (a[2].abs().min(b[2].abs()) > REACH_M && a[2] * b[2] > 0.0)
            || self.is_contested(topology.of_edge[edge as usize], self.f, self.g)
        {
            return;
        }
        let low = [0, 1].map(|axis| a[axis].min(b[axis]) - slack_m);
        let high = [0, 1].map(|axis| a[axis].max(b[axis]) + slack_m);
        let (from, to) = (topology.mesh.cell(low), topology.mesh.cell(high));
        let [rows, columns] = topology.mesh.sheet.nodes;
        // Edges that reach into these cells start at their corners.
        for i in from[0]..=(to[0] + 1).min(rows - 1) {
            let first = topology.mesh.sheet.index(i, from[1]);
            let last = topology.mesh.sheet.index(i, (to[1] + 1).min(columns - 1));
            let edges = topology.mesh.edges_from[first]..topology.mesh.edges_from[last + 1];
            for other in edges {
                self.try_edges([edge, other], [a, b], local, found);
            }
        }
    }

    fn try_edges(
        &self,
        [edge, other]: [u32; 2],
        [a, b]: [[f64; 3]; 2],
        local: &[[f64; 3]],
        found: &mut Vec<EdgeEdge>,
    ) {
        let topology = self.gaps.topology;
        let of_other = topology.of_edge[other as usize];
        if of_other >> self.g & 1 == 0 || of_other >> self.f & 1 == 1 {
            return;
        }
        let ([p, q], [r, s]) =
            (topology.mesh.edges[edge as usize], topology.mesh.edges[other as usize]);
        let [c, d] = [r, s].map(|n| local[n as usize]);
        let apart = |axis: usize| {
            c[axis].max(d[axis]) < a[axis].min(b[axis])
                || c[axis].min(d[axis]) > a[axis].max(b[axis])
        };
        // Two boundaries are met from both sides: once is enough. A boundary has met all.
        let (ends, other_ends) = (topology.ends[edge as usize], topology.ends[other as usize]);
        let twice = if ends { self.f > self.g && other_ends } else { other_ends };
        if apart(0) || apart(1) || twice || [p, q].iter().any(|n| *n == r || *n == s) {
            return;
        }
        let Some([at_e, at_f]) = crossing([a, b], [c, d]) else { return };
        let sign = f64::from(self.order.sign(self.f, self.g));
        let height_m = a[2] + at_e * (b[2] - a[2]) - c[2] - at_f * (d[2] - c[2]);
        let clear_m = if ends { CLEAR_M } else { CLEAR_INSIDE_M };
        if sign * height_m > clear_m
            || self.is_on_crease([r, s], self.f)
            || self.is_contested(of_other, self.g, self.f)
        {
            return;
        }
        let (mine, theirs) = ([1.0 - at_e, at_e], [1.0 - at_f, at_f]);
        let gap_m = self.gaps.between(self.f, self.g, (&[p, q], &mine), (&[r, s], &theirs));
        found.push(EdgeEdge { nodes: [p, q, r, s], facet: self.g as u8, sign, gap_m });
    }

    /// Whether both ends belong to `facet` too: then they lie on the common crease.
    fn is_on_crease(&self, ends: [u32; 2], facet: usize) -> bool {
        ends.iter().all(|n| self.gaps.topology.of_node[*n as usize] >> facet & 1 == 1)
    }

    /// An edge on a crease takes the side of the facet that overlaps more.
    fn is_contested(&self, facets: u32, own: usize, over: usize) -> bool {
        let mut others = facets & !(1 << own) & !(1 << over);
        while others != 0 {
            let other = others.trailing_zeros() as usize;
            others &= others - 1;
            let sign = self.order.sign(other, over);
            if sign != 0
                && sign != self.order.sign(own, over)
                && self.near.overlap(other, over) >= self.near.overlap(own, over)
            {
                return true;
            }
        }
        false
    }
}

impl EdgeEdge {
    /// Pushes the edges apart where they are nearer than their gap.
    pub fn solve(
        &self,
        x: &mut [Vector3<f64>],
        mobility: &[f64],
        poses: &[Pose],
        flat_m2: f64,
        worst: &mut Worst,
    ) {
        let normal = &poses[usize::from(self.facet)].normal;
        let [p, q, r, s] = self.nodes.map(|n| x[n as usize]);
        // p + a·e − r − b·f = h·n
        let (e, f, from) = (q - p, s - r, r - p);
        let across = f.cross(normal);
        let det = e.dot(&across);
        if det.is_nan() || det.abs() <= PARALLEL_SOLVED * flat_m2 {
            return;
        }
        let a = from.dot(&across) / det;
        let b = -e.dot(&from.cross(normal)) / det;
        let on = -OUTSIDE..=1.0 + OUTSIDE;
        if !(on.contains(&a) && on.contains(&b)) {
            return;
        }
        let height_m = self.sign * (e * a - f * b - from).dot(normal);
        if height_m >= self.gap_m {
            return;
        }
        worst.note(self.gap_m, height_m);
        let push = normal * (self.sign * (self.gap_m - height_m));
        weighted_push(x, mobility, &self.nodes, &[1.0 - a, a, b - 1.0, -b], push);
    }
}
