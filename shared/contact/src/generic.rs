//! Contact without knowledge of folds: node against triangle, edge against edge.
//!
//! ```text
//! begin_step(x°)     x° is free of crossings
//! project(x)         pairs nearer than the thickness part along their offset at x°, with friction
//! truncate(x°, x)    the net: no pair passes through itself on the straight way from x° to x, once
//!   x° has been carried along with the best rigid motion between the two
//!   pairs whose ways come near; for each the share of its way that is proven free (pair.rs)
//!   where that is not all, its four nodes go on with their mean motion and that share of their own
//!   what still fails after some rounds: everyone goes the smallest share of the way
//! ```
//!
//! The last line always holds: shortening all ways by one factor makes no new meeting. Distances
//! never fall below a fifth of what they were, and nothing within a micrometre comes nearer, so
//! that the rounding of f32 stays outside. No pair is ever dropped.
//!
//! Source: `../shared/design/simulate.md`, "Contact, second round".

mod cells;
mod pair;
mod parted;
mod truncate;
mod untangle;

use crate::mesh::Mesh;
use crate::params::{ContactConfig, ContactParams};
use crate::push::weighted_push;
use cells::{Boxes, Cells, Parts};
use nalgebra::{Point3, Vector3};
use orime_geometry::SheetGrid;
use pair::Pair;
use parted::Quads;
pub use truncate::NetReport;
pub use untangle::UntangleReport;

/// A pair may part by this share of the thickness per projection.
const PART: f64 = 0.2;

/// What [`GenericContact::project`] did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GenericReport {
    /// Pairs that were nearer than the thickness.
    pub pairs: u32,
    /// How many of them were pushed.
    pub pushed: u32,
}

/// Keeps a sheet from passing through itself, whatever its shape.
#[derive(Debug, Clone)]
pub struct GenericContact {
    params: ContactParams,
    mesh: Mesh,
    parts: Parts,
    cells: Cells,
    boxes: Boxes,
    quads: Quads,
    mobility: Vec<f64>,
    origin_m: Vector3<f64>,
    from: Vec<Vector3<f64>>,
    to: Vec<Vector3<f64>>,
    /// The same, for the rigid motion between them.
    carried: [Vec<Point3<f64>>; 2],
    pairs: Vec<Pair>,
    /// When the net moved each node last, in pairs gone through.
    blended_at: Vec<u32>,
    /// What the net last let through: known to be free of crossings.
    proven_m: Vec<[f32; 3]>,
}

impl GenericContact {
    /// For a sheet of this grid.
    pub fn new(config: &ContactConfig, sheet: &SheetGrid) -> Self {
        let mesh = Mesh::new(sheet);
        let count = sheet.len();
        Self {
            params: config.params.clone(),
            parts: Parts::new(&mesh),
            cells: Cells::new(&mesh),
            boxes: Boxes::new(&mesh),
            quads: Quads::new(&mesh),
            mobility: vec![1.0; count],
            origin_m: Vector3::zeros(),
            from: vec![Vector3::zeros(); count],
            to: vec![Vector3::zeros(); count],
            carried: [Vec::with_capacity(count), Vec::with_capacity(count)],
            pairs: Vec::with_capacity(16 * count),
            blended_at: vec![0; count],
            proven_m: vec![[f32::NAN; 3]; count],
            mesh,
        }
    }

    /// Inverse masses, relative to each other; 0 holds a node. All 1 at first.
    pub fn set_mobility(&mut self, mobility: &[f32]) {
        for (own, mobility) in self.mobility.iter_mut().zip(mobility) {
            let usable = mobility.is_finite() && *mobility >= 0.0;
            *own = if usable { f64::from(*mobility) } else { 0.0 };
        }
    }

    /// Takes over where the step begins, metres.
    pub fn begin_step(&mut self, from_m: &[[f32; 3]]) {
        assert_eq!(from_m.len(), self.from.len(), "one position per node");
        self.origin_m = Vector3::from(from_m[0]).cast();
        load(&mut self.from, from_m, &self.origin_m);
    }

    /// Parts pairs that are nearer than the thickness, on the sides that they had when the step
    /// began. One sweep: call it among the sweeps over links.
    pub fn project(&mut self, x_m: &mut [[f32; 3]]) -> GenericReport {
        let mut report = GenericReport::default();
        if !is_usable(x_m, self.from.len()) {
            return report;
        }
        load(&mut self.to, x_m, &self.origin_m);
        self.list_pairs(self.params.thickness_m);
        for at in 0..self.pairs.len() {
            let pair = self.pairs[at];
            let nearest = pair.nearest(&pair.nodes.map(|n| self.from[n as usize]));
            if nearest.distance_m <= 0.0 {
                continue;
            }
            report.pairs += 1;
            let thickness_m = self.params.thickness_m;
            let gap_m = thickness_m.min(nearest.distance_m + PART * thickness_m);
            let normal = nearest.offset / nearest.distance_m;
            report.pushed += u32::from(self.part(&pair, &nearest.weights, &normal, gap_m));
        }
        if report.pushed > 0 {
            store(x_m, &self.to, &self.origin_m);
        }
        report
    }

    /// Pushes a pair apart and lets friction hold it. Whether it was too near.
    fn part(&mut self, pair: &Pair, weights: &[f64; 4], normal: &Vector3<f64>, gap_m: f64) -> bool {
        let terms = || pair.nodes.iter().zip(weights);
        let offset: Vector3<f64> = terms().map(|(n, w)| self.to[*n as usize] * *w).sum();
        let short_m = gap_m - offset.dot(normal);
        if short_m <= 0.0 {
            return false;
        }
        let slid: Vector3<f64> =
            terms().map(|(n, w)| (self.to[*n as usize] - self.from[*n as usize]) * *w).sum();
        let slid = slid - normal * slid.dot(normal);
        let held_m = (self.params.friction * short_m).min(slid.norm());
        let hold = slid.try_normalize(1e-12).unwrap_or_else(Vector3::zeros) * held_m;
        weighted_push(&mut self.to, &self.mobility, &pair.nodes, weights, normal * short_m - hold);
        true
    }

    /// Fills `pairs` with those that come nearer than `reach_m` between `from` and `to`.
    fn list_pairs(&mut self, reach_m: f64) {
        let Self { mesh, parts, cells, boxes, from, to, pairs, .. } = self;
        cells.find(mesh, from, to, reach_m);
        boxes.fill(mesh, from, to, 0.5 * reach_m);
        pairs.clear();
        for near in &cells.near {
            parts.pairs(mesh, boxes, *near, |pair| pairs.push(pair));
        }
        pairs.sort_unstable();
    }
}

fn is_usable(x_m: &[[f32; 3]], count: usize) -> bool {
    x_m.len() == count && x_m.iter().flatten().all(|c| c.is_finite())
}

fn load(own: &mut [Vector3<f64>], x_m: &[[f32; 3]], origin_m: &Vector3<f64>) {
    for (own, x) in own.iter_mut().zip(x_m) {
        *own = Vector3::from(*x).cast::<f64>() - origin_m;
    }
}

fn store(x_m: &mut [[f32; 3]], own: &[Vector3<f64>], origin_m: &Vector3<f64>) {
    for (own, x) in own.iter().zip(x_m) {
        *x = (own + origin_m).cast::<f32>().into();
    }
}
