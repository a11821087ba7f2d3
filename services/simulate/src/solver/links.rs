//! Distance links of a grid, in colours: links of one colour share no node.

use crate::effect::Effect;
use orime_creases::Folds;
use orime_geometry::SheetGrid;
use orime_lanes::LANES;
use orime_lanes::{Chunk, Layout};

/// All links of one direction and reach, split into two colours.
///
/// Within a colour no two links share a node, so any order of the links, and any number of
/// threads, gives the same bits. All links of a colour go equally far through the padded rows, so
/// that sixteen neighbouring links are two vectors of nodes.
#[derive(Debug, Clone)]
pub(crate) struct Colour {
    /// Stretch, shear or bend.
    pub effect: Effect,
    /// From first to second node, in numbers of a field.
    pub offset: usize,
    /// Vectors of links, by growing first node.
    pub chunks: Vec<LinkChunk>,
    /// Rest lengths.
    pub rest_m: Rest,
    /// End of the last vector that the second nodes are read from.
    pub end: usize,
}

/// Sixteen links that start side by side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LinkChunk {
    /// Place of the first link's first node.
    pub first: u32,
    /// The links that are there and act.
    pub bits: u16,
    /// The links that are there.
    pub all: u16,
}

/// Rest lengths of a colour, metres.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Rest {
    /// All are equal.
    Same(f32),
    /// One per link of each chunk.
    Each(Vec<Chunk>),
}

impl Rest {
    /// Rest length of link `lane` of chunk `at`.
    pub fn of(&self, at: usize, lane: usize) -> f32 {
        match self {
            Self::Same(rest_m) => *rest_m,
            Self::Each(rest_m) => rest_m[at].0[lane],
        }
    }
}

/// A link between neighbours that crosses a crease: it may become shorter, not longer, and so
/// holds two facets together without keeping them from folding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Seam {
    /// Places of its ends.
    pub ends: [u32; 2],
    /// Rest length, metres.
    pub rest_m: f32,
}

impl Colour {
    /// Whether both ends of a link may lie in one vector.
    pub fn is_close(&self) -> bool {
        self.offset < LANES
    }

    /// Links that act.
    pub fn count(&self) -> usize {
        self.chunks.iter().map(|chunk| chunk.bits.count_ones() as usize).sum()
    }

    /// The links that act at a place: ends and rest length, metres; at most two.
    pub fn at(&self, place: u32) -> impl Iterator<Item = ([u32; 2], f32)> {
        let firsts = [Some(place), place.checked_sub(self.offset as u32)];
        firsts.into_iter().flatten().filter_map(|first| {
            let (start, lane) = (first - first % LANES as u32, first as usize % LANES);
            let at = self.chunks.binary_search_by_key(&start, |chunk| chunk.first).ok()?;
            let acts = self.chunks[at].bits >> lane & 1 == 1;
            acts.then(|| ([first, first + self.offset as u32], self.rest_m.of(at, lane)))
        })
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        let each = if let Rest::Each(rest_m) = &self.rest_m { rest_m.len() } else { 0 };
        self.chunks.len() * size_of::<LinkChunk>() + each * size_of::<Chunk>()
    }

    /// Lets the links give way to creases: a link whose ends no facet holds both crosses one.
    /// Such links between neighbours along u or v become seams; all others rest, unless they are
    /// `plastic`.
    pub fn cross(&mut self, facets_of_place: &[u32], plastic: bool, seams: &mut Vec<Seam>) {
        for (at, chunk) in self.chunks.iter_mut().enumerate() {
            chunk.bits = chunk.all;
            for lane in (0..LANES).filter(|lane| chunk.all >> lane & 1 == 1) {
                let first = chunk.first as usize + lane;
                let ends = [first, first + self.offset];
                if facets_of_place[ends[0]] & facets_of_place[ends[1]] != 0 {
                    continue;
                }
                if self.effect == Effect::Stretch {
                    let rest_m = self.rest_m.of(at, lane);
                    seams.push(Seam { ends: ends.map(|n| n as u32), rest_m });
                }
                if self.effect == Effect::Stretch || !plastic {
                    chunk.bits &= !(1 << lane);
                }
            }
        }
    }
}

