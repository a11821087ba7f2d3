//! Edgels of one camera and kind, sorted by their place in the image.

use orime_geometry::Edgel;
use orime_lanes::LANES;
use std::ops::Range;

/// Side of a cell, pixels.
const CELL_PX: f32 = 16.0;

/// Edgels in structures of arrays, those of a cell beside each other, row of cells after row.
#[derive(Debug, Clone, Default)]
pub(super) struct Cells {
    columns: usize,
    rows: usize,
    inserted: Vec<Edgel>,
    /// First edgel of each cell, and the first that is of none.
    starts: Vec<u32>,
    /// Column and row of each, pixels; a vector of room behind, as the normals.
    pub position_px: [Vec<f32>; 2],
    /// Unit normals out of the sheet.
    pub normal: [Vec<f32>; 2],
}

impl Cells {
    /// None yet, of an image so large, pixels.
    pub fn new(width: u32, height: u32) -> Self {
        let cells = |px: u32| (px as f32 / CELL_PX) as usize + 1;
        let (columns, rows) = (cells(width), cells(height));
        Self { columns, rows, starts: vec![0; columns * rows + 1], ..Self::default() }
    }

    /// Adds an edgel, which must lie in the image, to those that [`Self::sort`] takes over.
    pub fn insert(&mut self, edgel: &Edgel) {
        self.inserted.push(*edgel);
    }

    /// Takes over what was inserted, in place of what was there.
    pub fn sort(&mut self) {
        let columns = self.columns;
        let cell = |edgel: &Edgel| {
            let [x, y] = edgel.position_px.map(|px| (px / CELL_PX) as usize);
            y * columns + x
        };
        self.starts.fill(0);
        for edgel in &self.inserted {
            self.starts[cell(edgel) + 1] += 1;
        }
        for k in 1..self.starts.len() {
            self.starts[k] += self.starts[k - 1];
        }
        let room = self.inserted.len() + LANES;
        for axis in self.position_px.iter_mut().chain(&mut self.normal) {
            axis.clear();
            axis.resize(room, 0.0);
        }
        // Each start counts up to the next cell's, and is put back in its place at last.
        for edgel in self.inserted.drain(..) {
            let at = &mut self.starts[cell(&edgel)];
            for axis in 0..2 {
                self.position_px[axis][*at as usize] = edgel.position_px[axis];
                self.normal[axis][*at as usize] = edgel.normal[axis];
            }
            *at += 1;
        }
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.starts.last().map_or(0, |last| *last as usize)
    }

    /// Those in the cells that a box about a pixel touches, `half_px` to either side of it; and
    /// some beside it.
    pub fn near(
        &self,
        pixel: [f32; 2],
        half_px: [f32; 2],
    ) -> impl Iterator<Item = Range<usize>> + '_ {
        let range = |axis: usize, count: usize| {
            let cell = |at: f32| ((at / CELL_PX).max(0.0) as usize).min(count);
            let first = cell(pixel[axis] - half_px[axis]);
            first..(cell(pixel[axis] + half_px[axis]) + 1).min(count)
        };
        let (columns, rows) = (range(0, self.columns), range(1, self.rows));
        rows.map(move |row| {
            let start = |column: usize| self.starts[row * self.columns + column] as usize;
            if columns.is_empty() { 0..0 } else { start(columns.start)..start(columns.end) }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_given_what_lies_in_it() {
        let edgel = |k: u32| {
            let px = [(k * 37 % 90) as f32 + 0.25, (k * 23 % 70) as f32];
            Edgel { position_px: px, normal: [k as f32, -(k as f32)], camera: 0, kind: 0 }
        };
        let edgels: Vec<Edgel> = (0..60).map(edgel).collect();
        let mut cells = Cells::new(90, 70);
        for edgels in [&edgels[..10], &edgels] {
            edgels.iter().for_each(|edgel| cells.insert(edgel));
            cells.sort();
        }
        assert_eq!(cells.len(), 60);
        for (pixel, half) in [([45.0, 30.0], [9.0, 20.0]), ([-3.0, 66.0], [25.0, 12.0])] {
            let mut found: Vec<[f32; 2]> = Vec::new();
            for k in cells.near(pixel, half).flatten() {
                let [x, y] = [0, 1].map(|axis| cells.position_px[axis][k]);
                let number = cells.normal[0][k];
                assert_eq!([x, y], edgels[number as usize].position_px);
                assert_eq!(cells.normal[1][k], -number);
                found.push([x, y]);
            }
            let inside = |e: &&Edgel| {
                (0..2).all(|axis| (e.position_px[axis] - pixel[axis]).abs() <= half[axis])
            };
            let wanted: Vec<_> = edgels.iter().filter(inside).collect();
            assert!(!wanted.is_empty() && found.len() < 60, "{} of {found:?}", wanted.len());
            assert!(wanted.iter().all(|edgel| found.contains(&edgel.position_px)));
        }
        assert_eq!(cells.near([500.0, 500.0], [3.0, 3.0]).flatten().count(), 0);
    }
}
