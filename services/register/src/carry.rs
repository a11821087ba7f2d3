//! Carries mass and force from the components of the mixture to the control points.
//!
//! Components of one control cell are taken sixteen at a time, so that what they give to the
//! cell's four corners are sums over lanes.

use crate::basis::Corner;
use crate::blocks::{Blocks, fold};
use crate::expectation::Components;
use orime_lanes::{LANES, Lanes, Pass, Width};

/// Up to sixteen components of one control cell.
#[derive(Debug, Clone)]
struct Group {
    /// The cell's lowest corner, as [`Corner::base`].
    base: u32,
    places: [u32; LANES],
    /// Weights of the four corners, as [`Corner::weights`]; 0 in lanes that are left over.
    weights: [[f32; LANES]; 4],
}

/// All components, cell by cell.
#[derive(Debug, Clone)]
pub(crate) struct Carry {
    groups: Vec<Group>,
    stride: usize,
    width: Width,
}

/// Per control point, what pulls at it and how it is coupled to its neighbours.
#[derive(Debug, Clone, Default)]
pub(crate) struct Gathered {
    /// Coupling to the nine neighbours; row major, own place 4.
    pub stencil: Vec<[f64; 9]>,
    /// Σ weight·(target − start), metres.
    pub force: Vec<[f64; 3]>,
}

/// Place of corner `b` in the nine neighbours of corner `a`.
const PLACE: [[usize; 4]; 4] = [[4, 5, 7, 8], [3, 4, 6, 7], [1, 2, 4, 5], [0, 1, 3, 4]];

impl Gathered {
    /// Nothing, for so many control points.
    pub fn clear(&mut self, controls: usize) {
        self.stencil.clear();
        self.stencil.resize(controls, [0.0; 9]);
        self.force.clear();
        self.force.resize(controls, [0.0; 3]);
    }

    /// One material point with a weight and Σ weight·(target − start).
    pub fn add(&mut self, corner: Corner, stride: usize, mass: f64, force: [f64; 3]) {
        for (a, control) in corner.indices(stride).into_iter().enumerate() {
            let weight = f64::from(corner.weights[a]);
            for (sum, force) in self.force[control].iter_mut().zip(force) {
                *sum += weight * force;
            }
            for (place, other) in PLACE[a].into_iter().zip(corner.weights) {
                self.stencil[control][place] += weight * f64::from(other) * mass;
            }
        }
    }
}

impl Carry {
    /// `corners`: where each place of the blocks lies among the control points, whose rows are
    /// `stride` long.
    pub fn new(blocks: &Blocks, corners: &[Corner], stride: usize) -> Self {
        let mut places: Vec<u32> = (0..blocks.places() as u32).collect();
        places.retain(|place| blocks.is_present(*place as usize));
        places.sort_by_key(|place| corners[*place as usize].base);
        let base = |place: &u32| corners[*place as usize].base;
        let cells = places.chunk_by(|a, b| base(a) == base(b));
        let group = |some: &[u32]| {
            let mut group = Group {
                base: base(&some[0]),
                places: [some[0]; LANES],
                weights: [[0.0; LANES]; 4],
            };
            for (lane, place) in some.iter().enumerate() {
                group.places[lane] = *place;
                for (corner, weights) in group.weights.iter_mut().enumerate() {
                    weights[lane] = corners[*place as usize].weights[corner];
                }
            }
            group
        };
        let groups = cells.flat_map(|cell| cell.chunks(LANES).map(group)).collect();
        Self { groups, stride, width: Width::available()[0] }
    }

    /// Adds what the last E-step gave the components; `start_m`: where they were predicted.
    pub fn gather(
        &self,
        components: &Components,
        start_m: &[Vec<f32>; 3],
        gathered: &mut Gathered,
    ) {
        self.width.run(Gather { carry: self, components, start_m, gathered });
    }
}

