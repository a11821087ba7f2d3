//! Creases that close around a facet, and creases that meet back to back.

use crate::gap::Gaps;
use crate::near::Near;
use crate::order::{Facing, Order};
use crate::pose::Opening;
use crate::push::{Worst, weighted_push};
use crate::topology::SpinePoint;
use nalgebra::Vector3;

/// A crease with a cosine below this closes around nothing (45°).
const OPEN_COSINE: f64 = -0.7;
/// Nodes deeper than this in the wedge, or farther than this outside of it, are no contact, metres.
const DEEP_M: f64 = 3e-3;
const OUTSIDE_M: f64 = 10e-3;
/// A facet with a node farther than this outside of a crease is taken for one that lies elsewhere,
/// whatever the order says, which may have been taken when the two did not overlap yet: pulled
/// through by 9 mm, one threw a sheet apart. Metres.
const WRONG_M: f64 = 4e-3;
/// How far a place may lie past the crease's end, metres: inside the sheet, and at its rim, where
/// tips lie on tips.
const END_M: f64 = 1e-6;
const RIM_END_M: f64 = 1e-3;

/// A place that has to stay on one side of a crease.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SpineContact {
    nodes: [u32; 6],
    weights: [f64; 6],
    direction: Vector3<f64>,
    gap_m: f64,
}

/// What a round needs to find them.
pub(crate) struct Search<'a> {
    pub gaps: &'a Gaps<'a>,
    pub near: &'a Near,
    pub order: &'a Order,
    pub x: &'a [Vector3<f64>],
}

/// Fills `found` with the contacts of a round. `seen`: room for one mark per node.
pub(crate) fn find(found: &mut Vec<SpineContact>, seen: &mut [u32], search: &Search) {
    found.clear();
    seen.fill(u32::MAX);
    for crease in 0..search.gaps.openings.len() {
        search.nested(crease, found, seen);
    }
    for facing in &search.order.facing {
        let [c, d] = facing.creases;
        search.back_to_back(facing, [c, d], found);
        search.back_to_back(facing, [d, c], found);
    }
}

impl Search<'_> {
    fn at(&self, point: &SpinePoint) -> Vector3<f64> {
        let [a, b] = point.nodes.map(|n| self.x[n as usize]);
        a * (1.0 - point.t) + b * point.t
    }

    /// Facets between the two of a crease stay inside its wedge.
    fn nested(&self, crease: usize, found: &mut Vec<SpineContact>, seen: &mut [u32]) {
        let topology = self.gaps.topology;
        let opening = &self.gaps.openings[crease];
        let [left, right] = topology.creases[crease].facets;
        let (of_left, of_right) = (self.order.sign(right, left), self.order.sign(left, right));
        if opening.cosine < OPEN_COSINE || of_left == 0 || of_right == 0 {
            return;
        }
        for (g, facet) in topology.facets.iter().enumerate() {
            if g == left
                || g == right
                || self.near.overlap(g, left) + self.near.overlap(g, right) == 0
                || self.order.sign(g, left) != of_left
                || self.order.sign(g, right) != of_right
            {
                continue;
            }
            let first = found.len();
            for (node, _) in &facet.core {
                let facets = topology.of_node[*node as usize];
                let own = facets >> left & 1 == 1 || facets >> right & 1 == 1;
                if own
                    || std::mem::replace(&mut seen[*node as usize], crease as u32) == crease as u32
                {
                    continue;
                }
                let corner_gap_m = |f| self.gaps.beside_spine(f, g, *node);
                let gap_m = corner_gap_m(left).min(corner_gap_m(right));
                let place = SpinePoint { nodes: [*node; 2], t: 0.0, along_m: 0.0 };
                found.extend(self.contact(crease, opening, &place, opening.inward, gap_m));
            }
            let outside = |contact: &SpineContact| contact.deep_m(self.x) < -WRONG_M;
            if found[first..].iter().any(outside) {
                // Another facet that a node is of may yet be the one.
                for contact in found.drain(first..) {
                    seen[contact.nodes[0] as usize] = u32::MAX;
                }
            }
        }
    }

    /// The second crease's nodes stay outside of the first crease's wedge.
    fn back_to_back(&self, facing: &Facing, [c, d]: [usize; 2], found: &mut Vec<SpineContact>) {
        let topology = self.gaps.topology;
        let opening = &self.gaps.openings[c];
        let crease = &topology.creases[d];
        for point in &crease.spine {
            let params = self.gaps.params;
            let gap_m = match facing.corner_m {
                None => params.spine_gap_m,
                Some([u, v]) => {
                    let [a, b] = crease.ends_m[0];
                    let [x, y] = crease.direction;
                    let (u, v) = (a + x * point.along_m - u, b + y * point.along_m - v);
                    params.spine_gap_m.min(params.spine_slope * u.hypot(v))
                }
            };
            if gap_m > END_M {
                found.extend(self.contact(c, opening, point, -opening.inward, gap_m));
            }
        }
    }

    /// The contact of a place with the piece of the crease beside it.
    fn contact(
        &self,
        crease: usize,
        opening: &Opening,
        place: &SpinePoint,
        direction: Vector3<f64>,
        gap_m: f64,
    ) -> Option<SpineContact> {
        let spine = &self.gaps.topology.creases[crease].spine;
        let first = self.at(spine.first()?);
        let position = self.at(place);
        let along = |p: &Vector3<f64>| (p - first).dot(&opening.axis);
        let s = along(&position);
        let past = self.gaps.topology.creases[crease].at_rim;
        let past_m = past.map(|rim| if rim { RIM_END_M } else { END_M });
        if s < -past_m[0] || s > along(&self.at(spine.last()?)) + past_m[1] {
            return None;
        }
        let beside = |piece: &&[SpinePoint]| s <= along(&self.at(&piece[1]));
        let mut pieces = spine.windows(2);
        let piece = pieces.find(beside).or_else(|| spine.windows(2).next_back())?;
        let [a, b] = [&piece[0], &piece[1]].map(|p| self.at(p));
        let (from, to) = (along(&a), along(&b));
        let t = ((s - from) / (to - from).max(1e-12)).clamp(0.0, 1.0);
        let deep_m = (position - a * (1.0 - t) - b * t).dot(&direction);
        if !(-OUTSIDE_M..DEEP_M).contains(&deep_m) {
            return None;
        }
        let [p, q] = [&piece[0], &piece[1]];
        Some(SpineContact {
            nodes: [place.nodes[0], place.nodes[1], p.nodes[0], p.nodes[1], q.nodes[0], q.nodes[1]],
            weights: [
                1.0 - place.t,
                place.t,
                -(1.0 - t) * (1.0 - p.t),
                -(1.0 - t) * p.t,
                -t * (1.0 - q.t),
                -t * q.t,
            ],
            direction,
            gap_m,
        })
    }
}

