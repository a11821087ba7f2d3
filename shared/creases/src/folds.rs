//! Facets, creases and layer order.

use crate::frame::FacetFrame;
use crate::line::Line;
use orime_geometry::SheetGrid;

/// Most facets of a sheet.
pub const FACETS_MAX: usize = 32;
/// Facets' centres nearer than this to each other's plane do not change their order, metres.
///
/// Source: `../shared/design/loop.md`.
pub const ORDER_APART_M: f64 = 4e-3;
/// Facets with normals nearer than this lie on each other like a stack: what lies above one has
/// it below (60°).
const STACKED_COSINE: f64 = 0.5;
/// A node nearer than this share of the spacing to a facet counts as the facet's too.
const MARGIN: f64 = 0.25;
/// Corners nearer than this are one, metres.
const SAME_M: f64 = 1e-8;
/// A node keeps its facet until it lies so far outside of it, as a share of the spacing.
const STICKY: f64 = 0.2;
/// Shortest crease, as a share of the spacing.
const CREASE_MIN: f64 = 0.25;

/// A convex part of the sheet.
#[derive(Debug, Clone, PartialEq)]
pub struct Facet {
    /// Corners, (u, v), metres, counter-clockwise.
    pub corners_m: Vec<[f64; 2]>,
}

impl Facet {
    /// How deep a point lies inside, metres; negative outside.
    pub fn inside_m(&self, uv_m: [f64; 2]) -> f64 {
        self.sides().map(|side| side.side_m(uv_m)).fold(f64::INFINITY, f64::min)
    }

    /// Area, m².
    pub fn area_m2(&self) -> f64 {
        let next = self.corners_m.iter().cycle().skip(1);
        0.5 * self.corners_m.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
    }

    fn sides(&self) -> impl Iterator<Item = Line> + '_ {
        let next = self.corners_m.iter().cycle().skip(1);
        self.corners_m.iter().zip(next).map(|(a, b)| Line::through(*a, *b))
    }

    /// The parts left and right of a line; `None` where one of them would be a sliver.
    pub(crate) fn cut(&self, line: &Line, sliver_m: f64) -> Option<[Facet; 2]> {
        let mut parts = [Vec::new(), Vec::new()];
        let next = self.corners_m.iter().cycle().skip(1);
        for (&a, &b) in self.corners_m.iter().zip(next) {
            let (side_a, side_b) = (line.side_m(a), line.side_m(b));
            for (part, sign) in parts.iter_mut().zip([1.0, -1.0]) {
                if sign * side_a >= 0.0 {
                    part.push(a);
                }
                if side_a * side_b < 0.0 {
                    part.push(line.crossing(a, b));
                }
            }
        }
        let wide = |part: &Vec<[f64; 2]>| {
            part.iter().map(|p| line.side_m(*p).abs()).fold(0.0, f64::max) >= sliver_m
        };
        if !parts.iter().all(wide) {
            return None;
        }
        let same = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]) < SAME_M;
        let facets = parts.map(|mut corners_m| {
            corners_m.dedup_by(|a, b| same(a, b));
            if corners_m.len() > 1 && same(&corners_m[0], &corners_m[corners_m.len() - 1]) {
                corners_m.pop();
            }
            Facet { corners_m }
        });
        facets.iter().all(|facet| facet.corners_m.len() >= 3).then_some(facets)
    }
}

/// Where two facets meet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crease {
    /// The facets left and right of it, looking from the first end to the second.
    pub facets: [usize; 2],
    /// Its ends, (u, v), metres.
    pub ends_m: [[f64; 2]; 2],
    /// Fold angle as last observed, radians: 0 flat, π folded shut; positive where the sides that
    /// the normals (u × v) point away from come nearer (a mountain seen from the normals' side).
    pub angle_rad: f64,
}

impl Crease {
    /// The line that it lies on.
    pub fn line(&self) -> Line {
        Line::through(self.ends_m[0], self.ends_m[1])
    }
}

/// What is known of a sheet's folds.
#[derive(Debug, Clone, PartialEq)]
pub struct Folds {
    sheet: SheetGrid,
    facets: Vec<Facet>,
    creases: Vec<Crease>,
    members: Vec<Vec<u32>>,
    facets_of_node: Vec<u32>,
    facet_of_node: Vec<u8>,
    order: [[i8; FACETS_MAX]; FACETS_MAX],
}

