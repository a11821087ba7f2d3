//! A sheet printed with markers: which corner is which point of the sheet.
//!
//! The control points are every other node of the sheet's grid, for 25 × 25 nodes 13 × 13. A
//! marker fills one control cell, and the next cell is white, so that each marker's four corners
//! are control points and each control point is a corner of one marker:
//!
//! ```text
//! control line   0   1   2   3   4   5   6   7   8   9  10  11  12
//! markers        #####   #####   #####   ####  #####   #####   ##### (across u and across v)
//! ```
//!
//! Thirteen lines cannot be paired, so the span that begins at the middle line is a narrow one: it
//! ends short of line 7, where the next begins, and that end is no control point. So 7 × 7 markers
//! cover all 169 points; 13 rows and columns of their 196 corners are surplus, but their place on
//! the sheet is known as exactly. No marker lies across a crease through the middle lines.
//!
//! The outermost markers end with the sheet: they are seen before a table brighter than their ink.
//! A sheet that is seen from both sides carries a layout on each, with ids of their own.

use orime_params::Problem;

use crate::{Dictionary, Raster};

/// Side of the sheet that a layout is printed on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SheetSide {
    /// Seen with v to the left of u: from where u × v points (from above, when laid on a table).
    Front,
    /// The other.
    Back,
}

/// Where on the sheet a marker's corner is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerPlace {
    /// Shares of the sheet's sides, 0 to 1; times `size_m` these are its material coordinates.
    pub uv_share: [f64; 2],
    /// Index of the node there, `i · nodes[1] + j`; none on the narrow markers' short ends.
    pub node: Option<usize>,
}

/// A marker on the sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SheetMarker {
    /// Its number in the dictionary.
    pub id: u32,
    /// In the order of a detected marker's corners.
    pub corners: [CornerPlace; 4],
}

/// What a marker covers along one axis of the sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Span {
    /// Shares of the sheet's side, the smaller first.
    share: [f64; 2],
    /// Nodes along the axis at both ends.
    node: [Option<usize>; 2],
}

/// Markers on one side of a sheet.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetLayout {
    dictionary: Dictionary,
    side: SheetSide,
    first_id: u32,
    spans: [Vec<Span>; 2],
    markers: Vec<SheetMarker>,
}

/// Width of the narrow span, control cells.
const NARROW_CELLS: f64 = 0.85;

/// Fewest nodes along a side: two markers.
const NODES_MIN: usize = 7;

impl SheetLayout {
    /// Markers `first_id`, `first_id + 1` … of the dictionary on a sheet of `nodes` nodes along
    /// u and v; numbered along v first.
    ///
    /// The problem, if there is one, is about the key `nodes` or `dictionary`.
    pub fn new(
        dictionary: &Dictionary,
        nodes: [usize; 2],
        side: SheetSide,
        first_id: u32,
    ) -> Result<Self, Problem> {
        if nodes.iter().any(|count| count % 2 == 0 || *count < NODES_MIN) {
            let message = format!(
                "is {nodes:?}: a printed sheet needs odd numbers of at least {NODES_MIN}, so that \
                 every other node can be a marker's corner"
            );
            return Err(Problem { key: "nodes".to_owned(), message });
        }
        let spans = nodes.map(spans);
        let count = spans[0].len() * spans[1].len();
        if first_id as usize + count > dictionary.len() as usize {
            let message = format!(
                "has {} markers, but the sheet needs {count} from {first_id} on: use a larger one",
                dictionary.len()
            );
            return Err(Problem { key: "dictionary".to_owned(), message });
        }
        let cells = spans[0].iter().flat_map(|u| spans[1].iter().map(move |v| [u, v]));
        let markers = cells
            .zip(first_id..)
            .map(|(cell, id)| SheetMarker { id, corners: corners(cell, side, nodes[1]) })
            .collect();
        Ok(Self { dictionary: dictionary.clone(), side, first_id, spans, markers })
    }

    /// Every marker, by id.
    pub fn markers(&self) -> &[SheetMarker] {
        &self.markers
    }

    /// The marker of this id, if the sheet has it.
    pub fn marker(&self, id: u32) -> Option<&SheetMarker> {
        self.markers.get(id.checked_sub(self.first_id)? as usize)
    }

    /// Whether there is ink at a point of the sheet, given in shares of its sides.
    pub fn is_black(&self, uv_share: [f64; 2]) -> bool {
        let find = |axis: usize| {
            let share = uv_share[axis];
            let spans = &self.spans[axis];
            let k = spans.partition_point(|span| span.share[1] <= share);
            let [start, end] = spans.get(k)?.share;
            (start <= share).then(|| (k, (share - start) / (end - start)))
        };
        let (Some((column, s)), Some((row, t))) = (find(0), find(1)) else { return false };
        let id = self.first_id + (column * self.spans[1].len() + row) as u32;
        // From the marker's own top-left to the right and down.
        let right = if self.side == SheetSide::Front { s } else { 1.0 - s };
        let modules = self.dictionary.modules();
        let module = |share: f64| ((share * modules as f64) as usize).min(modules - 1);
        self.dictionary.is_black(id, module(1.0 - t), module(right))
    }

