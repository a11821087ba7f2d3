//! Projects one colour of distance links. GPU twin: `project` in `gpu/passes.wgsl`.
//!
//! ```text
//! n = (x₂ − x₁)/|x₂ − x₁|, C = |x₂ − x₁| − d
//! xpbd:   s = (C + γ n·[(x₂ − x₂°) − (x₁ − x₁°)]) / ((1 + γ)(w₁ + w₂) + α̃)
//!         x₁ ← x₁ + w₁ s n,   x₂ ← x₂ − w₂ s n
//! paper:  s₁ = (C − γ n·(x₁ − x₁°)) / (w₁ + w₂ + α̃),  s₂ = (C + γ n·(x₂ − x₂°)) / (w₁ + w₂ + α̃)
//! ```
//!
//! Masses stand in units of a node's ordinary mass (w = 1), and so does α̃.

use crate::solver::links::{Colour, Rest};
use orime_lanes::{Chunk, Field};
use orime_lanes::{LANES, Lanes, Pass, dot, load_points, minus, plus, store_points, times};

/// How links are damped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Damp {
    /// Not at all.
    Off,
    /// XPBD's way.
    Xpbd,
    /// As the paper prints it.
    Paper,
}

/// One colour to project.
pub(crate) struct Project<'a> {
    /// The links.
    pub colour: &'a Colour,
    /// α̃ = α/(dt²·w), without unit.
    pub alpha: f32,
    /// γ; 0 unless damped.
    pub gamma: f32,
    /// The form of the damping.
    pub damp: Damp,
    /// Inverse masses, where not all are 1.
    pub weights: Option<&'a Field>,
    /// Positions, metres.
    pub x: &'a mut [Field; 3],
    /// Positions at the substep's start, metres.
    pub before: &'a [Field; 3],
    /// Room for the moves of close links, one field per axis; as many again where the two ends
    /// move unlike (masses, or the paper's damping).
    pub moves: &'a mut [Field],
}

/// Squared length below which a link has no direction, m².
pub(crate) const COINCIDENT_M2: f32 = 1e-18;

const OFF: u8 = 0;
const XPBD: u8 = 1;
const PAPER: u8 = 2;

impl Pass for Project<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        match self.damp {
            Damp::Off => self.damped::<V, OFF>(),
            Damp::Xpbd => self.damped::<V, XPBD>(),
            Damp::Paper => self.damped::<V, PAPER>(),
        }
    }
}

impl Project<'_> {
    #[inline(always)]
    fn damped<V: Lanes, const DAMP: u8>(self) {
        match (&self.colour.rest_m, self.weights.is_some()) {
            (Rest::Same(_), false) => self.apply::<V, DAMP, false, false>(),
            (Rest::Each(_), false) => self.apply::<V, DAMP, true, false>(),
            (Rest::Same(_), true) => self.apply::<V, DAMP, false, true>(),
            (Rest::Each(_), true) => self.apply::<V, DAMP, true, true>(),
        }
    }

    #[inline(always)]
    fn apply<V: Lanes, const DAMP: u8, const EACH: bool, const WEIGHED: bool>(self) {
        let Self { colour, alpha, gamma, weights, x, before, moves, .. } = self;
        let (same, each): (f32, &[Chunk]) = match &colour.rest_m {
            Rest::Same(rest_m) => (*rest_m, &[]),
            Rest::Each(rest_m) => (0.0, rest_m),
        };
        let room = x[0].rows().len();
        assert!(!EACH || each.len() == colour.chunks.len(), "a rest length per link");
        assert!(colour.end <= room && before.iter().all(|b| b.rows().len() == room));
        let x = x.each_mut().map(|field| field.rows_mut().as_mut_ptr());
        let now = [x[0].cast_const(), x[1].cast_const(), x[2].cast_const()];
        let old = before.each_ref().map(|field| field.rows().as_ptr());
        let weight = weights.map_or(std::ptr::null(), |field| field.rows().as_ptr());
        let lopsided = if WEIGHED || DAMP == PAPER { 3 } else { 0 };
        assert!(!colour.is_close() || moves.len() >= 3 + lopsided, "room for the moves");
        let noted = starts(moves);
        let damping = if DAMP == XPBD { 1.0 + gamma } else { 1.0 };
        let even = V::splat(1.0 / (damping * 2.0 + alpha));
        for (at, chunk) in colour.chunks.iter().enumerate() {
            let a = chunk.first as usize;
            let b = a + colour.offset;
            // SAFETY: `colour.end` is the end of the last vector that the chunks read, and lies
            // within the fields, which all have one length (asserted above).
            unsafe {
                let (first, second) = (load_points::<V>(now, a), load_points::<V>(now, b));
                let d = minus(second, first);
                let squared = dot(d, d);
                let mut active = squared.above(V::splat(COINCIDENT_M2)) & chunk.bits;
                let inverse = squared.inverse_sqrt();
                let rest = if EACH { V::load(each[at].0.as_ptr()) } else { V::splat(same) };
                // C/|d|: what is left of the whole length.
                let violation = V::splat(1.0).sub(rest.mul(inverse));
                let (wa, wb, share) = if WEIGHED {
                    let (wa, wb) = (V::load(weight.add(a)), V::load(weight.add(b)));
                    active &= wa.add(wb).above(V::splat(0.0));
                    (wa, wb, share_of(wa.add(wb), damping, alpha))
                } else {
                    (even, even, even)
                };
                let (mut sa, mut sb) = (violation, violation);
                if DAMP != OFF {
                    let ends = [first, second, load_points::<V>(old, a), load_points::<V>(old, b)];
                    (sa, sb) =
                        damped::<V, DAMP>(violation, V::splat(gamma), squared, inverse, ends);
                }
                // Left out at the end, so that nothing of an idle lane gets through.
                sa = sa.mul(share).keep(active);
                sb = if DAMP == PAPER { sb.mul(share).keep(active) } else { sa };
                (sa, sb) = if WEIGHED { (sa.mul(wa), sb.mul(wb)) } else { (sa, sb) };
                if colour.is_close() {
                    // Ends may share a vector: note the moves, make them when all are known.
                    store_points(times(d, sa), [noted[0], noted[1], noted[2]], LANES + a);
                    if WEIGHED || DAMP == PAPER {
                        store_points(times(d, sb), [noted[3], noted[4], noted[5]], LANES + a);
                    }
                    continue;
                }
                store_points(plus(first, times(d, sa)), x, a);
                store_points(minus(second, times(d, sb)), x, b);
            }
        }
        if colour.is_close() {
            let len = colour.end - colour.offset;
            for (k, x) in x.into_iter().enumerate() {
                // SAFETY: the moves' fields have a vector of room in front, and `offset` is less.
                unsafe { make::<V>(x, noted[k], noted[k + lopsided], colour.offset, len) };
            }
        }
    }
}

