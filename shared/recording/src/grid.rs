//! Regular quad grids inside meshes: which vertex is node (i, j), whatever the file's order.

mod walk;

use crate::Obj;
use walk::Walk;

/// Why a mesh is no regular grid of quads.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GridError {
    /// A face has more or fewer than four different corners.
    #[error("face {face} of the mesh is no quad; a template is a regular grid of quads")]
    NoQuad {
        /// Number of the face, from 0.
        face: usize,
    },
    /// No vertex belongs to one quad alone.
    #[error("the mesh has no corner: a template is one rectangle of quads")]
    NoCorner,
    /// Rows differ in length, an edge has three faces, or a part hangs loose.
    #[error("the mesh is no rectangle of quads near vertex {vertex} (from 0)")]
    NoRectangle {
        /// Where it shows.
        vertex: u32,
    },
}

/// Nodes of a regular grid, `(i, j)` at `i * nodes[1] + j`.
///
/// Its quads `(i,j) (i+1,j) (i+1,j+1) (i,j+1)` wind as the mesh's faces do.
#[derive(Debug, Clone, PartialEq)]
pub struct QuadGrid {
    /// Nodes along i and j.
    pub nodes: [usize; 2],
    /// Positions, metres.
    pub positions_m: Vec<[f32; 3]>,
}

impl QuadGrid {
    /// Recovers the grid; node (0, 0) is the corner with the lowest vertex number.
    pub fn from_obj(obj: &Obj) -> Result<Self, GridError> {
        let mut quads = Vec::with_capacity(obj.faces.len());
        for (face, corners) in obj.faces.iter().enumerate() {
            let quad = <[u32; 4]>::try_from(&corners[..]).ok();
            let distinct = quad.filter(|q| (0..4).all(|a| (0..a).all(|b| q[a] != q[b])));
            quads.push(distinct.ok_or(GridError::NoQuad { face })?);
        }
        let walk = Walk::new(&quads);
        let order = walk.order(obj.vertices_m.len())?;
        let columns = order[0].len();
        Ok(Self {
            nodes: [order.len(), columns],
            positions_m: order.iter().flatten().map(|k| obj.vertices_m[*k as usize]).collect(),
        })
    }

