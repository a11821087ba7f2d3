//! Bending as a thin plate: hinges between neighbouring cells, and every cell's twist. GPU twin:
//! `flatten` in `gpu/plate.wgsl`.
//!
//! Bergou's isometric bending (A Quadratic Bending Model for Inextensible Surfaces, 2006) on a
//! grid: as long as lengths are kept, the energy of the dihedral angles is quadratic in the
//! positions, so that a hinge needs no angle, knows no degenerate area and cannot wrap around.
//!
//! ```text
//! along u, v:  C = x₁ − 2x₂ + x₃,       k = D·A/h⁴         at every node with two neighbours
//! twist:       C = x₁ − x₂ − x₃ + x₄,   k = 2·D·A/(hᵤhᵥ)²  in every cell
//! E = ½ k |C|²,   x_i ← x_i − w_i c_i C / (Σ c²w + α̃),   α̃ = 1/(k dt²)
//! ```
//!
//! D is the sheet's flexural rigidity, A a node's area. Σ c = 0 and Σ c x = C ∥ the moves, so that
//! nothing is pushed or turned as a whole. Masses stand in units of a node's ordinary mass (w = 1).
//! Deviations: each hinge is solved on its own (XPBD), and a template bends back to flat.

use crate::solver::links::LinkChunk;
use orime_geometry::SheetGrid;
use orime_lanes::{Field, Layout};
use orime_lanes::{LANES, Lanes, Pass, load_points, plus, store_points, times};

/// Nodes of a hinge or a twist; three have their last one in the middle again.
const POINTS: usize = 4;

/// Hinges of one direction, or twists, that share no node.
#[derive(Debug, Clone)]
pub(crate) struct Stencils {
    /// From the first node to each, in numbers of a field.
    offsets: [usize; POINTS],
    /// c; 0 for one that is not there.
    pub factors: [f32; POINTS],
    /// Stiffness for a rigidity of 1 N·m, 1/m².
    stiffness_per_m2: f64,
    /// Vectors of stencils, by growing first node.
    chunks: Vec<LinkChunk>,
}

impl Stencils {
    /// Stencils that act.
    pub fn count(&self) -> usize {
        self.chunks.iter().map(|chunk| chunk.bits.count_ones() as usize).sum()
    }

    /// The places of those that act.
    #[cfg(feature = "gpu")]
    pub fn acting(&self) -> impl Iterator<Item = [usize; POINTS]> {
        self.chunks.iter().flat_map(|chunk| {
            let acting = (0..LANES).filter(|lane| chunk.bits >> lane & 1 == 1);
            acting.map(|lane| self.offsets.map(|offset| chunk.first as usize + lane + offset))
        })
    }

    /// Bytes that they take.
    pub fn bytes(&self) -> usize {
        self.chunks.len() * size_of::<LinkChunk>()
    }

    /// Lets those give way whose nodes no facet holds all: a crease lies between them.
    pub fn cross(&mut self, facets_of_place: &[u32]) {
        let used = || (0..POINTS).filter(|k| self.factors[*k] != 0.0).map(|k| self.offsets[k]);
        for chunk in &mut self.chunks {
            let holds = |lane: &usize| {
                let first = chunk.first as usize + lane;
                used().fold(u32::MAX, |all, offset| all & facets_of_place[first + offset]) != 0
            };
            let there = (0..LANES).filter(|lane| chunk.all >> lane & 1 == 1);
            chunk.bits = there.filter(holds).fold(0, |bits, lane| bits | 1 << lane);
        }
    }

    /// α̃ in units of an ordinary node's inverse mass, for a rigidity in N·m.
    pub fn alpha(&self, rigidity_n_m: f64, inverse_mass_per_kg: f32, dt_s: f32) -> f32 {
        let stiffness_n_per_m = (rigidity_n_m * self.stiffness_per_m2) as f32;
        1.0 / (stiffness_n_per_m * dt_s * dt_s * inverse_mass_per_kg)
    }
}

