//! Creases as persistent lines in (u, v), facets as the rigid parts between them.
//!
//! Each step looks for kinks in every facet that no rigid pose explains (`candidates`), splits a
//! facet where one was seen several times, improves the lines that are known (`estimate`) and
//! undoes those that never became a fold.
//!
//! Source: `../shared/design/creases.md`, method F.

mod candidates;
mod estimate;
mod hinge;
mod measure;
mod moments;
mod nodes;
mod normal;
mod plan;
mod search;
mod snap;
mod tree;

use crate::folds::{Facet, Folds};
use crate::line::Line;
use crate::params::{CreaseConfig, CreaseParams};
use candidates::{Candidate, Judge, View};
use estimate::Estimate;
use hinge::Hinge;
use nodes::Nodes;
use orime_geometry::SheetGrid;
use tree::{Cut, Side, Tree};

/// Directions that are searched, over half a turn.
const DIRECTIONS: usize = 36;
/// Least width of both parts of a split, spacings, and least weight of their nodes.
const PART_MIN: (f64, f64) = (1.2, 6.0);
/// Least share of the sheet's nodes on either side of a crease off landmarks: tips that nobody sees
/// well bend in many ways.
const PART_OFF_LANDMARKS: f64 = 0.04;
/// What is smaller than this share of the nodes is a tip: one that is lifted fast runs ahead of the
/// rest and bends for some steps where no crease will be. Only what looks like a fold in so many
/// is one.
const TIP: (f64, u32) = (0.1, 10);
/// Standard deviations, and spacings at most, that a landmark may be off more than told.
const UNSURE: (f64, f64) = (3.0, 0.5);
/// A crease is undone after so many steps below the first angle, unless it ever passed the second.
const UNDO: (u32, f64, f64) = (20, 10.0, 45.0);

/// Finds lines.
#[derive(Debug, Clone)]
pub(crate) struct LineFinder {
    config: CreaseConfig,
    nodes: Nodes,
    tree: Tree,
    judge: Judge,
    /// Nodes and candidates of each facet.
    members: Vec<Vec<u32>>,
    candidates: Vec<Vec<Candidate>>,
    next_crease: usize,
    /// Middles of the sheet's sides, (u, v), metres.
    middles_m: [[f64; 2]; 4],
    /// Lines of the plan that the config has.
    planned_first: usize,
    /// Successive steps in which each sample of each planned line bent.
    plan_hits: Vec<[u32; plan::SAMPLES.len()]>,
}

impl LineFinder {
    pub fn new(config: &CreaseConfig, sheet: &SheetGrid) -> Self {
        let facets_max = config.params.facets_max;
        let mut finder = Self {
            config: config.clone(),
            nodes: Nodes::new(sheet),
            tree: Tree::new(sheet),
            judge: Judge::new(sheet.len(), DIRECTIONS),
            members: vec![Vec::new(); facets_max],
            candidates: (0..facets_max).map(|_| Judge::candidates()).collect(),
            next_crease: 0,
            middles_m: middles_m(sheet.size_m),
            planned_first: config.plan.len(),
            plan_hits: vec![[0; plan::SAMPLES.len()]; config.plan.len()],
        };
        finder.reset(&Folds::flat(sheet));
        finder
    }

    /// Forgets everything.
    pub fn reset(&mut self, flat: &Folds) {
        self.tree.clear();
        self.candidates.iter_mut().for_each(Vec::clear);
        self.next_crease = 0;
        self.plan_hits.fill([0; plan::SAMPLES.len()]);
        self.list_members(flat);
    }

    /// Takes in one step; true where the folds changed.
    pub fn step(
        &mut self,
        folds: &mut Folds,
        positions_m: &[[f32; 3]],
        confidence: &[f32],
    ) -> bool {
        self.nodes.read(positions_m, confidence);
        let mut changed = self.measure(folds);
        changed |= self.undo(folds);
        changed |= self.follow_plan(folds);
        for facet in 0..folds.facets().len() {
            self.look(folds, facet);
            changed |= self.split_where_sure(folds, facet);
        }
        changed
    }

