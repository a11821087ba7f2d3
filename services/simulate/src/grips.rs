//! Material points that are held. GPU twins: `pull_anchor` and `reach` in `gpu/grippers.wgsl`.

use crate::effect::Effect;
use crate::params::SimulateConfig;
use crate::solver::links::Colour;
use orime_creases::Folds;
use orime_geometry::SheetGrid;
use orime_lanes::{Field, Layout};
use std::collections::VecDeque;

/// A material point that a gripper holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grip {
    /// The point, (u, v), metres.
    pub uv_m: [f64; 2],
    /// Where it is held, world frame, metres.
    pub position_m: [f64; 3],
}

impl Grip {
    /// Whether it holds a point of this sheet, somewhere.
    pub(crate) fn is_on(&self, sheet: &SheetGrid) -> bool {
        cell(sheet, self.uv_m).is_some() && self.position_m.iter().all(|c| c.is_finite())
    }
}

/// What was said of the grippers around an instant.
///
/// Word of them may be late, rare or missing, and comes in any order with the targets: what was
/// said nearest to an instant counts, unless that is too long before or after it.
#[derive(Debug, Clone)]
pub struct GripLog {
    age_max_ns: u64,
    said: VecDeque<(u64, Vec<Grip>)>,
}

/// Most words on grippers that are kept; a capture that runs ahead has sixteen on their way.
const SAID_MAX: usize = 32;

impl GripLog {
    /// Nothing was said. Beyond `grippers.age_max_s` nothing counts.
    pub fn new(config: &SimulateConfig) -> Self {
        let age_max_ns = (config.params.grippers.age_max_s * 1e9) as u64;
        Self { age_max_ns, said: VecDeque::with_capacity(SAID_MAX) }
    }

    /// Notes what holds the sheet at an instant; the oldest word goes where there are many.
    pub fn note(&mut self, at_ns: u64, grips: impl Iterator<Item = Grip>) {
        let full = self.said.len() >= SAID_MAX;
        let mut room = full.then(|| self.said.pop_front()).flatten().unwrap_or_default().1;
        room.clear();
        room.extend(grips);
        self.said.push_back((at_ns, room));
    }

    /// What holds the sheet at an instant; nothing, where nothing was said of it.
    pub fn at(&self, at_ns: u64) -> &[Grip] {
        let nearest = self.said.iter().min_by_key(|(said_ns, _)| said_ns.abs_diff(at_ns));
        let fresh = nearest.filter(|(said_ns, _)| said_ns.abs_diff(at_ns) <= self.age_max_ns);
        fresh.map_or(&[], |(_, grips)| grips)
    }
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
    /// The links beside the point that may not become longer: their ends and rest lengths, metres.
    pub beside: [([u32; 2], f32); BESIDE],
}