/// All hinges and twists of a sheet, in colours.
pub(crate) fn plate(sheet: &SheetGrid) -> Vec<Stencils> {
    let stride = Layout::new(sheet).stride;
    let [h_u, h_v] = sheet.spacing_m();
    let area_m2 = sheet.size_m[0] * sheet.size_m[1] / sheet.len() as f64;
    let along = |step: usize, h_m: f64| Stencils {
        offsets: [0, step, 2 * step, step],
        factors: [1.0, -2.0, 1.0, 0.0],
        stiffness_per_m2: area_m2 / h_m.powi(4),
        chunks: Vec::new(),
    };
    let twist = Stencils {
        offsets: [0, 1, stride, stride + 1],
        factors: [1.0, -1.0, -1.0, 1.0],
        stiffness_per_m2: 2.0 * area_m2 / (h_u * h_v).powi(2),
        chunks: Vec::new(),
    };
    // How far a stencil reaches along u and v, and in how many colours none shares a node.
    let kinds = [(along(stride, h_u), [2, 0]), (along(1, h_v), [0, 2]), (twist, [1, 1])];
    let mut all = Vec::new();
    for (stencils, reach) in kinds {
        for phase in 0..(reach[0] + 1) * (reach[1] + 1) {
            let phase = [phase % (reach[0] + 1), phase / (reach[0] + 1)];
            let chunks = chunks(sheet, reach, phase);
            all.push(Stencils { chunks, ..stencils.clone() });
        }
    }
    all.retain(|stencils| !stencils.chunks.is_empty());
    all
}

/// The vectors of stencils that begin at nodes of this phase.
fn chunks(sheet: &SheetGrid, reach: [usize; 2], phase: [usize; 2]) -> Vec<LinkChunk> {
    let layout = Layout::new(sheet);
    let begins = |at: [usize; 2]| {
        (0..2).all(|k| at[k] + reach[k] < layout.nodes[k] && at[k] % (reach[k] + 1) == phase[k])
    };
    let chunk = |first: usize| {
        let (i, j) = (first / layout.stride, first % layout.stride);
        let bits = (0..LANES).fold(0, |bits, k| bits | u16::from(begins([i, j + k])) << k);
        LinkChunk { first: first as u32, bits, all: bits }
    };
    let all = (0..layout.size()).step_by(LANES).map(chunk);
    all.filter(|chunk| chunk.all != 0).collect()
}

/// Projects the stencils of one colour.
pub(crate) struct Flatten<'a> {
    /// The stencils.
    pub stencils: &'a Stencils,
    /// α̃.
    pub alpha: f32,
    /// Inverse masses, where not all are 1.
    pub weights: Option<&'a Field>,
    /// Positions, metres.
    pub x: &'a mut [Field; 3],
}

