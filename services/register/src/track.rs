//! One frame of Coherent Point Drift, from the prediction onto the cloud.
//!
//! Per iteration, with Y the prediction, V its virtual nodes, Q Λ Qᵀ the kernel on the control
//! points, B the interpolation from control points to virtual nodes, and t the tempering:
//!
//! ```text
//! E:  p[m,n] = exp(−|x[n]−v[m]|²/2σ²) / (Σ_k exp(−|x[n]−v[k]|²/2σ²) + c)
//! W:  Y ← Y moved as one rigid body (`whole.rs`)
//! M:  (t·(BQ)ᵀ D (BQ) + λσ²Λ⁻¹) C = t·(BQ)ᵀ (P X − D V₀),   D = diag(Σ_n p),   λ = 1/τ²
//!     T = Y + (B Q C on the nodes), then isometry sweeps on T
//! σ² = Σ p·|x − v|² / 3 N_p from the projected virtual nodes
//! ```
//!
//! Source: Myronenko & Song, IEEE TPAMI 32(12), 2010. Deviations, all measured in
//! `../shared/design/register.md`: virtual nodes, a low-rank kernel in (u,v), tempering, the
//! isometry projection, σ² started warm and floored, the outlier weight estimated. And W, which
//! `docs/results.md` measures.

use crate::basis::{Basis, Corner, Equations, Expand, Reduce, corners};
use crate::blend::Blender;
use crate::carry::{Carry, Gathered};
use crate::cloud::{Cloud, bounds};
use crate::isometry::Isometry;
use crate::mixture::{Answer, Asked, Mixture};
use crate::outline::Outline;
use crate::params::RegisterParams;
use crate::visibility::Visibility;
use crate::whole::Whole;
use nalgebra::{DMatrix, DVector};
use orime_creases::Folds;
use orime_geometry::{RgbdCamera, SheetGrid};
use orime_lanes::Width;

/// Why the iterations ended. Running out of them is a result, not an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Termination {
    /// The cloud gave nothing to move for: the prediction is returned as it was.
    #[default]
    NothingObserved = 0,
    /// No node moved farther than the tolerance.
    Converged = 1,
    /// The limit of iterations was reached.
    IterationLimit = 2,
    /// The caller's time was up.
    Deadline = 3,
}

/// How much work may go into a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Points used at most.
    pub points_max: usize,
    /// Iterations at most.
    pub iterations_max: u32,
}

impl Effort {
    /// As the parameters say.
    pub(crate) fn full(params: &RegisterParams) -> Self {
        Self { points_max: params.points_max, iterations_max: params.iterations_max }
    }
}

/// Iterations that are done in any case.
const ITERATIONS_MIN: u32 = 2;

/// How one frame went.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TrackReport {
    /// Why the iterations ended.
    pub termination: Termination,
    /// Iterations run.
    pub iterations: u32,
    /// σ at the end, metres.
    pub sigma_m: f32,
    /// N_p/N: the share of the points that the model explains.
    pub inlier_ratio: f32,
}

/// Points that are enough while σ exceeds the components' spacing, and most of them left out.
const THINNED: usize = 500;
const THINNING_MAX: usize = 4;
/// Points that are enough for what cameras err by, which is followed over many frames.
const ANSWERS: usize = 500;
/// Points per component at which a node's confidence is one half.
const MASS_HALF: f32 = 0.1;

/// Everything that registering to one cloud needs and that does not change from frame to frame.
#[derive(Debug, Clone)]
pub(crate) struct Tracker {
    params: RegisterParams,
    /// Mean side of the sheet, metres: the unit of the fractional parameters.
    pub side_m: f32,
    basis: Basis,
    node_corners: Vec<Corner>,
    pub mixture: Mixture,
    /// The contour of the frame set to be tracked; filled by the caller.
    pub outline: Outline,
    isometry: Isometry,
    visibility: Visibility,
    folds: Folds,
    /// σ that the next frame starts from, before its bounds, metres.
    sigma_next_m: f32,
    outlier_weight: f64,
    /// Virtual nodes of the prediction.
    start: [Vec<f32>; 3],
    /// Contour samples of the prediction.
    outline_start: Vec<[f32; 3]>,
    carry: Carry,
    gathered: Gathered,
    answers: Vec<Answer>,
    moved: Vec<[f32; 3]>,
    equations: Equations,
    width: Width,
}

