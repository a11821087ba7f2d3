//! The paper's clustering: nodes as points (x, y, z, u, v), k-means under Mahalanobis distance.
//!
//! d² = (p − µ)ᵀ Wᵀ diag(λ₁, λ₂, S, S, S)⁻¹ W (p − µ), with Σ = Wᵀ Λ W of each cluster;
//! a cluster splits where √((λ₃ + λ₄ + λ₅)/(λ₁ + λ₂)) > R_div; after a split no other until the
//! nodes' third spatial variance is below R_fix ("fixed").
//!
//! Where the paper says nothing: a split starts from the best of several halvings of the cluster
//! (least λ₃ + λ₄ + λ₅ left); one split a step, the worst cluster first; a cluster that gets too
//! small goes to its neighbours; two clusters that were one flat sheet for a while are joined; at
//! most so many iterations a step, the rest in the next one. Hidden nodes weigh nothing and follow
//! the nearest cluster.

mod eigen;
mod facets;

use crate::folds::Folds;
use crate::params::{Lock, PaperParams};
use eigen::eigen;
use orime_geometry::SheetGrid;

/// Most clusters.
pub(crate) const CLUSTERS_MAX: usize = crate::folds::FACETS_MAX;
/// Directions in the plane of the two widest axes that a split may start from.
const STARTS: usize = 10;
/// Smallest cluster, as a share of the nodes, and in nodes.
const SMALLEST: (f64, f64) = (0.01, 6.0);
/// Clusters that together stay below this share of R_div for so many steps are joined.
const JOINED: (f64, u32) = (0.3, 20);
/// Facets are made anew once this share of the labels has changed.
const STALE: f64 = 0.02;

type Point = [f64; 5];

/// What is known of one cluster.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClusterFit {
    /// Σ weights of its nodes.
    pub weight: f64,
    /// √((λ₃ + λ₄ + λ₅)/(λ₁ + λ₂)), which R_div bounds.
    pub flatness: f64,
    /// Third spatial variance, m², which R_fix bounds.
    pub thickness_m2: f64,
    /// Whether it may not split until it is fixed.
    pub locked: bool,
}

#[derive(Debug, Clone, Copy)]
struct Sums {
    weight: f64,
    first: Point,
    second: [Point; 5],
}

impl Sums {
    const NONE: Self = Self { weight: 0.0, first: [0.0; 5], second: [[0.0; 5]; 5] };

    fn add(&mut self, p: &Point, weight: f64) {
        self.weight += weight;
        for i in 0..5 {
            self.first[i] += weight * p[i];
            for j in 0..=i {
                self.second[i][j] += weight * p[i] * p[j];
            }
        }
    }

    fn plus(&self, other: &Self) -> Self {
        let mut sum = *self;
        sum.weight += other.weight;
        for i in 0..5 {
            sum.first[i] += other.first[i];
            for j in 0..=i {
                sum.second[i][j] += other.second[i][j];
            }
        }
        sum
    }

    fn mean(&self) -> Point {
        self.first.map(|f| f / self.weight.max(1e-12))
    }

    fn covariance<const N: usize>(&self) -> [[f64; N]; N] {
        let (mean, weight) = (self.mean(), self.weight.max(1e-12));
        let at = |i: usize, j: usize| self.second[i.max(j)][i.min(j)] / weight - mean[i] * mean[j];
        std::array::from_fn(|i| std::array::from_fn(|j| at(i, j)))
    }

    fn flatness(&self) -> f64 {
        let (l, _) = eigen(self.covariance::<5>());
        ((l[2] + l[3] + l[4]).max(0.0) / (l[0] + l[1]).max(1e-12)).sqrt()
    }

    fn thickness_m2(&self) -> f64 {
        eigen(self.covariance::<3>()).0[2].max(0.0)
    }
}

/// A cluster's distance: mean and Σ⁻¹ with the small variances replaced by S.
#[derive(Debug, Clone, Copy)]
struct Metric {
    mean: Point,
    inverse: [Point; 5],
}

impl Metric {
    fn new(sums: &Sums, s_m2: f64) -> Self {
        let (values, axes) = eigen(sums.covariance::<5>());
        let mut inverse = [[0.0; 5]; 5];
        for (k, axis) in axes.iter().enumerate() {
            let variance = if k < 2 { values[k].max(1e-12) } else { s_m2 };
            for i in 0..5 {
                for j in 0..5 {
                    inverse[i][j] += axis[i] * axis[j] / variance;
                }
            }
        }
        Self { mean: sums.mean(), inverse }
    }

    fn squared(&self, p: &Point) -> f64 {
        let d: Point = std::array::from_fn(|k| p[k] - self.mean[k]);
        (0..5).map(|i| d[i] * (0..5).map(|j| self.inverse[i][j] * d[j]).sum::<f64>()).sum()
    }
}

