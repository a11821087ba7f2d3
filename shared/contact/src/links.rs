//! Lengths of the mesh's edges.

use crate::topology::Topology;
use nalgebra::Vector3;

/// One sweep over all edges, back to front where `reverse`. An edge that a crease cuts may be
/// shorter than at rest.
pub(crate) fn sweep(topology: &Topology, x: &mut [Vector3<f64>], mobility: &[f64], reverse: bool) {
    let count = topology.mesh.edges.len();
    for at in 0..count {
        let edge = if reverse { count - 1 - at } else { at };
        let [a, b] = topology.mesh.edges[edge].map(|n| n as usize);
        let d = x[b] - x[a];
        let length = d.norm();
        let excess = length - topology.mesh.rest_m[edge];
        let sum = mobility[a] + mobility[b];
        if length < 1e-9 || sum <= 0.0 || (topology.cut[edge] && excess < 0.0) {
            continue;
        }
        let step = d * (excess / (length * sum));
        x[a] += step * mobility[a];
        x[b] -= step * mobility[b];
    }
}
