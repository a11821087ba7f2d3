//! `simulate`: soft targets in, sheet state out.

use orime_geometry::SheetGrid;
use orime_params::Problem;
use serde::{Deserialize, Serialize};

/// The `[simulate]` section of a set.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SimulateParams {}

impl SimulateParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<SimulateConfig, Vec<Problem>> {
        Ok(SimulateConfig {})
    }
}

/// Checked [`SimulateParams`].
#[derive(Debug, Clone)]
pub struct SimulateConfig {}

/// What one step did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SimulateReport {
    /// Targets that were not finite and were left out.
    pub targets_rejected: u32,
}

/// The sheet's mass points and springs.
#[derive(Debug)]
pub struct Simulator {}

impl Simulator {
    /// A flat sheet at the origin, at rest. `rest_m`: template node positions whose link lengths
    /// are the rest lengths, where the sheet is not a flat rectangle.
    pub fn new(
        _config: &SimulateConfig,
        _sheet: &SheetGrid,
        _density_kg_per_m2: f64,
        _rest_m: Option<&[[f32; 3]]>,
    ) -> Self {
        Self {}
    }

    /// Advances by `dt_s` towards the targets; `reset` takes them over as the new pose at once.
    /// Confidence 0 means no target for that node.
    pub fn step(
        &mut self,
        _dt_s: f64,
        _targets_m: &[[f32; 3]],
        _confidence: &[f32],
        _reset: bool,
    ) -> SimulateReport {
        SimulateReport::default()
    }

    /// Node positions, world frame, metres, index order of the sheet.
    pub fn positions_m(&self) -> &[[f32; 3]] {
        &[]
    }
}
