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
mod moments;
mod nodes;
mod normal;
mod search;
mod tree;

use crate::folds::Folds;
use crate::line::Line;
use crate::params::CreaseConfig;
use candidates::{Candidates, REACH, bends, middle};
use estimate::Estimate;
use hinge::{Hinge, Window};
use nodes::Nodes;
use orime_geometry::SheetGrid;
use tree::{Cut, Side, Tree};

/// Directions that are searched, over half a turn.
const DIRECTIONS: usize = 36;
/// Most candidates of a facet.
const PENDING_MAX: usize = 16;
/// What a miss takes from a candidate, hits.
const MISS: f64 = 0.5;
/// How near a candidate must be to be the same: radians, spacings.
const SAME: (f64, f64) = (0.2, 1.2);
/// Least width of both parts of a split, spacings, and least weight of their nodes.
const PART_MIN: (f64, f64) = (1.2, 6.0);
/// A published line follows its estimate where their distance in the sheet exceeds this, spacings.
const PUBLISH: f64 = 0.06;
/// A crease is undone after so many steps below the first angle, unless it ever passed the second.
const UNDO: (u32, f64, f64) = (20, 10.0, 45.0);
/// Creases whose line is measured in one step.
const MEASURED_MAX: usize = 3;

/// A crease that may come.
#[derive(Debug, Clone, Copy)]
struct Pending {
    hinge: Hinge,
    hits: f64,
    seen: bool,
}

/// Finds lines.
#[derive(Debug, Clone)]
pub(crate) struct LineFinder {
    config: CreaseConfig,
    nodes: Nodes,
    tree: Tree,
    candidates: Candidates,
    /// Nodes and candidates of each facet.
    members: Vec<Vec<u32>>,
    pending: Vec<Vec<Pending>>,
    next_crease: usize,
}

impl LineFinder {
    pub fn new(config: &CreaseConfig, sheet: &SheetGrid) -> Self {
        let facets_max = config.params.facets_max;
        let mut finder = Self {
            config: config.clone(),
            nodes: Nodes::new(sheet),
            tree: Tree::new(sheet),
            candidates: Candidates::new(sheet.len(), DIRECTIONS),
            members: vec![Vec::new(); facets_max],
            pending: vec![Vec::with_capacity(PENDING_MAX); facets_max],
            next_crease: 0,
        };
        finder.reset(&Folds::flat(sheet));
        finder
    }

    /// Forgets everything.
    pub fn reset(&mut self, flat: &Folds) {
        self.tree.clear();
        self.pending.iter_mut().for_each(Vec::clear);
        self.next_crease = 0;
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
        let members = &self.members[facet];
        self.candidates.judge(&self.nodes, members, known, &self.config.params);
        let pending = &mut self.pending[facet];
        pending.iter_mut().for_each(|p| p.seen = false);
        for hinge in &self.candidates.accepted {
            let h_m = self.nodes.h_m;
            let known = pending.iter_mut().find(|p| !p.seen && same(&p.hinge, hinge, h_m));
            if let Some(p) = known {
                *p = Pending { hinge: *hinge, hits: p.hits + 1.0, seen: true };
            } else if pending.len() < PENDING_MAX {
                pending.push(Pending { hinge: *hinge, hits: 1.0, seen: true });
            }
        }
        pending.retain_mut(|p| {
            p.hits -= if p.seen { 0.0 } else { 1.0 + MISS };
            p.hits > 0.0
        });
    }

