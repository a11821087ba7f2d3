//! Which facets can touch, and which nodes of one lie over another.

use crate::frames::Frames;
use crate::pose::Pose;
use crate::topology::Topology;
use orime_creases::FACETS_MAX;

/// Nodes farther than this from a facet's plane are of no concern to it, metres.
const REACH_M: f64 = 0.010;
/// Nodes that lie this deep inside make two facets overlap, metres.
const OVERLAP_M: f64 = 1e-3;
/// Nodes up to this far outside a facet are looked at, metres.
const OUTSIDE_M: f64 = 1e-4;
/// Facets may be nearer than their best planes say by this many times their residuals.
const RESIDUALS: f64 = 4.0;
/// Facets that bend less than this are not looked at more closely, metres.
const SLACK_M: f64 = 5e-4;

/// A node that lies over or under a facet.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Over {
    pub node: u32,
    /// The node's facet.
    pub from: u8,
    /// The facet that it lies over.
    pub over: u8,
    /// Where, material coordinates of `over`, metres.
    pub uv_m: [f64; 2],
}

/// What is near what, in one round.
#[derive(Debug, Clone)]
pub(crate) struct Near {
    /// Pairs that can touch, `f < g`.
    pub pairs: Vec<[u8; 2]>,
    pub over: Vec<Over>,
    /// Nodes inside facet `f` alone that lie well over facet `g`.
    count: Box<[[u16; FACETS_MAX]; FACETS_MAX]>,
}

impl Near {
    pub fn new() -> Self {
        Self {
            pairs: Vec::with_capacity(FACETS_MAX * FACETS_MAX / 2),
            over: Vec::with_capacity(4096),
            count: Box::new([[0; FACETS_MAX]; FACETS_MAX]),
        }
    }

    /// Nodes of `f` over `g` and of `g` over `f`.
    pub fn overlap(&self, f: usize, g: usize) -> u32 {
        u32::from(self.count[f][g]) + u32::from(self.count[g][f])
    }

    /// Nodes of `f` over `g`.
    pub fn overlap_of(&self, f: usize, g: usize) -> u32 {
        u32::from(self.count[f][g])
    }

    /// Pairs of facets that can touch. Whether there are any.
    pub fn find_pairs(&mut self, topology: &Topology, poses: &[Pose]) -> bool {
        self.pairs.clear();
        for f in 0..poses.len() {
            for g in f + 1..poses.len() {
                if !(poses[f].is_known() && poses[g].is_known()) {
                    continue;
                }
                if reaches(topology, poses, f, g) || reaches(topology, poses, g, f) {
                    self.pairs.push([f as u8, g as u8]);
                }
            }
        }
        !self.pairs.is_empty()
    }

    /// The nodes of near facets that lie over each other, and how many.
    pub fn find_overlaps(&mut self, topology: &Topology, frames: &Frames) {
        self.over.clear();
        for row in self.count.iter_mut() {
            row.fill(0);
        }
        for pair in 0..self.pairs.len() {
            let [f, g] = self.pairs[pair].map(usize::from);
            self.nodes_over(topology, frames, [f, g]);
            self.nodes_over(topology, frames, [g, f]);
        }
    }

    fn nodes_over(&mut self, topology: &Topology, frames: &Frames, [f, g]: [usize; 2]) {
        let (facet, local) = (&topology.facets[g], frames.over(g));
        for (node, _) in &topology.facets[f].core {
            let facets = topology.of_node[*node as usize];
            if facets >> g & 1 == 1 {
                continue;
            }
            let [u, v, height_m] = local[*node as usize];
            let uv_m = [u, v];
            if height_m.abs() > REACH_M {
                continue;
            }
            let inside_m = facet.inside_m(uv_m);
            if inside_m < -OUTSIDE_M {
                continue;
            }
            if facets.is_power_of_two() && inside_m > OVERLAP_M {
                self.count[f][g] += 1;
            }
            self.over.push(Over { node: *node, from: f as u8, over: g as u8, uv_m });
        }
    }
}

/// Whether facet `f`, as a flat polygon, reaches over facet `g`. Corners that they share do not
/// count: there they always meet.
fn reaches(topology: &Topology, poses: &[Pose], f: usize, g: usize) -> bool {
    let slack_m = SLACK_M + RESIDUALS * (poses[f].residual_m + poses[g].residual_m);
    let facet = &topology.facets[f];
    let (mut low_m, mut high_m) = (f64::INFINITY, f64::NEG_INFINITY);
    // Most sides of a facet are few; more than eight are not told apart.
    let mut deepest_m = [f64::NEG_INFINITY; 8];
    let sides = &topology.facets[g].sides;
    for (corner, touches) in facet.corners_m.iter().zip(&facet.corner_touches) {
        let (uv, height_m) = poses[g].local_m(&poses[f].position_m(*corner));
        low_m = low_m.min(height_m);
        high_m = high_m.max(height_m);
        if touches >> g & 1 == 1 {
            continue;
        }
        for (deepest, [a, b, c]) in deepest_m.iter_mut().zip(sides) {
            *deepest = deepest.max(a * uv[0] + b * uv[1] + c);
        }
    }
    let beside = deepest_m.iter().zip(sides).any(|(deepest, _)| *deepest < -slack_m);
    !beside && low_m < REACH_M + slack_m && high_m > -REACH_M - slack_m
}