/// Where each field starts, its room included; null for those that are not there.
#[inline(always)]
fn starts(moves: &mut [Field]) -> [*mut f32; 6] {
    let mut starts = [std::ptr::null_mut(); 6];
    for (start, field) in starts.iter_mut().zip(moves) {
        *start = field.with_room_mut().as_mut_ptr();
    }
    starts
}

/// 1/((1 + γ)(w₁ + w₂) + α̃).
#[inline(always)]
fn share_of<V: Lanes>(both: V, damping: f32, alpha: f32) -> V {
    V::splat(1.0).div(both.mul(V::splat(damping)).add(V::splat(alpha)))
}

/// The violation with what the ends' motion adds to it, for the first and the second end; `ends`
/// are both and where they were.
#[inline(always)]
fn damped<V: Lanes, const DAMP: u8>(
    violation: V,
    gamma: V,
    squared: V,
    inverse: V,
    [first, second, old_first, old_second]: [[V; 3]; 4],
) -> (V, V) {
    let d = minus(second, first);
    if DAMP == XPBD {
        // n·[(x₂ − x₂°) − (x₁ − x₁°)] = (|d|² − d·d°)/|d|: no motion gives exactly 0.
        let d_old = minus(old_second, old_first);
        let stretched = squared.sub(dot(d, d_old)).mul(inverse);
        let both = violation.add(stretched.mul(inverse.mul(gamma)));
        (both, both)
    } else {
        let share = gamma.mul(inverse).mul(inverse);
        let first = violation.sub(share.mul(dot(d, minus(first, old_first))));
        (first, violation.add(share.mul(dot(d, minus(second, old_second)))))
    }
}