    /// Splits a facet along all candidates that were seen often enough, the sharpest first.
    fn split_where_sure(&mut self, folds: &mut Folds, facet: usize) -> bool {
        let hits = f64::from(self.config.params.hits);
        let before = folds.facets().len();
        while let Some(at) = {
            let sure = self.pending[facet].iter().enumerate().filter(|(_, p)| p.hits >= hits);
            let sharper = |a: &Hinge, b: &Hinge| a.angle_rad.total_cmp(&b.angle_rad);
            sure.max_by(|(_, a), (_, b)| sharper(&a.hinge, &b.hinge)).map(|(at, _)| at)
        } {
            let hinge = self.pending[facet].swap_remove(at).hinge;
            // Earlier splits of this step may have put it into another part.
            let part = folds.facet_at(middle(&hinge));
            if (part == facet || part >= before) && self.is_wide(folds, part, &hinge.line) {
                self.split(folds, part, &hinge);
            }
        }
        folds.facets().len() > before
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

    fn split(&mut self, folds: &mut Folds, facet: usize, hinge: &Hinge) {
        let Some(new) = folds.split(facet, &hinge.line) else { return };
        let cut = Cut {
            sides: [Side::Facet(facet), Side::Facet(new)],
            estimate: Estimate::new(hinge, self.nodes.h_m),
            sign: hinge.sign,
            angle_max_rad: hinge.angle_rad,
            unfolded: 0,
        };
        self.tree.split(facet, new, cut);
        self.list_members(folds);
    }

    /// Measures the lines of some creases, and moves those that are clearly elsewhere.
    fn measure(&mut self, folds: &mut Folds) -> bool {
        let count = folds.creases().len();
        for _ in 0..count.min(MEASURED_MAX) {
            self.next_crease = (self.next_crease + 1) % count;
            let [f, g] = folds.creases()[self.next_crease].facets;
            if let Some(cut) = self.tree.between(f, g) {
                self.measure_crease(cut, f, g);
            }
        }
        let h_m = self.nodes.h_m;
        let is_off = |folds: &Folds, tree: &Tree| {
            folds.creases().iter().any(|crease| {
                let Some(cut) = tree.between(crease.facets[0], crease.facets[1]) else {
                    return false;
                };
                let best = tree.cuts[cut].estimate.best();
                crease.ends_m.iter().any(|end| best.side_m(*end).abs() > PUBLISH * h_m)
            })
        };
        count > 0 && is_off(folds, &self.tree) && self.publish(folds)
    }

    fn measure_crease(&mut self, cut: usize, f: usize, g: usize) {
        let h_m = self.nodes.h_m;
        let line = self.tree.cuts[cut].estimate.best();
        let members = [f, g].map(|facet| &self.members[facet]);
        let mut reach_m = [0.0f64; 2];
        for n in members.into_iter().flatten() {
            let side_m = line.side_m(self.nodes.uv_m[*n as usize]);
            let reach = &mut reach_m[usize::from(side_m > 0.0)];
            *reach = reach.max(side_m.abs() + 0.01 * h_m);
        }
        let window = Window { line, reach_m: reach_m.map(|r| r.min(REACH * h_m)) };
        let both = members[0].iter().chain(members[1]).copied();
        let bends = bends(&self.config.params, h_m);
        let Some(hinge) = self.candidates.fitter.fit(&self.nodes, both, window, 2, bends) else {
            return;
        };
        let known = &mut self.tree.cuts[cut];
        known.angle_max_rad = known.angle_max_rad.max(hinge.angle_rad);
        let flat = hinge.angle_rad < UNDO.1.to_radians();
        known.unfolded = if flat { known.unfolded + 1 } else { 0 };
        if !flat && hinge.kink_m2 < hinge.smooth_m2 {
            known.estimate.measure(&hinge, h_m);
        }
    }

    /// Puts all published lines where the estimates are.
    fn publish(&mut self, folds: &mut Folds) -> bool {
        self.tree.cuts.iter_mut().for_each(|cut| cut.estimate.publish());
        let Some(facets) = self.tree.facets() else {
            self.tree.cuts.iter_mut().for_each(|cut| cut.estimate.withdraw());
            return false;
        };
        let same: Vec<usize> = (0..facets.len()).collect();
        folds.retile(facets, &same);
        self.list_members(folds);
        true
    }

    /// Joins facets whose crease never became a fold.
    fn undo(&mut self, folds: &mut Folds) -> bool {
        let never = |cut: &Cut| {
            let between_facets = cut.sides.iter().all(|side| matches!(side, Side::Facet(_)));
            between_facets && cut.unfolded >= UNDO.0 && cut.angle_max_rad < UNDO.2.to_radians()
        };
        let Some(cut) = self.tree.cuts.iter().position(never) else { return false };
        let Some(from) = self.tree.join(cut) else { return false };
        let Some(facets) = self.tree.facets() else { return false };
        folds.retile(facets, &from);
        self.pending.iter_mut().for_each(Vec::clear);
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

/// Whether two fits are of one crease.
fn same(a: &Hinge, b: &Hinge, h_m: f64) -> bool {
    let turn =
        a.line.direction[0] * b.line.direction[1] - a.line.direction[1] * b.line.direction[0];
    turn.abs() < SAME.0 && a.line.side_m(middle(b)).abs() < SAME.1 * h_m
}
