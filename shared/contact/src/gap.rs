//! How far two layers keep apart at a place.

use crate::params::ContactParams;
use crate::pose::Opening;
use crate::topology::Topology;

/// Creases with a cosine above this are folded past 90°.
const PAST_UPRIGHT: f64 = 0.0;

/// Weights of a place lie in −0.02 to 1.04: it is nearer to a crease than the nearest of its nodes
/// by less than this many spacings.
const OUTSIDE: f64 = 0.1;

/// What gaps depend on.
#[derive(Clone, Copy)]
pub(crate) struct Gaps<'a> {
    pub params: &'a ContactParams,
    pub topology: &'a Topology,
    pub openings: &'a [Opening],
}

impl Gaps<'_> {
    /// Gap between a place of facet `f` and one of facet `g`, metres; each place is nodes and
    /// their weights.
    pub fn between(
        &self,
        f: usize,
        g: usize,
        of_f: (&[u32], &[f64]),
        of_g: (&[u32], &[f64]),
    ) -> f64 {
        let nodes_m = self
            .topology
            .away_from_creases_m(of_f.0)
            .min(self.topology.away_from_creases_m(of_g.0));
        let least_m = nodes_m - OUTSIDE * self.topology.mesh.spacing_max_m;
        if self.params.gap_slope * least_m >= self.params.thickness_m {
            return self.params.thickness_m; // Far from all creases.
        }
        let shared = self.topology.shared_crease(f, g);
        let mut from_crease_m = self.corner_m(f, g, of_f.0);
        for (facet, (nodes, weights)) in [(f, of_f), (g, of_g)] {
            for crease in &self.topology.facets[facet].creases {
                if shared == Some(*crease) || self.openings[*crease].cosine > PAST_UPRIGHT {
                    let near = nodes.iter().zip(weights);
                    let distance_m: f64 =
                        near.map(|(n, w)| w * self.topology.crease_distance_m(*crease, *n)).sum();
                    from_crease_m = from_crease_m.min(distance_m.max(0.0));
                }
            }
        }
        (self.params.gap_slope * from_crease_m)
            .clamp(self.params.gap_min_m, self.params.thickness_m)
    }

    fn corner_m(&self, f: usize, g: usize, nodes: &[u32]) -> f64 {
        let distances = nodes.iter().map(|n| self.topology.corner_distance_m(f, g, *n));
        distances.fold(f64::INFINITY, f64::min)
    }

    /// Gap between a node of facet `g` and a crease of facet `f`, metres.
    pub fn beside_spine(&self, f: usize, g: usize, node: u32) -> f64 {
        let corner_m = self.topology.corner_distance_m(f, g, node);
        self.params.spine_gap_m.min(self.params.spine_slope * corner_m)
    }
}