impl SpineContact {
    /// How far the place is on its side, metres.
    fn deep_m(&self, x: &[Vector3<f64>]) -> f64 {
        let terms = self.nodes.iter().zip(&self.weights);
        let offset: Vector3<f64> = terms.map(|(n, w)| x[*n as usize] * *w).sum();
        offset.dot(&self.direction)
    }

    /// Pushes place and crease apart where they are nearer than their gap.
    pub fn solve(&self, x: &mut [Vector3<f64>], mobility: &[f64], worst: &mut Worst) {
        let deep_m = self.deep_m(x);
        if deep_m >= self.gap_m {
            return;
        }
        worst.note(self.gap_m, deep_m);
        let push = self.direction * (self.gap_m - deep_m);
        weighted_push(x, mobility, &self.nodes, &self.weights, push);
    }
}

#[cfg(test)]
mod tests {
    use crate::params::ContactParams;
    use crate::project::FacetContact;
    use orime_creases::{Folds, Line};
    use orime_geometry::SheetGrid;

    /// Three panels of 50, 45 and 55 mm: the first folded under the second, the third over it, both
    /// but for some degrees. Closed, the third sticks out by 10 mm past the first crease.
    fn letter(sheet: &SheetGrid, open_deg: f64) -> Vec<[f32; 3]> {
        let (sin, cos) = open_deg.to_radians().sin_cos();
        let fold = |[u, v]: [f64; 2]| {
            let (under, over) = ((0.05 - u).max(0.0), (u - 0.095).max(0.0));
            let lift_m = |off: f64| sin * off + 3e-4 * (off / 0.005).min(1.0);
            let x = u.clamp(0.05, 0.095) + cos * (under - over);
            [x, v, lift_m(over) - lift_m(under)].map(|c| c as f32)
        };
        sheet.uv_m().map(fold).collect()
    }

    #[test]
    fn an_order_that_no_crease_can_hold_moves_nothing_far() {
        let sheet = SheetGrid::new([0.15, 0.15], [31, 31]);
        let mut folds = Folds::flat(&sheet);
        for u in [0.05, 0.095] {
            let facet = folds.facet_at([u + 1e-3, 0.07]);
            folds.split(facet, &Line::through([u, 0.0], [u, 0.15])).unwrap();
        }
        folds.observe(&letter(&sheet, 60.0));
        let [first, second, third] = [0.02, 0.07, 0.12].map(|u| folds.facet_at([u, 0.07]));
        let seen = [[first, second], [second, first], [third, first], [third, second]]
            .map(|[f, g]| folds.order(f, g));
        assert_eq!(seen, [-1, -1, -1, 1], "under, over, and turned over");
        // As if the third lay between the other two.
        folds.set_order(third, second, -1);
        folds.set_order(second, third, -1);
        let mut contact = FacetContact::new(&ContactParams::default().check().unwrap(), &sheet);
        let report = contact.project(&mut letter(&sheet, 0.0), &folds);
        assert!(report.moved_m < 3e-3, "{report:?}");
    }
}
