//! Components of the mixture in blocks of 4 × 4 neighbours on the sheet: a vector each.
//!
//! What is near on the sheet is near in space, so that a block is asked about a cell of points as
//! a whole: nothing is gathered before the E-step, nor scattered after it.

use orime_geometry::SheetGrid;
use orime_lanes::{LANES, Lanes};

/// Components along a side of a block.
const SIDE: usize = 4;

/// The components of a grid in blocks, and where the blocks are.
#[derive(Debug, Clone)]
pub(crate) struct Blocks {
    /// The grid's component in each place; places that are left over repeat a neighbour's.
    pub components: Vec<u32>,
    /// A bit per place of a block: whether it is not left over.
    pub present: Vec<u16>,
    /// Lowest and highest coordinates of each block, metres, padded to whole vectors.
    low_m: [Vec<f32>; 3],
    high_m: [Vec<f32>; 3],
}

impl Blocks {
    /// For the components of a grid.
    pub fn new(grid: &SheetGrid) -> Self {
        let [rows, columns] = grid.nodes;
        let mut blocks = Self {
            components: Vec::new(),
            present: Vec::new(),
            low_m: Default::default(),
            high_m: Default::default(),
        };
        for i in (0..rows).step_by(SIDE) {
            for j in (0..columns).step_by(SIDE) {
                let mut present = 0;
                for lane in 0..LANES {
                    let (i, j) = (i + lane / SIDE, j + lane % SIDE);
                    present |= u16::from(i < rows && j < columns) << lane;
                    let component = grid.index(i.min(rows - 1), j.min(columns - 1));
                    blocks.components.push(component as u32);
                }
                blocks.present.push(present);
            }
        }
        // Blocks that pad the last vector are nowhere near anything.
        let padded = blocks.present.len().next_multiple_of(LANES);
        blocks.low_m.iter_mut().for_each(|low| low.resize(padded, f32::INFINITY));
        blocks.high_m.iter_mut().for_each(|high| high.resize(padded, f32::INFINITY));
        blocks
    }

    /// Places, left-over ones among them.
    pub fn places(&self) -> usize {
        self.components.len()
    }

    /// Whether a place is not left over.
    pub fn is_present(&self, place: usize) -> bool {
        self.present[place / LANES] >> (place % LANES) & 1 == 1
    }

    /// Places that are not left over.
    pub fn count(&self) -> usize {
        self.present.iter().map(|bits| bits.count_ones() as usize).sum()
    }

    /// Takes over where the places are.
    #[inline(always)]
    pub fn bound(&mut self, at_m: &[Vec<f32>; 3]) {
        for ((at_m, low_m), high_m) in at_m.iter().zip(&mut self.low_m).zip(&mut self.high_m) {
            let blocks = at_m.as_chunks::<LANES>().0.iter();
            for ((low, high), block) in low_m.iter_mut().zip(high_m).zip(blocks) {
                (*low, *high) = (fold(block, f32::min), fold(block, f32::max));
            }
        }
    }

    /// The blocks within `reach_m` of the box `low … high`, by their numbers.
    #[inline(always)]
    pub fn near<V: Lanes>(
        &self,
        (low, high): ([f32; 3], [f32; 3]),
        reach_m: f32,
        found: &mut Vec<u32>,
    ) {
        found.clear();
        let zero = V::splat(0.0);
        for first in (0..self.low_m[0].len()).step_by(LANES) {
            let mut squared = zero;
            for axis in 0..3 {
                let lows: &[f32] = &self.low_m[axis][first..first + LANES];
                let highs: &[f32] = &self.high_m[axis][first..first + LANES];
                // SAFETY: both slices have sixteen numbers.
                let (lows, highs) = unsafe { (V::load(lows.as_ptr()), V::load(highs.as_ptr())) };
                let beyond = lows.sub(V::splat(high[axis])).max(V::splat(low[axis]).sub(highs));
                let beyond = beyond.max(zero);
                squared = squared.add(beyond.mul(beyond));
            }
            let mut bits = V::splat(reach_m * reach_m).above(squared);
            while bits != 0 {
                found.push(first as u32 + bits.trailing_zeros());
                bits &= bits - 1;
            }
        }
    }
}

/// Sixteen numbers to one, pairwise.
#[inline(always)]
pub(crate) fn fold(lanes: &[f32; LANES], with: impl Fn(f32, f32) -> f32) -> f32 {
    let mut lanes = *lanes;
    let mut width = LANES / 2;
    while width > 0 {
        for lane in 0..width {
            lanes[lane] = with(lanes[lane], lanes[lane + width]);
        }
        width /= 2;
    }
    lanes[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_lanes::{Pass, Width};

    struct Near<'a>(&'a Blocks, ([f32; 3], [f32; 3]), f32, &'a mut Vec<u32>);

    impl Pass for Near<'_> {
        #[inline(always)]
        fn run<V: Lanes>(self) {
            self.0.near::<V>(self.1, self.2, self.3);
        }
    }

    #[test]
    fn every_component_has_one_place_and_near_blocks_are_found() {
        let grid = SheetGrid::new([0.15, 0.2], [10, 13]);
        let mut blocks = Blocks::new(&grid);
        assert_eq!((blocks.present.len(), blocks.count()), (12, 130));
        let mut of: Vec<u32> = (0..blocks.places())
            .filter(|place| blocks.is_present(*place))
            .map(|place| blocks.components[place])
            .collect();
        of.sort_unstable();
        assert!(of.into_iter().eq(0..130), "each component once");

        let flat = grid.flat_m();
        let at_m = [0, 1, 2].map(|axis| -> Vec<f32> {
            blocks.components.iter().map(|c| flat[*c as usize][axis]).collect()
        });
        blocks.bound(&at_m);
        let (low, high, reach_m) = ([0.01, 0.02, -0.01], [0.02, 0.03, 0.004], 0.02f32);
        let is_near = |block: u32| {
            (0..LANES).any(|lane| {
                let place = block as usize * LANES + lane;
                let beyond = |k: usize| (low[k] - at_m[k][place]).max(at_m[k][place] - high[k]);
                (0..3).map(|k| beyond(k).max(0.0).powi(2)).sum::<f32>() < reach_m * reach_m
            })
        };
        for width in Width::available() {
            let mut found = vec![7; 3];
            width.run(Near(&blocks, (low, high), reach_m, &mut found));
            assert!((1..9).contains(&found.len()), "{found:?}");
            assert!((0..12).all(|block| !is_near(block) || found.contains(&block)));
        }
    }
}