impl Tracker {
    pub fn new(params: &RegisterParams, sheet: &SheetGrid, rest_m: &[[f32; 3]]) -> Self {
        let side_m = (sheet.size_m[0] + sheet.size_m[1]) / 2.0;
        let controls = params.controls(sheet);
        let basis = Basis::new(sheet, controls, params.kernel_width * side_m, params.modes_max);
        let per_cell = params.virtual_per_cell(sheet);
        let fine = corners(basis.controls, Mixture::fine_nodes(sheet, per_cell));
        let mixture = Mixture::new(sheet, per_cell);
        let of_place = |c: &u32| fine[*c as usize];
        let mixture_corners: Vec<Corner> = mixture.blocks.components.iter().map(of_place).collect();
        Self {
            side_m: side_m as f32,
            node_corners: corners(basis.controls, sheet.nodes),
            outline: Outline::new(sheet, controls, per_cell),
            isometry: Isometry::new(sheet, rest_m, params.flatness),
            sigma_next_m: 0.0,
            outlier_weight: params.outlier_weight,
            visibility: Visibility::new(sheet),
            folds: Folds::flat(sheet),
            start: Default::default(),
            outline_start: Vec::new(),
            carry: Carry::new(&mixture.blocks, &mixture_corners, basis.controls[1]),
            gathered: Gathered::default(),
            answers: Vec::new(),
            moved: vec![[0.0; 3]; basis.len()],
            equations: Equations::default(),
            width: Width::available()[0],
            basis,
            mixture,
            params: params.clone(),
        }
    }

    /// Edge of the cells that clouds are to be sorted into, metres.
    pub fn cell_m(&self) -> f32 {
        0.053 * self.side_m
    }

    /// Takes over the sheet's folds.
    pub fn refold(&mut self, folds: &Folds) {
        if self.folds.facets() == folds.facets() {
            return;
        }
        self.folds.clone_from(folds);
        let blender = Blender::new(folds);
        self.mixture.refold(&blender);
        self.outline.refold(folds, &blender);
        self.isometry.refold(folds);
    }

    /// Finds what each camera can see of the nodes, for the next [`Self::track`].
    pub fn judge_visibility(&mut self, cameras: &[RgbdCamera], nodes_m: &[[f32; 3]]) {
        self.mixture.place(nodes_m);
        self.visibility.judge(cameras, nodes_m, &self.mixture);
    }

    /// Takes every camera to see everything.
    pub fn forget_visibility(&mut self) {
        self.visibility.forget();
    }

    /// Forgets σ and the outlier weight of the last frame.
    pub fn forget(&mut self) {
        self.sigma_next_m = f32::INFINITY;
        self.outlier_weight = self.params.outlier_weight;
    }

