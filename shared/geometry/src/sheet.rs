//! The sheet as a grid of nodes in material coordinates.

use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

/// Most nodes a sheet may have; bounds every message that carries node positions.
pub const NODES_MAX: usize = 4096;

/// The `[sheet]` section of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SheetParams {
    /// Extent along u and v, metres. Default 0.15 × 0.15.
    pub size_m: [f64; 2],
    /// Nodes along u and v. More nodes bend more finely; cost grows with their square. Odd
    /// numbers let every other node be a control point. Default 25 × 25.
    pub nodes: [usize; 2],
    /// Mass per area, kg/m². Default 0.08 (copy paper).
    pub density_kg_per_m2: f64,
    /// Template mesh (OBJ, a regular quad grid), where the sheet does not start flat.
    pub template: Option<String>,
    /// Signs that turn the template's axes into the world's, as a start. Default `[1, 1, 1]`.
    pub template_axis_signs: [f64; 3],
}

impl Default for SheetParams {
    fn default() -> Self {
        Self {
            size_m: [0.15, 0.15],
            nodes: [25, 25],
            density_kg_per_m2: 0.08,
            template: None,
            template_axis_signs: [1.0; 3],
        }
    }
}

impl SheetParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<SheetGrid, Vec<Problem>> {
        let Self { size_m, nodes, density_kg_per_m2, template: _, template_axis_signs } = self;
        let mut checker = Checker::new();
        let length_ok = |l: &f64| 0.01 <= *l && *l <= 5.0;
        checker.require(
            size_m.iter().all(length_ok),
            "size_m",
            size_m,
            "both sides must be 0.01 to 5 metres (is it in millimetres?)",
        );
        checker.require(
            nodes.iter().all(|n| *n >= 5),
            "nodes",
            nodes,
            "at least 5 along each side",
        );
        checker.require(
            nodes[0].saturating_mul(nodes[1]) <= NODES_MAX,
            "nodes",
            nodes,
            "at most 4096 nodes in all",
        );
        checker.require(
            0.001 <= *density_kg_per_m2 && *density_kg_per_m2 <= 10.0,
            "density_kg_per_m2",
            density_kg_per_m2,
            "must be 0.001 to 10 kg/m² (is it in g/m²?)",
        );
        checker.require(
            template_axis_signs.iter().all(|s| s.abs() == 1.0),
            "template_axis_signs",
            template_axis_signs,
            "each must be 1 or -1",
        );
        checker.finish(|| SheetGrid::new(*size_m, *nodes))
    }
}

/// A sheet of `nodes[0] × nodes[1]` nodes; node `(i, j)` has index `i * nodes[1] + j` and
/// material coordinates `u = i·h_u`, `v = j·h_v`.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetGrid {
    /// Extent along u and v, metres.
    pub size_m: [f64; 2],
    /// Nodes along u and v.
    pub nodes: [usize; 2],
}

impl SheetGrid {
    /// A grid with these sides and node counts (both at least 2).
    pub fn new(size_m: [f64; 2], nodes: [usize; 2]) -> Self {
        assert!(nodes[0] >= 2 && nodes[1] >= 2, "a sheet has at least 2 × 2 nodes");
        Self { size_m, nodes }
    }

    /// Number of nodes.
    #[expect(clippy::len_without_is_empty, reason = "a sheet is never empty")]
    pub fn len(&self) -> usize {
        self.nodes[0] * self.nodes[1]
    }

