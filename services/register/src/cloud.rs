//! Observed points in cells, for the whole of a frame.

use std::ops::Range;

/// Observed points, sorted into cells for the whole frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cloud {
    /// Positions, metres, cell after cell.
    pub points_m: Vec<[f32; 3]>,
    /// The cells that hold points.
    pub cells: Vec<Cell>,
    /// Camera of each point; within a cell they ascend.
    pub cameras: Vec<u32>,
    /// Cell, then camera and place in the input.
    keys: Vec<(u64, u64)>,
}

/// Points near each other.
#[derive(Debug, Clone)]
pub(crate) struct Cell {
    /// Their places in the cloud.
    pub points: Range<usize>,
    /// Corners of their bounding box, metres.
    pub bounds_m: ([f32; 3], [f32; 3]),
}

impl Cloud {
    /// The place that a point had in what was filled in.
    pub fn source(&self, point: usize) -> usize {
        (self.keys[point].1 & 0xffff_ffff) as usize
    }

    /// Sorts points, each with its camera, into cells of `cell_m`; all must be finite. Their order
    /// does not matter.
    pub fn fill(&mut self, points: impl Iterator<Item = ([f32; 3], u32)>, cell_m: f32) {
        let unsorted: Vec<([f32; 3], u32)> = points.collect();
        let cell =
            |c: f32| ((c / cell_m).floor() as i64 + (1 << 20)).clamp(0, (1 << 21) - 1) as u64;
        self.keys.clear();
        self.keys.extend(unsorted.iter().enumerate().map(|(n, (p, camera))| {
            let key = (cell(p[0]) << 42) | (cell(p[1]) << 21) | cell(p[2]);
            (key, (u64::from(*camera) << 32) | n as u64)
        }));
        self.keys.sort_unstable();
        let place = |key: &(u64, u64)| unsorted[(key.1 & 0xffff_ffff) as usize];
        self.points_m.clear();
        self.points_m.extend(self.keys.iter().map(|key| place(key).0));
        self.cameras.clear();
        self.cameras.extend(self.keys.iter().map(|key| place(key).1));
        self.cells.clear();
        let mut start = 0;
        for end in 1..=self.keys.len() {
            if end == self.keys.len() || self.keys[end].0 != self.keys[start].0 {
                let bounds_m = bounds(&self.points_m[start..end]);
                self.cells.push(Cell { points: start..end, bounds_m });
                start = end;
            }
        }
    }
}

/// Corners of the bounding box; an inverted box for no points.
pub(crate) fn bounds(points: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for p in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(p[axis]);
            high[axis] = high[axis].max(p[axis]);
        }
    }
    (low, high)
}
