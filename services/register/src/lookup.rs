//! Which components of the mixture lie near a box.

use crate::cloud::bounds;
use orime_lanes::{LANES, Lanes};
use std::ops::Range;

/// Most cells of the grid along an axis.
const CELLS_MAX: usize = 48;

/// Counting-sorted grid over the components.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lookup {
    low: [f32; 3],
    cells_per_m: f32,
    cells: [usize; 3],
    /// First place of each cell, and the end of the last.
    starts: Vec<u32>,
    /// The cell of each component.
    cell_of: Vec<u32>,
    /// The component in each place, cell after cell.
    order: Vec<u32>,
    /// Where it is, metres; a vector of room behind.
    at_m: [Vec<f32>; 3],
}

impl Lookup {
    /// Sorts components into cells of `cell_m` or, where that would be too many, larger ones.
    pub fn fill(&mut self, positions_m: &[[f32; 3]], cell_m: f32) {
        let (low, high) = bounds(positions_m);
        let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0f32, f32::max);
        self.low = low;
        self.cells_per_m = 1.0 / cell_m.max(extent / (CELLS_MAX - 1) as f32);
        self.cells =
            [0, 1, 2].map(|axis| ((high[axis] - low[axis]) * self.cells_per_m) as usize + 1);
        self.starts.clear();
        self.starts.resize(self.cells.iter().product::<usize>() + 1, 0);
        self.cell_of.clear();
        for position in positions_m {
            let cell = self.cell(*position);
            self.cell_of.push(cell as u32);
            self.starts[cell] += 1;
        }
        // Each cell's end; filling from the back then makes it the cell's start.
        let mut end = 0;
        for start in &mut self.starts {
            end += *start;
            *start = end;
        }
        self.order.resize(positions_m.len(), 0);
        for at_m in &mut self.at_m {
            at_m.resize(positions_m.len() + LANES, 0.0);
        }
        for (m, cell) in self.cell_of.iter().enumerate().rev() {
            let start = &mut self.starts[*cell as usize];
            *start -= 1;
            let place = *start as usize;
            self.order[place] = m as u32;
            for (at_m, position) in self.at_m.iter_mut().zip(positions_m[m]) {
                at_m[place] = position;
            }
        }
    }

    /// Tells each component within `reach_m` of the box `low … high`, cell by cell: its number
    /// and where it is from `low`, metres.
    #[inline(always)]
    pub fn near<V: Lanes>(
        &self,
        (low, high): ([f32; 3], [f32; 3]),
        reach_m: f32,
        mut found: impl FnMut(u32, [f32; 3]),
    ) {
        let range = |axis: usize| -> Option<Range<usize>> {
            let first = (low[axis] - reach_m - self.low[axis]) * self.cells_per_m;
            let last = (high[axis] + reach_m - self.low[axis]) * self.cells_per_m;
            if last < 0.0 || first >= self.cells[axis] as f32 {
                return None;
            }
            Some(first.max(0.0) as usize..(last as usize + 1).min(self.cells[axis]))
        };
        let (Some(xs), Some(ys), Some(zs)) = (range(0), range(1), range(2)) else { return };
        for x in xs {
            for y in ys.clone() {
                let row = (x * self.cells[1] + y) * self.cells[2];
                let end = self.starts[row + zs.end] as usize;
                for first in (self.starts[row + zs.start] as usize..end).step_by(LANES) {
                    let mut bits = self.within::<V>(first, low, high, reach_m);
                    bits &= u16::MAX >> (LANES - (end - first).min(LANES));
                    while bits != 0 {
                        let place = first + bits.trailing_zeros() as usize;
                        bits &= bits - 1;
                        let from_low = [0, 1, 2].map(|axis| self.at_m[axis][place] - low[axis]);
                        found(self.order[place], from_low);
                    }
                }
            }
        }
    }

    /// A bit for each of sixteen places from `first` on: whether it lies near the box.
    #[inline(always)]
    fn within<V: Lanes>(&self, first: usize, low: [f32; 3], high: [f32; 3], reach_m: f32) -> u16 {
        let zero = V::splat(0.0);
        let mut squared = zero;
        for axis in 0..3 {
            let at: &[f32] = &self.at_m[axis][first..first + LANES];
            // SAFETY: the slice has sixteen numbers.
            let at = unsafe { V::load(at.as_ptr()) };
            let outside = V::splat(low[axis]).sub(at).max(at.sub(V::splat(high[axis]))).max(zero);
            squared = squared.add(outside.mul(outside));
        }
        V::splat(reach_m * reach_m).above(squared)
    }

    fn cell(&self, p: [f32; 3]) -> usize {
        let at = |axis: usize| {
            (((p[axis] - self.low[axis]) * self.cells_per_m) as usize).min(self.cells[axis] - 1)
        };
        (at(0) * self.cells[1] + at(1)) * self.cells[2] + at(2)
    }
}