    /// Spacing between neighbours along u and v, metres.
    pub fn spacing_m(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.size_m[axis] / (self.nodes[axis] - 1) as f64)
    }

    /// Index of node `(i, j)`.
    pub fn index(&self, i: usize, j: usize) -> usize {
        i * self.nodes[1] + j
    }

    /// Material coordinates of every node, metres, in index order.
    pub fn uv_m(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        let [h_u, h_v] = self.spacing_m();
        (0..self.nodes[0])
            .flat_map(move |i| (0..self.nodes[1]).map(move |j| [i as f64 * h_u, j as f64 * h_v]))
    }

    /// The flat sheet in its own plane, centred, z = 0, metres.
    pub fn flat_m(&self) -> Vec<[f32; 3]> {
        let [a, b] = self.size_m;
        self.uv_m().map(|[u, v]| [(u - a / 2.0) as f32, (v - b / 2.0) as f32, 0.0]).collect()
    }

    /// Two triangles per cell, diagonals alternating so that no direction is preferred.
    pub fn triangles(&self) -> Vec<[u32; 3]> {
        let mut triangles = Vec::with_capacity(2 * (self.nodes[0] - 1) * (self.nodes[1] - 1));
        for i in 0..self.nodes[0] - 1 {
            for j in 0..self.nodes[1] - 1 {
                let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                    .map(|(i, j)| self.index(i, j) as u32);
                if (i + j) % 2 == 0 {
                    triangles.extend([[a, b, c], [a, c, d]]);
                } else {
                    triangles.extend([[a, b, d], [b, c, d]]);
                }
            }
        }
        triangles
    }

    /// Links between neighbours along u and v, with their rest lengths, metres.
    pub fn edges(&self) -> Vec<([u32; 2], f64)> {
        let [h_u, h_v] = self.spacing_m();
        let mut edges = Vec::new();
        for i in 0..self.nodes[0] {
            for j in 0..self.nodes[1] {
                let here = self.index(i, j) as u32;
                if i + 1 < self.nodes[0] {
                    edges.push(([here, self.index(i + 1, j) as u32], h_u));
                }
                if j + 1 < self.nodes[1] {
                    edges.push(([here, self.index(i, j + 1) as u32], h_v));
                }
            }
        }
        edges
    }

    /// Index permutations that map the blank rectangle onto itself by a turn in its plane:
    /// the identity and the half turn, and the quarter turns of a square with square grid.
    ///
    /// Nobody can tell these apart on an unmarked sheet; `result[k][n]` is the node that takes
    /// the place of node `n`.
    pub fn turns(&self) -> Vec<Vec<usize>> {
        type Turn = fn([usize; 2], (usize, usize)) -> (usize, usize);
        let mut maps: Vec<Turn> = vec![|_, ij| ij, |[n, m], (i, j)| (n - 1 - i, m - 1 - j)];
        let [n, m] = self.nodes;
        if n == m && (self.size_m[0] - self.size_m[1]).abs() < 1e-9 {
            maps.push(|[n, _], (i, j)| (j, n - 1 - i));
            maps.push(|[n, _], (i, j)| (n - 1 - j, i));
        }
        let nodes: Vec<(usize, usize)> = (0..n).flat_map(|i| (0..m).map(move |j| (i, j))).collect();
        let turned = |turn: &Turn| {
            let places = nodes.iter().map(|ij| turn(self.nodes, *ij));
            places.map(|(i, j)| self.index(i, j)).collect()
        };
        maps.iter().map(turned).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn index_and_uv_agree_with_v_fastest() {
        let grid = SheetGrid::new([0.2, 0.3], [3, 4]);
        let uv: Vec<[f64; 2]> = grid.uv_m().collect();
        assert_eq!(uv.len(), grid.len());
        let [u, v] = uv[grid.index(2, 1)];
        assert!((u - 0.2).abs() < 1e-12 && (v - 0.1).abs() < 1e-12);
    }

    #[test]
    fn triangles_cover_the_area_once() {
        let grid = SheetGrid::new([0.2, 0.3], [3, 4]);
        let x = grid.flat_m();
        let area: f32 = grid
            .triangles()
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|k| x[k as usize]);
                ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0
            })
            .inspect(|area| assert!(*area > 0.0, "triangles are wound counter-clockwise"))
            .sum();
        assert!((area - 0.06).abs() < 1e-6);
    }

    #[test]
    fn turns_of_a_square_are_four_and_of_a_rectangle_two() {
        let square = SheetGrid::new([0.15, 0.15], [5, 5]);
        assert_eq!(square.turns().len(), 4);
        let flat = square.flat_m();
        for turn in square.turns() {
            // A turn is a rotation about the centre: (x, y) lands at equal radius, and the
            // images of two neighbours stay neighbours with the same handedness.
            let [a, b, c] = [(0, 0), (1, 0), (0, 1)].map(|(i, j)| flat[turn[square.index(i, j)]]);
            let cross = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            assert!(cross > 0.0);
        }
        assert_eq!(SheetGrid::new([0.21, 0.297], [25, 25]).turns().len(), 2);
    }

    #[test]
    fn bad_sheets_are_reported_whole() {
        let params = SheetParams {
            size_m: [210.0, f64::NAN],
            nodes: [1, 9000],
            density_kg_per_m2: 80.0,
            ..SheetParams::default()
        };
        let keys: Vec<String> = params.check().unwrap_err().into_iter().map(|p| p.key).collect();
        assert_eq!(keys, ["size_m", "nodes", "nodes", "density_kg_per_m2"]);
    }
}
