//! Creases remember how far they were folded.
//!
//! ```text
//! hinge:  e = θ − θ₀;  |e| > yield:  θ₀ ← θ − sgn(e)·yield, and yield grows by hardening·|Δθ₀|
//!         the two facets turn by k·(θ₀ − θ) in all, each in inverse proportion to Σ distance²
//! paper:  a link across a crease, ε = (l − d)/d₀;  |ε| > yield:  d ← l − sgn(ε)·yield·d₀
//! ```
//!
//! The hinge turns whole facets about their common line, so that the crease need not lie on the
//! grid. Angles are as in `orime_creases::Crease`, followed through half a turn.
//!
//! GPU twins: `turn`, `follow`, `yield_to` and `lean_facet` in `gpu/crease.wgsl`, `yield_link` in
//! `gpu/plastic.wgsl`.

use crate::solver::facets::{FacetTable, FitFacet, Frame, dot};
use crate::solver::links::{Colour, Rest};
use orime_creases::Folds;
use orime_lanes::Field;
use orime_lanes::{LANES, Lanes, Pass, Width};
use std::f64::consts::{PI, TAU};

/// How creases yield.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plastic {
    /// Elastic range: radians, or strain of a link.
    pub yields_at: f64,
    /// How much the elastic range grows per radian that was yielded.
    pub hardening: f64,
    /// Share of the way back to the rest angle in a substep.
    pub stiffness: f64,
}

/// A crease's own state.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Hinge {
    /// The facets left and right of it.
    pub facets: [usize; 2],
    /// Unit direction, (u, v).
    pub direction: [f64; 2],
    /// Distance from it of each facet's mean, metres, both positive.
    pub center_m: [f64; 2],
    /// Σ distance² over each facet's nodes, m².
    pub inertia_m2: [f64; 2],
    /// Angle as last seen, radians.
    pub angle_rad: f64,
    /// Angle that it goes back to, radians.
    pub rest_rad: f64,
    /// Elastic range by now, radians.
    pub yields_at_rad: f64,
}

impl Hinge {
    /// The hinges of all creases; those that were known before keep their state, new ones rest as
    /// they are.
    pub fn all(folds: &Folds, plastic: &Plastic, known: &[Self]) -> Vec<Self> {
        let uv: Vec<[f64; 2]> = folds.sheet().uv_m().collect();
        let hinge = |crease: &orime_creases::Crease| {
            let line = crease.line();
            let distance = |n: &u32| line.side_m(uv[*n as usize]).abs();
            let members = crease.facets.map(|facet| folds.members(facet));
            let mean =
                |nodes: &[u32]| nodes.iter().map(distance).sum::<f64>() / nodes.len().max(1) as f64;
            let squares = |nodes: &[u32]| nodes.iter().map(|n| distance(n).powi(2)).sum::<f64>();
            let same = |other: &&Self| {
                let [d, e] = [line.direction, other.direction];
                other.facets == crease.facets && (d[0] * e[1] - d[1] * e[0]).abs() < 0.02
            };
            let before = known.iter().find(same);
            Self {
                facets: crease.facets,
                direction: line.direction,
                center_m: members.map(mean),
                inertia_m2: members.map(squares),
                angle_rad: crease.angle_rad,
                rest_rad: before.map_or(crease.angle_rad, |hinge| hinge.rest_rad),
                yields_at_rad: before.map_or(plastic.yields_at, |hinge| hinge.yields_at_rad),
            }
        };
        folds.creases().iter().map(hinge).collect()
    }

