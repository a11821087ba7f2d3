//! Ends of a crease put on landmarks of the piece that it parts: corners, middles of sides, and
//! ends of other creases.

use super::hinge::chord;
use crate::folds::Facet;
use crate::line::Line;

/// Points of a piece's border nearer to it than this are on it, metres.
pub(super) const ON_BORDER_M: f64 = 1e-6;

/// The line with its ends on landmarks that are near enough: the piece's own and those of `others`
/// that lie on its border; `tolerance_m` is for each end point. `None` where none is; and whether
/// both are.
pub(crate) fn snap(
    line: &Line,
    piece: &Facet,
    others: impl Iterator<Item = [f64; 2]> + Clone,
    tolerance_m: impl Fn([f64; 2]) -> f64,
) -> Option<(Line, bool)> {
    let ends = chord(&piece.corners_m, line)?;
    let ends = ends.map(|t| [0, 1].map(|k| line.point_m[k] + t * line.direction[k]));
    let snapped = ends.map(|end| nearest(end, piece, others.clone(), tolerance_m(end)));
    match snapped {
        [Some(a), Some(b)] if apart_m(a, b) > ON_BORDER_M => Some((Line::through(a, b), true)),
        [Some(a), None] | [None, Some(a)] => {
            Some((Line { point_m: a, direction: line.direction }, false))
        }
        _ => None,
    }
}

/// The landmark nearest to a point, where near enough.
fn nearest(
    end: [f64; 2],
    piece: &Facet,
    others: impl Iterator<Item = [f64; 2]>,
    tolerance_m: f64,
) -> Option<[f64; 2]> {
    let corners = piece.corners_m.iter();
    let next = corners.clone().cycle().skip(1);
    let middles = corners.clone().zip(next).map(|(a, b)| [0, 1].map(|k| (a[k] + b[k]) / 2.0));
    let others = others.filter(|p| piece.inside_m(*p).abs() < ON_BORDER_M);
    let near = corners.copied().chain(others).chain(middles).map(|p| (apart_m(p, end), p));
    let near = near.filter(|(apart, _)| *apart <= tolerance_m);
    near.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, p)| p)
}

fn apart_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_ends_are_snapped_and_far_ones_are_not() {
        let piece = Facet { corners_m: vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] };
        let others = [[0.5, 0.5], [1.0, 0.2]].into_iter();
        let cases = [
            // Both near corners; one near a middle; none.
            (([0.02, 0.0], [1.0, 0.97]), ([0.0, 0.0], [1.0, 1.0])),
            (([0.0, 0.52], [1.0, 0.3]), ([0.0, 0.5], [1.0, 0.28])),
            (([0.0, 0.3], [0.8, 0.0]), ([0.0, 0.3], [0.8, 0.0])),
            // Near the end of another crease.
            (([0.0, 0.3], [1.0, 0.23]), ([0.0, 0.27], [1.0, 0.2])),
        ];
        for ((a, b), (c, d)) in cases {
            let line = Line::through(a, b);
            let snapped = snap(&line, &piece, others.clone(), |_| 0.05);
            let (line, both) = snapped.unwrap_or((line, false));
            assert_eq!(both, (a[0] - c[0]).abs() < 0.03 && c[1] == 0.0, "{line:?}");
            assert!(line.side_m(c).abs() < 1e-9 && line.side_m(d).abs() < 1e-9, "{line:?}");
        }
    }
}
