//! Whether a plane parts two cells of the grid: then nothing of one crosses anything of the other.
//!
//! A cell is the hull of its four nodes. Planes that are tried: across the one's normal, across the
//! way between the middles, across the other's normal. Cells that share a node or a side touch the
//! plane there, and only there.

use crate::mesh::Mesh;
use nalgebra::Vector3;

/// The four nodes of each cell, and what planes are made of.
#[derive(Debug, Clone)]
pub(crate) struct Quads {
    columns: usize,
    quads: Vec<Quad>,
}

#[derive(Debug, Clone, Copy)]
struct Quad {
    /// Nodes, metres; repeated where the grid ends.
    corners: [Vector3<f64>; 4],
    /// Across both diagonals, of no certain length.
    normal: Vector3<f64>,
}

impl Quads {
    pub fn new(mesh: &Mesh) -> Self {
        let zero = Vector3::zeros();
        let quad = Quad { corners: [zero; 4], normal: zero };
        Self { columns: mesh.sheet.nodes[1], quads: vec![quad; mesh.uv_m.len()] }
    }

    /// Takes over positions, metres, one per node.
    pub fn fill(&mut self, x: &[Vector3<f64>]) {
        let columns = self.columns;
        let rows = x.len() / columns;
        for (node, quad) in self.quads.iter_mut().enumerate() {
            let (i, j) = (node / columns, node % columns);
            let (below, right) = ((i + 1).min(rows - 1), (j + 1).min(columns - 1));
            let [a, b, c, d] = [[i, j], [i, right], [below, j], [below, right]];
            let corners = [a, b, c, d].map(|[i, j]| x[i * columns + j]);
            let normal = (corners[3] - corners[0]).cross(&(corners[2] - corners[1]));
            *quad = Quad { corners, normal };
        }
    }

    /// Whether a plane was found that parts two cells.
    pub fn are_parted(&self, cells: [u32; 2]) -> bool {
        let [a, b] = [cells[0].min(cells[1]), cells[0].max(cells[1])].map(|cell| cell as usize);
        let (first, second) = (&self.quads[a], &self.quads[b]);
        let [i, j] = [a / self.columns, a % self.columns];
        match (b / self.columns - i, b % self.columns) {
            (0, l) if l == j => true,
            (0, l) if l == j + 1 => first.meets_at_side(second, [1, 3], [0, 2], [1, 3]),
            (1, l) if l == j => first.meets_at_side(second, [2, 3], [0, 1], [2, 3]),
            (1, l) if l == j + 1 => first.meets_at_node(second, [3, 0], [1, 2, 3]),
            (1, l) if l + 1 == j => first.meets_at_node(second, [2, 1], [0, 2, 3]),
            _ => {
                let between = second.corners[0] - first.corners[0];
                first.lies_beside(second, &first.normal)
                    || first.lies_beside(second, &between)
                    || first.lies_beside(second, &second.normal)
            }
        }
    }
}

impl Quad {
    fn lies_beside(&self, other: &Self, axis: &Vector3<f64>) -> bool {
        let [low, high] = self.extent(axis);
        let [other_low, other_high] = other.extent(axis);
        high < other_low || other_high < low
    }

    fn extent(&self, axis: &Vector3<f64>) -> [f64; 2] {
        let [a, b, c, d] = self.corners.map(|p| p.dot(axis));
        [a.min(b).min(c.min(d)), a.max(b).max(c.max(d))]
    }

    /// Whether the corners of two cells lie on two sides of the corners that they share.
    fn meets_at_side(
        &self,
        other: &Self,
        shared: [usize; 2],
        own: [usize; 2],
        others: [usize; 2],
    ) -> bool {
        let [p, q] = shared.map(|corner| self.corners[corner]);
        let axis = (q - p).cross(&self.normal);
        let beyond = |corner: &Vector3<f64>| (corner - p).dot(&axis);
        let own = own.map(|corner| beyond(&self.corners[corner]));
        let others = others.map(|corner| beyond(&other.corners[corner]));
        own[0].max(own[1]) < 0.0 && others[0].min(others[1]) > 0.0
            || own[0].min(own[1]) > 0.0 && others[0].max(others[1]) < 0.0
    }

    /// The same of one corner that they share: its number in either, and the other's others.
    fn meets_at_node(&self, other: &Self, shared: [usize; 2], others: [usize; 3]) -> bool {
        let p = self.corners[shared[0]];
        let axis = other.corners[3 - shared[1]] - self.corners[3 - shared[0]];
        let mut own = (0..4).filter(|corner| *corner != shared[0]);
        own.all(|corner| (self.corners[corner] - p).dot(&axis) < 0.0)
            && others.iter().all(|corner| (other.corners[*corner] - p).dot(&axis) > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generic::cells::Parts;
    use crate::generic::untangle::pierce;
    use orime_geometry::SheetGrid;

    /// Whatever the pose: cells that are said to be parted do not cross each other.
    #[test]
    fn what_is_parted_does_not_cross() {
        let mesh = Mesh::new(&SheetGrid::new([0.05, 0.04], [6, 5]));
        let parts = Parts::new(&mesh);
        let mut quads = Quads::new(&mesh);
        let mut seed = 5u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
        };
        let (mut parted, mut neighbours, mut crossing) = (0, 0, 0);
        for round in 0..60 {
            // From a flat sheet to a heap of nodes.
            let size_m = 0.05 * f64::from(round) / 60.0;
            let x: Vec<Vector3<f64>> = (mesh.uv_m.iter())
                .map(|[u, v]| {
                    let off = Vector3::new(random(), random(), random()) * size_m;
                    Vector3::new(*u, *v, 0.0) + off
                })
                .collect();
            quads.fill(&x);
            for a in 0..30u32 {
                for b in a..30 {
                    let mut crosses = 0;
                    parts.piercings(&mesh, [a, b], |edge, triangle| {
                        let (edge, triangle) =
                            (mesh.edges[edge as usize], mesh.triangles[triangle as usize]);
                        crosses += u32::from(pierce(edge, triangle, &x, 0.0).is_some());
                    });
                    crossing += u32::from(crosses > 0);
                    if quads.are_parted([a, b]) {
                        assert_eq!(crosses, 0, "round {round}: {a} and {b}");
                        assert!(quads.are_parted([b, a]));
                        parted += 1;
                        neighbours += u32::from(a + 1 == b || a + 5 == b);
                    }
                }
            }
        }
        assert!(
            parted > 10_000 && neighbours > 500 && crossing > 500,
            "{parted} {neighbours} {crossing}"
        );
    }

    #[test]
    fn in_a_flat_sheet_all_cells_are_parted() {
        let mesh = Mesh::new(&SheetGrid::new([0.05, 0.04], [6, 5]));
        let x: Vec<Vector3<f64>> =
            mesh.uv_m.iter().map(|[u, v]| Vector3::new(*u, *v, 0.1)).collect();
        let mut quads = Quads::new(&mesh);
        quads.fill(&x);
        // But for those that the grid's end makes narrow.
        let inside = |cell: u32| cell < 25 && cell % 5 < 4;
        for a in (0..30).filter(|a| inside(*a)) {
            for b in (a..30).filter(|b| inside(*b)) {
                assert!(quads.are_parted([a, b]), "{a} and {b}");
            }
        }
    }
}
