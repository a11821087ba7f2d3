//! Edges of one facet against edges of another, along the facet's normal.
//!
//! Where facets are flat, the edges where one of them ends are enough; where they bend, ridges
//! meet too.

use crate::candidates::{Candidates, Row};
use crate::gap::Gaps;
use crate::near::Near;
use crate::order::Order;
use crate::pose::Pose;
use crate::push::{ROUNDING_M, Worst, weighted_push};
use crate::runs::{Contact, Room};
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
    facets: [u8; 2],
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

/// Fills `found` with the contacts of a round.
pub(crate) fn find(
    found: &mut Vec<EdgeEdge>,
    candidates: &mut Candidates,
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
            let inside = f < g && poses[f].normal.dot(&poses[g].normal).abs() > STACKED_COSINE;
            let (rows, local) = candidates.of(gaps.topology, &poses[g], [f, g], inside, x);
            let pair = Pair { gaps, near, order, f, g };
            for row in rows {
                pair.against(row, local, found);
            }
        }
    }
}

/// Whether two segments lie beside each other in the plane.
fn beside([a, b]: [[f64; 3]; 2], [c, d]: [[f64; 3]; 2]) -> bool {
    let apart = |axis: usize| {
        c[axis].max(d[axis]) < a[axis].min(b[axis]) || c[axis].min(d[axis]) > a[axis].max(b[axis])
    };
    apart(0) || apart(1)
}

/// No crossing of two segments is less high than this, in the direction of `sign`, metres.
fn least_height_m([a, b]: [f64; 2], [c, d]: [f64; 2], sign: f64) -> f64 {
    let [a, b, c, d] = [a, b, c, d].map(|height_m| sign * height_m);
    // A little may lie outside of the ends, and rounding.
    let outside_m = 2.0 * OUTSIDE * ((a - b).abs() + (c - d).abs()) + ROUNDING_M;
    a.min(b) - c.max(d) - outside_m
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
    /// The contacts of one edge of `f` with those edges of `g` that may cross it.
    fn against(&self, row: Row<'_>, local: &[[f64; 3]], found: &mut Vec<EdgeEdge>) {
        let topology = self.gaps.topology;
        let [a, b] = topology.mesh.edges[row.edge as usize].map(|n| local[n as usize]);
        if (a[2].abs().min(b[2].abs()) > REACH_M && a[2] * b[2] > 0.0)
            || self.is_contested(topology.of_edge[row.edge as usize], self.f, self.g)
        {
            return;
        }
        for other in row.others {
            self.try_edges([row.edge, *other], [a, b], local, found);
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
        let [r, s] = topology.mesh.edges[other as usize];
        let [c, d] = [r, s].map(|n| local[n as usize]);
        let sign = f64::from(self.order.sign(self.f, self.g));
        let ends = topology.ends[edge as usize];
        let clear_m = if ends { CLEAR_M } else { CLEAR_INSIDE_M };
        if beside([a, b], [c, d]) || least_height_m([a[2], b[2]], [c[2], d[2]], sign) > clear_m {
            return;
        }
        let Some([at_e, at_f]) = crossing([a, b], [c, d]) else { return };
        let height_m = a[2] + at_e * (b[2] - a[2]) - c[2] - at_f * (d[2] - c[2]);
        let of_other = topology.of_edge[other as usize];
        if sign * height_m > clear_m || self.is_contested(of_other, self.g, self.f) {
            return;
        }
        let [p, q] = topology.mesh.edges[edge as usize];
        let (mine, theirs) = ([1.0 - at_e, at_e], [1.0 - at_f, at_f]);
        let gap_m = self.gaps.between(self.f, self.g, (&[p, q], &mine), (&[r, s], &theirs));
        found.push(EdgeEdge {
            nodes: [p, q, r, s],
            facets: [self.f as u8, self.g as u8],
            sign,
            gap_m,
        });
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

impl Contact for EdgeEdge {
    fn facets(&self) -> [u8; 2] {
        self.facets
    }

    fn nodes(&self) -> [u32; 4] {
        self.nodes
    }

    fn is_clear(&self, heights_m: &[f64]) -> bool {
        let [p, q, r, s] = self.nodes.map(|n| heights_m[n as usize]);
        least_height_m([p, q], [r, s], self.sign) > self.gap_m
    }

    fn solve(&self, room: &mut Room<'_>, worst: &mut Worst) -> bool {
        let normal = &room.poses[usize::from(self.facets[1])].normal;
        let [p, q, r, s] = self.nodes.map(|n| room.x[n as usize]);
        // p + a·e − r − b·f = h·n
        let (e, f, from) = (q - p, s - r, r - p);
        let across = f.cross(normal);
        let det = e.dot(&across);
        if det.is_nan() || det.abs() <= PARALLEL_SOLVED * room.flat_m2 {
            return false;
        }
        let a = from.dot(&across) / det;
        let b = -e.dot(&from.cross(normal)) / det;
        let on = -OUTSIDE..=1.0 + OUTSIDE;
        if !(on.contains(&a) && on.contains(&b)) {
            return false;
        }
        let height_m = self.sign * (e * a - f * b - from).dot(normal);
        if height_m >= self.gap_m {
            return false;
        }
        worst.note(self.gap_m, height_m);
        let push = normal * (self.sign * (self.gap_m - height_m));
        weighted_push(room.x, room.mobility, &self.nodes, &[1.0 - a, a, b - 1.0, -b], push);
        true
    }
}
