//! Distance from points to a triangle mesh.

use nalgebra::Vector3;

/// A triangle mesh prepared for nearest-point queries: an implicit bounding-volume hierarchy.
#[derive(Debug)]
pub struct Surface<'a> {
    positions_m: &'a [[f32; 3]],
    triangles: &'a [[u32; 3]],
    /// Triangle numbers, sorted so that every node of the tree owns a contiguous range.
    order: Vec<u32>,
    boxes: Vec<Aabb>,
}

/// The nearest point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Distance, metres.
    pub distance_m: f32,
    /// Index of the triangle.
    pub triangle: u32,
    /// Barycentric weights of its three corners.
    pub weights: [f32; 3],
}

#[derive(Debug, Clone, Copy)]
struct Aabb {
    low: Vector3<f32>,
    high: Vector3<f32>,
}

const LEAF: usize = 4;

impl<'a> Surface<'a> {
    /// Prepares a mesh. O(T log² T). Positions must be finite; indices must be in range.
    pub fn new(positions_m: &'a [[f32; 3]], triangles: &'a [[u32; 3]]) -> Self {
        let centres: Vec<Vector3<f32>> = triangles
            .iter()
            .map(|t| t.iter().map(|k| Vector3::from(positions_m[*k as usize])).sum())
            .collect();
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        split(&mut order, &centres);
        let mut surface = Self { positions_m, triangles, order, boxes: Vec::new() };
        surface.boxes = vec![Aabb::EMPTY; 2 * triangles.len().max(1)];
        if !triangles.is_empty() {
            surface.bound(0, 0, triangles.len());
        }
        surface
    }

    /// The nearest point of the surface to `point_m`; `None` for an empty mesh.
    pub fn nearest(&self, point_m: [f32; 3]) -> Option<Nearest> {
        let mut best = None;
        if !self.triangles.is_empty() {
            self.search(0, 0, self.triangles.len(), &Vector3::from(point_m), &mut best);
        }
        best
    }

    /// Distance from `point_m` to the surface, metres; infinite for an empty mesh.
    pub fn distance_m(&self, point_m: [f32; 3]) -> f32 {
        self.nearest(point_m).map_or(f32::INFINITY, |nearest| nearest.distance_m)
    }

    /// Fills the boxes of the subtree at `node`, which owns `order[start..end]`.
    fn bound(&mut self, node: usize, start: usize, end: usize) -> Aabb {
        let mut aabb = Aabb::EMPTY;
        if end - start <= LEAF {
            for t in &self.order[start..end] {
                for k in self.triangles[*t as usize] {
                    aabb.include(&Vector3::from(self.positions_m[k as usize]));
                }
            }
        } else {
            let (left, right, middle) = children(node, start, end);
            let (a, b) = (self.bound(left, start, middle), self.bound(right, middle, end));
            aabb = Aabb { low: a.low.inf(&b.low), high: a.high.sup(&b.high) };
        }
        self.boxes[node] = aabb;
        aabb
    }

    fn search(
        &self,
        node: usize,
        start: usize,
        end: usize,
        point: &Vector3<f32>,
        best: &mut Option<Nearest>,
    ) {
        if best.is_some_and(|b| self.boxes[node].distance_squared(point) >= b.distance_m.powi(2)) {
            return;
        }
        if end - start <= LEAF {
            for t in &self.order[start..end] {
                let corners = self.triangles[*t as usize]
                    .map(|k| Vector3::from(self.positions_m[k as usize]));
                let weights = closest_weights(point, &corners);
                let closest: Vector3<f32> =
                    corners.iter().zip(weights).map(|(corner, weight)| corner * weight).sum();
                let distance_m = (point - closest).norm();
                if best.is_none_or(|b| distance_m < b.distance_m) {
                    *best = Some(Nearest { distance_m, triangle: *t, weights });
                }
            }
            return;
        }
        let (left, right, middle) = children(node, start, end);
        let near_left =
            self.boxes[left].distance_squared(point) <= self.boxes[right].distance_squared(point);
        for left_turn in [near_left, !near_left] {
            if left_turn {
                self.search(left, start, middle, point, best);
            } else {
                self.search(right, middle, end, point, best);
            }
        }
    }
}

