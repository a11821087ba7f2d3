//! Material points that are held.

use orime_creases::Folds;
use orime_geometry::SheetGrid;
use orime_lanes::{Field, Layout};

/// A material point that a gripper holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grip {
    /// The point, (u, v), metres.
    pub uv_m: [f64; 2],
    /// Where it is held, world frame, metres.
    pub position_m: [f64; 3],
}

/// A material point as a mean of nodes that all lie in one facet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Anchor {
    /// Places of the nodes; those of weight 0 do not count.
    pub places: [u32; 4],
    /// Their weights; they sum to 1.
    pub weights: [f32; 4],
    /// Where the point is held, metres, in the frame of the nodes.
    pub position_m: [f32; 3],
}

impl Anchor {
    /// The cell's nodes around a grip; a corner in another facet is left out where possible.
    ///
    /// `facets_of_place` has a bit per facet. `None` for a point off the sheet or not finite.
    pub fn new(
        grip: &Grip,
        folds: &Folds,
        facets_of_place: &[u32],
        origin_m: [f32; 3],
    ) -> Option<Self> {
        let layout = Layout::new(folds.sheet());
        let (corner, [s, t]) = cell(folds.sheet(), grip.uv_m)?;
        if !grip.position_m.iter().all(|c| c.is_finite()) {
            return None;
        }
        let [i, j] = corner;
        let places = [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]]
            .map(|[i, j]| (i * layout.stride + j) as u32);
        let bit = 1 << folds.facet_at(grip.uv_m);
        let inside = places.map(|n| facets_of_place[n as usize] & bit != 0);
        let candidates = [
            ([true; 4], [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t]),
            ([true, true, true, false], [1.0 - s - t, s, t, 0.0]),
            ([true, true, false, true], [1.0 - s, s - t, 0.0, t]),
            ([true, false, true, true], [1.0 - t, 0.0, t - s, s]),
            ([false, true, true, true], [0.0, 1.0 - t, 1.0 - s, s + t - 1.0]),
        ];
        // Extrapolating from a facet's own nodes beats interpolating across a crease.
        let within = candidates.iter().find(|(used, _)| (0..4).all(|k| inside[k] || !used[k]));
        let (_, weights) = within.unwrap_or(&candidates[0]);
        let position_m =
            [0, 1, 2].map(|axis| (grip.position_m[axis] - f64::from(origin_m[axis])) as f32);
        Some(Self { places, weights: weights.map(|w| w as f32), position_m })
    }

    /// Moves the nodes by that share of the way, each in proportion to its weight; nodes without
    /// inverse mass stay.
    pub fn pull(&self, x: &mut [Field; 3], masses: Option<&Field>, strength: f32) {
        let places = self.places.map(|n| n as usize);
        let mobility = places.map(|n| masses.map_or(1.0, |w| w.rows()[n].min(1.0)));
        let sum: f32 = (0..4).map(|k| mobility[k] * self.weights[k] * self.weights[k]).sum();
        if sum <= 0.0 {
            return;
        }
        for (x, position_m) in x.iter_mut().zip(self.position_m) {
            let x = x.rows_mut();
            let held: f32 = places.iter().zip(self.weights).map(|(n, w)| w * x[*n]).sum();
            let way = strength * (position_m - held) / sum;
            for k in 0..4 {
                x[places[k]] += mobility[k] * self.weights[k] * way;
            }
        }
    }
}

/// The cell that holds a point, and where in it.
fn cell(sheet: &SheetGrid, uv_m: [f64; 2]) -> Option<([usize; 2], [f64; 2])> {
    let mut corner = [0; 2];
    let mut within = [0.0; 2];
    for axis in 0..2 {
        let at = uv_m[axis] / sheet.spacing_m()[axis];
        let last = (sheet.nodes[axis] - 1) as f64;
        if !(-1e-6 <= at && at <= last + 1e-6) {
            return None;
        }
        corner[axis] = (at.max(0.0) as usize).min(sheet.nodes[axis] - 2);
        within[axis] = at - corner[axis] as f64;
    }
    Some((corner, within))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::links::facets_of_place;
    use orime_creases::Line;
    use orime_lanes::scatter;

    fn grip(uv_m: [f64; 2]) -> Grip {
        Grip { uv_m, position_m: [0.1, 0.2, 0.3] }
    }

    fn point(anchor: &Anchor, field: &Field) -> f64 {
        let each = anchor.places.iter().zip(anchor.weights);
        each.map(|(n, w)| f64::from(w) * f64::from(field.rows()[*n as usize])).sum()
    }

    #[test]
    fn weights_give_the_point_and_avoid_the_other_side_of_a_crease() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let layout = Layout::new(&sheet);
        let mut folds = Folds::flat(&sheet);
        folds.split(0, &Line::through([0.0, 0.0], [0.15, 0.15])).unwrap();
        let facets = facets_of_place(layout, &folds);
        let mut uv = layout.fields();
        let points: Vec<[f32; 3]> = sheet.uv_m().map(|[u, v]| [u as f32, v as f32, 0.0]).collect();
        scatter(layout, &points, &mut uv);
        for at in [[0.03, 0.1], [0.0341, 0.0332], [0.0332, 0.0341], [0.15, 0.15], [0.0, 0.0]] {
            let anchor = Anchor::new(&grip(at), &folds, &facets, [0.0; 3]).unwrap();
            let facet = 1 << folds.facet_at(at);
            for (place, weight) in anchor.places.iter().zip(anchor.weights) {
                assert!(weight == 0.0 || facets[*place as usize] & facet != 0, "{at:?} crosses");
            }
            let found = [point(&anchor, &uv[0]), point(&anchor, &uv[1])];
            assert!((0..2).all(|k| (found[k] - at[k]).abs() < 1e-7), "{found:?} not {at:?}");
        }
        for off in [[-0.01, 0.1], [0.1, 0.16], [f64::NAN, 0.1]] {
            assert_eq!(Anchor::new(&grip(off), &folds, &facets, [0.0; 3]), None);
        }
    }

    #[test]
    fn a_full_pull_puts_the_point_where_it_is_held() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let layout = Layout::new(&sheet);
        let folds = Folds::flat(&sheet);
        let facets = facets_of_place(layout, &folds);
        let anchor = Anchor::new(&grip([0.031, 0.1]), &folds, &facets, [0.0; 3]).unwrap();
        let mut x = layout.fields();
        scatter(layout, &sheet.flat_m(), &mut x);
        anchor.pull(&mut x, None, 1.0);
        for (x, expected) in x.iter().zip([0.1, 0.2, 0.3]) {
            assert!((point(&anchor, x) - expected).abs() < 1e-6);
        }
    }
}