/// Times that all pairs of grips are brought within reach of each other.
const REACH_SWEEPS: usize = 8;
/// Neighbours of four nodes.
pub(crate) const BESIDE: usize = 16;

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
        if !grip.is_on(folds.sheet()) {
            return None;
        }
        let (corner, [s, t]) = cell(folds.sheet(), grip.uv_m)?;
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
        let beside = [([0; 2], f32::INFINITY); BESIDE];
        Some(Self { places, weights: weights.map(|w| w as f32), position_m, beside })
    }

    /// Looks up the links beside the point.
    pub fn tie(mut self, colours: &[Colour]) -> Self {
        let stretch = || colours.iter().filter(|colour| colour.effect == Effect::Stretch);
        let held = self.places.iter().zip(self.weights).filter(|(_, weight)| *weight != 0.0);
        let links = held.flat_map(|(place, _)| stretch().flat_map(|colour| colour.at(*place)));
        for (own, link) in self.beside.iter_mut().zip(links) {
            *own = link;
        }
        self
    }

    /// Where the nodes have the point, metres.
    pub fn held_m(&self, x: &[Field; 3]) -> [f32; 3] {
        let held = |x: &Field| {
            let each = self.places.iter().zip(self.weights);
            each.map(|(place, weight)| weight * x.rows()[*place as usize]).sum()
        };
        x.each_ref().map(held)
    }

    /// Moves the nodes by that share of the way, each in proportion to its weight; nodes without
    /// inverse mass stay. It goes no farther than where a link beside the point would be stretched
    /// by `strain_max`: there the point slips.
    pub fn pull(&self, x: &mut [Field; 3], masses: Option<&Field>, strength: f32, strain_max: f32) {
        let places = self.places.map(|n| n as usize);
        let mobility = places.map(|n| masses.map_or(1.0, |w| w.rows()[n].min(1.0)));
        let sum: f32 = (0..4).map(|k| mobility[k] * self.weights[k] * self.weights[k]).sum();
        if sum <= 0.0 {
            return;
        }
        let held_m = self.held_m(x);
        let way_m = [0, 1, 2].map(|axis| strength * (self.position_m[axis] - held_m[axis]) / sum);
        let shares = [0, 1, 2, 3].map(|k| mobility[k] * self.weights[k]);
        let reach = self.reach(x, way_m, shares, strain_max);
        for (x, way_m) in x.iter_mut().zip(way_m) {
            let x = x.rows_mut();
            for k in 0..4 {
                x[places[k]] += shares[k] * reach * way_m;
            }
        }
    }

    /// Share of a way, of which each node goes its own share, that stretches no link too far.
    fn reach(&self, x: &[Field; 3], way_m: [f32; 3], shares: [f32; 4], strain_max: f32) -> f32 {
        let share_of = |place: u32| -> f32 {
            let own = self.places.iter().zip(shares).filter(|(own, _)| **own == place);
            own.map(|(_, share)| share).sum()
        };
        let mut reach: f32 = 1.0;
        for ([a, b], rest_m) in self.beside {
            // |d + t·e| = L: the larger t, or where |d + t·e| is least.
            let most_m = rest_m * (1.0 + strain_max);
            let d = x.each_ref().map(|x| x.rows()[b as usize] - x.rows()[a as usize]);
            let e = way_m.map(|way_m| way_m * (share_of(b) - share_of(a)));
            let dot = |p: [f32; 3], q: [f32; 3]| -> f32 { (0..3).map(|k| p[k] * q[k]).sum() };
            let (ee, de, over_m2) = (dot(e, e), dot(d, e), dot(d, d) - most_m * most_m);
            if ee + 2.0 * de + over_m2 > 0.0 && ee > 0.0 {
                let t = ((de * de - ee * over_m2).max(0.0).sqrt() - de) / ee;
                reach = reach.min(t.max(0.0));
            }
        }
        reach
    }
}

/// Moves grips together that are farther apart than the flat sheet between them is long, each by
/// half of what is too much: paper does not stretch, and both hold equally.
pub(crate) fn within_reach(grips: &mut [Grip]) {
    for _ in 0..REACH_SWEEPS {
        for b in 1..grips.len() {
            for a in 0..b {
                let [p, q] = [grips[a], grips[b]];
                let long_m = (p.uv_m[0] - q.uv_m[0]).hypot(p.uv_m[1] - q.uv_m[1]);
                let d: [f64; 3] = [0, 1, 2].map(|k| q.position_m[k] - p.position_m[k]);
                let apart_m = d.iter().map(|d| d * d).sum::<f64>().sqrt();
                if apart_m > long_m {
                    for (k, d) in d.into_iter().enumerate() {
                        let give_m = 0.5 * (1.0 - long_m / apart_m) * d;
                        grips[a].position_m[k] += give_m;
                        grips[b].position_m[k] -= give_m;
                    }
                }
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
    use crate::SimulateParams;
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
    fn the_nearest_word_counts_unless_it_is_stale() {
        let mut log = GripLog::new(&SimulateParams::default().check().unwrap());
        assert!(log.at(0).is_empty());
        for step in 1..100u64 {
            log.note(step * 10_000_000, [grip([step as f64, 0.0])].into_iter());
        }
        let at = |log: &GripLog, ms: u64| log.at(ms * 1_000_000).first().map(|g| g.uv_m[0]);
        assert_eq!(at(&log, 800), Some(80.0));
        assert_eq!(at(&log, 804), Some(80.0));
        assert_eq!(at(&log, 806), Some(81.0));
        // 0.05 s: the default of `grippers.age_max_s`.
        assert_eq!([1040, 1041].map(|ms| at(&log, ms)), [Some(99.0), None]);
        assert_eq!([630, 629].map(|ms| at(&log, ms)), [Some(68.0), None]);
        log.note(1_100_000_000, std::iter::empty());
        assert_eq!(at(&log, 1100), None, "it was let go");
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
        anchor.pull(&mut x, None, 1.0, f32::INFINITY);
        for (x, expected) in x.iter().zip([0.1, 0.2, 0.3]) {
            assert!((point(&anchor, x) - expected).abs() < 1e-6);
        }
    }
}
