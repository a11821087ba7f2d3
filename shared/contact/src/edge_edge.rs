//! Edges of one facet against edges of another, along the facet's normal.
//!
//! Where facets are flat, the edges where one of them ends are enough; where they bend, ridges
//! meet too.

use crate::candidates::{Candidates, Row};
use crate::frames::{Frames, OUTSIDE, is_beyond, limit, ordered};
use crate::gap::Gaps;
use crate::near::Near;
use crate::order::Order;
use crate::pose::Pose;
use crate::runs::Contact;

/// Edges farther than this from the other facet's plane, on one side, are no contact, metres.
const REACH_M: f64 = 3e-3;
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
    /// Where they crossed, as shares of their lengths.
    at: [f64; 2],
}

/// What a round needs to find them.
pub(crate) struct Search<'a> {
    pub gaps: &'a Gaps<'a>,
    pub near: &'a Near,
    pub order: &'a Order,
    pub poses: &'a [Pose],
    pub frames: &'a Frames,
}

/// Where two edges cross as seen from above, as shares of their lengths.
#[derive(Debug, Clone, Copy, Default)]
struct Crossing {
    edges: [u32; 2],
    at: [f64; 2],
}

/// Room for what is left of a pair's candidates.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sieve {
    /// Edges and slots that lie over each other and are not clear.
    beside: Vec<[u32; 2]>,
    crossings: Vec<Crossing>,
}

/// A pair of facets as seen from the second one's plane.
struct Pair<'a> {
    search: &'a Search<'a>,
    local: &'a [[f64; 3]],
    f: usize,
    g: usize,
    sign: f64,
}

impl Search<'_> {
    /// Fills `found` with the contacts of a round.
    pub fn find(&self, found: &mut Vec<EdgeEdge>, candidates: &mut Candidates, sieve: &mut Sieve) {
        found.clear();
        let topology = self.gaps.topology;
        for pair in &self.near.pairs {
            let [f, g] = pair.map(usize::from);
            for (f, g) in [(f, g), (g, f)] {
                let sign = f64::from(self.order.sign(f, g));
                if sign == 0.0 {
                    continue;
                }
                let cosine = self.poses[f].normal.dot(&self.poses[g].normal);
                let inside = f < g && cosine.abs() > STACKED_COSINE;
                let local = self.frames.over(g);
                let rows = candidates.of(topology, local, [f, g], inside);
                let pair = Pair { search: self, local, f, g, sign };
                let count = pair.sift(rows, &mut sieve.beside);
                let count = pair.cross(&sieve.beside[..count], &mut sieve.crossings);
                pair.collect(&sieve.crossings[..count], found);
            }
        }
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

/// Keeps what a test lets through, in its order, without a branch on it: such branches are guessed
/// wrong too often.
struct Kept<'a, T> {
    room: &'a mut Vec<T>,
    count: usize,
}

impl<'a, T: Copy + Default> Kept<'a, T> {
    fn new(room: &'a mut Vec<T>) -> Self {
        Self { room, count: 0 }
    }

    /// Makes room for as many more.
    fn reserve(&mut self, more: usize) {
        if self.room.len() < self.count + more {
            self.room.resize(2 * (self.count + more), T::default());
        }
    }

    fn offer(&mut self, item: T, is_kept: bool) {
        self.room[self.count] = item;
        self.count += usize::from(is_kept);
    }
}

