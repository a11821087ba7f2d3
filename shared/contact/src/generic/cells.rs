//! Which parts of the sheet come near each other: a hierarchy of boxes over the grid.

use crate::generic::pair::Pair;
use crate::mesh::Mesh;
use nalgebra::Vector3;

/// An axis-aligned box, metres; empty at first.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

impl Span {
    const EMPTY: Self = Self {
        low: Vector3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        high: Vector3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    fn add(&mut self, p: &Vector3<f64>) {
        self.low = self.low.inf(p);
        self.high = self.high.sup(p);
    }

    fn join(&mut self, other: &Self) {
        self.low = self.low.inf(&other.low);
        self.high = self.high.sup(&other.high);
    }

    fn is_near(&self, other: &Self, reach_m: f64) -> bool {
        (0..3).all(|k| {
            self.low[k] <= other.high[k] + reach_m && other.low[k] <= self.high[k] + reach_m
        })
    }
}

/// Boxes around every node, edge and triangle on its way.
#[derive(Debug, Clone)]
pub(crate) struct Boxes {
    nodes: Vec<Span>,
    edges: Vec<Span>,
    triangles: Vec<Span>,
}

impl Boxes {
    pub fn new(mesh: &Mesh) -> Self {
        let empty = |count: usize| vec![Span::EMPTY; count];
        Self {
            nodes: empty(mesh.uv_m.len()),
            edges: empty(mesh.edges.len()),
            triangles: empty(mesh.triangles.len()),
        }
    }

    /// Around the ways from `from` to `to`, this much wider on every side, metres.
    pub fn fill(&mut self, mesh: &Mesh, from: &[Vector3<f64>], to: &[Vector3<f64>], margin_m: f64) {
        let wide = Vector3::repeat(margin_m);
        for (node, (p, q)) in self.nodes.iter_mut().zip(from.iter().zip(to)) {
            *node = Span { low: p.inf(q) - wide, high: p.sup(q) + wide };
        }
        let around = |nodes: &[u32]| {
            nodes.iter().fold(Span::EMPTY, |mut span, n| {
                span.join(&self.nodes[*n as usize]);
                span
            })
        };
        for (span, edge) in self.edges.iter_mut().zip(&mesh.edges) {
            *span = around(edge);
        }
        for (span, triangle) in self.triangles.iter_mut().zip(&mesh.triangles) {
            *span = around(triangle);
        }
    }
}

/// Boxes over 2ᵏ × 2ᵏ blocks of cells, and the cells that come near each other.
#[derive(Debug, Clone)]
pub(crate) struct Cells {
    /// Finest first; each level has half as many rows and columns.
    levels: Vec<Level>,
    /// Pairs of near cells, by number of their first node.
    pub near: Vec<[u32; 2]>,
    stack: Vec<(usize, [usize; 2], [usize; 2])>,
}

#[derive(Debug, Clone)]
struct Level {
    size: [usize; 2],
    boxes: Vec<Span>,
}

impl Cells {
    pub fn new(mesh: &Mesh) -> Self {
        let mut size = mesh.sheet.nodes;
        let mut levels = Vec::new();
        loop {
            levels.push(Level { size, boxes: vec![Span::EMPTY; size[0] * size[1]] });
            if size == [1, 1] {
                break;
            }
            size = size.map(|n| n.div_ceil(2));
        }
        Self {
            levels,
            near: Vec::with_capacity(16 * mesh.uv_m.len()),
            stack: Vec::with_capacity(256),
        }
    }

    /// Finds the cells that come nearer than `reach_m` while nodes move from `from` to `to`.
    pub fn find(&mut self, mesh: &Mesh, from: &[Vector3<f64>], to: &[Vector3<f64>], reach_m: f64) {
        self.bound(mesh, from, to);
        self.near.clear();
        self.stack.clear();
        self.stack.push((self.levels.len() - 1, [0, 0], [0, 0]));
        while let Some((level, a, b)) = self.stack.pop() {
            let Level { size, boxes } = &self.levels[level];
            let at = |[i, j]: [usize; 2]| i * size[1] + j;
            if a != b && !boxes[at(a)].is_near(&boxes[at(b)], reach_m) {
                continue;
            }
            if level == 0 {
                self.near.push([at(a) as u32, at(b) as u32]);
                continue;
            }
            let below = self.levels[level - 1].size;
            let children = |[i, j]: [usize; 2]| {
                let all = [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[di, dj]| [2 * i + di, 2 * j + dj]);
                all.into_iter().filter(move |[i, j]| *i < below[0] && *j < below[1])
            };
            for c in children(a) {
                for d in children(b) {
                    if a != b || c <= d {
                        self.stack.push((level - 1, c, d));
                    }
                }
            }
        }
    }

