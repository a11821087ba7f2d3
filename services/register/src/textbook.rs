//! Coherent Point Drift as published: dense, every model point a component.
//!
//! Kept as the paper's baseline and as the oracle of the fast tracker; O(M·N + M³) per iteration.

use nalgebra::{DMatrix, Point3};

/// Parameters of the published algorithm, in the unit of the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TextbookParams {
    /// Width of the Gaussian kernel. Default 2.
    pub beta: f64,
    /// Trade-off λ between fit and coherence. Default 2.
    pub lambda: f64,
    /// Weight of the uniform outlier distribution, `0 <= w < 1`. Default 0.
    pub outlier_weight: f64,
    /// Variance to start from; `None` takes the mean squared distance of all pairs.
    pub variance: Option<f64>,
    /// Most iterations. Default 100.
    pub iterations_max: u32,
    /// Stop once σ² changes by no more than this. Default 0.001.
    pub tolerance: f64,
}

impl Default for TextbookParams {
    fn default() -> Self {
        Self {
            beta: 2.0,
            lambda: 2.0,
            outlier_weight: 0.0,
            variance: None,
            iterations_max: 100,
            tolerance: 0.001,
        }
    }
}

/// Result of [`register`].
#[derive(Debug, Clone)]
pub struct TextbookResult {
    /// The moved model points.
    pub moved: Vec<Point3<f64>>,
    /// Iterations run.
    pub iterations: u32,
    /// Final variance.
    pub variance: f64,
    /// Whether σ² settled before the limit of iterations.
    pub converged: bool,
}

/// Why textbook CPD cannot run.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum TextbookError {
    /// One of the clouds has no points.
    #[error("{observed} observed and {model} model points: both clouds need at least one point")]
    Empty {
        /// Observed points.
        observed: usize,
        /// Model points.
        model: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("a coordinate is not finite")]
    NotFinite,
    /// The M-step's matrix is singular.
    #[error("the linear system of iteration {iteration} is singular")]
    Singular {
        /// Iteration, from 1.
        iteration: u32,
    },
}

/// Registers `model` (M points) to `observed` (N points), non-rigidly.
///
/// p[m,n] = exp(−|x[n]−y[m]|²/2σ²) / (Σ_k exp(−|x[n]−y[k]|²/2σ²) + (2πσ²)^{3/2}·w/(1−w)·M/N)
/// (diag(P1) G + λσ² I) W = P X − diag(P1) Y,   T = Y + G W
///
/// Source: Myronenko & Song, IEEE TPAMI 32(12), 2010, figure 4. Deviations: convergence is tested
/// on σ² and a column without weight gets ε as its denominator, both as pycpd 2.0.0 does, so that
/// the two can be compared; σ² comes from residuals instead of a difference of large sums.
pub fn register(
    observed: &[Point3<f64>],
    model: &[Point3<f64>],
    params: &TextbookParams,
) -> Result<TextbookResult, TextbookError> {
    let (n, m) = (observed.len(), model.len());
    if n == 0 || m == 0 {
        return Err(TextbookError::Empty { observed: n, model: m });
    }
    if !observed.iter().chain(model).all(|p| p.coords.iter().all(|c| c.is_finite())) {
        return Err(TextbookError::NotFinite);
    }
    let kernel = DMatrix::from_fn(m, m, |a, b| {
        (-(model[a] - model[b]).norm_squared() / (2.0 * params.beta * params.beta)).exp()
    });
    let mut moved = model.to_vec();
    let mut variance = params.variance.unwrap_or_else(|| mean_squared_distance(observed, model));
    let mut iterations = 0;
    let mut converged = false;
    while iterations < params.iterations_max && !converged {
        iterations += 1;
        let expected = expect(observed, &moved, variance, params.outlier_weight);
        let mut system = kernel.clone();
        let mut right = DMatrix::zeros(m, 3);
        for a in 0..m {
            system.row_mut(a).scale_mut(expected.mass[a]);
            system[(a, a)] += params.lambda * variance;
            for axis in 0..3 {
                right[(a, axis)] = expected.weighted[a][axis] - expected.mass[a] * model[a][axis];
            }
        }
        let weights = system
            .lu()
            .solve(&right)
            .filter(|w| w.iter().all(|c| c.is_finite()))
            .ok_or(TextbookError::Singular { iteration: iterations })?;
        let offset = &kernel * weights;
        for a in 0..m {
            moved[a] = Point3::from(model[a].coords + offset.row(a).transpose().fixed_rows::<3>(0));
        }
        let before = variance;
        variance = expected.variance(observed, &moved);
        if variance <= 0.0 {
            variance = params.tolerance / 10.0;
        }
        converged = (variance - before).abs() <= params.tolerance;
    }
    Ok(TextbookResult { moved, iterations, variance, converged })
}

