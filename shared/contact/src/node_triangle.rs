//! Nodes of one facet against triangles of another, along the facet's normal.

use crate::frames::Frames;
use crate::gap::Gaps;
use crate::mesh::NONE;
use crate::near::{Near, Over};
use crate::order::Order;
use crate::runs::Contact;
use crate::topology::Topology;

/// A place this far outside a triangle still counts as on it, barycentric.
const TOUCH: f64 = 0.002;
/// The same, at the sheet's or the facet's end.
const RIM: f64 = 0.02;
/// A contact that slid farther than this out of its triangle waits for the next round.
const SLID: f64 = 0.25;
/// Nodes that are farther away than this in the right order are no contact, metres.
const CLEAR_M: f64 = 2e-3;
/// A place that lies this deep in a triangle lies in no other, barycentric.
const INSIDE: f64 = 1e-6;
/// A triangle that looks smaller than this from above spans nothing, as a share of its rest area.
pub(crate) const FLAT: f64 = 1e-5;
/// Steps from triangle to triangle.
const WALK: usize = 4;

/// A node that has to stay on one side of a triangle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NodeTriangle {
    node: u32,
    triangle: [u32; 3],
    facets: [u8; 2],
    sign: f64,
    gap_m: f64,
    /// Barycentric weights when it was found.
    weights: [f64; 3],
    /// Smallest barycentric weights.
    outside: [f64; 3],
}

/// What a round needs to find them.
pub(crate) struct Search<'a> {
    pub gaps: &'a Gaps<'a>,
    pub near: &'a Near,
    pub order: &'a Order,
    pub frames: &'a Frames,
}

impl Search<'_> {
    /// Fills `found` with the contacts of a round.
    pub fn find(&self, found: &mut Vec<NodeTriangle>) {
        found.clear();
        found.extend(self.near.over.iter().filter_map(|over| self.contact(over)));
    }

    fn contact(&self, over: &Over) -> Option<NodeTriangle> {
        let topology = self.gaps.topology;
        let (f, g) = (usize::from(over.from), usize::from(over.over));
        let sign = self.order.sign(f, g);
        if sign == 0 || is_contested(topology, self.near, self.order, over) {
            return None;
        }
        let start = locate(topology, g, over.uv_m)?;
        let (t, weights, height) = walk(topology, over, start, self.frames.over(g))?;
        let triangle = topology.mesh.triangles[t];
        if f64::from(sign) * height > CLEAR_M || triangle.contains(&over.node) {
            return None;
        }
        let outside = topology.mesh.neighbours[t].map(|s| {
            let same = s != NONE && topology.of_triangle[s as usize] >> g & 1 == 1;
            if same { -SLID } else { -RIM }
        });
        Some(NodeTriangle {
            node: over.node,
            triangle,
            facets: [over.from, over.over],
            sign: f64::from(sign),
            gap_m: self.gaps.between(f, g, (&[over.node], &[1.0]), (&triangle, &weights)),
            weights,
            outside,
        })
    }
}

/// A node on a crease belongs to two facets: it takes the side of the one that overlaps more.
fn is_contested(topology: &Topology, near: &Near, order: &Order, over: &Over) -> bool {
    let (f, g) = (usize::from(over.from), usize::from(over.over));
    let mut others = topology.of_node[over.node as usize] & !(1 << f);
    while others != 0 {
        let other = others.trailing_zeros() as usize;
        others &= others - 1;
        let sign = order.sign(other, g);
        let own = near.overlap_of(f, g);
        if sign != 0 && sign != order.sign(f, g) && near.overlap_of(other, g) >= own {
            return true;
        }
    }
    false
}