    /// Judges a facet and updates its candidates.
    fn look(&mut self, folds: &Folds, facet: usize) {
        let creases = folds.creases().iter().filter(|crease| crease.facets.contains(&facet));
        let tree = &self.tree;
        let known = creases.filter_map(|crease| {
            let cut = tree.between(crease.facets[0], crease.facets[1])?;
            Some((crease.line(), tree.cuts[cut].sign))
        });
        let view = View {
            nodes: &self.nodes,
            members: &self.members[facet],
            facet: &folds.facets()[facet],
            params: &self.config.params,
        };
        self.judge.judge(&view, known, &mut self.candidates[facet]);
    }

    /// Splits a facet along all candidates that were seen often enough, the sharpest first.
    fn split_where_sure(&mut self, folds: &mut Folds, facet: usize) -> bool {
        let CreaseParams { hits, evidence, .. } = self.config.params;
        let before = folds.facets().len();
        while let Some(at) = {
            let sure = self.candidates[facet].iter().enumerate();
            let sure = sure.filter(|(_, c)| {
                c.hits >= hits && c.evidence >= evidence && self.may_be(folds, facet, c)
            });
            sure.max_by(|(_, a), (_, b)| a.hinge.angle_rad.total_cmp(&b.hinge.angle_rad))
                .map(|(at, _)| at)
        } {
            let hinge = self.candidates[facet].swap_remove(at).hinge;
            // Earlier splits of this step may have put it into another part.
            let part = folds.facet_at(hinge.middle_m());
            if (part == facet || part >= before) && self.is_wide(folds, part, &hinge.line) {
                self.split(folds, part, &hinge, false);
            }
        }
        if folds.facets().len() > before {
            self.move_candidates(folds, facet);
        }
        folds.facets().len() > before
    }

    /// Whether a fold of a facet is sharp enough, and parts enough of it, for where it lies.
    fn may_be(
        &self,
        folds: &Folds,
        facet: usize,
        Candidate { hinge, hits, .. }: &Candidate,
    ) -> bool {
        let piece = &folds.facets()[facet];
        let estimate = Estimate::new(hinge, self.nodes.h_m);
        let ends = self.at_landmarks(&estimate, piece, folds.facets());
        if self.planned(&hinge.line, hinge.middle_m()).is_some()
            || ends.is_some_and(|(_, both)| both)
        {
            return true;
        }
        let members = &self.members[facet];
        let is_left = |n: &&u32| hinge.line.side_m(self.nodes.uv_m[**n as usize]) > 0.0;
        let left = members.iter().filter(is_left).count();
        let least = left.min(members.len() - left) as f64 / self.nodes.uv_m.len() as f64;
        hinge.angle_rad >= self.config.params.angle_off_landmarks_deg.to_radians()
            && least >= PART_OFF_LANDMARKS
            && (least >= TIP.0 || *hits >= TIP.1)
    }

    /// Hands a facet's candidates to the parts that they lie in.
    fn move_candidates(&mut self, folds: &Folds, facet: usize) {
        let mut at = 0;
        while at < self.candidates[facet].len() {
            let part = folds.facet_at(self.candidates[facet][at].hinge.middle_m());
            if part == facet {
                at += 1;
            } else {
                let candidate = self.candidates[facet].swap_remove(at);
                self.candidates[part].push(candidate);
            }
        }
    }

    fn is_wide(&self, folds: &Folds, facet: usize, line: &Line) -> bool {
        let mut parts = [(0.0, 0.0f64); 2];
        for n in &self.members[facet] {
            let side_m = line.side_m(self.nodes.uv_m[*n as usize]);
            let part = &mut parts[usize::from(side_m > 0.0)];
            part.0 += self.nodes.weight[*n as usize];
            part.1 = part.1.max(side_m.abs());
        }
        let wide = parts.iter().all(|(weight, width_m)| {
            *weight >= PART_MIN.1 && *width_m > PART_MIN.0 * self.nodes.h_m
        });
        wide && folds.facets().len() < self.config.params.facets_max
    }

