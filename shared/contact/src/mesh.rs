//! The sheet's triangles and edges, whatever its folds.

use orime_geometry::SheetGrid;

/// No neighbour.
pub(crate) const NONE: u32 = u32::MAX;

/// Connectivity of [`SheetGrid::triangles`].
#[derive(Debug, Clone)]
pub(crate) struct Mesh {
    pub sheet: SheetGrid,
    pub triangles: Vec<[u32; 3]>,
    /// Across the side opposite of each corner: another triangle or [`NONE`].
    pub neighbours: Vec<[u32; 3]>,
    /// Every edge once, first node below second, ascending.
    pub edges: Vec<[u32; 2]>,
    /// The triangles at each edge; the second may be [`NONE`].
    pub sides: Vec<[u32; 2]>,
    /// Where the edges of each first node start; one more entry than nodes.
    pub edges_from: Vec<u32>,
    /// Rest length of each edge, metres.
    pub rest_m: Vec<f64>,
    pub uv_m: Vec<[f64; 2]>,
    /// Sides of a cell at rest, metres.
    spacing_m: [f64; 2],
    /// Twice the area of a triangle at rest, m².
    pub double_area_m2: f64,
    /// The longer side of a cell at rest, metres.
    pub spacing_max_m: f64,
}

impl Mesh {
    pub fn new(sheet: &SheetGrid) -> Self {
        let triangles = sheet.triangles();
        let uv_m: Vec<[f64; 2]> = sheet.uv_m().collect();
        // (edge, triangle, corner opposite), sorted by edge.
        let mut sides: Vec<([u32; 2], u32, usize)> = Vec::with_capacity(3 * triangles.len());
        for (t, corners) in triangles.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (corners[(k + 1) % 3], corners[(k + 2) % 3]);
                sides.push(([a.min(b), a.max(b)], t as u32, k));
            }
        }
        sides.sort_unstable();
        let mut mesh = Self {
            sheet: sheet.clone(),
            neighbours: vec![[NONE; 3]; triangles.len()],
            triangles,
            edges: Vec::new(),
            sides: Vec::new(),
            edges_from: Vec::new(),
            rest_m: Vec::new(),
            uv_m,
            spacing_m: sheet.spacing_m(),
            double_area_m2: sheet.spacing_m().into_iter().product(),
            spacing_max_m: sheet.spacing_m().into_iter().fold(0.0, f64::max),
        };
        for same in sides.chunk_by(|a, b| a.0 == b.0) {
            mesh.edges.push(same[0].0);
            mesh.sides.push([same[0].1, same.get(1).map_or(NONE, |side| side.1)]);
            if let [(_, t, k), (_, s, l)] = *same {
                mesh.neighbours[t as usize][k] = s;
                mesh.neighbours[s as usize][l] = t;
            }
        }
        let uv = |n: u32| mesh.uv_m[n as usize];
        let length = |[a, b]: &[u32; 2]| (uv(*a)[0] - uv(*b)[0]).hypot(uv(*a)[1] - uv(*b)[1]);
        mesh.rest_m = mesh.edges.iter().map(length).collect();
        let first = |n: usize| mesh.edges.partition_point(|edge| (edge[0] as usize) < n) as u32;
        mesh.edges_from = (0..=sheet.len()).map(first).collect();
        mesh
    }

    /// The cell that holds a material point, clamped to the sheet.
    pub fn cell(&self, uv_m: [f64; 2]) -> [usize; 2] {
        let nodes = self.sheet.nodes;
        // The cast cuts off; NaN and negatives go to 0.
        let cell =
            |axis: usize| ((uv_m[axis] / self.spacing_m[axis]) as usize).min(nodes[axis] - 2);
        [cell(0), cell(1)]
    }

    /// The two triangles of a cell.
    pub fn triangles_of(&self, [i, j]: [usize; 2]) -> [usize; 2] {
        let first = 2 * (i * (self.sheet.nodes[1] - 1) + j);
        [first, first + 1]
    }

    /// Barycentric weights of a material point in a triangle, at rest.
    pub fn weights(&self, triangle: usize, uv_m: [f64; 2]) -> [f64; 3] {
        let [a, b, c] = self.triangles[triangle];
        let [a, b, c] = [self.uv_m[a as usize], self.uv_m[b as usize], self.uv_m[c as usize]];
        let (e, f) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        let d = [uv_m[0] - a[0], uv_m[1] - a[1]];
        let double_area = e[0] * f[1] - e[1] * f[0];
        let v = (d[0] * f[1] - d[1] * f[0]) / double_area;
        let w = (e[0] * d[1] - e[1] * d[0]) / double_area;
        [1.0 - v - w, v, w]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_and_neighbours_fit_the_triangles() {
        let mesh = Mesh::new(&SheetGrid::new([0.2, 0.3], [5, 4]));
        // Euler: V − E + T = 1.
        assert_eq!(20 + mesh.triangles.len(), mesh.edges.len() + 1);
        let rim = mesh.sides.iter().filter(|side| side[1] == NONE).count();
        assert_eq!(rim, 2 * (4 + 3));
        let missing = mesh.neighbours.iter().flatten().filter(|t| **t == NONE).count();
        assert_eq!(missing, rim);
        for node in 0..20u32 {
            let [from, to] = [0, 1].map(|k| mesh.edges_from[node as usize + k] as usize);
            assert!(mesh.edges[from..to].iter().all(|edge| edge[0] == node));
        }
        // Both triangles of a cell hold its middle between them.
        let middle = [0.12, 0.22];
        let [s, t] = mesh.triangles_of(mesh.cell(middle));
        let inside = |t: usize| mesh.weights(t, middle).iter().all(|w| *w >= -1e-12);
        assert!(inside(s) || inside(t));
    }
}
