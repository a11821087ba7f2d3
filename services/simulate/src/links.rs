//! Distance links of a grid, in colours: links of one colour share no node.

use crate::effect::Effect;
use orime_creases::Folds;
use orime_geometry::SheetGrid;

/// All links of one direction and reach, split into two colours.
///
/// Within a colour no two links share a node, so any order of the links, and any number of
/// threads, gives the same bits.
#[derive(Debug, Clone)]
pub(crate) struct Colour {
    /// First and second node of each link.
    pub ends: Vec<[u32; 2]>,
    /// Rest length of each link, metres.
    pub rest_m: Vec<f32>,
    /// Whether a crease leaves each link alone, only forbids it to grow, or takes it out.
    pub holds: Vec<Hold>,
    /// Stretch, shear or bend.
    pub effect: Effect,
}

/// What a link does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Hold {
    /// It keeps its length.
    Length,
    /// It may become shorter: it joins two facets and must not keep them from folding.
    Growth,
    /// Nothing: it would keep two facets from folding.
    Nothing,
}

impl Colour {
    /// Lets the links give way to the creases: a link whose ends no facet holds both crosses one.
    pub fn cross(&mut self, folds: &Folds, facets_of_node: &[u32]) {
        let sheet = folds.sheet();
        for (ends, hold) in self.ends.iter().zip(&mut self.holds) {
            let [a, b] = ends.map(|n| facets_of_node[n as usize]);
            let axis = self.effect == Effect::Stretch;
            debug_assert!((ends[1] as usize) < sheet.len());
            *hold = if a & b != 0 {
                Hold::Length
            } else if axis {
                Hold::Growth
            } else {
                Hold::Nothing
            };
        }
    }
}

/// The facets that each node belongs to, a bit per facet.
pub(crate) fn facets_of_node(folds: &Folds) -> Vec<u32> {
    let mut facets = vec![0; folds.sheet().len()];
    for facet in 0..folds.facets().len() {
        for node in folds.members(facet) {
            facets[*node as usize] |= 1 << facet;
        }
    }
    facets
}

/// The links of `sheet` that these effects ask for: along u, v and both diagonals, skip links up
/// to `reach` steps away.
///
/// `rest_m` gives the positions whose distances are the rest lengths. For steps s, links start in
/// alternating blocks of s rows (columns for v), which makes the two colours disjoint.
pub(crate) fn coloured(
    sheet: &SheetGrid,
    effects: &[Effect],
    reach: usize,
    rest_m: &[[f32; 3]],
) -> Vec<Colour> {
    let mut colours = Vec::new();
    for step in 1..=reach {
        for [di, dj] in [[1, 0], [0, 1], [1, 1], [1, -1]] {
            let effect = match (step, di * dj) {
                (1, 0) => Effect::Stretch,
                (1, _) => Effect::Shear,
                _ => Effect::Bend,
            };
            if !effects.contains(&effect) {
                continue;
            }
            for parity in 0..2 {
                let ends = ends(sheet, [di, dj], step, parity);
                if !ends.is_empty() {
                    let rest_m = ends.iter().map(|ends| distance_m(rest_m, *ends)).collect();
                    let holds = vec![Hold::Length; ends.len()];
                    colours.push(Colour { ends, rest_m, holds, effect });
                }
            }
        }
    }
    colours
}

fn ends(sheet: &SheetGrid, [di, dj]: [isize; 2], step: usize, parity: usize) -> Vec<[u32; 2]> {
    let mut ends = Vec::new();
    for i in 0..sheet.nodes[0] {
        for j in 0..sheet.nodes[1] {
            let block = if di == 1 { i / step } else { j / step };
            if block % 2 != parity {
                continue;
            }
            let Some(end) = neighbour(sheet, [i, j], [di, dj], step) else { continue };
            ends.push([sheet.index(i, j), end].map(|n| n as u32));
        }
    }
    ends
}

fn neighbour(
    sheet: &SheetGrid,
    [i, j]: [usize; 2],
    [di, dj]: [isize; 2],
    step: usize,
) -> Option<usize> {
    let i = i.checked_add_signed(di * step as isize)?;
    let j = j.checked_add_signed(dj * step as isize)?;
    (i < sheet.nodes[0] && j < sheet.nodes[1]).then(|| sheet.index(i, j))
}

/// Distance of two nodes, in f64 so that equal links get equal lengths.
fn distance_m(x: &[[f32; 3]], ends: [u32; 2]) -> f32 {
    let [a, b] = ends.map(|n| x[n as usize].map(f64::from));
    let squared: f64 = (0..3).map(|axis| (b[axis] - a[axis]).powi(2)).sum();
    squared.sqrt() as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_creases::Line;

    const LINKS: [Effect; 3] = [Effect::Stretch, Effect::Shear, Effect::Bend];

    #[test]
    fn links_of_a_colour_share_no_node_and_all_links_are_there() {
        let n = 25;
        let sheet = SheetGrid::new([0.15, 0.15], [n, n]);
        let colours = coloured(&sheet, &LINKS, 4, &sheet.flat_m());
        let mut total = 0;
        for colour in &colours {
            let mut used = vec![false; sheet.len()];
            for node in colour.ends.iter().flatten() {
                assert!(!std::mem::replace(&mut used[*node as usize], true));
            }
            total += colour.ends.len();
        }
        assert_eq!(total, 16 * n * n - 60 * n + 60); // design/simulate.md, fact 2.
        assert!(coloured(&sheet, &[Effect::Track], 4, &sheet.flat_m()).is_empty());
    }

    #[test]
    fn rest_lengths_are_the_distances_of_the_rest_shape() {
        let sheet = SheetGrid::new([0.4, 0.3], [5, 4]);
        let rest = sheet.flat_m();
        let colours = coloured(&sheet, &LINKS, 2, &rest);
        let longest = colours.iter().flat_map(|c| &c.rest_m).fold(0f32, |a, b| a.max(*b));
        assert!((longest - 2.0 * 2f32.sqrt() * 0.1).abs() < 1e-6);
        assert!(colours.iter().all(|c| c.ends.len() == c.rest_m.len()));
    }

    /// Links per kind of hold, with a crease along u = `u_m`.
    fn held(u_m: f64) -> [usize; 3] {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let mut folds = Folds::flat(&sheet);
        folds.split(0, &Line::through([u_m, 0.0], [u_m, 0.15])).unwrap();
        let mut colours = coloured(&sheet, &LINKS, 2, &sheet.flat_m());
        let facets = facets_of_node(&folds);
        colours.iter_mut().for_each(|colour| colour.cross(&folds, &facets));
        [Hold::Length, Hold::Growth, Hold::Nothing]
            .map(|hold| colours.iter().flat_map(|c| &c.holds).filter(|h| **h == hold).count())
    }

    #[test]
    fn links_that_cross_a_crease_give_way() {
        // On a grid line: skip links go, 25 along u and 23 along each diagonal; no neighbours.
        assert_eq!(held(0.075)[1..], [0, 25 + 2 * 23]);
        // Between two: 25 neighbours may shorten; 48 diagonals and two rows of skip links go.
        assert_eq!(held(0.078)[1..], [25, 2 * 24 + 2 * (25 + 2 * 23)]);
    }
}