/// The facets that each place belongs to, a bit per facet; none for the rows' padding.
pub(crate) fn facets_of_place(layout: Layout, folds: &Folds) -> Vec<u32> {
    layout.by_place(folds.facets_of_node())
}

/// What the links are made for.
pub(crate) struct Wanted<'a> {
    /// The effects; those that are no links are ignored.
    pub effects: &'a [Effect],
    /// Skip links reach that many steps.
    pub reach: usize,
    /// Node positions whose distances are the rest lengths, where the sheet is no flat rectangle.
    pub rest_m: Option<&'a [[f32; 3]]>,
    /// Whether each link needs a rest length of its own.
    pub each: bool,
}

/// The links of `sheet` that are wanted: along u, v and both diagonals, skip links up to `reach`
/// steps away.
///
/// For steps s, links start in alternating blocks of s rows (columns for v), which makes the two
/// colours disjoint. Long links come first: neighbours, whose stretch shows, have the last word.
pub(crate) fn coloured(sheet: &SheetGrid, wanted: &Wanted<'_>) -> Vec<Colour> {
    let mut colours = Vec::new();
    for step in (1..=wanted.reach).rev() {
        for direction in [[1, 0], [0, 1], [1, 1], [1, -1]] {
            let effect = match (step, direction[0] * direction[1]) {
                (1, 0) => Effect::Stretch,
                (1, _) => Effect::Shear,
                _ => Effect::Bend,
            };
            if wanted.effects.contains(&effect) {
                let colour = |parity| colour(sheet, wanted, direction, step, parity);
                let both = [0, 1].map(|parity| Colour { effect, ..colour(parity) });
                colours.extend(both.into_iter().filter(|colour| colour.count() > 0));
            }
        }
    }
    colours
}

fn colour(
    sheet: &SheetGrid,
    wanted: &Wanted<'_>,
    [di, dj]: [isize; 2],
    step: usize,
    parity: usize,
) -> Colour {
    let layout = Layout::new(sheet);
    let [n_u, n_v] = layout.nodes;
    let offset = (step as isize * (di * layout.stride as isize + dj)) as usize;
    let is_link = |i: usize, j: usize| {
        let block = if di == 1 { i / step } else { j / step };
        let (end_i, end_j) = (i + step * di as usize, j as isize + step as isize * dj);
        block % 2 == parity && j < n_v && end_i < n_u && 0 <= end_j && end_j < n_v as isize
    };
    let mut chunks = Vec::new();
    for first in (0..layout.size()).step_by(LANES) {
        let (i, j) = (first / layout.stride, first % layout.stride);
        let bits = (0..LANES).fold(0, |bits, k| bits | u16::from(is_link(i, j + k)) << k);
        // Close colours note every vector's moves, those of vectors without links too.
        if bits != 0 || offset < LANES {
            chunks.push(LinkChunk { first: first as u32, bits, all: bits });
        }
    }
    let h = sheet.spacing_m();
    let length_m = (step as f64) * (di as f64 * h[0]).hypot(dj as f64 * h[1]);
    let rest_m = match wanted.rest_m {
        None if !wanted.each => Rest::Same(length_m as f32),
        rest_m => {
            let length_of = |n: [usize; 2]| rest_m.map_or(length_m as f32, |x| distance_m(x, n));
            let each = |chunk: &LinkChunk| {
                let rest = |k: usize| {
                    let place = chunk.first as usize + k;
                    let (i, j) = (place / layout.stride, place % layout.stride);
                    let end = |along: isize, d: isize| (along + d * step as isize) as usize;
                    let ends = [[i, j], [end(i as isize, di), end(j as isize, dj)]];
                    let is_there = chunk.all >> k & 1 == 1;
                    if is_there { length_of(ends.map(|[i, j]| sheet.index(i, j))) } else { 1.0 }
                };
                Chunk(std::array::from_fn(rest))
            };
            Rest::Each(chunks.iter().map(each).collect())
        }
    };
    let end = chunks.last().map_or(0, |chunk| chunk.first as usize + offset + LANES);
    Colour { effect: Effect::Stretch, offset, chunks, rest_m, end }
}