impl Pass for Flatten<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { stencils, alpha, weights, x } = self;
        let room = x[0].rows().len();
        let reach = stencils.offsets.into_iter().fold(0, usize::max) + LANES;
        let last = stencils.chunks.last().map_or(0, |chunk| chunk.first as usize);
        assert!(last + reach <= room, "the last stencil lies within the fields");
        let x = x.each_mut().map(|field| field.rows_mut().as_mut_ptr());
        let now = [x[0].cast_const(), x[1].cast_const(), x[2].cast_const()];
        let weight = weights.map(|field| &field.rows()[..room]);
        for chunk in &stencils.chunks {
            let mut c = [V::splat(0.0); 3];
            let mut sum = V::splat(alpha);
            let mut mobile = [V::splat(1.0); POINTS];
            for (k, mobile) in mobile.iter_mut().enumerate() {
                let at = chunk.first as usize + stencils.offsets[k];
                let factor = V::splat(stencils.factors[k]);
                // SAFETY: sixteen numbers from `at` on lie within the fields (asserted above).
                unsafe {
                    c = plus(c, times(load_points::<V>(now, at), factor));
                    if let Some(weight) = weight {
                        *mobile = V::load(weight.as_ptr().add(at));
                    }
                }
                sum = sum.add(factor.mul(factor).mul(*mobile));
            }
            // Where all are pinned and nothing gives, there is nothing to share.
            let moves = sum.above(V::splat(0.0)) & chunk.bits;
            let share = V::splat(-1.0).div(sum).keep(moves);
            for (k, mobile) in mobile.into_iter().enumerate() {
                let at = chunk.first as usize + stencils.offsets[k];
                let way = times(c, share.mul(V::splat(stencils.factors[k])).mul(mobile));
                // SAFETY: as above. Vectors of one stencil may overlap: one after the other.
                unsafe { store_points(plus(load_points::<V>(now, at), way), x, at) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::links::facets_of_place;
    use orime_creases::{Folds, Line};
    use orime_lanes::Width;
    use orime_lanes::{gather, scatter};

    const ALPHA: f32 = 0.3;

    type Nodes = Vec<[f32; 3]>;

    /// A sheet turned about a slanted axis, and bent out of its plane by a height.
    fn bent(sheet: &SheetGrid, height_m: f32) -> Vec<[f32; 3]> {
        let (sine, cosine) = 0.7f32.sin_cos();
        let place = |(n, x): (usize, &[f32; 3])| {
            let z = height_m * (0.8 * n as f32).sin();
            let [x, y] = [x[0] * cosine - x[1] * sine, x[0] * sine + x[1] * cosine];
            [x, 0.6 * y - 0.8 * z, 0.8 * y + 0.6 * z]
        };
        sheet.flat_m().iter().enumerate().map(place).collect()
    }

    fn project(sheet: &SheetGrid, x: &[[f32; 3]], weights: Option<&[f32]>, width: Width) -> Nodes {
        let layout = Layout::new(sheet);
        let (mut now, mut field) = (layout.fields(), layout.field());
        scatter(layout, x, &mut now);
        for (place, weight) in layout.places().zip(weights.unwrap_or_default()) {
            field.rows_mut()[place] = *weight;
        }
        for stencils in &plate(sheet) {
            let weights = weights.map(|_| &field);
            width.run(Flatten { stencils, alpha: ALPHA, weights, x: &mut now });
        }
        let mut found = x.to_vec();
        gather(layout, &now, [0.0; 3], &mut found);
        found
    }

    /// The module's equations, hinge by hinge and twist by twist, in f64.
    fn by_the_book(sheet: &SheetGrid, x: &[[f32; 3]], weights: &[f32]) -> Vec<[f64; 3]> {
        let [n_u, n_v] = sheet.nodes;
        let mut x: Vec<[f64; 3]> = x.iter().map(|x| x.map(f64::from)).collect();
        let mut solve = |points: &[([usize; 2], f64)]| {
            let at = |[i, j]: [usize; 2]| i * n_v + j;
            let w = |p: [usize; 2]| f64::from(weights[at(p)]);
            let sum: f64 = points.iter().map(|(p, c)| c * c * w(*p)).sum();
            let c = [0, 1, 2].map(|axis| points.iter().map(|(p, c)| c * x[at(*p)][axis]).sum());
            for (p, factor) in points {
                for (x, c) in x[at(*p)].iter_mut().zip::<[f64; 3]>(c) {
                    *x -= w(*p) * factor * c / (sum + f64::from(ALPHA));
                }
            }
        };
        for phase in 0..3 {
            for i in (phase..n_u - 2).step_by(3) {
                (0..n_v)
                    .for_each(|j| solve(&[([i, j], 1.0), ([i + 1, j], -2.0), ([i + 2, j], 1.0)]));
            }
        }
        for phase in 0..3 {
            for j in (phase..n_v - 2).step_by(3) {
                (0..n_u)
                    .for_each(|i| solve(&[([i, j], 1.0), ([i, j + 1], -2.0), ([i, j + 2], 1.0)]));
            }
        }
        for phase in 0..4 {
            for i in (phase % 2..n_u - 1).step_by(2) {
                for j in (phase / 2..n_v - 1).step_by(2) {
                    let corners = [[i, j], [i, j + 1], [i + 1, j], [i + 1, j + 1]];
                    let signs = [1.0, -1.0, -1.0, 1.0];
                    solve(&[0, 1, 2, 3].map(|k| (corners[k], signs[k])));
                }
            }
        }
        x
    }

    #[test]
    fn hinges_and_twists_are_the_equations_at_every_width() {
        for nodes in [[25, 25], [7, 5], [4, 40], [2, 2]] {
            let sheet = SheetGrid::new([0.15, 0.15], nodes);
            let x = bent(&sheet, 0.004);
            let masses: Vec<f32> = (0..x.len()).map(|n| [1.0, 0.0, 1e-3, 2.0][n % 4]).collect();
            let even = vec![1.0; x.len()];
            for weights in [None, Some(&masses[..])] {
                let expected = by_the_book(&sheet, &x, weights.unwrap_or(&even));
                let portable = project(&sheet, &x, weights, Width::Portable);
                for (found, expected) in portable.iter().zip(&expected) {
                    let apart = (0..3).map(|k| (f64::from(found[k]) - expected[k]).abs());
                    assert!(apart.fold(0.0, f64::max) < 1e-7, "{nodes:?}: {found:?} {expected:?}");
                }
                for width in Width::available() {
                    assert_eq!(project(&sheet, &x, weights, width), portable, "{width:?}");
                }
            }
        }
    }

    #[test]
    fn what_is_flat_stays_and_nothing_is_pushed_or_turned_as_a_whole() {
        let sheet = SheetGrid::new([0.15, 0.2], [13, 21]);
        let moved_m = |before: &Nodes, after: &Nodes| {
            let each = before.iter().flatten().zip(after.iter().flatten());
            each.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
        };
        let flat = bent(&sheet, 0.0);
        assert!(moved_m(&flat, &project(&sheet, &flat, None, Width::Portable)) < 1e-7);
        let before = bent(&sheet, 0.004);
        let after = project(&sheet, &before, None, Width::Portable);
        assert!(moved_m(&before, &after) > 1e-3);
        let each = || before.iter().zip(&after).map(|(a, b)| [a, b].map(|x| x.map(f64::from)));
        for axis in 0..3 {
            let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
            let pushed_m: f64 = each().map(|[a, b]| b[axis] - a[axis]).sum();
            let turned_m2: f64 =
                each().map(|[a, b]| a[j] * (b[k] - a[k]) - a[k] * (b[j] - a[j])).sum();
            assert!(
                pushed_m.abs() < 1e-6 && turned_m2.abs() < 1e-7,
                "{pushed_m} m, {turned_m2} m²"
            );
        }
    }

    #[test]
    fn hinges_give_way_to_creases() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let count = |stencils: &[Stencils]| stencils.iter().map(Stencils::count).sum::<usize>();
        let mut stencils = plate(&sheet);
        assert_eq!(count(&stencils), 2 * 23 * 25 + 24 * 24);
        for (u_m, given_up) in [(0.075, 25), (0.078, 2 * 25 + 24)] {
            let mut folds = Folds::flat(&sheet);
            folds.split(0, &Line::through([u_m, 0.0], [u_m, 0.15])).unwrap();
            let facets = facets_of_place(Layout::new(&sheet), &folds);
            stencils.iter_mut().for_each(|stencils| stencils.cross(&facets));
            assert_eq!(count(&stencils), 2 * 23 * 25 + 24 * 24 - given_up, "u = {u_m} m");
        }
    }
}
