//! Robust bundle adjustment: cameras, markers on the target, target poses and depth errors at once.
//!
//! | symbol | meaning                                           | unit | free                    |
//! |--------|---------------------------------------------------|------|-------------------------|
//! | `C_c`  | camera 0 from camera c                            | m    | all but `C_0`           |
//! | `T_s`  | camera 0 from target at frame set s               | m    | all                     |
//! | `M_i`  | target from marker i                              | m    | all but the first       |
//! | `b_c`  | depth bias of camera c: measured = `g_c`·true + b | m    | all with depth          |
//! | `g_c`  | depth scale of camera c                           | 1    | where depths span enough |
//!
//! Corner: p = C_c⁻¹ T_s M_i x, residual f·(p_xy / p_z − observed ray) / σ_px.
//! Depth: the line of sight of a depth pixel meets the marker's plane at z,
//! residual (measured − g_c z − b_c) / σ_depth.
//!
//! Both through Cauchy's loss; poses move by a right factor exp(δ), δ = (translation, rotation).
//! Levenberg–Marquardt; the T_s are eliminated by a Schur complement, so that a step costs
//! O(views · n² + n³) with n the parameters that are not target poses. Sums in fixed order.

use orime_geometry::nalgebra::{DMatrix, DVector, Matrix6, SMatrix, Vector6};

use crate::residuals::{Row, rows_of};
use crate::square::motion;
use crate::unknowns::{Common, Sigmas, TargetViews, Unknowns};

/// Most steps of one adjustment.
const STEPS_MAX: usize = 100;
/// Adjustment ends when a step lowers the cost by less than this share.
const DECREASE_MIN: f64 = 1e-9;
/// Residuals beyond so many sigmas lose weight.
const CAUCHY: f64 = 3.0;

/// How an adjustment ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Termination {
    /// The cost no longer sinks.
    Converged,
    /// The limit of steps came first.
    StepsMax,
}

