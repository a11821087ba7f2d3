//! Numbers of nodes as structures of arrays, in rows padded to whole vectors.

use crate::lanes::LANES;
use bytemuck::{Pod, Zeroable};
use orime_geometry::SheetGrid;

/// One vector's worth of numbers, on a cache line of its own.
#[repr(C, align(64))]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Chunk(pub [f32; LANES]);

/// How the nodes of a grid lie in a [`Field`]: node (i, j) at `i·stride + j`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Nodes along u and v.
    pub nodes: [usize; 2],
    /// Numbers from row to row, a multiple of [`LANES`].
    pub stride: usize,
}

impl Layout {
    /// The layout of a sheet.
    pub fn new(sheet: &SheetGrid) -> Self {
        Self { nodes: sheet.nodes, stride: sheet.nodes[1].next_multiple_of(LANES) }
    }

    /// Numbers in all rows, without what stands around them.
    pub fn size(&self) -> usize {
        self.nodes[0] * self.stride
    }

    /// Where a node of the sheet's index order lies.
    pub fn place(&self, node: usize) -> usize {
        node / self.nodes[1] * self.stride + node % self.nodes[1]
    }

    /// Where each node lies, in the sheet's index order.
    pub fn places(self) -> impl Iterator<Item = usize> {
        (0..self.nodes[0]).flat_map(move |i| (0..self.nodes[1]).map(move |j| i * self.stride + j))
    }

    /// A value per node, in the sheet's index order, to where it lies; the default in the padding.
    pub fn by_place<T: Copy + Default>(&self, by_node: &[T]) -> Vec<T> {
        let mut by_place = vec![T::default(); self.size()];
        for (place, value) in self.places().zip(by_node) {
            by_place[place] = *value;
        }
        by_place
    }

    /// A field of zeros: a vector of room before the first row, and one after the last.
    pub fn field(&self) -> Field {
        Field(vec![Chunk([0.0; LANES]); self.size() / LANES + 2])
    }

    /// Three fields of zeros.
    pub fn fields(&self) -> [Field; 3] {
        [self.field(), self.field(), self.field()]
    }
}

/// A number per node.
#[derive(Debug, Clone, PartialEq)]
pub struct Field(Vec<Chunk>);

impl Field {
    /// All rows, and a vector of room after them.
    pub fn rows(&self) -> &[f32] {
        &bytemuck::cast_slice(&self.0)[LANES..]
    }

    /// All rows, and a vector of room after them.
    pub fn rows_mut(&mut self) -> &mut [f32] {
        &mut bytemuck::cast_slice_mut(&mut self.0)[LANES..]
    }

    /// A vector of room, then all rows, then a vector of room.
    pub fn with_room_mut(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.0)
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.0.as_slice())
    }
}

/// Writes positions into fields.
pub fn scatter(layout: Layout, from: &[[f32; 3]], to: &mut [Field; 3]) {
    for (axis, field) in to.iter_mut().enumerate() {
        let rows = field.rows_mut();
        for (place, x) in layout.places().zip(from) {
            rows[place] = x[axis];
        }
    }
}

/// Reads positions out of fields, moved by `origin_m`.
pub fn gather(layout: Layout, from: &[Field; 3], origin_m: [f32; 3], to: &mut [[f32; 3]]) {
    let [x, y, z] = [0, 1, 2].map(|axis| from[axis].rows());
    for (place, to) in layout.places().zip(to) {
        *to = [x[place] + origin_m[0], y[place] + origin_m[1], z[place] + origin_m[2]];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_scattered_is_gathered() {
        let sheet = SheetGrid::new([0.1, 0.2], [7, 18]);
        let layout = Layout::new(&sheet);
        assert_eq!((layout.stride, layout.size()), (32, 7 * 32));
        let mut fields = layout.fields();
        scatter(layout, &sheet.flat_m(), &mut fields);
        assert_eq!(fields[0].rows()[layout.place(20)], sheet.flat_m()[20][0]);
        let mut back = vec![[f32::NAN; 3]; sheet.len()];
        gather(layout, &fields, [0.0; 3], &mut back);
        assert_eq!(back, sheet.flat_m());
        assert_eq!(fields[0].rows().as_ptr() as usize % 64, 0);
    }
}
