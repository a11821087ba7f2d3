//! Creases that a facet might have.
//!
//! Divisions into rigid strips propose lines; each line that is not known yet becomes a candidate.
//! A candidate is fitted again in every step and gathers evidence: how much likelier a narrow bend
//! is than a wide or a smooth one. It becomes a crease once that is enough.

use super::hinge::{Bends, Fitter, Hinge, Window};
use super::moments;
use super::nodes::Nodes;
use super::search::{STRIPS_MAX, Search};
use crate::folds::Facet;
use crate::line::Line;
use crate::params::CreaseParams;

/// How far a fit looks on both sides of a line, spacings.
const REACH: f64 = 6.0;
/// Radius below which a bend of any angle is a crease, spacings.
const BEND_RADIUS: f64 = 1.28;
/// Deviations below this share of the spacing are not looked into, per coordinate.
const FLATNESS: f64 = 0.05;
/// Deviations from a rigid facet that are worth a search: noise, and a share of the spacing.
const WORTH: (f64, f64) = (1.1, 0.03);
/// A step searches every second direction, the next one the others.
const STRIDE: usize = 2;
/// Log-likelihood ratio that one more strip must gain to be looked at.
const STRIP_EVIDENCE: f64 = 10.0;
/// Standard errors by which a fold angle must differ from zero.
const ERRORS_MIN: f64 = 4.0;
/// Bends of one sign nearer to each other than this many spacings are an arc.
const ARC_SPACING: f64 = 4.0;
/// Believable stretch of both sides of a crease.
const STRETCH: std::ops::RangeInclusive<f64> = 0.6..=1.5;
/// Most candidates of a facet.
const CANDIDATES_MAX: usize = 12;
/// How near a line must be to be the same: radians, spacings.
const SAME: (f64, f64) = (0.2, 1.2);
/// Evidence that one step can add or take.
const EVIDENCE_STEP: f64 = 5.0;
/// A candidate is dropped below this evidence, or after so many steps without a fold.
const DROPPED: (f64, u32) = (-5.0, 3);

/// A crease that may come.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidate {
    pub hinge: Hinge,
    /// Log-likelihood ratio, summed over steps.
    pub evidence: f64,
    /// Steps in which it looked like a fold, and since it last did.
    pub hits: u32,
    misses: u32,
    reach_m: [f64; 2],
}

/// A facet as its candidates see it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View<'a> {
    pub nodes: &'a Nodes,
    pub members: &'a [u32],
    pub facet: &'a Facet,
    pub params: &'a CreaseParams,
}

/// Room for a step's work.
#[derive(Debug, Clone)]
pub(crate) struct Judge {
    search: Search,
    pub fitter: Fitter,
    fits: Vec<(Border, Option<Hinge>)>,
    found: Vec<(Border, Hinge)>,
    best: Vec<(Border, Hinge)>,
    turn: usize,
}

/// Where a fit starts; equal ones are fitted once.
#[derive(Debug, Clone, Copy)]
struct Border {
    normal: [f64; 2],
    at_m: f64,
    reach_m: [f64; 2],
}

impl Judge {
    pub fn new(nodes: usize, directions: usize) -> Self {
        Self {
            search: Search::new(directions),
            fitter: Fitter::new(nodes),
            fits: Vec::with_capacity(STRIPS_MAX * STRIPS_MAX),
            found: Vec::with_capacity(STRIPS_MAX),
            best: Vec::with_capacity(STRIPS_MAX),
            turn: 0,
        }
    }

    /// Room for one facet's candidates.
    pub fn candidates() -> Vec<Candidate> {
        Vec::with_capacity(CANDIDATES_MAX)
    }

    /// Updates a facet's candidates; `known` are the creases that it has, with their signs.
    pub fn judge(
        &mut self,
        view: &View,
        known: impl Iterator<Item = (Line, f64)> + Clone,
        candidates: &mut Vec<Candidate>,
    ) {
        let weight: f64 = view.members.iter().map(|n| view.nodes.weight[*n as usize]).sum();
        if weight < 12.0 {
            return;
        }
        for candidate in candidates.iter_mut() {
            let (line, reach_m) = (candidate.hinge.line, candidate.reach_m);
            candidate.update(fit(&mut self.fitter, view, line, reach_m, 1), view);
        }
        candidates.retain(|c| c.evidence > DROPPED.0 && c.misses < DROPPED.1);
        self.propose(view, known.clone(), weight);
        let h_m = view.nodes.h_m;
        for (border, hinge) in &self.best {
            let known = candidates.iter_mut().find(|c| same(&c.hinge, hinge, h_m));
            if let Some(candidate) = known {
                candidate.reach_m = border.reach_m;
            } else if candidates.len() < CANDIDATES_MAX {
                candidates.push(Candidate::new(hinge, border.reach_m, view));
            }
        }
        drop_arcs(candidates, known, h_m);
    }