/// Adjusts the unknowns in place.
pub fn adjust(unknowns: &mut Unknowns, targets: &[TargetViews<'_>], sigmas: Sigmas) -> Termination {
    let mut damping = 1e-3;
    let mut system = build(unknowns, targets, sigmas);
    for _ in 0..STEPS_MAX {
        let Some((common, per_target)) = system.solve(damping) else {
            damping *= 10.0;
            if damping > 1e12 {
                return Termination::Converged;
            }
            continue;
        };
        let next = unknowns.moved(&common, &per_target);
        let cost = cost(&next, targets, sigmas);
        if cost <= system.cost {
            let done = system.cost - cost <= DECREASE_MIN * system.cost;
            *unknowns = next;
            if done {
                return Termination::Converged;
            }
            system = build(unknowns, targets, sigmas);
            damping = (damping * 0.2).max(1e-12);
        } else {
            damping *= 10.0;
            if damping > 1e12 {
                return Termination::Converged;
            }
        }
    }
    Termination::StepsMax
}

/// Normal equations with the target poses apart.
struct System {
    common: DMatrix<f64>,
    common_gradient: DVector<f64>,
    /// Per target: coupling with the common unknowns, own block, own gradient.
    targets: Vec<(DMatrix<f64>, Matrix6<f64>, Vector6<f64>)>,
    cost: f64,
}

/// Cauchy's loss and the weight of its tangent parabola.
fn cauchy(residual: f64) -> (f64, f64) {
    let ratio2 = (residual / CAUCHY).powi(2);
    (CAUCHY * CAUCHY * ratio2.ln_1p() / 2.0, 1.0 / (1.0 + ratio2))
}

fn cost(unknowns: &Unknowns, targets: &[TargetViews<'_>], sigmas: Sigmas) -> f64 {
    let mut cost = unknowns.prior_cost();
    for (target, views) in targets.iter().enumerate() {
        rows_of(unknowns, target, views, sigmas, &mut |row: &Row| {
            cost += row.share * cauchy(row.residual).0;
        });
    }
    cost
}

fn build(unknowns: &Unknowns, targets: &[TargetViews<'_>], sigmas: Sigmas) -> System {
    let n = unknowns.common.len();
    let mut system = System {
        common: DMatrix::zeros(n, n),
        common_gradient: DVector::zeros(n),
        targets: Vec::with_capacity(targets.len()),
        cost: unknowns.prior_cost(),
    };
    unknowns.add_priors(&mut system.common, &mut system.common_gradient);
    for (target, views) in targets.iter().enumerate() {
        let mut coupling = DMatrix::zeros(n, 6);
        let (mut own, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
        rows_of(unknowns, target, views, sigmas, &mut |row: &Row| {
            let (loss, weight) = cauchy(row.residual);
            let weight = row.share * weight;
            system.cost += row.share * loss;
            let entries = row.common();
            for &(i, a) in entries {
                for &(j, b) in entries {
                    system.common[(i, j)] += weight * a * b;
                }
                for k in 0..6 {
                    coupling[(i, k)] += weight * a * row.target[k];
                }
                system.common_gradient[i] += weight * a * row.residual;
            }
            own += row.target * row.target.transpose() * weight;
            gradient += row.target * (weight * row.residual);
        });
        system.targets.push((coupling, own, gradient));
    }
    system
}

impl System {
    /// The step that the damped normal equations say; `None` where they are not definite.
    fn solve(&self, damping: f64) -> Option<(DVector<f64>, Vec<Vector6<f64>>)> {
        let mut reduced = self.common.clone();
        let mut right = -&self.common_gradient;
        for k in 0..reduced.nrows() {
            reduced[(k, k)] += damping * self.common[(k, k)].max(1e-9);
        }
        let mut factors = Vec::with_capacity(self.targets.len());
        for (coupling, own, gradient) in &self.targets {
            let mut damped = *own;
            for k in 0..6 {
                damped[(k, k)] += damping * own[(k, k)].max(1e-9);
            }
            let factor = damped.cholesky()?;
            let inverse: SMatrix<f64, 6, 6> = factor.inverse();
            reduced -= coupling * inverse * coupling.transpose();
            right += coupling * (inverse * gradient);
            factors.push(factor);
        }
        let common = reduced.cholesky()?.solve(&right);
        let per_target =
            self.targets.iter().zip(&factors).map(|((coupling, _, gradient), factor)| {
                let pulled = coupling.transpose() * &common;
                let pulled = Vector6::from_column_slice(pulled.as_slice());
                -factor.solve(&(gradient + pulled))
            });
        let per_target = per_target.collect();
        Some((common, per_target))
    }
}

impl Unknowns {
    /// The unknowns after a step.
    fn moved(&self, common: &DVector<f64>, per_target: &[Vector6<f64>]) -> Self {
        let mut next = self.clone();
        let six = |first: usize| Vector6::from_column_slice(&common.as_slice()[first..first + 6]);
        let Common { cameras, markers, bias, scale, .. } = &self.common;
        for (pose, place) in next.first_from_camera.iter_mut().zip(cameras) {
            place.iter().for_each(|first| *pose *= motion(&six(*first)));
        }
        for (pose, place) in next.target_from_marker.iter_mut().zip(markers) {
            place.iter().for_each(|first| *pose *= motion(&six(*first)));
        }
        for (value, place) in next.bias_m.iter_mut().zip(bias) {
            place.iter().for_each(|k| *value += common[*k]);
        }
        for (value, place) in next.scale.iter_mut().zip(scale) {
            place.iter().for_each(|k| *value += common[*k]);
        }
        for (pose, step) in next.first_from_target.iter_mut().zip(per_target) {
            *pose *= motion(step);
        }
        // Products of many rotations leave the unit sphere slowly.
        let poses = next.first_from_camera.iter_mut().chain(&mut next.target_from_marker);
        for pose in poses.chain(&mut next.first_from_target) {
            pose.rotation.renormalize();
        }
        next
    }
}