    /// Splits a facet at a fold; true where that was possible.
    fn split(&mut self, folds: &mut Folds, facet: usize, hinge: &Hinge, planned: bool) -> bool {
        let known = if planned { Some(hinge.line) } else { None };
        let known = known.or_else(|| self.planned(&hinge.line, hinge.middle_m()));
        let mut estimate = Estimate::new(hinge, self.nodes.h_m);
        estimate.fixed = known.is_some();
        let snapped = self.at_landmarks(&estimate, &folds.facets()[facet], folds.facets());
        let line = known.or(snapped.map(|(line, _)| line)).unwrap_or(hinge.line);
        estimate.publish(line, known.is_none() && snapped.is_some());
        let Some(new) = folds.split(facet, &line) else { return false };
        let cut = Cut {
            sides: [Side::Facet(facet), Side::Facet(new)],
            estimate,
            sign: hinge.sign,
            angle_max_rad: hinge.angle_rad,
            unfolded: 0,
        };
        self.tree.split(facet, new, cut);
        self.list_members(folds);
        true
    }

    /// An estimate's best line, put on landmarks of the piece that it parts, where some are near;
    /// and whether both its ends are.
    fn at_landmarks(
        &self,
        estimate: &Estimate,
        piece: &Facet,
        facets: &[Facet],
    ) -> Option<(Line, bool)> {
        let snap_m = self.config.params.snap * self.nodes.h_m;
        let best = estimate.best();
        if snap_m <= 0.0 {
            return None;
        }
        // Its own ends are no landmarks.
        let others = facets.iter().flat_map(|facet| facet.corners_m.iter().copied());
        let others = others.chain(self.middles_m);
        let others = others.filter(|p| estimate.line.side_m(*p).abs() > snap::ON_BORDER_M);
        snap::snap(&best, piece, others, |end| snap_m + self.unsure_m(estimate, end))
    }

    /// How far an end of a line may be off by noise, metres.
    fn unsure_m(&self, estimate: &Estimate, end: [f64; 2]) -> f64 {
        (UNSURE.0 * estimate.deviation_m(end)).min(UNSURE.1 * self.nodes.h_m)
    }

    /// Joins a facet whose crease never became a fold to what lies beyond it.
    fn undo(&mut self, folds: &mut Folds) -> bool {
        let never = |cut: &Cut| {
            let has_facet = cut.sides.iter().any(|side| matches!(side, Side::Facet(_)));
            has_facet && cut.unfolded >= UNDO.0 && cut.angle_max_rad < UNDO.2.to_radians()
        };
        let Some(cut) = self.tree.cuts.iter().position(never) else { return false };
        let before = self.tree.clone();
        let joined = self.tree.join(cut).zip(self.tree.facets());
        let Some((from, facets)) = joined else {
            // A line that goes on into the facet would leave a sliver.
            self.tree = before;
            self.tree.cuts[cut].unfolded = 0;
            return false;
        };
        folds.retile(facets, &from);
        self.candidates.iter_mut().for_each(Vec::clear);
        self.list_members(folds);
        true
    }

    fn list_members(&mut self, folds: &Folds) {
        self.members.iter_mut().for_each(Vec::clear);
        for (n, facet) in (0u32..).zip(folds.facet_of_node()) {
            self.members[usize::from(*facet)].push(n);
        }
    }
}

/// Middles of a sheet's sides.
fn middles_m([a, b]: [f64; 2]) -> [[f64; 2]; 4] {
    [[0.5 * a, 0.0], [a, 0.5 * b], [0.5 * a, b], [0.0, 0.5 * b]]
}
