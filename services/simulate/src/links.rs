//! Distance links of a grid, in colours: links of one colour share no node.

use orime_geometry::SheetGrid;

/// All links of one direction and reach, split into two colours.
///
/// Within a colour no two links share a node, so any order of the links, and any number of
/// threads, gives the same bits.
#[derive(Debug)]
pub(crate) struct Colour {
    /// First and second node of each link.
    pub ends: Vec<[u32; 2]>,
    /// Rest length of each link, metres.
    pub rest_m: Vec<f32>,
    /// Whether these are links between neighbours, as opposed to skip links.
    pub is_stretch: bool,
}

/// The links of `sheet` that reach 1 … `link_steps` steps, along u, v and both diagonals.
///
/// `rest_m` gives the positions whose distances are the rest lengths. For steps s, links start in
/// alternating blocks of s rows (columns for v), which makes the two colours disjoint.
pub(crate) fn coloured(sheet: &SheetGrid, link_steps: usize, rest_m: &[[f32; 3]]) -> Vec<Colour> {
    let mut colours = Vec::new();
    for step in 1..=link_steps {
        for [di, dj] in [[1, 0], [0, 1], [1, 1], [1, -1]] {
            for parity in 0..2 {
                let mut colour =
                    Colour { ends: Vec::new(), rest_m: Vec::new(), is_stretch: step == 1 };
                for i in 0..sheet.nodes[0] {
                    for j in 0..sheet.nodes[1] {
                        let block = if di == 1 { i / step } else { j / step };
                        if block % 2 != parity {
                            continue;
                        }
                        let Some(end) = neighbour(sheet, [i, j], [di, dj], step) else { continue };
                        let ends = [sheet.index(i, j), end];
                        colour.rest_m.push(distance_m(rest_m, ends));
                        colour.ends.push(ends.map(|n| n as u32));
                    }
                }
                if !colour.ends.is_empty() {
                    colours.push(colour);
                }
            }
        }
    }
    colours
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
fn distance_m(x: &[[f32; 3]], [a, b]: [usize; 2]) -> f32 {
    let squared: f64 =
        (0..3).map(|axis| (f64::from(x[b][axis]) - f64::from(x[a][axis])).powi(2)).sum();
    squared.sqrt() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_of_a_colour_share_no_node_and_all_links_are_there() {
        let n = 25;
        let sheet = SheetGrid::new([0.15, 0.15], [n, n]);
        let colours = coloured(&sheet, 4, &sheet.flat_m());
        let mut total = 0;
        for colour in &colours {
            let mut used = vec![false; sheet.len()];
            for node in colour.ends.iter().flatten() {
                assert!(!std::mem::replace(&mut used[*node as usize], true));
            }
            total += colour.ends.len();
        }
        assert_eq!(total, 16 * n * n - 60 * n + 60); // design/simulate.md, fact 2.
    }

    #[test]
    fn rest_lengths_are_the_distances_of_the_rest_shape() {
        let sheet = SheetGrid::new([0.4, 0.3], [5, 4]);
        let rest = sheet.flat_m();
        let colours = coloured(&sheet, 2, &rest);
        let longest = colours.iter().flat_map(|c| &c.rest_m).fold(0f32, |a, b| a.max(*b));
        assert!((longest - 2.0 * 2f32.sqrt() * 0.1).abs() < 1e-6);
        assert!(colours.iter().all(|c| c.ends.len() == c.rest_m.len()));
    }
}