    /// Mean length of the grid's lines along i and along j, metres.
    pub fn size_m(&self) -> [f64; 2] {
        let [n, m] = self.nodes;
        let length = |a: usize, b: usize| -> f64 {
            let (a, b) = (self.positions_m[a], self.positions_m[b]);
            (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
        };
        let mut sum = [0.0; 2];
        for i in 0..n {
            for j in 0..m {
                let here = i * m + j;
                if i + 1 < n {
                    sum[0] += length(here, here + m);
                }
                if j + 1 < m {
                    sum[1] += length(here, here + 1);
                }
            }
        }
        [sum[0] / m as f64, sum[1] / n as f64]
    }

    /// The same grid counted from its next corner: i and j change places, the winding stays.
    pub fn quarter_turned(&self) -> Self {
        let [n, m] = self.nodes;
        let positions_m = (0..m)
            .flat_map(|i| (0..n).map(move |j| (n - 1 - j) * m + i))
            .map(|k| self.positions_m[k])
            .collect();
        Self { nodes: [m, n], positions_m }
    }

    /// The same surface with other numbers of nodes (at least 2 each), bilinear within cells and
    /// even in the grid's own counting.
    pub fn resampled(&self, nodes: [usize; 2]) -> Vec<[f32; 3]> {
        let place = |k: usize, axis: usize| -> (usize, f32) {
            let cells = self.nodes[axis] - 1;
            let x = k as f64 * cells as f64 / (nodes[axis] - 1) as f64;
            let cell = (x as usize).min(cells - 1);
            (cell, (x - cell as f64) as f32)
        };
        let mut resampled = Vec::with_capacity(nodes[0] * nodes[1]);
        for a in 0..nodes[0] {
            for b in 0..nodes[1] {
                let ((i, s), (j, t)) = (place(a, 0), place(b, 1));
                let at = |i: usize, j: usize| self.positions_m[i * self.nodes[1] + j];
                let corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                let weights = [(1.0 - s) * (1.0 - t), s * (1.0 - t), s * t, (1.0 - s) * t];
                resampled.push(
                    [0, 1, 2].map(|k| {
                        corners.iter().zip(weights).map(|(corner, w)| w * corner[k]).sum()
                    }),
                );
            }
        }
        resampled
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid of `n × m` nodes at (i, j, 0), vertices and faces in a scrambled order.
    fn scrambled(n: usize, m: usize) -> Obj {
        let count = n * m;
        // Multiplying by a number without common factor permutes.
        let place = |k: usize| (k * 7 + 3) % count;
        assert_ne!(count % 7, 0);
        let mut vertices_m = vec![[0.0; 3]; count];
        let mut faces = Vec::new();
        for i in 0..n {
            for j in 0..m {
                vertices_m[place(i * m + j)] = [i as f32, j as f32, 0.0];
                if i + 1 < n && j + 1 < m {
                    let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                    let mut quad: Vec<u32> =
                        corners.iter().map(|(i, j)| place(i * m + j) as u32).collect();
                    quad.rotate_left((i + 2 * j) % 4);
                    faces.push(quad);
                }
            }
        }
        faces.reverse();
        Obj { vertices_m, faces }
    }

    #[test]
    fn a_scrambled_grid_is_put_in_order_with_its_winding() {
        for (n, m) in [(2, 2), (4, 5), (5, 4), (2, 6)] {
            let grid = QuadGrid::from_obj(&scrambled(n, m)).unwrap();
            let [rows, columns] = grid.nodes;
            assert!([rows, columns] == [n, m] || [rows, columns] == [m, n]);
            let at = |i: usize, j: usize| grid.positions_m[i * columns + j];
            for i in 0..rows - 1 {
                for j in 0..columns - 1 {
                    let (o, u, v) = (at(i, j), at(i + 1, j), at(i, j + 1));
                    let cross = (u[0] - o[0]) * (v[1] - o[1]) - (u[1] - o[1]) * (v[0] - o[0]);
                    assert_eq!(cross, 1.0, "node {i} {j} of {n} × {m}");
                }
            }
        }
    }

    #[test]
    fn sizes_turns_and_resampling_of_a_known_grid() {
        let grid = QuadGrid::from_obj(&scrambled(4, 5)).unwrap();
        let turned = grid.quarter_turned();
        assert_eq!(turned.nodes, [grid.nodes[1], grid.nodes[0]]);
        assert_eq!(turned.size_m(), [grid.size_m()[1], grid.size_m()[0]]);
        assert_eq!(turned.quarter_turned().quarter_turned().quarter_turned(), grid);
        // A plane stays a plane: corners stay, and nodes lie evenly between them.
        let fine = grid.resampled([7, 9]);
        assert_eq!(fine[0], grid.positions_m[0]);
        assert_eq!(fine[62], grid.positions_m[19]);
        let (a, b, middle) = (fine[0], fine[8], fine[4]);
        assert!((0..3).all(|k| (middle[k] - (a[k] + b[k]) / 2.0).abs() < 1e-6));
        assert_eq!(grid.resampled(grid.nodes), grid.positions_m);
    }

    #[test]
    fn what_is_no_rectangle_is_refused() {
        let mut triangle = scrambled(3, 3);
        triangle.faces[1].pop();
        assert_eq!(QuadGrid::from_obj(&triangle), Err(GridError::NoQuad { face: 1 }));
        for face in 0..12 {
            let mut hole = scrambled(4, 5);
            hole.faces.remove(face);
            assert!(QuadGrid::from_obj(&hole).is_err(), "without face {face}");
        }
        let mut twice = scrambled(3, 3);
        twice.faces.push(twice.faces[0].clone());
        assert!(QuadGrid::from_obj(&twice).is_err());
        assert_eq!(QuadGrid::from_obj(&Obj::default()), Err(GridError::NoCorner));
        // Found by fuzzing: a walk that leaves by a corner comes to an edge of no quad.
        let faces = [[0, 1, 2, 4], [1, 4, 5, 3], [8, 1, 2, 4], [1, 4, 0, 3]].map(Vec::from);
        let bent = Obj { vertices_m: vec![[0.0; 3]; 9], faces: faces.into() };
        assert!(QuadGrid::from_obj(&bent).is_err());
    }
}
