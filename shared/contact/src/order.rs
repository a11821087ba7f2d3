//! Which facet lies on which side of which, in one round.

use crate::near::Near;
use crate::pose::Opening;
use crate::topology::Topology;
use orime_creases::{FACETS_MAX, Folds};

/// Across a crease with a cosine below this, what lies on one facet lies on the same side of the
/// other (60°).
const FLAT_COSINE: f64 = -0.5;
/// Two creases with cosines above this can meet back to back (60°).
const SHARP_COSINE: f64 = 0.5;
/// Inward directions with a product below this are opposite.
const OPPOSITE: f64 = -0.5;
/// Axes with a product above this are parallel.
const PARALLEL: f64 = 0.9;
/// Creases without a common corner meet back to back if their middles are this near, metres:
/// along the wedge, and across it.
const BACK_TO_BACK_M: [f64; 2] = [0.010, 0.005];

/// Signs as in [`Folds::order`], and creases that meet back to back.
#[derive(Debug, Clone)]
pub(crate) struct Order {
    sign: Box<[[i8; FACETS_MAX]; FACETS_MAX]>,
    /// Creases that meet back to back.
    pub facing: Vec<Facing>,
}

/// Two creases, back to back.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facing {
    pub creases: [usize; 2],
    /// The corner that they share, material, if they do, metres.
    pub corner_m: Option<[f64; 2]>,
}

impl Order {
    pub fn new() -> Self {
        Self {
            sign: Box::new([[0; FACETS_MAX]; FACETS_MAX]),
            facing: Vec::with_capacity(FACETS_MAX),
        }
    }

    /// Side of facet `g` on which facet `f` has to stay: 1 or −1, 0 for either.
    pub fn sign(&self, f: usize, g: usize) -> i8 {
        self.sign[f][g]
    }

    pub fn decide(
        &mut self,
        topology: &Topology,
        folds: &Folds,
        near: &Near,
        openings: &[Opening],
    ) {
        let count = topology.facets.len();
        for f in 0..count {
            for g in 0..count {
                self.sign[f][g] = effective(topology, folds, near, openings, [f, g]);
            }
        }
        self.find_facing(topology, near, openings);
        for at in 0..self.facing.len() {
            let [c, d] = self.facing[at].creases.map(|c| topology.creases[c].facets);
            for f in c {
                for g in d {
                    self.sign[f][g] = 0;
                    self.sign[g][f] = 0;
                }
            }
        }
    }

    /// Creases that are folded sharply and meet spine to spine: their facets have no order.
    fn find_facing(&mut self, topology: &Topology, near: &Near, openings: &[Opening]) {
        self.facing.clear();
        for c in 0..openings.len() {
            for d in 0..c {
                let (a, b) = (&openings[c], &openings[d]);
                if a.cosine < SHARP_COSINE || b.cosine < SHARP_COSINE {
                    continue;
                }
                self.facing.extend(meet(topology, near, [c, d], [a, b]));
            }
        }
    }
}

/// A pair that does not overlap goes by a neighbour that does: across a flat crease it takes the
/// neighbour's order; across a sharper one that says otherwise nothing is known.
fn effective(
    topology: &Topology,
    folds: &Folds,
    near: &Near,
    openings: &[Opening],
    [f, g]: [usize; 2],
) -> i8 {
    let own = folds.order(f, g);
    if f == g || near.overlap(f, g) > 0 {
        return own;
    }
    let mut sign = own;
    let mut most = 0;
    for (mine, theirs) in [(f, g), (g, f)] {
        for crease in &topology.facets[mine].creases {
            let [left, right] = topology.creases[*crease].facets;
            let other = if left == mine { right } else { left };
            let overlap = if other == theirs { 0 } else { near.overlap(other, theirs) };
            let flat = openings[*crease].cosine < FLAT_COSINE;
            let theirs = if mine == f { folds.order(other, g) } else { folds.order(f, other) };
            if overlap > most && (flat || own != theirs) {
                most = overlap;
                sign = if flat { theirs } else { 0 };
            }
        }
    }
    sign
}

/// Two sharp creases, if they meet back to back.
fn meet(
    topology: &Topology,
    near: &Near,
    [c, d]: [usize; 2],
    [a, b]: [&Opening; 2],
) -> Option<Facing> {
    let (first, second) = (&topology.creases[c], &topology.creases[d]);
    if first.facets.iter().any(|f| second.facets.contains(f)) || a.inward.dot(&b.inward) > OPPOSITE
    {
        return None;
    }
    let same = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]) < 1e-6;
    let ends = [(0, 0), (0, 1), (1, 0), (1, 1)];
    let shared = ends.into_iter().find(|(i, j)| same(first.ends_m[*i], second.ends_m[*j]));
    let parallel = a.axis.dot(&b.axis);
    // From a common corner both have to go the same way.
    let corner_m = match shared {
        Some((i, j)) if (if i == j { parallel } else { -parallel }) > PARALLEL => {
            Some(first.ends_m[i])
        }
        None if parallel.abs() > PARALLEL && is_back_to_back(a, b) => None,
        _ => return None,
    };
    let overlaps = |f: &usize| second.facets.iter().any(|g| near.overlap(*f, *g) > 0);
    if first.facets.iter().any(overlaps) {
        return None;
    }
    Some(Facing { creases: [c, d], corner_m })
}

/// Whether two parallel creases lie back to back, the second outside the first's wedge.
fn is_back_to_back(first: &Opening, second: &Opening) -> bool {
    let offset = second.middle_m - first.middle_m;
    let along = offset.dot(&first.inward);
    let across = offset - first.inward * along - first.axis * offset.dot(&first.axis);
    let [deep_m, wide_m] = BACK_TO_BACK_M;
    -deep_m < along && along < 0.2 * deep_m && across.norm() < wide_m
}