    /// Bends `nodes_m` (the prediction on entry) onto the cloud, until `is_late` at the latest.
    pub fn track(
        &mut self,
        cloud: &Cloud,
        nodes_m: &mut [[f32; 3]],
        iterations_max: u32,
        is_late: &dyn Fn() -> bool,
    ) -> TrackReport {
        let mut report = TrackReport { sigma_m: self.sigma_next_m, ..TrackReport::default() };
        let mut predicted = nodes_m.to_vec();
        self.mixture.place(nodes_m);
        self.start.clone_from(&self.mixture.components.at_m);
        self.outline.place(nodes_m);
        self.outline_start.clone_from(&self.outline.positions_m);
        let [sigma_min, sigma_max] = self.params.sigma_start.map(|s| s as f32 * self.side_m);
        let floor = self.params.sigma_floor as f32 * self.side_m;
        let mut sigma = (1.5 * self.sigma_next_m).clamp(sigma_min, sigma_max);
        let uniform_per_m3 = self.uniform_per_m3(cloud);
        let lambda = (self.params.prediction_error * f64::from(self.side_m)).powi(-2);
        let spacing_m = self.mixture.spacing_m();
        let tolerance = self.params.move_tolerance as f32 * self.side_m;
        for _ in 0..iterations_max {
            let thinning = if sigma > spacing_m { cloud.points_m.len() / THINNED } else { 1 };
            let asked =
                Asked { sigma_m: sigma, uniform_per_m3, thinning: thinning.clamp(1, THINNING_MAX) };
            let expected = self.mixture.expect(cloud, &self.visibility, &asked);
            if expected.mass < 1.0 {
                break; // Fewer than one point explained: there is nothing to move for.
            }
            report.iterations += 1;
            report.inlier_ratio = (expected.mass / cloud.points_m.len() as f64) as f32;
            let variance_m2 = f64::from(sigma).powi(2);
            if !self.outline.is_empty() {
                self.outline.matched(nodes_m, report.iterations - 1, variance_m2);
            }
            self.move_whole(nodes_m, variance_m2, &mut predicted);
            self.gathered.clear(self.basis.len());
            self.carry.gather(&self.mixture.components, &self.start, &mut self.gathered);
            self.gather_outline();
            let Some(modes) = self.solve(lambda * f64::from(sigma).powi(2)) else { break };
            let largest = self.apply(&modes, &predicted, nodes_m);
            let squared_m2 = self.mixture.place_after(nodes_m, expected.squared_m2);
            sigma = (squared_m2.max(0.0) / (3.0 * expected.mass)).sqrt() as f32;
            sigma = sigma.max(floor);
            report.sigma_m = sigma;
            report.termination = Termination::IterationLimit;
            if largest < tolerance {
                report.termination = Termination::Converged;
                break;
            }
            if report.iterations >= ITERATIONS_MIN
                && report.iterations < iterations_max
                && is_late()
            {
                report.termination = Termination::Deadline;
                break;
            }
        }
        if report.iterations > 0 {
            self.sigma_next_m = sigma;
            let unexplained = 1.0 - f64::from(report.inlier_ratio);
            let blended = 0.7 * self.outlier_weight + 0.3 * unexplained;
            self.outlier_weight = blended.clamp(0.01, 0.5);
        }
        report
    }

    /// What some of the points say about where the nodes are now, each for as many as is returned.
    pub fn answers(&mut self, cloud: &Cloud, report: &TrackReport) -> (&[Answer], f64) {
        let asked = Asked {
            sigma_m: report.sigma_m,
            uniform_per_m3: self.uniform_per_m3(cloud),
            thinning: (cloud.points_m.len() / ANSWERS).clamp(1, THINNING_MAX),
        };
        self.mixture.answers(cloud, &self.visibility, &asked, &mut self.answers);
        (&self.answers, asked.thinning as f64)
    }

    /// Mean relative change of the links' lengths.
    pub fn strain(&self, nodes_m: &[[f32; 3]]) -> f32 {
        self.isometry.strain(nodes_m).1
    }

    /// How much each node was seen in the last [`Self::track`], 0 … 1: the mass that the points
    /// gave its components, and whether a camera could see them; `unseen_confidence` at least.
    pub fn confidence(&self, nodes: &mut [f32]) {
        let unseen = self.params.unseen_confidence as f32;
        let mut seen = vec![0f32; nodes.len()];
        self.mixture.to_nodes(|m| self.mixture.components.mass[m], nodes);
        self.mixture.to_nodes(|m| f32::from(u8::from(self.visibility.is_seen(m))), &mut seen);
        for (node, seen) in nodes.iter_mut().zip(seen) {
            *node = (*node / (*node + MASS_HALF) * seen).max(unseen);
        }
    }

    /// Density of outliers relative to one component: components per volume of the box in which
    /// outliers are taken to be uniform, times the odds that a point is one.
    fn uniform_per_m3(&self, cloud: &Cloud) -> f64 {
        let (low, high) = bounds(&cloud.points_m);
        let margin = 0.13 * f64::from(self.side_m);
        let volume_m3: f64 =
            (0..3).map(|axis| f64::from(high[axis] - low[axis]).max(0.0) + margin).product();
        let components_per_m3 = self.visibility.owners(self.mixture.blocks.count()) / volume_m3;
        self.outlier_weight / (1.0 - self.outlier_weight) * components_per_m3
    }