impl Pair<'_> {
    fn clear_m(&self, edge: u32) -> f64 {
        if self.search.gaps.topology.ends[edge as usize] { CLEAR_M } else { CLEAR_INSIDE_M }
    }

    fn ends(&self, edge: u32) -> [[f64; 3]; 2] {
        let [a, b] = self.search.gaps.topology.mesh.edges[edge as usize];
        [self.local[a as usize], self.local[b as usize]]
    }

    /// Candidates that lie over each other and are not clear of each other by their heights alone.
    fn sift<'a>(&self, rows: impl Iterator<Item = Row<'a>>, room: &mut Vec<[u32; 2]>) -> usize {
        let topology = self.search.gaps.topology;
        let bounds = self.search.frames.bounds();
        let mut kept = Kept::new(room);
        for row in rows {
            let [a, b] = self.ends(row.edge);
            if (ordered(a[2].abs(), b[2].abs())[0] > REACH_M && a[2] * b[2] > 0.0)
                || self.search.is_contested(topology.of_edge[row.edge as usize], self.f, self.g)
            {
                continue;
            }
            let limit = limit([a, b], self.sign, self.clear_m(row.edge));
            kept.reserve(row.others.len());
            for slot in row.others {
                kept.offer([row.edge, *slot], !is_beyond(&bounds[*slot as usize], &limit));
            }
        }
        kept.count
    }

    /// Where they cross in the plane, if they do, and are not clear there.
    fn cross(&self, beside: &[[u32; 2]], room: &mut Vec<Crossing>) -> usize {
        let mut kept = Kept::new(room);
        kept.reserve(beside.len());
        for [edge, slot] in beside {
            let other = self.search.gaps.topology.of_slot[*slot as usize];
            let ([a, b], [c, d]) = (self.ends(*edge), self.ends(other));
            let (e, f) = ([b[0] - a[0], b[1] - a[1]], [d[0] - c[0], d[1] - c[1]]);
            let det = e[0] * f[1] - e[1] * f[0];
            let squares = (e[0] * e[0] + e[1] * e[1]) * (f[0] * f[0] + f[1] * f[1]);
            let from = [c[0] - a[0], c[1] - a[1]];
            let at_e = (from[0] * f[1] - from[1] * f[0]) / det;
            let at_f = (from[0] * e[1] - from[1] * e[0]) / det;
            let height_m = a[2] + at_e * (b[2] - a[2]) - c[2] - at_f * (d[2] - c[2]);
            // False where anything is NaN.
            let on = -OUTSIDE..=1.0 + OUTSIDE;
            let is_kept = (det * det > PARALLEL * PARALLEL * squares)
                & on.contains(&at_e)
                & on.contains(&at_f)
                & (self.sign * height_m <= self.clear_m(*edge));
            kept.offer(Crossing { edges: [*edge, other], at: [at_e, at_f] }, is_kept);
        }
        kept.count
    }

    fn collect(&self, crossings: &[Crossing], found: &mut Vec<EdgeEdge>) {
        let Search { gaps, .. } = self.search;
        let topology = gaps.topology;
        for Crossing { edges, at } in crossings {
            let [at_e, at_f] = *at;
            let of_other = topology.of_edge[edges[1] as usize];
            if self.search.is_contested(of_other, self.g, self.f) {
                continue;
            }
            let [[p, q], [r, s]] = edges.map(|edge| topology.mesh.edges[edge as usize]);
            let (mine, theirs) = ([1.0 - at_e, at_e], [1.0 - at_f, at_f]);
            let gap_m = gaps.between(self.f, self.g, (&[p, q], &mine), (&[r, s], &theirs));
            found.push(EdgeEdge {
                nodes: [p, q, r, s],
                facets: [self.f as u8, self.g as u8],
                sign: self.sign,
                gap_m,
                at: *at,
            });
        }
    }
}

impl Contact for EdgeEdge {
    fn facets(&self) -> [u8; 2] {
        self.facets
    }

    fn nodes(&self) -> [u32; 4] {
        self.nodes
    }

    fn gap_m(&self) -> f64 {
        self.gap_m
    }

    fn weights(&self) -> [f64; 4] {
        weights(self.sign, self.at)
    }

    fn weigh(&self, [p, q, r, s]: [[f64; 2]; 4], flat_m2: f64) -> Option<[f64; 4]> {
        // p + a·e = r + b·f
        let [e, f, from] = [[p, q], [r, s], [p, r]].map(|[a, b]| [b[0] - a[0], b[1] - a[1]]);
        let cross = |[a, b]: [f64; 2], [c, d]: [f64; 2]| a * d - b * c;
        let det = cross(e, f);
        if det.is_nan() || det.abs() <= PARALLEL_SOLVED * flat_m2 {
            return None;
        }
        let at = [cross(from, f) / det, cross(from, e) / det];
        let on = -OUTSIDE..=1.0 + OUTSIDE;
        at.iter().all(|at| on.contains(at)).then(|| weights(self.sign, at))
    }
}

/// Weights of the ends' heights: the first edge's height over the second's where they cross.
fn weights(sign: f64, [a, b]: [f64; 2]) -> [f64; 4] {
    [1.0 - a, a, b - 1.0, -b].map(|weight| sign * weight)
}