    /// Follows the angle, yields, and turns the two facets towards the rest angle.
    pub fn turn(
        &mut self,
        plastic: &Plastic,
        width: Width,
        table: &FacetTable,
        x: &mut [Field; 3],
    ) {
        let nodes = self.facets.map(|facet| &table.facets[facet]);
        if nodes.iter().any(|nodes| nodes.count < 3) || self.inertia_m2.iter().any(|i| *i <= 0.0) {
            return;
        }
        let mut frames = [Frame { center_m: [0.0; 3], u: [0.0; 3], v: [0.0; 3] }; 2];
        for (nodes, frame) in nodes.iter().zip(&mut frames) {
            width.run(FitFacet { nodes, uv_m: &table.uv_m, x, frame });
        }
        let normals = frames.map(|frame| cross(frame.u, frame.v));
        self.follow(&frames, normals);
        self.yield_to(plastic);
        let turn_rad = plastic.stiffness * (self.rest_rad - self.angle_rad);
        let [left, right] = self.inertia_m2;
        let turns = [turn_rad * right / (left + right), turn_rad * left / (left + right)];
        let counts = nodes.map(|nodes| f64::from(nodes.count));
        // What the turns move in all is taken back from everyone.
        let shift: [f64; 3] = std::array::from_fn(|axis| {
            let moved = |k: usize| turns[k] * self.center_m[k] * counts[k] * normals[k][axis];
            (moved(0) + moved(1)) / (counts[0] + counts[1])
        });
        for side in 0..2 {
            let sign = if side == 0 { 1.0 } else { -1.0 };
            let [d_u, d_v] = self.direction;
            let across = [-sign * d_v, sign * d_u];
            let lean = Lean {
                spans: &nodes[side].spans,
                uv_m: &table.uv_m,
                center_uv_m: nodes[side].center_uv_m,
                across: across.map(|c| c as f32),
                center_m: self.center_m[side] as f32,
                turn: normals[side].map(|c| (-turns[side] * c) as f32),
                shift: shift.map(|c| c as f32),
                x,
            };
            width.run(lean);
        }
    }

    fn follow(&mut self, frames: &[Frame; 2], normals: [[f64; 3]; 2]) {
        let [d_u, d_v] = self.direction;
        let axis: [f64; 3] = std::array::from_fn(|k| {
            frames.iter().map(|frame| frame.u[k] * d_u + frame.v[k] * d_v).sum()
        });
        let length = dot(axis, axis).sqrt();
        if length > 0.0 {
            let sine = dot(cross(normals[0], normals[1]), axis) / length;
            let angle_rad = sine.atan2(dot(normals[0], normals[1]));
            // The nearest of all angles that look alike: a fold does not jump.
            let turns = ((self.angle_rad - angle_rad) / TAU).round();
            self.angle_rad = (angle_rad + TAU * turns).clamp(-1.5 * PI, 1.5 * PI);
        }
    }

    fn yield_to(&mut self, plastic: &Plastic) {
        let elastic_rad = self.angle_rad - self.rest_rad;
        if elastic_rad.abs() > self.yields_at_rad {
            let flow_rad = elastic_rad - elastic_rad.signum() * self.yields_at_rad;
            self.rest_rad += flow_rad;
            self.yields_at_rad = (self.yields_at_rad + plastic.hardening * flow_rad.abs()).min(PI);
        }
    }
}

/// x ← x + distance·turn + shift for one facet: a small turn about a line of the sheet.
struct Lean<'a> {
    spans: &'a [(u32, u16)],
    uv_m: &'a [Field; 2],
    center_uv_m: [f32; 2],
    /// Unit direction away from the line, (u, v).
    across: [f32; 2],
    /// Distance of the mean from the line.
    center_m: f32,
    /// Move per metre of distance.
    turn: [f32; 3],
    shift: [f32; 3],
    x: &'a mut [Field; 3],
}