    fn bound(&mut self, mesh: &Mesh, from: &[Vector3<f64>], to: &[Vector3<f64>]) {
        let [rows, columns] = mesh.sheet.nodes;
        for i in 0..rows {
            for j in 0..columns {
                let mut span = Span::EMPTY;
                for i in i..(i + 2).min(rows) {
                    for j in j..(j + 2).min(columns) {
                        let node = mesh.sheet.index(i, j);
                        span.add(&from[node]);
                        span.add(&to[node]);
                    }
                }
                self.levels[0].boxes[i * columns + j] = span;
            }
        }
        for level in 1..self.levels.len() {
            let (finer, coarser) = self.levels.split_at_mut(level);
            let (finer, coarser) = (&finer[level - 1], &mut coarser[0]);
            coarser.boxes.fill(Span::EMPTY);
            for i in 0..finer.size[0] {
                for j in 0..finer.size[1] {
                    let parent = i / 2 * coarser.size[1] + j / 2;
                    coarser.boxes[parent].join(&finer.boxes[i * finer.size[1] + j]);
                }
            }
        }
    }
}

/// What begins in a cell: its node, its edges and its triangles.
#[derive(Debug, Clone)]
pub(crate) struct Parts {
    edges: Vec<Vec<u32>>,
    triangles: Vec<Vec<u32>>,
}

impl Parts {
    pub fn new(mesh: &Mesh) -> Self {
        let columns = mesh.sheet.nodes[1];
        let mut parts = Self {
            edges: vec![Vec::new(); mesh.uv_m.len()],
            triangles: vec![Vec::new(); mesh.uv_m.len()],
        };
        let cell = |nodes: &[u32]| {
            let row = nodes.iter().map(|n| *n as usize / columns).min().unwrap_or(0);
            let column = nodes.iter().map(|n| *n as usize % columns).min().unwrap_or(0);
            row * columns + column
        };
        for (e, edge) in mesh.edges.iter().enumerate() {
            parts.edges[cell(edge)].push(e as u32);
        }
        for (t, triangle) in mesh.triangles.iter().enumerate() {
            parts.triangles[cell(triangle)].push(t as u32);
        }
        parts
    }

    /// All pairs of two cells that share no node and whose boxes meet.
    pub fn pairs(&self, mesh: &Mesh, boxes: &Boxes, [a, b]: [u32; 2], mut found: impl FnMut(Pair)) {
        for (first, second) in [(a, b), (b, a)] {
            for t in &self.triangles[second as usize] {
                let [p, q, r] = mesh.triangles[*t as usize];
                let meets = boxes.nodes[first as usize].is_near(&boxes.triangles[*t as usize], 0.0);
                if meets && first != p && first != q && first != r {
                    found(Pair { nodes: [first, p, q, r], edges: false });
                }
            }
            if a == b {
                break;
            }
        }
        for (k, e) in self.edges[a as usize].iter().enumerate() {
            let others = &self.edges[b as usize];
            for f in if a == b { &others[k + 1..] } else { &others[..] } {
                let ([p, q], [r, s]) = (mesh.edges[*e as usize], mesh.edges[*f as usize]);
                let meets = boxes.edges[*e as usize].is_near(&boxes.edges[*f as usize], 0.0);
                if meets && p != r && p != s && q != r && q != s {
                    found(Pair { nodes: [p, q, r, s], edges: true });
                }
            }
        }
    }

    /// All edges and triangles of two cells that share no node: edge number and triangle number.
    pub fn piercings(&self, mesh: &Mesh, [a, b]: [u32; 2], mut found: impl FnMut(u32, u32)) {
        for (first, second) in [(a, b), (b, a)] {
            for e in &self.edges[first as usize] {
                for t in &self.triangles[second as usize] {
                    let edge = mesh.edges[*e as usize];
                    if !mesh.triangles[*t as usize].iter().any(|n| edge.contains(n)) {
                        found(*e, *t);
                    }
                }
            }
            if a == b {
                break;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::SheetGrid;

    #[test]
    fn every_edge_and_triangle_begins_in_one_cell() {
        let mesh = Mesh::new(&SheetGrid::new([0.1, 0.1], [7, 5]));
        let parts = Parts::new(&mesh);
        assert_eq!(parts.edges.iter().map(Vec::len).sum::<usize>(), mesh.edges.len());
        assert_eq!(parts.triangles.iter().map(Vec::len).sum::<usize>(), mesh.triangles.len());
    }

    #[test]
    fn near_cells_are_found_once_and_all_of_them() {
        let sheet = SheetGrid::new([0.1, 0.1], [9, 6]);
        let mesh = Mesh::new(&sheet);
        let mut seed = 5u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1 << 24)
        };
        let x: Vec<Vector3<f64>> =
            (0..54).map(|_| Vector3::new(random(), random(), random())).collect();
        let mut cells = Cells::new(&mesh);
        cells.find(&mesh, &x, &x, 0.01);
        let mut found: Vec<[u32; 2]> =
            cells.near.iter().map(|[a, b]| [*a.min(b), *a.max(b)]).collect();
        found.sort_unstable();
        let boxes = &cells.levels[0].boxes;
        let mut expected = Vec::new();
        for a in 0..54u32 {
            for b in a..54 {
                if a == b || boxes[a as usize].is_near(&boxes[b as usize], 0.01) {
                    expected.push([a, b]);
                }
            }
        }
        assert_eq!(found, expected);
    }
}
