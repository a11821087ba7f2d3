//! Nodes and edges as each facet sees them, once a round.

use crate::near::Near;
use crate::pose::Pose;
use crate::push::ROUNDING_M;
use crate::topology::Topology;
use nalgebra::Vector3;

/// A crossing this far outside of an edge still counts, as a share of it.
pub(crate) const OUTSIDE: f64 = 1e-3;

/// Bounds of an edge in the frame of its facet, metres: u and v at least, −u and −v at least, minus
/// the height that nothing on it exceeds, and the height that nothing on it falls below.
pub(crate) type Bounds = [f64; 6];
/// The greatest bounds of what is of concern to another edge.
pub(crate) type Limit = [f64; 6];

/// Whether any bound lies beyond its limit.
pub(crate) fn is_beyond(bounds: &Bounds, limit: &Limit) -> bool {
    // All of them, without branches: they would be guessed wrong.
    bounds.iter().zip(limit).fold(false, |beyond, (bound, limit)| beyond | (bound > limit))
}

/// What all facets that are near others see.
#[derive(Debug, Clone, Default)]
pub(crate) struct Frames {
    /// (u, v, height) over facet `g` of node `n` at `g·nodes + n`, metres.
    local: Vec<[f64; 3]>,
    nodes: usize,
    /// Of each slot of [`Topology`].
    bounds: Vec<Bounds>,
}

impl Frames {
    /// Looks from every facet that is near another.
    pub fn look(&mut self, topology: &Topology, near: &Near, poses: &[Pose], x: &[Vector3<f64>]) {
        self.nodes = x.len();
        self.local.resize(topology.facets.len() * self.nodes, [0.0; 3]);
        self.bounds.resize(topology.of_slot.len(), [0.0; 6]);
        let looking = near.pairs.iter().flatten().fold(0u32, |mask, g| mask | 1 << g);
        for g in (0..topology.facets.len()).filter(|g| looking >> g & 1 == 1) {
            let local = &mut self.local[g * self.nodes..][..self.nodes];
            for (local, x) in local.iter_mut().zip(x) {
                let ([u, v], height_m) = poses[g].local_m(x);
                *local = [u, v, height_m];
            }
            let facet = &topology.facets[g];
            for edge in facet.boundary.iter().chain(&facet.interior) {
                let ends = topology.mesh.edges[*edge as usize].map(|n| local[n as usize]);
                self.bounds[topology.slot(*edge, g)] = bounds(ends);
            }
        }
    }

    /// (u, v, height) of all nodes over a facet that is near another, metres.
    pub fn over(&self, g: usize) -> &[[f64; 3]] {
        &self.local[g * self.nodes..][..self.nodes]
    }

    /// Bounds of the edges of all facets, by slot.
    pub fn bounds(&self) -> &[Bounds] {
        &self.bounds
    }
}

/// The smaller and the greater of two numbers; neither is NaN.
pub(crate) fn ordered(a: f64, b: f64) -> [f64; 2] {
    // One instruction each; `f64::min` looks for NaN as well.
    [if a < b { a } else { b }, if a > b { a } else { b }]
}

fn bounds([c, d]: [[f64; 3]; 2]) -> Bounds {
    let [[u_low, u_high], [v_low, v_high], [low, high]] = [0, 1, 2].map(|k| ordered(c[k], d[k]));
    let outside_m = 2.0 * OUTSIDE * (high - low);
    [u_low, v_low, -u_high, -v_high, -high - outside_m, low - outside_m]
}

/// What an edge may meet: what lies beside it in the plane it does not, nor what is clear of it by
/// more than `clear_m` in the direction of `sign` wherever they cross.
pub(crate) fn limit([a, b]: [[f64; 3]; 2], sign: f64, clear_m: f64) -> Limit {
    let [[u_low, u_high], [v_low, v_high], [low, high]] = [0, 1, 2].map(|k| ordered(a[k], b[k]));
    // A little may lie outside of the ends, and rounding.
    let clear_m = clear_m + 2.0 * OUTSIDE * (high - low) + ROUNDING_M;
    let (above, below) =
        if sign > 0.0 { (clear_m - low, f64::INFINITY) } else { (f64::INFINITY, clear_m + high) };
    [u_high, v_high, -u_low, -v_low, above, below]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_is_beyond_beside_the_other_or_clear_of_it_on_its_side() {
        let first = [[0.0, 0.0, 1.0], [2.0, 1.0, 1.5]];
        let second = |u: f64, v: f64, height_m: f64| {
            bounds([[u, v, height_m], [u + 1.0, v - 0.5, height_m - 0.5]])
        };
        let is_met = |sign: f64, bounds: Bounds| !is_beyond(&bounds, &limit(first, sign, 0.2));
        for sign in [-1.0, 1.0] {
            // In the plane it is the same on either side, and touching is not beside.
            let height_m = 1.0 + 0.1 * sign;
            for [u, v] in [[0.5, 0.5], [2.0, 0.0], [-1.0, 1.5], [1.9, 1.5]] {
                assert!(is_met(sign, second(u, v, height_m)), "{u}, {v}");
            }
            for [u, v] in [[2.01, 0.5], [-1.01, 0.5], [0.5, 1.51], [0.5, -0.01]] {
                assert!(!is_met(sign, second(u, v, height_m)), "{u}, {v}");
            }
        }
        // The first is to be above: the second from 0.3 to 0.8 is clear of it, up to 0.81 is not.
        assert!(!is_met(1.0, second(0.5, 0.5, 0.79)) && is_met(1.0, second(0.5, 0.5, 0.81)));
        assert!(is_met(1.0, second(0.5, 0.5, 9.0)), "it is on the wrong side");
        // The first is to be below: the second from 1.7 upwards is clear.
        assert!(!is_met(-1.0, second(0.5, 0.5, 2.21)) && is_met(-1.0, second(0.5, 0.5, 2.19)));
        assert!(is_met(-1.0, second(0.5, 0.5, -9.0)), "it is on the wrong side");
    }
}