    /// The printed side, as one sees it with v upwards: `size_px` pixels, u across. Pixels on a
    /// boundary are grey.
    pub fn print(&self, size_px: [usize; 2]) -> Raster {
        const SUBPIXELS: usize = 4;
        let [width, height] = size_px;
        let share = |pixel: usize, part: usize, count: usize| {
            (pixel as f64 + (part as f64 + 0.5) / SUBPIXELS as f64) / count as f64
        };
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let parts = (0..SUBPIXELS * SUBPIXELS).map(|k| {
                    let right = share(x, k % SUBPIXELS, width);
                    let u = if self.side == SheetSide::Front { right } else { 1.0 - right };
                    [u, 1.0 - share(y, k / SUBPIXELS, height)]
                });
                let white = parts.filter(|uv_share| !self.is_black(*uv_share)).count();
                pixels.push((255 * white / (SUBPIXELS * SUBPIXELS)) as u8);
            }
        }
        Raster { width, height, pixels }
    }
}

/// How the markers lie along an axis of `nodes` nodes.
fn spans(nodes: usize) -> Vec<Span> {
    let lines = nodes.div_ceil(2);
    let share = |cells: f64| cells / (lines - 1) as f64;
    let whole = |line: usize| Span {
        share: [share(line as f64), share((line + 1) as f64)],
        node: [Some(2 * line), Some(2 * line + 2)],
    };
    if lines.is_multiple_of(2) {
        return (0..lines).step_by(2).map(whole).collect();
    }
    // The last even line up to the middle.
    let middle = (lines - 1) / 2 / 2 * 2;
    let narrow = Span {
        share: [share(middle as f64), share(middle as f64 + NARROW_CELLS)],
        node: [Some(2 * middle), None],
    };
    let before = (0..middle).step_by(2).map(whole);
    before.chain([narrow]).chain((middle + 1..lines).step_by(2).map(whole)).collect()
}

/// Corners of the marker on two spans, clockwise as seen, from the top-left; v is upwards.
fn corners([u, v]: [&Span; 2], side: SheetSide, nodes_v: usize) -> [CornerPlace; 4] {
    let (left, right) = match side {
        SheetSide::Front => (0, 1),
        SheetSide::Back => (1, 0),
    };
    [(left, 1), (right, 1), (right, 0), (left, 0)].map(|(a, b)| CornerPlace {
        uv_share: [u.share[a], v.share[b]],
        node: u.node[a].zip(v.node[b]).map(|(i, j)| i * nodes_v + j),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(nodes: [usize; 2], side: SheetSide, first_id: u32) -> SheetLayout {
        let dictionary = Dictionary::predefined("DICT_4X4_100").unwrap();
        SheetLayout::new(&dictionary, nodes, side, first_id).unwrap()
    }

    #[test]
    fn every_other_node_is_a_corner_of_one_marker() {
        for nodes in [[25, 25], [25, 35], [21, 23], [7, 9]] {
            for side in [SheetSide::Front, SheetSide::Back] {
                let layout = layout(nodes, side, 0);
                let mut seen = vec![0; nodes[0] * nodes[1]];
                for corner in layout.markers().iter().flat_map(|marker| marker.corners) {
                    let Some(node) = corner.node else { continue };
                    seen[node] += 1;
                    let ij = [node / nodes[1], node % nodes[1]];
                    for axis in 0..2 {
                        let expected = ij[axis] as f64 / (nodes[axis] - 1) as f64;
                        assert!((corner.uv_share[axis] - expected).abs() < 1e-12);
                    }
                }
                for (node, seen) in seen.into_iter().enumerate() {
                    let control = node / nodes[1] % 2 == 0 && node % nodes[1] % 2 == 0;
                    assert_eq!(seen, usize::from(control), "node {node} of {nodes:?}");
                }
            }
        }
        assert_eq!(layout([25, 25], SheetSide::Front, 0).markers().len(), 49);
    }

    #[test]
    fn markers_keep_apart_and_off_the_middle_creases() {
        for span in spans(25).windows(2) {
            assert!(span[1].share[0] - span[0].share[1] > 0.14 / 12.0);
        }
        assert!(spans(25).iter().all(|span| span.share[1] <= 0.5 || span.share[0] >= 0.5));
    }

    #[test]
    fn ink_lies_inside_the_corners_and_shows_the_bits() {
        let dictionary = Dictionary::predefined("DICT_4X4_100").unwrap();
        for side in [SheetSide::Front, SheetSide::Back] {
            let layout = layout([25, 25], side, 40);
            for marker in layout.markers() {
                assert_eq!(layout.marker(marker.id), Some(marker));
                let [a, b, _, d] = marker.corners.map(|corner| corner.uv_share);
                for row in 0..6 {
                    for column in 0..6 {
                        let [s, t] = [column, row].map(|k| (k as f64 + 0.5) / 6.0);
                        let at = |k: usize| a[k] + s * (b[k] - a[k]) + t * (d[k] - a[k]);
                        let black = dictionary.is_black(marker.id, row, column);
                        assert_eq!(layout.is_black([at(0), at(1)]), black);
                    }
                }
                let outside = [0, 1].map(|k| a[k] - 0.1 * (b[k] - a[k]) - 0.1 * (d[k] - a[k]));
                assert!(!layout.is_black(outside));
            }
            assert_eq!(layout.marker(39), None);
            assert_eq!(layout.marker(89), None);
        }
    }

    #[test]
    fn what_cannot_be_printed_is_refused() {
        let dictionary = Dictionary::predefined("DICT_4X4_50").unwrap();
        let key = |nodes, first_id| {
            SheetLayout::new(&dictionary, nodes, SheetSide::Front, first_id).unwrap_err().key
        };
        assert_eq!(key([24, 25], 0), "nodes");
        assert_eq!(key([25, 5], 0), "nodes");
        assert_eq!(key([25, 25], 2), "dictionary");
    }
}
