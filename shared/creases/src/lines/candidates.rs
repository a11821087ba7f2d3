//! Creases that a facet might have, judged in one step.

use super::hinge::{Bends, Fitter, Hinge, Window};
use super::nodes::Nodes;
use super::search::{STRIPS_MAX, Search};
use crate::line::Line;
use crate::params::CreaseParams;

/// How far a fit looks on both sides of a line, spacings.
pub(crate) const REACH: f64 = 6.0;
/// Radius below which a bend of any angle is a crease, spacings.
const BEND_RADIUS: f64 = 1.28;
/// Deviations below this share of the spacing are not looked into, per coordinate.
const FLATNESS: f64 = 0.1;
/// Deviations from a rigid facet that are worth a search: noise, and a share of the spacing.
const WORTH: (f64, f64) = (1.1, 0.03);
/// Standard errors by which a fold angle must differ from zero.
const ERRORS_MIN: f64 = 4.0;
/// Bends of one sign nearer to each other than this many spacings are an arc.
const ARC_SPACING: f64 = 4.0;
/// Believable stretch of both sides of a crease.
const STRETCH: std::ops::RangeInclusive<f64> = 0.6..=1.5;

/// Room for a step's candidates.
#[derive(Debug, Clone)]
pub(crate) struct Candidates {
    search: Search,
    pub fitter: Fitter,
    fits: Vec<(Border, Option<Hinge>)>,
    found: Vec<Hinge>,
    /// The accepted kinks of the facet that was judged last.
    pub accepted: Vec<Hinge>,
    /// Standard deviation of the nodes from the rigid facet, per coordinate, metres.
    pub residual_m: f64,
}

/// Where a fit starts; equal ones are fitted once.
#[derive(Debug, Clone, Copy)]
struct Border {
    normal: [f64; 2],
    at_m: f64,
    reach_m: [f64; 2],
}

impl Candidates {
    pub fn new(nodes: usize, directions: usize) -> Self {
        Self {
            search: Search::new(directions),
            fitter: Fitter::new(nodes),
            fits: Vec::with_capacity(STRIPS_MAX * STRIPS_MAX),
            found: Vec::with_capacity(STRIPS_MAX),
            accepted: Vec::with_capacity(STRIPS_MAX),
            residual_m: 0.0,
        }
    }

    /// Judges a facet, given by its nodes; `known` are the creases that it has, with their signs.
    pub fn judge(
        &mut self,
        nodes: &Nodes,
        members: &[u32],
        known: impl Iterator<Item = (Line, f64)> + Clone,
        params: &CreaseParams,
    ) {
        self.accepted.clear();
        self.fits.clear();
        let weight: f64 = members.iter().map(|n| nodes.weight[*n as usize]).sum();
        if weight < 12.0 {
            return;
        }
        self.search.run(nodes, members, 0, 1);
        self.residual_m = (self.search.best[1].cost_m2 / (3.0 * weight)).sqrt();
        if self.residual_m < WORTH.0 * nodes.noise_m + WORTH.1 * nodes.h_m {
            return;
        }
        for strips in 2..=STRIPS_MAX {
            if !self.search.best[strips].cost_m2.is_finite() {
                break;
            }
            self.judge_division(nodes, members, strips, params);
            drop_arcs(&mut self.found, known.clone(), nodes.h_m);
            if self.found.len() > self.accepted.len() {
                std::mem::swap(&mut self.found, &mut self.accepted);
            }
        }
    }