impl Folds {
    /// A sheet without folds: one facet.
    pub fn flat(sheet: &SheetGrid) -> Self {
        let [a, b] = sheet.size_m;
        let corners_m = vec![[0.0, 0.0], [a, 0.0], [a, b], [0.0, b]];
        let mut folds = Self {
            sheet: sheet.clone(),
            facets: vec![Facet { corners_m }],
            creases: Vec::new(),
            members: Vec::new(),
            facets_of_node: Vec::new(),
            facet_of_node: Vec::new(),
            order: [[0; FACETS_MAX]; FACETS_MAX],
        };
        folds.derive();
        folds
    }

    /// A sheet whose facets are known. They must tile it.
    pub fn from_facets(sheet: &SheetGrid, facets: Vec<Facet>) -> Self {
        assert!((1..=FACETS_MAX).contains(&facets.len()), "1 to {FACETS_MAX} facets");
        let mut folds = Self::flat(sheet);
        folds.facets = facets;
        folds.derive();
        folds
    }

    /// The grid that the nodes are of.
    pub fn sheet(&self) -> &SheetGrid {
        &self.sheet
    }

    /// The facets; they tile the sheet.
    pub fn facets(&self) -> &[Facet] {
        &self.facets
    }

    /// The creases between facets.
    pub fn creases(&self) -> &[Crease] {
        &self.creases
    }

    /// The nodes of a facet, those on its creases included; a node may belong to several.
    pub fn members(&self, facet: usize) -> &[u32] {
        &self.members[facet]
    }

    /// The facets that each node is a member of: bit f for facet f.
    pub fn facets_of_node(&self) -> &[u32] {
        &self.facets_of_node
    }

    /// One facet per node: one that it lies in, or on the edge of.
    pub fn facet_of_node(&self) -> &[u8] {
        &self.facet_of_node
    }

    /// The facet that a material point lies deepest in.
    pub fn facet_at(&self, uv_m: [f64; 2]) -> usize {
        let depth = |facet: &Facet| facet.inside_m(uv_m);
        (0..self.facets.len())
            .max_by(|a, b| {
                depth(&self.facets[*a]).total_cmp(&depth(&self.facets[*b])).then(b.cmp(a))
            })
            .unwrap_or(0)
    }

    /// On which side of facet `g`'s plane facet `f` lies: 1 where the normal (u × v) points to,
    /// −1 behind, 0 where that was never seen.
    pub fn order(&self, f: usize, g: usize) -> i8 {
        self.order[f][g]
    }

    /// Says that facet `f` lies on that side of facet `g`, see [`Folds::order`].
    pub fn set_order(&mut self, f: usize, g: usize, side: i8) {
        self.order[f][g] = side.signum();
    }

    /// Cuts a facet in two along a line: the part on its left keeps the number, the other gets the
    /// next free one, which is returned. `None`, and no change, where a part would be narrower than
    /// half a spacing or the facets are used up.
    pub fn split(&mut self, facet: usize, line: &Line) -> Option<usize> {
        let [h_u, h_v] = self.sheet.spacing_m();
        if self.facets.len() == FACETS_MAX {
            return None;
        }
        let [left, right] = self.facets[facet].cut(line, 0.5 * h_u.min(h_v))?;
        let new = self.facets.len();
        self.facets[facet] = left;
        self.facets.push(right);
        for other in 0..new {
            self.order[other][new] = self.order[other][facet];
            self.order[new][other] = self.order[facet][other];
        }
        self.order[facet][new] = 0;
        self.order[new][facet] = 0;
        self.derive();
        Some(new)
    }

    /// Replaces the facets: number k of the new ones is (part of) number `from[k]` of the old ones,
    /// and inherits its angles and its layer order. They must tile the sheet.
    pub fn retile(&mut self, facets: Vec<Facet>, from: &[usize]) {
        assert!((1..=FACETS_MAX).contains(&facets.len()), "1 to {FACETS_MAX} facets");
        assert_eq!(facets.len(), from.len(), "each facet comes from one");
        let before = self.order;
        self.order = [[0; FACETS_MAX]; FACETS_MAX];
        for (f, from_f) in from.iter().enumerate() {
            for (g, from_g) in from.iter().enumerate() {
                self.order[f][g] = if from_f == from_g { 0 } else { before[*from_f][*from_g] };
            }
        }
        let renamed = |old: usize| from.iter().position(|f| *f == old);
        self.creases.retain_mut(|crease| {
            let [Some(f), Some(g)] = crease.facets.map(renamed) else { return false };
            crease.facets = [f.min(g), f.max(g)];
            true
        });
        for facet in &mut self.facet_of_node {
            *facet = renamed(usize::from(*facet)).map_or(u8::MAX, |new| new as u8);
        }
        self.facets = facets;
        self.derive();
    }