    /// Moves the prediction, and what was made of it, as a whole towards where points and contour
    /// pull the nodes.
    fn move_whole(&mut self, nodes_m: &[[f32; 3]], variance_m2: f64, predicted: &mut [[f32; 3]]) {
        let error_m = self.params.rigid_error * f64::from(self.side_m);
        if error_m <= 0.0 {
            return;
        }
        let mut whole = Whole::about(nodes_m);
        whole.add_components(&self.mixture.components, self.params.temper);
        for row in &self.outline.rows {
            let weight = row.weight * self.params.outline_weight;
            whole.add_row(self.outline.positions_m[row.sample], &row.normal, row.way_m, weight);
        }
        let angle_rad = error_m / (0.5 * f64::from(self.side_m));
        let Some(motion) = whole.solve(variance_m2, error_m, angle_rad) else { return };
        self.outline.follow(|point_m| motion.moved(point_m));
        for point_m in predicted.iter_mut().chain(&mut self.outline_start) {
            *point_m = motion.moved(*point_m);
        }
        let [x, y, z] = &mut self.start;
        for m in 0..x.len() {
            [x[m], y[m], z[m]] = motion.moved([x[m], y[m], z[m]]);
        }
    }

    /// Adds the contour's rows to what the mixture gave. They are not tempered: edgels err less
    /// together than depth pixels do.
    fn gather_outline(&mut self) {
        for row in &self.outline.rows {
            let weight = row.weight * self.params.outline_weight / self.params.temper;
            let corner = self.outline.samples[row.sample].corner;
            let (now, start) =
                (self.outline.positions_m[row.sample], self.outline_start[row.sample]);
            let force = [0, 1, 2].map(|axis| {
                let to_m = row.way_m * row.normal[axis] + f64::from(now[axis]);
                weight * (to_m - f64::from(start[axis]))
            });
            self.gathered.add(corner, self.basis.controls[1], weight, force);
        }
    }

    /// Solves the M-step for the mode coefficients, K × 3; `None` if nothing is finite.
    fn solve(&mut self, regularisation: f64) -> Option<[DVector<f64>; 3]> {
        let k = self.basis.eigenvalues.len();
        let temper = self.params.temper;
        self.width.run(Reduce {
            basis: &self.basis,
            stencil: &self.gathered.stencil,
            force: &self.gathered.force,
            equations: &mut self.equations,
        });
        let mut normal = DMatrix::from_column_slice(k, k, &self.equations.normal);
        normal *= temper;
        for (j, eigenvalue) in self.basis.eigenvalues.iter().enumerate() {
            normal[(j, j)] += regularisation / eigenvalue;
        }
        // Only the lower triangle is filled, and only it is read. λσ²Λ⁻¹ makes it SPD.
        let factor = normal.cholesky()?;
        let right = self.equations.right.each_ref();
        Some(right.map(|b| factor.solve(&(DVector::from_column_slice(b) * temper))))
    }

    /// Moves the nodes and the mixture; returns the largest move of a node, metres.
    fn apply(
        &mut self,
        modes: &[DVector<f64>; 3],
        predicted: &[[f32; 3]],
        nodes_m: &mut [[f32; 3]],
    ) -> f32 {
        self.width.run(Expand { basis: &self.basis, modes, moved: &mut self.moved });
        let before = nodes_m.to_vec();
        for ((node, corner), start) in nodes_m.iter_mut().zip(&self.node_corners).zip(predicted) {
            let offset = corner.interpolate(&self.moved, self.basis.controls[1]);
            *node = [0, 1, 2].map(|axis| start[axis] + offset[axis]);
        }
        self.isometry.project(nodes_m, self.params.isometry_sweeps);
        let moves = before
            .iter()
            .zip(nodes_m.iter())
            .map(|(a, b)| (0..3).map(|axis| (b[axis] - a[axis]).powi(2)).sum::<f32>());
        moves.fold(0f32, f32::max).sqrt()
    }
}
