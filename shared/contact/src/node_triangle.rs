//! Nodes of one facet against triangles of another, along the facet's normal.

use crate::frames::ordered;
use crate::gap::Gaps;
use crate::mesh::NONE;
use crate::near::{Near, Over};
use crate::order::Order;
use crate::pose::Pose;
use crate::push::{ROUNDING_M, Worst, weighted_push};
use crate::runs::{Contact, Room};
use crate::topology::Topology;
use nalgebra::Vector3;

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
    /// Smallest barycentric weights.
    outside: [f64; 3],
}

/// What a round needs to find them.
pub(crate) struct Search<'a> {
    pub gaps: &'a Gaps<'a>,
    pub near: &'a Near,
    pub order: &'a Order,
    pub poses: &'a [Pose],
    pub x: &'a [Vector3<f64>],
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
        let normal = &self.poses[g].normal;
        let (t, weights, height) = walk(topology, over, start, normal, self.x)?;
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

/// From triangle to triangle of the facet to the one below the node.
fn walk(
    topology: &Topology,
    over: &Over,
    start: usize,
    normal: &Vector3<f64>,
    x: &[Vector3<f64>],
) -> Option<(usize, [f64; 3], f64)> {
    let mesh = &topology.mesh;
    let flat = 1e-5 * mesh.double_area_m2();
    let mut t = start;
    for _ in 0..WALK {
        let corners = mesh.triangles[t].map(|n| x[n as usize]);
        let (weights, height) = below(&x[over.node as usize], &corners, normal, flat)?;
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

/// Weights of the point of a triangle that lies below `p` along `normal`, and the height above it.
fn below(
    p: &Vector3<f64>,
    [a, b, c]: &[Vector3<f64>; 3],
    normal: &Vector3<f64>,
    flat_m2: f64,
) -> Option<([f64; 3], f64)> {
    // p − h·n = a + v·e + w·f
    let (e, f, r) = (b - a, c - a, p - a);
    let across = f.cross(normal);
    let det = e.dot(&across);
    if det.is_nan() || det.abs() <= flat_m2 {
        return None;
    }
    let v = r.dot(&across) / det;
    let w = e.dot(&r.cross(normal)) / det;
    let height = e.cross(&f).dot(&r) / det;
    Some(([1.0 - v - w, v, w], height))
}

impl Contact for NodeTriangle {
    fn facets(&self) -> [u8; 2] {
        self.facets
    }

    fn nodes(&self) -> [u32; 4] {
        let [a, b, c] = self.triangle;
        [self.node, a, b, c]
    }

    fn is_clear(&self, heights_m: &[f64]) -> bool {
        let [p, a, b, c] = self.nodes().map(|n| self.sign * heights_m[n as usize]);
        let [low_m, high_m] = ordered(a, b);
        let (low_m, high_m) = (ordered(low_m, c)[0], ordered(high_m, c)[1]);
        // No weight is below −SLID, so that none is above 1 + 2·SLID.
        p - high_m - 2.0 * SLID * (high_m - low_m) - ROUNDING_M > self.gap_m
    }

    fn solve(&self, room: &mut Room<'_>, worst: &mut Worst) -> bool {
        let normal = &room.poses[usize::from(self.facets[1])].normal;
        let corners = self.triangle.map(|n| room.x[n as usize]);
        let point = room.x[self.node as usize];
        let Some((weights, height)) = below(&point, &corners, normal, room.flat_m2) else {
            return false;
        };
        if weights.iter().zip(&self.outside).any(|(w, low)| w < low) {
            return false;
        }
        let height_m = self.sign * height;
        if height_m >= self.gap_m {
            return false;
        }
        worst.note(self.gap_m, height_m);
        let [u, v, w] = weights;
        let push = normal * (self.sign * (self.gap_m - height_m));
        weighted_push(room.x, room.mobility, &self.nodes(), &[1.0, -u, -v, -w], push);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_height_is_measured_along_the_normal() {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Vector3::from);
        let normal = Vector3::new(0.6, 0.0, 0.8);
        let (weights, height) =
            below(&Vector3::new(0.8, 0.25, 0.4), &corners, &normal, 1e-9).unwrap();
        assert!((height - 0.5).abs() < 1e-12); // 0.4 / 0.8; the foot is 0.8 − 0.5·0.6 = 0.5.
        assert!((weights[1] - 0.5).abs() < 1e-12 && (weights[2] - 0.25).abs() < 1e-12);
        assert!(below(&Vector3::x(), &corners, &Vector3::x(), 1e-9).is_none());
    }
}
