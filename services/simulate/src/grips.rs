//! Material points that are held.

use orime_creases::Folds;
use orime_geometry::SheetGrid;

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
    /// The nodes; those of weight 0 do not count.
    pub nodes: [u32; 4],
    /// Their weights; they sum to 1.
    pub weights: [f32; 4],
    /// Where the point is held, metres, in the frame of the nodes.
    pub position_m: [f32; 3],
}

impl Anchor {
    /// The cell's nodes around a grip; a corner in another facet is left out where possible.
    ///
    /// `facets_of_node` has a bit per facet. `None` for a point off the sheet or not finite.
    pub fn new(
        grip: &Grip,
        folds: &Folds,
        facets_of_node: &[u32],
        origin_m: [f32; 3],
    ) -> Option<Self> {
        let sheet = folds.sheet();
        let (corner, [s, t]) = cell(sheet, grip.uv_m)?;
        if !grip.position_m.iter().all(|c| c.is_finite()) {
            return None;
        }
        let [i, j] = corner;
        let nodes =
            [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]].map(|[i, j]| sheet.index(i, j) as u32);
        let bit = 1 << folds.facet_at(grip.uv_m);
        let inside = nodes.map(|n| facets_of_node[n as usize] & bit != 0);
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
        Some(Self { nodes, weights: weights.map(|w| w as f32), position_m })
    }

    /// Moves the nodes by that share of the way, each in proportion to its weight.
    pub fn pull(&self, x: &mut [[f32; 3]], strength: f32) {
        let sum: f32 = self.weights.iter().map(|w| w * w).sum();
        for axis in 0..3 {
            let held: f32 =
                self.nodes.iter().zip(self.weights).map(|(n, w)| w * x[*n as usize][axis]).sum();
            let way = strength * (self.position_m[axis] - held) / sum;
            for (node, weight) in self.nodes.iter().zip(self.weights) {
                x[*node as usize][axis] += weight * way;
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
    use crate::links::facets_of_node;
    use orime_creases::Line;

    fn grip(uv_m: [f64; 2]) -> Grip {
        Grip { uv_m, position_m: [0.1, 0.2, 0.3] }
    }

    #[test]
    fn weights_give_the_point_and_avoid_the_other_side_of_a_crease() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let mut folds = Folds::flat(&sheet);
        folds.split(0, &Line::through([0.0, 0.0], [0.15, 0.15])).unwrap();
        let facets = facets_of_node(&folds);
        let uv: Vec<[f64; 2]> = sheet.uv_m().collect();
        for point in [[0.03, 0.1], [0.0341, 0.0332], [0.0332, 0.0341], [0.15, 0.15], [0.0, 0.0]] {
            let anchor = Anchor::new(&grip(point), &folds, &facets, [0.0; 3]).unwrap();
            let facet = 1 << folds.facet_at(point);
            let mut found = [0.0; 2];
            for (node, weight) in anchor.nodes.iter().zip(anchor.weights) {
                let node = *node as usize;
                assert!(weight == 0.0 || facets[node] & facet != 0, "{point:?} crosses");
                for axis in 0..2 {
                    found[axis] += f64::from(weight) * uv[node][axis];
                }
            }
            assert!((0..2).all(|k| (found[k] - point[k]).abs() < 1e-7), "{found:?} not {point:?}");
        }
        for off in [[-0.01, 0.1], [0.1, 0.16], [f64::NAN, 0.1]] {
            assert_eq!(Anchor::new(&grip(off), &folds, &facets, [0.0; 3]), None);
        }
    }

    #[test]
    fn a_full_pull_puts_the_point_where_it_is_held() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let folds = Folds::flat(&sheet);
        let facets = facets_of_node(&folds);
        let anchor = Anchor::new(&grip([0.031, 0.1]), &folds, &facets, [0.0; 3]).unwrap();
        let mut x = sheet.flat_m();
        anchor.pull(&mut x, 1.0);
        for (axis, expected) in [0.1, 0.2, 0.3].into_iter().enumerate() {
            let held: f32 =
                (0..4).map(|k| anchor.weights[k] * x[anchor.nodes[k] as usize][axis]).sum();
            assert!((held - expected).abs() < 1e-6);
        }
    }
}