/// The triangle of facet `g` that holds a material point best.
fn locate(topology: &Topology, g: usize, uv_m: [f64; 2]) -> Option<usize> {
    let mesh = &topology.mesh;
    let [i, j] = mesh.cell(uv_m);
    for t in mesh.triangles_of([i, j]) {
        // What holds it well inside does so best.
        if topology.of_triangle[t] >> g & 1 == 1
            && mesh.weights(t, uv_m).into_iter().all(|weight| weight > INSIDE)
        {
            return Some(t);
        }
    }
    let mut best = (f64::NEG_INFINITY, None);
    for i in i.saturating_sub(1)..=(i + 1).min(mesh.sheet.nodes[0] - 2) {
        for j in j.saturating_sub(1)..=(j + 1).min(mesh.sheet.nodes[1] - 2) {
            for t in mesh.triangles_of([i, j]) {
                if topology.of_triangle[t] >> g & 1 == 0 {
                    continue;
                }
                let inside = mesh.weights(t, uv_m).into_iter().fold(f64::INFINITY, f64::min);
                if inside > best.0 {
                    best = (inside, Some(t));
                }
            }
        }
    }
    best.1
}

/// From triangle to triangle of the facet to the one below the node; its weights there, and the
/// node's height above it. `local`: (u, v, height) over the facet.
fn walk(
    topology: &Topology,
    over: &Over,
    start: usize,
    local: &[[f64; 3]],
) -> Option<(usize, [f64; 3], f64)> {
    let mesh = &topology.mesh;
    let flat_m2 = FLAT * mesh.double_area_m2;
    let p = local[over.node as usize];
    let mut t = start;
    for _ in 0..WALK {
        let [a, b, c] = mesh.triangles[t];
        let [a, b, c] = [local[a as usize], local[b as usize], local[c as usize]];
        let weights = below(p, [a, b, c], flat_m2)?;
        let height = p[2] - (weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]);
        let side = (0..3).fold(0, |low, k| if weights[k] < weights[low] { k } else { low });
        if weights[side] >= -TOUCH {
            return Some((t, weights, height));
        }
        let next = mesh.neighbours[t][side];
        let stays = next != NONE && topology.of_triangle[next as usize] >> over.over & 1 == 1;
        if !stays {
            return (weights[side] > -RIM).then_some((t, weights, height));
        }
        t = next as usize;
    }
    None
}

/// Weights of the point of a triangle that lies below another in a facet's frame; none where the
/// triangle spans nothing there.
fn below<const N: usize>(p: [f64; N], [a, b, c]: [[f64; N]; 3], flat_m2: f64) -> Option<[f64; 3]> {
    // p = a + v·e + w·f, in the plane
    let (e, f) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let r = [p[0] - a[0], p[1] - a[1]];
    let det = e[0] * f[1] - e[1] * f[0];
    if det.is_nan() || det.abs() <= flat_m2 {
        return None;
    }
    let v = (r[0] * f[1] - r[1] * f[0]) / det;
    let w = (e[0] * r[1] - e[1] * r[0]) / det;
    Some([1.0 - v - w, v, w])
}

impl Contact for NodeTriangle {
    fn facets(&self) -> [u8; 2] {
        self.facets
    }

    fn nodes(&self) -> [u32; 4] {
        let [a, b, c] = self.triangle;
        [self.node, a, b, c]
    }

    fn gap_m(&self) -> f64 {
        self.gap_m
    }

    fn weights(&self) -> [f64; 4] {
        weights(self.sign, self.weights)
    }

    fn weigh(&self, [p, a, b, c]: [[f64; 2]; 4], flat_m2: f64) -> Option<[f64; 4]> {
        let of_corners = below(p, [a, b, c], flat_m2)?;
        let is_over = of_corners.iter().zip(&self.outside).all(|(weight, low)| weight >= low);
        is_over.then(|| weights(self.sign, of_corners))
    }
}

/// Weights of the heights of a node and its triangle's corners: the node's height over it.
fn weights(sign: f64, [u, v, w]: [f64; 3]) -> [f64; 4] {
    [1.0, -u, -v, -w].map(|weight| sign * weight)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_the_point_below() {
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let weights = below([0.5, 0.25], corners, 1e-9).unwrap();
        assert!((weights[1] - 0.5).abs() < 1e-12 && (weights[2] - 0.25).abs() < 1e-12);
        // The same from the other side, and one that stands upright.
        let turned = below([0.5, 0.25], [corners[0], corners[2], corners[1]], 1e-9).unwrap();
        assert!((turned[1] - 0.25).abs() < 1e-12 && (turned[2] - 0.5).abs() < 1e-12);
        assert!(below([0.5, 0.25], [corners[0], [1.0, 0.0], [2.0, 0.0]], 1e-9).is_none());
    }
}