/// Clusters a sheet's nodes.
#[derive(Debug, Clone)]
pub(crate) struct Clustering {
    params: PaperParams,
    points: Vec<Point>,
    weight: Vec<f64>,
    /// Cluster of every node.
    pub labels: Vec<u8>,
    /// How good each cluster is.
    pub fits: Vec<ClusterFit>,
    sums: Vec<Sums>,
    locked: Vec<bool>,
    flat_steps: Vec<u32>,
    trial: [Vec<bool>; 2],
    shown: Vec<u8>,
}

impl Clustering {
    pub fn new(params: &PaperParams, sheet: &SheetGrid) -> Self {
        let mut clustering = Self {
            params: params.clone(),
            points: sheet.uv_m().map(|[u, v]| [0.0, 0.0, 0.0, u, v]).collect(),
            weight: vec![0.0; sheet.len()],
            labels: vec![0; sheet.len()],
            fits: Vec::with_capacity(CLUSTERS_MAX),
            sums: Vec::with_capacity(CLUSTERS_MAX),
            locked: Vec::with_capacity(CLUSTERS_MAX),
            flat_steps: vec![0; CLUSTERS_MAX * CLUSTERS_MAX],
            trial: [vec![false; sheet.len()], vec![false; sheet.len()]],
            shown: vec![0; sheet.len()],
        };
        clustering.reset();
        clustering
    }

    /// One cluster again.
    pub fn reset(&mut self) {
        self.labels.fill(0);
        self.shown.fill(0);
        self.locked.clear();
        self.locked.push(false);
        self.flat_steps.fill(0);
    }

    /// Takes in one step; true where the folds changed.
    pub fn step(
        &mut self,
        folds: &mut Folds,
        positions_m: &[[f32; 3]],
        confidence: &[f32],
    ) -> bool {
        self.read(positions_m, confidence);
        self.iterate();
        self.unlock();
        if let Some(cluster) = self.to_split() {
            self.split(cluster);
        }
        self.join();
        self.report();
        let changed = self.labels.iter().zip(&self.shown).filter(|(a, b)| a != b).count();
        if changed as f64 <= STALE * self.labels.len() as f64 {
            return false;
        }
        self.shown.copy_from_slice(&self.labels);
        facets::show(folds, &self.labels);
        true
    }

    fn read(&mut self, positions_m: &[[f32; 3]], confidence: &[f32]) {
        for (n, point) in self.points.iter_mut().enumerate() {
            let x = positions_m.get(n).copied().unwrap_or([f32::NAN; 3]);
            let sure = f64::from(confidence.get(n).copied().unwrap_or(1.0));
            let finite = x.iter().all(|c| c.is_finite()) && sure.is_finite();
            self.weight[n] = if finite { sure.clamp(0.0, 1.0) } else { 0.0 };
            for k in 0..3 {
                point[k] = if finite { f64::from(x[k]) } else { f64::NAN };
            }
        }
    }

    fn sum(&mut self) {
        self.sums.clear();
        self.sums.resize(self.locked.len(), Sums::NONE);
        for ((p, weight), label) in self.points.iter().zip(&self.weight).zip(&self.labels) {
            if *weight > 0.0 {
                self.sums[usize::from(*label)].add(p, *weight);
            }
        }
    }

    /// k-means, at most so many iterations.
    fn iterate(&mut self) {
        self.sum();
        for _ in 0..self.params.iterations {
            self.drop_small();
            if self.locked.len() < 2 {
                return;
            }
            let mut metrics = [Metric { mean: [0.0; 5], inverse: [[0.0; 5]; 5] }; CLUSTERS_MAX];
            for (metric, sums) in metrics.iter_mut().zip(&self.sums) {
                *metric = Metric::new(sums, self.params.s_m2);
            }
            let metrics = &metrics[..self.sums.len()];
            let mut changed = false;
            for (p, label) in self.points.iter().zip(&mut self.labels) {
                if p[0].is_nan() {
                    continue;
                }
                let mut best = (f64::INFINITY, *label);
                for (k, metric) in metrics.iter().enumerate() {
                    let squared = metric.squared(p);
                    if squared < best.0 {
                        best = (squared, k as u8);
                    }
                }
                changed |= *label != best.1;
                *label = best.1;
            }
            self.sum();
            if !changed {
                break;
            }
        }
        self.drop_small();
    }

    /// Gives clusters that are too small to their neighbours in (u, v).
    fn drop_small(&mut self) {
        let least = SMALLEST.1.max(SMALLEST.0 * self.labels.len() as f64);
        while self.locked.len() > 1 {
            let Some(small) = self.sums.iter().position(|s| s.weight < least) else { return };
            for n in 0..self.labels.len() {
                if usize::from(self.labels[n]) == small {
                    self.labels[n] = self.nearest_other(n, small);
                }
            }
            self.remove(small);
            self.sum();
        }
    }

    fn nearest_other(&self, n: usize, small: usize) -> u8 {
        let [_, _, _, u, v] = self.points[n];
        let distance = |m: &usize| (self.points[*m][3] - u).hypot(self.points[*m][4] - v);
        (0..self.labels.len())
            .filter(|m| usize::from(self.labels[*m]) != small)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .map_or(0, |m| self.labels[m])
    }