    /// Takes the fold angles, and the layer order of every pair that is clearly apart, from the
    /// nodes' positions, world frame, metres.
    pub fn observe(&mut self, positions_m: &[[f32; 3]]) {
        let mut frames = [FacetFrame::flat(); FACETS_MAX];
        let poses = &mut frames[..self.facets.len()];
        for (f, pose) in poses.iter_mut().enumerate() {
            *pose = FacetFrame::fit(&self.sheet, &self.members[f], positions_m);
        }
        let height_m =
            |f: usize, g: usize| (poses[f].center_m - poses[g].center_m).dot(&poses[g].normal);
        for f in 0..poses.len() {
            for g in (0..poses.len()).filter(|g| *g != f) {
                let height_m = height_m(f, g);
                let side = if height_m > 0.0 { 1 } else { -1 };
                // What lies over a facet cannot come to its other side: it would pass through.
                if height_m.abs() > ORDER_APART_M
                    && (self.order[f][g] != -side || !self.is_over(f, g, &poses[g], positions_m))
                {
                    self.order[f][g] = side;
                }
            }
        }
        for f in 0..poses.len() {
            for g in (0..poses.len()).filter(|g| *g != f) {
                if height_m(f, g).abs() <= ORDER_APART_M && height_m(g, f).abs() > ORDER_APART_M {
                    self.order[f][g] = self.seen_from(f, g, poses[f].normal.dot(&poses[g].normal));
                }
            }
        }
        for crease in &mut self.creases {
            let [left, right] = crease.facets.map(|facet| &poses[facet]);
            let d = crease.line().direction;
            let axis =
                (left.u * d[0] + left.v * d[1] + right.u * d[0] + right.v * d[1]).normalize();
            let sine = left.normal.cross(&right.normal).dot(&axis);
            let angle_rad = sine.atan2(left.normal.dot(&right.normal));
            // Near ±π the sign is noise: a fold does not pass through itself.
            let wrapped = (angle_rad - crease.angle_rad).abs() > 1.5 * std::f64::consts::PI;
            let turn = if wrapped { -std::f64::consts::TAU * angle_rad.signum() } else { 0.0 };
            crease.angle_rad = angle_rad + turn;
        }
    }

    /// On which side of `g` facet `f` lies, by where `g` lies as seen from `f`: `f` is cut by the
    /// plane of `g`, and what was known may be of before that plane swept over it.
    fn seen_from(&self, f: usize, g: usize, cosine: f64) -> i8 {
        let side = if cosine > 0.0 { -self.order[g][f] } else { self.order[g][f] };
        if cosine.abs() > STACKED_COSINE { side } else { 0 }
    }

    /// Whether a part of facet `f` lies over or under facet `g`, whose pose is known.
    fn is_over(&self, f: usize, g: usize, pose: &FacetFrame, positions_m: &[[f32; 3]]) -> bool {
        let [h_u, h_v] = self.sheet.spacing_m();
        self.members[f].iter().any(|node| {
            let uv_m = pose.uv_of(positions_m[*node as usize]);
            self.facets[g].inside_m(uv_m) > h_u.min(h_v)
        })
    }

    /// The rigid pose that fits a facet's nodes best.
    pub fn frame(&self, facet: usize, positions_m: &[[f32; 3]]) -> FacetFrame {
        FacetFrame::fit(&self.sheet, &self.members[facet], positions_m)
    }