fn mean_squared_distance(observed: &[Point3<f64>], model: &[Point3<f64>]) -> f64 {
    let sum: f64 =
        observed.iter().flat_map(|x| model.iter().map(move |y| (x - y).norm_squared())).sum();
    sum / (3.0 * observed.len() as f64 * model.len() as f64)
}

struct Expected {
    /// Σ_n p[m,n].
    mass: Vec<f64>,
    /// Σ_n p[m,n] x[n].
    weighted: Vec<[f64; 3]>,
    /// p[m,n], row-major.
    p: Vec<f64>,
}

fn expect(observed: &[Point3<f64>], moved: &[Point3<f64>], variance: f64, w: f64) -> Expected {
    let (n, m) = (observed.len(), moved.len());
    let uniform =
        (std::f64::consts::TAU * variance).powf(1.5) * w / (1.0 - w) * m as f64 / n as f64;
    let mut expected =
        Expected { mass: vec![0.0; m], weighted: vec![[0.0; 3]; m], p: vec![0.0; m * n] };
    let mut column = vec![0.0; m];
    for (k, x) in observed.iter().enumerate() {
        for (entry, y) in column.iter_mut().zip(moved) {
            *entry = (-(x - y).norm_squared() / (2.0 * variance)).exp();
        }
        let sum: f64 = column.iter().sum();
        let denominator = if sum == 0.0 { f64::EPSILON } else { sum } + uniform;
        for (a, entry) in column.iter().enumerate() {
            let p = entry / denominator;
            expected.p[a * n + k] = p;
            expected.mass[a] += p;
            for axis in 0..3 {
                expected.weighted[a][axis] += p * x[axis];
            }
        }
    }
    expected
}

impl Expected {
    fn variance(&self, observed: &[Point3<f64>], moved: &[Point3<f64>]) -> f64 {
        let n = observed.len();
        let mut sum = 0.0;
        for (a, y) in moved.iter().enumerate() {
            for (k, x) in observed.iter().enumerate() {
                sum += self.p[a * n + k] * (x - y).norm_squared();
            }
        }
        sum / (3.0 * self.mass.iter().sum::<f64>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_line_is_followed() {
        let model: Vec<Point3<f64>> =
            (0..21).map(|k| Point3::new(f64::from(k) / 10.0, 0.0, 0.0)).collect();
        let bent: Vec<Point3<f64>> =
            model.iter().map(|p| Point3::new(p.x, 0.2 * p.x * p.x, 0.1)).collect();
        let params = TextbookParams { tolerance: 1e-7, ..TextbookParams::default() };
        let result = register(&bent, &model, &params).unwrap();
        assert!(result.converged);
        let error: f64 = result.moved.iter().zip(&bent).map(|(a, b)| (a - b).norm()).sum();
        assert!(error / 21.0 < 0.02, "mean error {}", error / 21.0);
    }

    #[test]
    fn impossible_inputs_are_named() {
        let one = [Point3::new(0.0, 0.0, 0.0)];
        let nan = [Point3::new(f64::NAN, 0.0, 0.0)];
        let params = TextbookParams::default();
        assert_eq!(
            register(&[], &one, &params).unwrap_err(),
            TextbookError::Empty { observed: 0, model: 1 }
        );
        assert_eq!(register(&nan, &one, &params).unwrap_err(), TextbookError::NotFinite);
    }
}