/// Tree layout in depth-first order: a node's left child follows it, and a subtree of `k`
/// triangles takes less than `2k` places.
fn children(node: usize, start: usize, end: usize) -> (usize, usize, usize) {
    let middle = start + (end - start) / 2;
    (node + 1, node + 2 * (middle - start), middle)
}

/// Sorts triangles so that halves are halves in space, recursively along the longest side.
fn split(order: &mut [u32], centres: &[Vector3<f32>]) {
    if order.len() <= LEAF {
        return;
    }
    let mut aabb = Aabb::EMPTY;
    for t in order.iter() {
        aabb.include(&centres[*t as usize]);
    }
    let axis = (aabb.high - aabb.low).imax();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |a, b| {
        let (x, y) = (centres[*a as usize][axis], centres[*b as usize][axis]);
        x.total_cmp(&y).then(a.cmp(b))
    });
    let (left, right) = order.split_at_mut(middle);
    split(left, centres);
    split(right, centres);
}

impl Aabb {
    const EMPTY: Self = Self {
        low: Vector3::new(f32::INFINITY, f32::INFINITY, f32::INFINITY),
        high: Vector3::new(f32::NEG_INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY),
    };

    fn include(&mut self, point: &Vector3<f32>) {
        self.low = self.low.inf(point);
        self.high = self.high.sup(point);
    }

    fn distance_squared(&self, point: &Vector3<f32>) -> f32 {
        let outside = (self.low - point).sup(&(point - self.high)).sup(&Vector3::zeros());
        outside.norm_squared()
    }
}

/// Barycentric weights of the point of a triangle that is nearest to `p`.
///
/// Source: Ericson, Real-Time Collision Detection, 5.1.5. Degenerate triangles fall back to
/// their nearest corner.
fn closest_weights(p: &Vector3<f32>, [a, b, c]: &[Vector3<f32>; 3]) -> [f32; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 - d3 > 0.0 {
        let v = d1 / (d1 - d3);
        return [1.0 - v, v, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 - d6 > 0.0 {
        let w = d2 / (d2 - d6);
        return [1.0 - w, 0.0, w];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 && (d4 - d3) + (d5 - d6) > 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - w, w];
    }
    let sum = va + vb + vc;
    if sum > 0.0 {
        let (v, w) = (vb / sum, vc / sum);
        return [1.0 - v - w, v, w];
    }
    [1.0, 0.0, 0.0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SheetGrid;

    /// A fixed, irregular sequence of numbers in [-1, 1].
    fn noise(k: usize) -> f32 {
        let mut x = (k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x2545_f491_4f6c_dd1d;
        x ^= x >> 29;
        x = x.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((x >> 40) as f32) / (1u64 << 23) as f32 - 1.0
    }

    #[test]
    fn tree_finds_what_brute_force_finds() {
        let grid = SheetGrid::new([0.2, 0.3], [9, 14]);
        let mut x = grid.flat_m();
        for (k, p) in x.iter_mut().enumerate() {
            p[2] = 0.03 * noise(k);
        }
        let triangles = grid.triangles();
        let surface = Surface::new(&x, &triangles);
        for k in 0..300 {
            let point = [1, 2, 3].map(|axis| 0.3 * noise(1000 * axis + k));
            let brute = triangles
                .iter()
                .map(|t| Surface::new(&x, &[*t]).distance_m(point))
                .fold(f32::INFINITY, f32::min);
            let found = surface.distance_m(point);
            assert!((found - brute).abs() < 1e-7, "{point:?}: {found} against {brute}");
        }
    }

    #[test]
    fn distances_to_one_triangle_by_hand() {
        let x = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let triangles = [[0, 1, 2]];
        let surface = Surface::new(&x, &triangles);
        for (point, expected) in [
            ([0.25, 0.25, 2.0], 2.0),         // above the face
            ([0.5, -3.0, 0.0], 3.0),          // beside an edge
            ([-3.0, -4.0, 0.0], 5.0),         // beyond a corner
            ([1.0, 1.0, 0.0], 0.5f32.sqrt()), // beyond the long edge
        ] {
            assert!((surface.distance_m(point) - expected).abs() < 1e-6);
        }
        assert_eq!(Surface::new(&x, &[]).distance_m([0.0; 3]), f32::INFINITY);
    }
}