    /// Everything that follows from the facets.
    fn derive(&mut self) {
        let [h_u, h_v] = self.sheet.spacing_m();
        let margin_m = MARGIN * h_u.min(h_v);
        let uv: Vec<[f64; 2]> = self.sheet.uv_m().collect();
        let members = |facet: &Facet| {
            let inside = |n: &u32| facet.inside_m(uv[*n as usize]) >= -margin_m;
            (0..uv.len() as u32).filter(inside).collect()
        };
        self.members = self.facets.iter().map(members).collect();
        self.facets_of_node = vec![0; uv.len()];
        for (facet, nodes) in self.members.iter().enumerate() {
            for node in nodes {
                self.facets_of_node[*node as usize] |= 1 << facet;
            }
        }
        let kept = |n: usize, uv: [f64; 2]| {
            // What lies on a crease does not change hands for a hair's breadth.
            let facet = usize::from(*self.facet_of_node.get(n)?);
            let inside_m = self.facets.get(facet)?.inside_m(uv);
            (inside_m >= -STICKY * h_u.min(h_v)).then_some(facet)
        };
        self.facet_of_node = (0..uv.len())
            .map(|n| kept(n, uv[n]).unwrap_or_else(|| self.facet_at(uv[n])) as u8)
            .collect();
        let before = std::mem::take(&mut self.creases);
        for f in 0..self.facets.len() {
            for g in f + 1..self.facets.len() {
                let shared =
                    shared_side(&self.facets[f], &self.facets[g], CREASE_MIN * h_u.min(h_v));
                let Some(ends_m) = shared else { continue };
                let known = before.iter().find(|crease| crease.facets == [f, g]);
                let angle_rad = known.map_or(0.0, |crease| crease.angle_rad);
                self.creases.push(Crease { facets: [f, g], ends_m, angle_rad });
            }
        }
    }
}