/// Distance of two nodes, in f64 so that equal links get equal lengths.
fn distance_m(x: &[[f32; 3]], ends: [usize; 2]) -> f32 {
    let [a, b] = ends.map(|n| x[n].map(f64::from));
    let squared: f64 = (0..3).map(|axis| (b[axis] - a[axis]).powi(2)).sum();
    squared.sqrt() as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_creases::Line;

    const LINKS: [Effect; 3] = [Effect::Stretch, Effect::Shear, Effect::Bend];

    fn links(sheet: &SheetGrid, effects: &[Effect], reach: usize, each: bool) -> Vec<Colour> {
        coloured(sheet, &Wanted { effects, reach, rest_m: None, each })
    }

    #[test]
    fn links_of_a_colour_share_no_node_and_all_links_are_there() {
        for n in [5, 13, 25, 40] {
            let sheet = SheetGrid::new([0.15, 0.15], [n, n]);
            let mut total = 0;
            let colours = links(&sheet, &LINKS, 4, false);
            for colour in &colours {
                let mut used = vec![false; Layout::new(&sheet).size()];
                for chunk in &colour.chunks {
                    for lane in (0..LANES).filter(|lane| chunk.bits >> lane & 1 == 1) {
                        let first = chunk.first as usize + lane;
                        for place in [first, first + colour.offset] {
                            assert!(place % Layout::new(&sheet).stride < n, "in the padding");
                            assert!(!std::mem::replace(&mut used[place], true));
                        }
                    }
                }
                total += colour.count();
            }
            assert_eq!(total, 16 * n * n - 60 * n + 60); // design/simulate.md, fact 2.
        }
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        assert!(links(&sheet, &[Effect::Track], 4, false).is_empty());
    }

    #[test]
    fn rest_lengths_are_the_distances_of_the_rest_shape() {
        let sheet = SheetGrid::new([0.4, 0.3], [5, 4]);
        let flat = sheet.flat_m();
        let wanted = Wanted { effects: &LINKS, reach: 2, rest_m: Some(&flat), each: false };
        for (same, each) in links(&sheet, &LINKS, 2, false).iter().zip(coloured(&sheet, &wanted)) {
            assert!(matches!((&same.rest_m, &each.rest_m), (Rest::Same(_), Rest::Each(_))));
            for (at, chunk) in each.chunks.iter().enumerate() {
                for lane in (0..LANES).filter(|lane| chunk.all >> lane & 1 == 1) {
                    let [a, b] = [same, &each].map(|colour| colour.rest_m.of(at, lane));
                    assert!((a - b).abs() < 1e-7, "{a} {b}");
                }
            }
        }
    }

    /// Links along u that become seams, and links that rest, with a crease along u = `u_m`.
    fn crossed(u_m: f64, plastic: bool) -> [usize; 2] {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let mut folds = Folds::flat(&sheet);
        folds.split(0, &Line::through([u_m, 0.0], [u_m, 0.15])).unwrap();
        let mut colours = links(&sheet, &LINKS, 2, false);
        let before: usize = colours.iter().map(Colour::count).sum();
        let facets = facets_of_place(Layout::new(&sheet), &folds);
        let mut seams = Vec::new();
        colours.iter_mut().for_each(|colour| colour.cross(&facets, plastic, &mut seams));
        let after: usize = colours.iter().map(Colour::count).sum();
        [seams.len(), before - after - seams.len()]
    }

    #[test]
    fn links_that_cross_a_crease_give_way() {
        // On a grid line: skip links go, 25 along u and 23 along each diagonal; no neighbours.
        assert_eq!(crossed(0.075, false), [0, 25 + 2 * 23]);
        // Between two: 25 neighbours may shorten; 48 diagonals and two rows of skip links go.
        assert_eq!(crossed(0.078, false), [25, 2 * 24 + 2 * (25 + 2 * 23)]);
        // Plastic links stay.
        assert_eq!(crossed(0.078, true), [25, 0]);
    }
}