impl Pass for Lean<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let [u, v] = self.uv_m.each_ref().map(Field::rows);
        for (first, bits) in self.spans {
            let at = *first as usize..*first as usize + LANES;
            // SAFETY: the slices have sixteen numbers.
            unsafe {
                let du = V::load(u[at.clone()].as_ptr()).sub(V::splat(self.center_uv_m[0]));
                let dv = V::load(v[at.clone()].as_ptr()).sub(V::splat(self.center_uv_m[1]));
                let away = du.mul(V::splat(self.across[0])).add(dv.mul(V::splat(self.across[1])));
                let distance = away.add(V::splat(self.center_m));
                for (axis, field) in self.x.iter_mut().enumerate() {
                    let x = &mut field.rows_mut()[at.clone()];
                    let way = distance.mul(V::splat(self.turn[axis]));
                    let way = way.add(V::splat(self.shift[axis])).keep(*bits);
                    V::load(x.as_ptr()).add(way).store(x.as_mut_ptr());
                }
            }
        }
    }
}

/// A skip or diagonal link that may yield.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlasticLink {
    colour: u16,
    lane: u16,
    chunk: u32,
    /// Places of its ends.
    pub ends: [u32; 2],
    /// Rest length of the uncreased sheet, metres.
    pub rest_m: f32,
}

impl PlasticLink {
    /// The rest length that it has come to, metres.
    #[cfg(feature = "gpu")]
    pub fn rest_now_m(&self, colours: &[Colour]) -> f32 {
        let colour = &colours[usize::from(self.colour)];
        colour.rest_m.of(self.chunk as usize, usize::from(self.lane))
    }

    /// The same, to be changed.
    pub fn rest_mut<'a>(&self, colours: &'a mut [Colour]) -> Option<&'a mut f32> {
        let colour = &mut colours[usize::from(self.colour)];
        let Rest::Each(rest_m) = &mut colour.rest_m else { return None };
        Some(&mut rest_m[self.chunk as usize].0[usize::from(self.lane)])
    }
}

/// The links across creases, which yield; those that no longer cross one get their first rest
/// length back.
pub(crate) fn plastic_links(
    colours: &mut [Colour],
    facets_of_place: &[u32],
    known: &[PlasticLink],
) -> Vec<PlasticLink> {
    let crosses = |[a, b]: [u32; 2]| facets_of_place[a as usize] & facets_of_place[b as usize] == 0;
    let (kept, mended): (Vec<&PlasticLink>, Vec<&PlasticLink>) =
        known.iter().partition(|link| crosses(link.ends));
    for link in mended {
        if let Some(rest_m) = link.rest_mut(colours) {
            *rest_m = link.rest_m;
        }
    }
    let mut links = Vec::new();
    for (colour_at, colour) in colours.iter().enumerate() {
        if colour.effect == crate::Effect::Stretch {
            continue;
        }
        for (at, chunk) in colour.chunks.iter().enumerate() {
            for lane in (0..LANES).filter(|lane| chunk.all >> lane & 1 == 1) {
                let first = chunk.first + lane as u32;
                let ends = [first, first + colour.offset as u32];
                if crosses(ends) {
                    let same = |link: &&&PlasticLink| link.ends == ends;
                    let new = || PlasticLink {
                        colour: colour_at as u16,
                        lane: lane as u16,
                        chunk: at as u32,
                        ends,
                        rest_m: colour.rest_m.of(at, lane),
                    };
                    links.push(kept.iter().find(same).map_or_else(new, |link| **link));
                }
            }
        }
    }
    links
}

/// Lets the links yield to the lengths that they have.
pub(crate) fn yield_links(
    links: &[PlasticLink],
    plastic: &Plastic,
    x: &[Field; 3],
    colours: &mut [Colour],
) {
    for link in links {
        let [a, b] = link.ends.map(|n| n as usize);
        let Some(rest_m) = link.rest_mut(colours) else { continue };
        let squared = |field: &Field| (field.rows()[b] - field.rows()[a]).powi(2);
        let length_m = x.iter().map(squared).sum::<f32>().sqrt();
        let strain = (length_m - *rest_m) / link.rest_m;
        let yields_at = plastic.yields_at as f32;
        if strain.abs() > yields_at {
            *rest_m = (length_m - strain.signum() * yields_at * link.rest_m).max(0.0);
        }
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