/// The part of a side that `f` (on its left) shares with `g`, where longer than `length_min_m`.
fn shared_side(f: &Facet, g: &Facet, length_min_m: f64) -> Option<[[f64; 2]; 2]> {
    let touch_m = 1e-6;
    for (at, side) in f.sides().enumerate() {
        let to = f.corners_m[(at + 1) % f.corners_m.len()];
        let length = (to[0] - side.point_m[0]).hypot(to[1] - side.point_m[1]);
        let along = |p: &[f64; 2]| {
            (p[0] - side.point_m[0]) * side.direction[0]
                + (p[1] - side.point_m[1]) * side.direction[1]
        };
        let on: Vec<f64> =
            g.corners_m.iter().filter(|p| side.side_m(**p).abs() < touch_m).map(along).collect();
        let low = on.iter().copied().fold(f64::INFINITY, f64::min).max(0.0);
        let high = on.iter().copied().fold(f64::NEG_INFINITY, f64::max).min(length);
        if on.len() >= 2 && high - low > length_min_m {
            let at = |s: f64| [0, 1].map(|axis| side.point_m[axis] + s * side.direction[axis]);
            return Some([at(low), at(high)]);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet() -> SheetGrid {
        SheetGrid::new([0.15, 0.15], [25, 25])
    }

    /// The sheet folded along the line u = 0.075 by an angle, the part of large u lifted.
    fn folded(angle_rad: f64) -> Vec<[f32; 3]> {
        let fold = |[u, v]: [f64; 2]| {
            let over = (u - 0.075).max(0.0);
            let x = u.min(0.075) + over * angle_rad.cos();
            [x as f32, v as f32, (over * angle_rad.sin()) as f32]
        };
        sheet().uv_m().map(fold).collect()
    }

    #[test]
    fn a_split_in_the_middle_makes_two_halves_that_share_a_crease() {
        let mut folds = Folds::flat(&sheet());
        let new = folds.split(0, &Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
        assert_eq!((new, folds.creases().len()), (1, 1));
        let areas: f64 = folds.facets().iter().map(Facet::area_m2).sum();
        assert!((areas - 0.15 * 0.15).abs() < 1e-12);
        assert_eq!(folds.members(0).len(), 13 * 25);
        assert_eq!(folds.facet_at([0.01, 0.05]), 0);
        assert_eq!(folds.facet_at([0.10, 0.05]), 1);
        // A second cut across both gives four facets and four creases.
        for facet in [0, 1] {
            folds.split(facet, &Line::through([0.0, 0.075], [0.15, 0.075])).unwrap();
        }
        assert_eq!((folds.facets().len(), folds.creases().len()), (4, 4));
        // A sliver is refused.
        assert!(folds.split(0, &Line::through([0.001, 0.0], [0.001, 0.15])).is_none());
    }

    #[test]
    fn angle_and_order_follow_the_fold() {
        let mut folds = Folds::flat(&sheet());
        folds.split(0, &Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
        let low = folds.facet_at([0.0, 0.0]);
        let flap = 1 - low;
        for degrees in [10.0, 60.0, 120.0, 175.0, 179.0, 180.0, 180.5] {
            folds.observe(&folded(f64::to_radians(degrees)));
            let angle = folds.creases()[0].angle_rad.to_degrees().abs();
            assert!((angle - degrees).abs() < 1e-3, "{angle} instead of {degrees}");
        }
        // The flap lies where the lower normal points, and the lower part where the flap's does.
        assert_eq!(folds.order(flap, low), 1);
        assert_eq!(folds.order(low, flap), 1); // And the lower part where the flap's points.
    }

    /// A Z: a strip of so many metres lies flat, the next, 50 mm, stands up from it, the last, of
    /// 50 mm too, leans from that by `degrees` against the horizontal. Its folds as known from a
    /// pose with the last strip over the first, then observed.
    fn zed(flat_m: f64, degrees: f64) -> Folds {
        let (width_m, up_m) = (flat_m + 0.1, flat_m + 0.05);
        let sheet = SheetGrid::new([width_m, 0.1], [21, 41]);
        let strip = |low: f64, high: f64| Facet {
            corners_m: vec![[low, 0.0], [high, 0.0], [high, 0.1], [low, 0.1]],
        };
        let strips = vec![strip(0.0, flat_m), strip(flat_m, up_m), strip(up_m, width_m)];
        let mut folds = Folds::from_facets(&sheet, strips);
        for degrees in [180.0, degrees] {
            let (sin, cos) = f64::to_radians(degrees).sin_cos();
            let at = |[u, v]: [f64; 2]| {
                let (up, along) = ((u - flat_m).clamp(0.0, 0.05), (u - up_m).max(0.0));
                [u.min(flat_m) + along * cos, v, up + along * sin].map(|c| c as f32)
            };
            folds.observe(&sheet.uv_m().map(at).collect::<Vec<_>>());
        }
        folds
    }

    #[test]
    fn a_facet_whose_plane_swept_over_another_forgets_the_order_of_before() {
        let order = |folds: &Folds| (folds.order(0, 2), folds.order(2, 0));
        assert_eq!(order(&zed(0.1, 180.0)), (1, 1), "one over the other, turned");
        // The last strip's plane goes through the first one's centre. The first sees the last
        // where its own normal points, and both normals look alike.
        assert_eq!(order(&zed(0.1, 45.0)), (-1, 1));
        // The same, with planes that stand steep on each other: they say nothing of sides.
        assert_eq!(order(&zed(0.05, 2f64.atan().to_degrees())), (0, 1));
    }

    #[test]
    fn mountains_are_positive_and_valleys_negative() {
        let (p, q) = ([0.075, 0.0], [0.075, 0.15]);
        // Lifting a part makes a valley on the side that u × v points to; either way round.
        for (line, lift, positive) in
            [((p, q), 1.0, false), ((q, p), 1.0, false), ((p, q), -1.0, true), ((q, p), -1.0, true)]
        {
            let mut folds = Folds::flat(&sheet());
            folds.split(0, &Line::through(line.0, line.1)).unwrap();
            folds.observe(&folded(lift * 0.5));
            let angle_rad = folds.creases()[0].angle_rad;
            assert!((angle_rad.abs() - 0.5).abs() < 1e-6);
            assert_eq!(angle_rad > 0.0, positive, "{line:?} lifted by {lift}");
        }
    }

    #[test]
    fn retiling_keeps_angles_order_and_nodes_on_creases() {
        let mut folds = Folds::flat(&sheet());
        folds.split(0, &Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
        folds.observe(&folded(1.0));
        let (before, label) = (folds.clone(), folds.facet_of_node()[12 * 25]);
        let mut facets = folds.facets().to_vec();
        facets.reverse();
        folds.retile(facets, &[1, 0]);
        assert_eq!(folds.order(0, 1), before.order(1, 0));
        assert_eq!(folds.facet_of_node()[12 * 25], 1 - label);
        assert_eq!(folds.facet_of_node()[0], 1 - before.facet_of_node()[0]);
        let [now, then] = [&folds, &before].map(|f| f.creases()[0].angle_rad.abs());
        assert!((now - then).abs() < 1e-12);
    }
}