/// x ← x + (move of the link that starts here) − (move of the link that ends here).
///
/// # Safety
/// `x` has `len` numbers, the others a vector of room and then `len` numbers; `offset` < 16.
#[inline(always)]
unsafe fn make<V: Lanes>(
    x: *mut f32,
    starts: *const f32,
    ends: *const f32,
    offset: usize,
    len: usize,
) {
    for at in (0..len).step_by(LANES) {
        // SAFETY: the caller's; `len` is a multiple of the lanes.
        unsafe {
            let start = V::load(starts.add(LANES + at));
            let end = V::load(ends.add(LANES + at - offset));
            V::load(x.add(at)).add(start).sub(end).store(x.add(at));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Effect;
    use crate::solver::links::{Wanted, coloured};
    use orime_geometry::SheetGrid;
    use orime_lanes::Width;
    use orime_lanes::{Layout, gather, scatter};

    const LINKS: [Effect; 3] = [Effect::Stretch, Effect::Shear, Effect::Bend];
    const ALPHA: f32 = 0.3;
    const GAMMA: f32 = 0.4;

    /// A crumpled sheet: positions, positions before, inverse masses.
    fn crumpled(sheet: &SheetGrid) -> ([Vec<[f32; 3]>; 2], Vec<f32>) {
        let h = sheet.spacing_m()[0] as f32;
        let wave = |k: f32| {
            move |(n, x): (usize, &[f32; 3])| {
                let phase = k * n as f32;
                [
                    x[0] + 0.3 * h * phase.sin(),
                    x[1] + 0.2 * h * phase.cos(),
                    h * (phase * 0.7).sin(),
                ]
            }
        };
        let flat = sheet.flat_m();
        let [x, before] = [1.3, 1.1].map(|k| flat.iter().enumerate().map(wave(k)).collect());
        let weights = (0..flat.len()).map(|n| [1.0, 0.0, 1e-6, 2.0][n % 4]).collect();
        ([x, before], weights)
    }

    /// The module's equations, link by link, in f64.
    fn by_the_book(
        colour: &Colour,
        layout: Layout,
        damp: Damp,
        weights: &[f32],
        x: &mut [[f64; 3]],
        before: &[[f32; 3]],
    ) {
        let node = |place: usize| place / layout.stride * layout.nodes[1] + place % layout.stride;
        let (alpha, gamma) = (f64::from(ALPHA), f64::from(GAMMA));
        for (at, chunk) in colour.chunks.iter().enumerate() {
            for lane in (0..LANES).filter(|lane| chunk.bits >> lane & 1 == 1) {
                let place = chunk.first as usize + lane;
                let (a, b) = (node(place), node(place + colour.offset));
                let (wa, wb) = (f64::from(weights[a]), f64::from(weights[b]));
                let d: [f64; 3] = std::array::from_fn(|k| x[b][k] - x[a][k]);
                let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
                let along = |n: usize| {
                    let moved = |k: usize| x[n][k] - f64::from(before[n][k]);
                    (0..3).map(|k| d[k] / length * moved(k)).sum::<f64>()
                };
                let c = length - f64::from(colour.rest_m.of(at, lane));
                let (sa, sb) = match damp {
                    Damp::Off => (c / (wa + wb + alpha), c / (wa + wb + alpha)),
                    Damp::Xpbd => {
                        let s = c + gamma * (along(b) - along(a));
                        let s = s / ((1.0 + gamma) * (wa + wb) + alpha);
                        (s, s)
                    }
                    Damp::Paper => (
                        (c - gamma * along(a)) / (wa + wb + alpha),
                        (c + gamma * along(b)) / (wa + wb + alpha),
                    ),
                };
                if wa + wb > 0.0 {
                    for k in 0..3 {
                        x[a][k] += wa * sa * d[k] / length;
                        x[b][k] -= wb * sb * d[k] / length;
                    }
                }
            }
        }
    }

    #[test]
    fn every_form_is_the_equation_at_every_width() {
        for nodes in [[25, 25], [7, 5], [6, 40]] {
            let sheet = SheetGrid::new([0.15, 0.15], nodes);
            let layout = Layout::new(&sheet);
            let ([x, before], masses) = crumpled(&sheet);
            let rest = x.iter().map(|x| x.map(|c| 1.01 * c)).collect::<Vec<_>>();
            for damp in [Damp::Off, Damp::Xpbd, Damp::Paper] {
                for (weighed, template) in
                    [(false, false), (true, false), (false, true), (true, true)]
                {
                    let rest_m = template.then_some(&rest[..]);
                    let wanted = Wanted { effects: &LINKS, reach: 4, rest_m, each: false };
                    let weights = if weighed { masses.clone() } else { vec![1.0; sheet.len()] };
                    let mut field = layout.field();
                    for (place, weight) in layout.places().zip(&weights) {
                        field.rows_mut()[place] = *weight;
                    }
                    for colour in coloured(&sheet, &wanted) {
                        let mut expected: Vec<[f64; 3]> =
                            x.iter().map(|x| x.map(f64::from)).collect();
                        by_the_book(&colour, layout, damp, &weights, &mut expected, &before);
                        for width in Width::available() {
                            let (mut now, mut old) = (layout.fields(), layout.fields());
                            scatter(layout, &x, &mut now);
                            scatter(layout, &before, &mut old);
                            let mut moves: Vec<Field> = (0..6).map(|_| layout.field()).collect();
                            width.run(Project {
                                colour: &colour,
                                alpha: ALPHA,
                                gamma: GAMMA,
                                damp,
                                weights: weighed.then_some(&field),
                                x: &mut now,
                                before: &old,
                                moves: &mut moves,
                            });
                            let mut found = vec![[0.0; 3]; sheet.len()];
                            gather(layout, &now, [0.0; 3], &mut found);
                            for (n, (found, expected)) in found.iter().zip(&expected).enumerate() {
                                let apart =
                                    (0..3).map(|k| (f64::from(found[k]) - expected[k]).abs());
                                assert!(
                                    apart.fold(0.0, f64::max) < 1e-7,
                                    "{nodes:?} {damp:?} {weighed} {template} offset {} {width:?}: \
                                     node {n} at {found:?}, not {expected:?}",
                                    colour.offset
                                );
                            }
                        }
                    }
                }
            }
        }
    }
}
