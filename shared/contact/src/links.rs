//! Lengths of the mesh's edges.

use crate::topology::Topology;
use nalgebra::Vector3;

/// One sweep over all edges and the links that keep facets flat, back to front where `reverse`. An
/// edge that a crease cuts may be shorter than at rest.
pub(crate) fn sweep(topology: &Topology, x: &mut [Vector3<f64>], mobility: &[f64], reverse: bool) {
    let edges = &topology.mesh.edges;
    let (count, all) = (edges.len(), edges.len() + topology.skips.len());
    for at in 0..all {
        let link = if reverse { all - 1 - at } else { at };
        if link < count {
            let rest_m = topology.mesh.rest_m[link];
            solve(x, mobility, edges[link], rest_m, topology.cut[link]);
        } else {
            let (nodes, rest_m) = topology.skips[link - count];
            solve(x, mobility, nodes, rest_m, false);
        }
    }
}

fn solve(
    x: &mut [Vector3<f64>],
    mobility: &[f64],
    nodes: [u32; 2],
    rest_m: f64,
    may_shorten: bool,
) {
    let [a, b] = nodes.map(|n| n as usize);
    let d = x[b] - x[a];
    let length = d.norm();
    let excess = length - rest_m;
    let sum = mobility[a] + mobility[b];
    if length < 1e-9 || sum <= 0.0 || (may_shorten && excess < 0.0) {
        return;
    }
    let step = d * (excess / (length * sum));
    x[a] += step * mobility[a];
    x[b] -= step * mobility[b];
}