    /// Fits a kink to every border of a division; the good ones are in `found`.
    fn judge_division(
        &mut self,
        nodes: &Nodes,
        members: &[u32],
        strips: usize,
        params: &CreaseParams,
    ) {
        let division = self.search.best[strips];
        let (normal, h_m) = (division.normal, nodes.h_m);
        let across = |n: &u32| {
            let q = nodes.uv_m[*n as usize];
            q[0] * normal[0] + q[1] * normal[1]
        };
        let low = members.iter().map(across).fold(f64::INFINITY, f64::min) - h_m;
        let high = members.iter().map(across).fold(f64::NEG_INFINITY, f64::max) + h_m;
        self.found.clear();
        for k in 0..strips - 1 {
            let at_m = division.borders_m[k];
            let before = if k == 0 { low } else { division.borders_m[k - 1] };
            let after = if k == strips - 2 { high } else { division.borders_m[k + 1] };
            // The line's left is where its normal points to.
            let reach_m = [at_m - before, after - at_m].map(|r| r.min(REACH * h_m));
            let border = Border { normal, at_m, reach_m };
            let known = self.fits.iter().find(|(other, _)| other.equals(&border, h_m));
            let fit = known.map(|(_, fit)| *fit).unwrap_or_else(|| {
                let window = Window { line: border.line(), reach_m };
                let bends = bends(params, h_m);
                let fit = self.fitter.fit(nodes, members.iter().copied(), window, 3, bends);
                let fit = fit.filter(|hinge| is_crease(hinge, &window, params, h_m));
                self.fits.push((border, fit));
                fit
            });
            self.found.extend(fit);
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

/// What bends count as creases.
pub(crate) fn bends(params: &CreaseParams, h_m: f64) -> Bends {
    Bends { width_m: params.bend_width * h_m, radius_m: BEND_RADIUS * h_m }
}

/// Whether a fit is a fold and not a bend, a stretch or noise.
fn is_crease(hinge: &Hinge, window: &Window, params: &CreaseParams, h_m: f64) -> bool {
    let n = hinge.weight;
    let noise_m2 = (hinge.kink_m2 / (3.0 * n)).max((FLATNESS * h_m).powi(2));
    let reach_m = window.reach_m[0].min(window.reach_m[1]);
    let error_rad = (noise_m2 * 24.0 / (0.5 * n)).sqrt() / reach_m;
    let shift_m = window.line.side_m(middle(hinge)).abs();
    hinge.angle_rad > params.angle_min_deg.to_radians().max(ERRORS_MIN * error_rad)
        && (hinge.smooth_m2 - hinge.kink_m2) / (2.0 * noise_m2) > params.evidence
        && (hinge.kink_m2 - hinge.arc_m2) / (2.0 * noise_m2) < params.evidence
        && shift_m < 2.0 * h_m
        && hinge.stretch.iter().all(|s| STRETCH.contains(s))
}

/// The middle of the nodes along a fit's line.
pub(crate) fn middle(hinge: &Hinge) -> [f64; 2] {
    let line = &hinge.line;
    [0, 1].map(|k| line.point_m[k] + hinge.along[0] * line.direction[k])
}

/// Drops bends that are neighbours of others with the same sign.
fn drop_arcs(found: &mut Vec<Hinge>, known: impl Iterator<Item = (Line, f64)> + Clone, h_m: f64) {
    let near_m = ARC_SPACING * h_m;
    let mut is_arc = [false; STRIPS_MAX];
    for a in 0..found.len() {
        let (line, sign) = (found[a].line, found[a].sign);
        for b in 0..found.len() {
            let other = &found[b];
            let same = sign == other.sign;
            let apart_m = line.side_m(middle(other)).abs();
            is_arc[a] |= a != b && same && apart_m < near_m && near_parallel(&line, &other.line);
        }
        is_arc[a] |= known.clone().any(|(other, other_sign)| {
            let apart_m = other.side_m(middle(&found[a])).abs();
            let same = sign == other_sign;
            same && apart_m < near_m && near_parallel(&line, &other)
        });
    }
    let mut at = 0;
    found.retain(|_| {
        at += 1;
        !is_arc[at - 1]
    });
}

fn near_parallel(a: &Line, b: &Line) -> bool {
    (a.direction[0] * b.direction[1] - a.direction[1] * b.direction[0]).abs() < 0.3
}