    /// The lines of the division with the most folds are in `best`.
    fn propose(
        &mut self,
        view: &View,
        known: impl Iterator<Item = (Line, f64)> + Clone,
        weight: f64,
    ) {
        self.fits.clear();
        self.best.clear();
        let residual_m = (rigid_residual_m2(view) / (3.0 * weight)).sqrt();
        if residual_m < WORTH.0 * view.nodes.noise_m + WORTH.1 * view.nodes.h_m {
            return;
        }
        self.turn = (self.turn + 1) % STRIDE;
        self.search.run(view.nodes, view.members, self.turn, STRIDE);
        let noise_m = view.nodes.noise_m.max(FLATNESS * view.nodes.h_m);
        for strips in 2..=STRIPS_MAX {
            let [before, after] = [strips - 1, strips].map(|k| self.search.best[k].cost_m2);
            if (before - after) / (2.0 * noise_m * noise_m) < STRIP_EVIDENCE || after.is_infinite()
            {
                break;
            }
            self.judge_division(view, strips);
            self.drop_found_arcs(known.clone(), view.nodes.h_m);
            if self.found.len() > self.best.len() {
                std::mem::swap(&mut self.found, &mut self.best);
            }
        }
    }

    /// Drops what is found beside a fold of the same sign.
    fn drop_found_arcs(&mut self, known: impl Iterator<Item = (Line, f64)> + Clone, h_m: f64) {
        let mut arcs = [false; STRIPS_MAX];
        for (a, (_, hinge)) in self.found.iter().enumerate() {
            let others = self.found.iter().enumerate().filter(|(b, _)| *b != a);
            let others = others.map(|(_, (_, other))| (other.line, other.sign));
            arcs[a] = is_near(hinge, others, h_m) || is_near(hinge, known.clone(), h_m);
        }
        let mut at = 0;
        self.found.retain(|_| {
            at += 1;
            !arcs[at - 1]
        });
    }

    /// Fits a kink to every border of a division; the good ones are in `found`.
    fn judge_division(&mut self, view: &View, strips: usize) {
        let division = self.search.best[strips];
        let (normal, h_m) = (division.normal, view.nodes.h_m);
        let across = |n: &u32| {
            let q = view.nodes.uv_m[*n as usize];
            q[0] * normal[0] + q[1] * normal[1]
        };
        let low = view.members.iter().map(across).fold(f64::INFINITY, f64::min) - h_m;
        let high = view.members.iter().map(across).fold(f64::NEG_INFINITY, f64::max) + h_m;
        self.found.clear();
        for k in 0..strips - 1 {
            let at_m = division.borders_m[k];
            let before = if k == 0 { low } else { division.borders_m[k - 1] };
            let after = if k == strips - 2 { high } else { division.borders_m[k + 1] };
            // The line's left is where its normal points to.
            let reach_m = [at_m - before, after - at_m].map(|r| r.min(REACH * h_m));
            let border = Border { normal, at_m, reach_m };
            let known = self.fits.iter().find(|(other, _)| other.equals(&border, h_m));
            let good = known.map(|(_, fit)| *fit).unwrap_or_else(|| {
                let good = fit(&mut self.fitter, view, border.line(), reach_m, 3);
                let shift_m = |hinge: &Hinge| border.line().side_m(hinge.middle_m()).abs();
                let good = good.filter(|h| is_fold(h, view) && shift_m(h) < 2.0 * h_m);
                self.fits.push((border, good));
                good
            });
            self.found.extend(good.map(|hinge| (border, hinge)));
        }
    }
}

impl Candidate {
    fn new(hinge: &Hinge, reach_m: [f64; 2], view: &View) -> Self {
        let evidence = step_evidence(hinge, view.nodes.h_m);
        Self { hinge: *hinge, evidence, hits: 1, misses: 0, reach_m }
    }

    fn update(&mut self, fit: Option<Hinge>, view: &View) {
        match fit.filter(|hinge| is_fold(hinge, view)) {
            Some(hinge) => {
                self.evidence += step_evidence(&hinge, view.nodes.h_m);
                self.hinge = hinge;
                (self.hits, self.misses) = (self.hits + 1, 0);
            }
            None => self.misses += 1,
        }
    }
}