    /// Takes an empty cluster's number away; the last one gets it.
    fn remove(&mut self, cluster: usize) {
        let last = self.locked.len() - 1;
        for label in &mut self.labels {
            if usize::from(*label) == last {
                *label = cluster as u8;
            }
        }
        self.locked.swap_remove(cluster);
        self.flat_steps.fill(0);
    }

    fn unlock(&mut self) {
        let fixed_m2 = self.params.r_fix_m2;
        match self.params.lock {
            Lock::None => self.locked.fill(false),
            Lock::Cluster => {
                for (locked, sums) in self.locked.iter_mut().zip(&self.sums) {
                    *locked &= sums.thickness_m2() >= fixed_m2;
                }
            }
            Lock::Global => {
                let all = self.sums.iter().fold(Sums::NONE, |all, sums| all.plus(sums));
                if all.thickness_m2() < fixed_m2 {
                    self.locked.fill(false);
                }
            }
        }
    }

    /// The cluster that is least flat, where it may split.
    fn to_split(&self) -> Option<usize> {
        let any = self.locked.iter().any(|locked| *locked);
        if self.locked.len() == CLUSTERS_MAX || (any && self.params.lock == Lock::Global) {
            return None;
        }
        let free = (0..self.locked.len()).filter(|k| !self.locked[*k]);
        let worst = free.map(|k| (k, self.sums[k].flatness()));
        let worst = worst.max_by(|a, b| a.1.total_cmp(&b.1))?;
        (worst.1 > self.params.r_div).then_some(worst.0)
    }

    /// Halves a cluster: several starts, two-means from each, the flattest halves win.
    fn split(&mut self, cluster: usize) {
        let (_, axes) = eigen(self.sums[cluster].covariance::<5>());
        let mean = self.sums[cluster].mean();
        let mut best = f64::INFINITY;
        for start in 0..STARTS {
            let (sin, cos) = (std::f64::consts::PI * start as f64 / STARTS as f64).sin_cos();
            for n in 0..self.labels.len() {
                let p = &self.points[n];
                let side: f64 =
                    (0..5).map(|k| (p[k] - mean[k]) * (cos * axes[0][k] + sin * axes[1][k])).sum();
                self.trial[0][n] = side > 0.0;
            }
            let left = self.two_means(cluster);
            if left < best {
                best = left;
                let [trial, kept] = &mut self.trial;
                kept.copy_from_slice(trial);
            }
        }
        if best.is_finite() {
            let new = self.locked.len();
            self.locked.push(true);
            self.locked[cluster] = true;
            for (label, moved) in self.labels.iter_mut().zip(&self.trial[1]) {
                if usize::from(*label) == cluster && *moved {
                    *label = new as u8;
                }
            }
            self.iterate();
        }
    }

    /// Two-means within a cluster from the trial's halves; what they leave out of their planes.
    fn two_means(&mut self, cluster: usize) -> f64 {
        for iteration in 0..=self.params.iterations {
            let mut halves = [Sums::NONE; 2];
            for n in 0..self.labels.len() {
                if usize::from(self.labels[n]) == cluster && self.weight[n] > 0.0 {
                    halves[usize::from(self.trial[0][n])].add(&self.points[n], self.weight[n]);
                }
            }
            let least = SMALLEST.1.max(SMALLEST.0 * self.labels.len() as f64);
            if halves.iter().any(|half| half.weight < least) {
                return f64::INFINITY;
            }
            let metrics = halves.map(|half| Metric::new(&half, self.params.s_m2));
            let mut changed = false;
            for n in 0..self.labels.len() {
                if usize::from(self.labels[n]) == cluster && !self.points[n][0].is_nan() {
                    let [a, b] = [0, 1].map(|k| metrics[k].squared(&self.points[n]));
                    changed |= self.trial[0][n] != (b < a);
                    self.trial[0][n] = b < a;
                }
            }
            if !changed || iteration == self.params.iterations {
                let left = halves.map(|half| {
                    let (l, _) = eigen(half.covariance::<5>());
                    half.weight * (l[2] + l[3] + l[4])
                });
                return left[0] + left[1];
            }
        }
        f64::INFINITY
    }

    /// Joins two clusters that have been one flat sheet for a while.
    fn join(&mut self) {
        let count = self.locked.len();
        for a in 0..count {
            for b in a + 1..count {
                let steps = &mut self.flat_steps[a * CLUSTERS_MAX + b];
                let flat = self.sums[a].plus(&self.sums[b]).flatness();
                *steps = if flat < JOINED.0 * self.params.r_div { *steps + 1 } else { 0 };
                if *steps >= JOINED.1 {
                    self.labels
                        .iter_mut()
                        .filter(|l| usize::from(**l) == b)
                        .for_each(|l| *l = a as u8);
                    self.remove(b);
                    self.sum();
                    return;
                }
            }
        }
    }

    fn report(&mut self) {
        self.fits.clear();
        self.fits.extend(self.sums.iter().zip(&self.locked).map(|(sums, locked)| ClusterFit {
            weight: sums.weight,
            flatness: sums.flatness(),
            thickness_m2: sums.thickness_m2(),
            locked: *locked,
        }));
    }
}
