//! What a bundle adjustment finds, and where each part stands in its equations.

use orime_geometry::RgbdCamera;
use orime_geometry::nalgebra::{DMatrix, DVector, Isometry3};

use crate::observe::View;

/// How far a depth bias is expected from zero, metres (one sigma).
const BIAS_SIGMA_M: f64 = 0.02;
/// How far a depth scale is expected from one (one sigma).
const SCALE_SIGMA: f64 = 0.01;

/// How much views scatter (one sigma).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sigmas {
    /// Corners, pixels.
    pub corner_px: f64,
    /// Depth, metres.
    pub depth_m: f64,
}

/// The views of one pose of the target.
#[derive(Debug, Clone)]
pub struct TargetViews<'a> {
    /// Each with the index of its marker in [`Unknowns::target_from_marker`].
    pub views: Vec<(usize, &'a View)>,
}

/// Everything that is adjusted.
#[derive(Debug, Clone)]
pub struct Unknowns {
    /// The cameras' lenses, and where their depth lens sits: not adjusted.
    pub lenses: Vec<RgbdCamera>,
    /// Side of every marker, metres: not adjusted.
    pub side_m: f64,
    /// Maps each camera's colour frame into that of camera 0.
    pub first_from_camera: Vec<Isometry3<f64>>,
    /// Maps each marker into the target.
    pub target_from_marker: Vec<Isometry3<f64>>,
    /// Maps the target into camera 0, per pose of the target.
    pub first_from_target: Vec<Isometry3<f64>>,
    /// Depth bias per camera, metres: measured = scale · true + bias.
    pub bias_m: Vec<f64>,
    /// Depth scale per camera.
    pub scale: Vec<f64>,
    /// Where they stand in the equations.
    pub common: Common,
}

/// First row of each free unknown that all target poses share; `None` where it is fixed.
#[derive(Debug, Clone, Default)]
pub struct Common {
    /// Six rows each.
    pub cameras: Vec<Option<usize>>,
    /// Six rows each.
    pub markers: Vec<Option<usize>>,
    /// One row each.
    pub bias: Vec<Option<usize>>,
    /// One row each.
    pub scale: Vec<Option<usize>>,
    rows: usize,
}

impl Common {
    /// Gives every free unknown its rows.
    pub fn new(cameras: &[bool], markers: &[bool], bias: &[bool], scale: &[bool]) -> Self {
        let mut rows = 0;
        let mut place = |free: &[bool], width: usize| -> Vec<Option<usize>> {
            let each = free.iter().map(|free| {
                free.then(|| {
                    rows += width;
                    rows - width
                })
            });
            each.collect()
        };
        let (cameras, markers) = (place(cameras, 6), place(markers, 6));
        let (bias, scale) = (place(bias, 1), place(scale, 1));
        Self { cameras, markers, bias, scale, rows }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows
    }
}

impl Unknowns {
    /// What the expectations about depth cost.
    pub fn prior_cost(&self) -> f64 {
        let bias = self.bias_m.iter().map(|b| (b / BIAS_SIGMA_M).powi(2));
        let scale = self.scale.iter().map(|g| ((g - 1.0) / SCALE_SIGMA).powi(2));
        bias.chain(scale).sum::<f64>() / 2.0
    }

    /// Adds the expectations about depth to the normal equations.
    pub fn add_priors(&self, hessian: &mut DMatrix<f64>, gradient: &mut DVector<f64>) {
        let mut add = |places: &[Option<usize>], values: &[f64], about: f64, sigma: f64| {
            for (place, value) in places.iter().zip(values) {
                if let Some(k) = *place {
                    hessian[(k, k)] += 1.0 / (sigma * sigma);
                    gradient[k] += (value - about) / (sigma * sigma);
                }
            }
        };
        add(&self.common.bias, &self.bias_m, 0.0, BIAS_SIGMA_M);
        add(&self.common.scale, &self.scale, 1.0, SCALE_SIGMA);
    }
}