struct Gather<'a> {
    carry: &'a Carry,
    components: &'a Components,
    start_m: &'a [Vec<f32>; 3],
    gathered: &'a mut Gathered,
}

impl Pass for Gather<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { carry, components, start_m, gathered } = self;
        for Group { base, places, weights } in &carry.groups {
            let mut mass = [0f32; LANES];
            let mut force = [[0f32; LANES]; 3];
            for (lane, place) in places.iter().enumerate() {
                let m = *place as usize;
                mass[lane] = components.mass[m];
                for (axis, force) in force.iter_mut().enumerate() {
                    let moved = components.at_m[axis][m] - start_m[axis][m];
                    force[lane] = components.pull_m[axis][m] + mass[lane] * moved;
                }
            }
            let base = *base as usize;
            let controls = [base, base + 1, base + carry.stride, base + carry.stride + 1];
            for a in 0..4 {
                for (sum, force) in gathered.force[controls[a]].iter_mut().zip(&force) {
                    *sum += product(&weights[a], force);
                }
                let mut share = [0f32; LANES];
                for lane in 0..LANES {
                    share[lane] = weights[a][lane] * mass[lane];
                }
                for b in a..4 {
                    let coupling = product(&weights[b], &share);
                    gathered.stencil[controls[a]][PLACE[a][b]] += coupling;
                    if a != b {
                        gathered.stencil[controls[b]][PLACE[b][a]] += coupling;
                    }
                }
            }
        }
    }
}

/// Σ a·b over the lanes, pairwise.
#[inline(always)]
fn product(a: &[f32; LANES], b: &[f32; LANES]) -> f64 {
    let mut products = [0f32; LANES];
    for lane in 0..LANES {
        products[lane] = a[lane] * b[lane];
    }
    f64::from(fold(&products, |a, b| a + b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::basis::corners;
    use orime_geometry::SheetGrid;

    #[test]
    fn groups_give_what_single_points_give() {
        // 19 × 13 components over 5 × 4 control points: cells and blocks do not fall together.
        let fine = SheetGrid::new([0.15, 0.1], [19, 13]);
        let blocks = Blocks::new(&fine);
        let all = corners([5, 4], fine.nodes);
        let corners: Vec<Corner> = blocks.components.iter().map(|c| all[*c as usize]).collect();
        let mut components = Components::new(blocks.places());
        let start_m = components.at_m.clone();
        let mut expected = Gathered::default();
        expected.clear(20);
        for m in (0..blocks.places()).filter(|m| blocks.is_present(*m)) {
            let k = m as f32;
            components.mass[m] = 1.0 + (0.3 * k).sin();
            let mut force = [0f64; 3];
            for (axis, force) in force.iter_mut().enumerate() {
                components.at_m[axis][m] = 0.001 * (k + axis as f32).cos();
                components.pull_m[axis][m] = 0.002 * (1.7 * k + axis as f32).sin();
                *force = f64::from(components.pull_m[axis][m])
                    + f64::from(components.mass[m]) * f64::from(components.at_m[axis][m]);
            }
            expected.add(corners[m], 4, f64::from(components.mass[m]), force);
        }
        let mut carry = Carry::new(&blocks, &corners, 4);
        for width in Width::available() {
            carry.width = width;
            let mut found = Gathered::default();
            found.clear(20);
            carry.gather(&components, &start_m, &mut found);
            for (found, expected) in found.stencil.iter().zip(&expected.stencil) {
                for (found, expected) in found.iter().zip(expected) {
                    assert!((found - expected).abs() < 1e-5 * expected.abs().max(1.0));
                }
            }
            for (found, expected) in found.force.iter().zip(&expected.force) {
                for (found, expected) in found.iter().zip(expected) {
                    assert!((found - expected).abs() < 1e-7, "{found} {expected}");
                }
            }
        }
        let mass: f64 = expected.stencil.iter().flatten().sum();
        assert!(mass > 100.0, "the weights of a component add up to one: {mass}");
    }
}