impl Border {
    fn equals(&self, other: &Self, h_m: f64) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() < 0.25 * h_m;
        self.normal == other.normal
            && near(self.at_m, other.at_m)
            && near(self.reach_m[0], other.reach_m[0])
            && near(self.reach_m[1], other.reach_m[1])
    }

    fn line(&self) -> Line {
        let [a, b] = self.normal;
        // Turned by a right angle clockwise, so that the normal is on the left.
        Line { point_m: [a * self.at_m, b * self.at_m], direction: [b, -a] }
    }
}

/// Squared distances of a facet's nodes from its best rigid pose, m².
fn rigid_residual_m2(view: &View) -> f64 {
    let Some(first) = view.members.iter().find(|n| view.nodes.weight[**n as usize] > 0.0) else {
        return 0.0;
    };
    let origin = view.nodes.x_m[*first as usize];
    let (none, mut sums) = ([0.0; 14], [0.0; 14]);
    for n in view.members {
        let n = *n as usize;
        let x = view.nodes.x_m[n];
        let x = [x[0] - origin[0], x[1] - origin[1], x[2] - origin[2]];
        moments::add(&mut sums, view.nodes.weight[n], x, view.nodes.uv_m[n]);
    }
    moments::rigid_cost(&none, &sums)
}

/// Fits a line in a facet.
fn fit(
    fitter: &mut Fitter,
    view: &View,
    line: Line,
    reach_m: [f64; 2],
    iterations: usize,
) -> Option<Hinge> {
    let window = Window { line, reach_m, piece: &view.facet.corners_m };
    let bends = bends(view.params, view.nodes.h_m);
    fitter.fit(view.nodes, view.members.iter().copied(), window, iterations, bends)
}

/// What bends count as creases.
pub(crate) fn bends(params: &CreaseParams, h_m: f64) -> Bends {
    Bends {
        width_m: params.bend_width * h_m,
        radius_m: BEND_RADIUS * h_m,
        angle_rad: params.angle_min_deg.to_radians(),
    }
}

/// Variance of a coordinate about a fit, m², with what is not looked into.
pub(crate) fn noise_m2(hinge: &Hinge, h_m: f64) -> f64 {
    hinge.noise_m2(FLATNESS * h_m)
}

/// What a fit says for a crease (or against it).
fn step_evidence(hinge: &Hinge, h_m: f64) -> f64 {
    hinge.evidence(noise_m2(hinge, h_m)).clamp(-EVIDENCE_STEP, EVIDENCE_STEP)
}

/// Whether a fit is folded at all, and neither stretch nor noise.
fn is_fold(hinge: &Hinge, view: &View) -> bool {
    let error_rad = hinge.error_rad(noise_m2(hinge, view.nodes.h_m));
    hinge.angle_rad > view.params.angle_min_deg.to_radians().max(ERRORS_MIN * error_rad)
        && hinge.stretch.iter().all(|s| STRETCH.contains(s))
}

/// Whether two fits are of one crease.
fn same(a: &Hinge, b: &Hinge, h_m: f64) -> bool {
    let (p, q) = (a.line.direction, b.line.direction);
    (p[0] * q[1] - p[1] * q[0]).abs() < SAME.0 && a.line.side_m(b.middle_m()).abs() < SAME.1 * h_m
}

/// Drops candidates that are neighbours of stronger ones, or of creases, with the same sign.
fn drop_arcs(
    candidates: &mut Vec<Candidate>,
    known: impl Iterator<Item = (Line, f64)> + Clone,
    h_m: f64,
) {
    let mut at = 0;
    while at < candidates.len() {
        let Candidate { hinge, evidence, .. } = candidates[at];
        let stronger = candidates
            .iter()
            .enumerate()
            .filter(|(other, c)| *other != at && (c.evidence, *other) > (evidence, at));
        let stronger = stronger.map(|(_, c)| (c.hinge.line, c.hinge.sign));
        if is_near(&hinge, known.clone(), h_m) || is_near(&hinge, stronger, h_m) {
            candidates.swap_remove(at);
        } else {
            at += 1;
        }
    }
}

/// Whether a fit is a neighbour of a line that bends the same way.
fn is_near(hinge: &Hinge, lines: impl Iterator<Item = (Line, f64)>, h_m: f64) -> bool {
    lines.into_iter().any(|(line, sign)| {
        let apart_m = line.side_m(hinge.middle_m()).abs();
        let (p, q) = (line.direction, hinge.line.direction);
        let parallel = (p[0] * q[1] - p[1] * q[0]).abs() < 0.3;
        sign == hinge.sign && parallel && apart_m < ARC_SPACING * h_m
    })
}
