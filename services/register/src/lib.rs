//! `register`: observed cloud and predicted sheet in, soft targets out.

use orime_geometry::{ObservedPoint, SheetGrid};
use orime_params::Problem;
use serde::{Deserialize, Serialize};

/// The `[register]` section of a set.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RegisterParams {}

impl RegisterParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<RegisterConfig, Vec<Problem>> {
        Ok(RegisterConfig {})
    }
}

/// Checked [`RegisterParams`].
#[derive(Debug, Clone)]
pub struct RegisterConfig {}

/// Whether the sheet is being followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Tracking {
    /// No pose yet: no first cloud, or nothing in it that fits the sheet.
    #[default]
    Searching = 0,
    /// Following.
    Tracking = 1,
    /// Nothing to register against in this step: the simulator carries on alone.
    Coasting = 2,
    /// The pose is known to be wrong; looking for a new one.
    Lost = 3,
}

/// What registering one step gave.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(C)]
pub struct RegisterReport {
    /// Whether the sheet is being followed.
    pub tracking: Tracking,
    /// Whether the targets are a new pose for *every* node, to be taken over at once.
    pub reset: bool,
    /// Iterations of expectation maximisation.
    pub iterations: u32,
    /// Standard deviation of the mixture at the end, metres.
    pub sigma_m: f32,
    /// Share of the observed points that the model explains.
    pub inlier_ratio: f32,
    /// Observed points that were not finite.
    pub points_rejected: u32,
}

/// Registers the sheet to one cloud after the other.
#[derive(Debug)]
pub struct Registrar {}

impl Registrar {
    /// A registrar that has no pose yet. `template_m`: node positions to start from, where the
    /// sheet does not start flat.
    pub fn new(
        _config: &RegisterConfig,
        _sheet: &SheetGrid,
        _template_m: Option<Vec<[f32; 3]>>,
    ) -> Self {
        Self {}
    }

    /// Registers one cloud. `predicted_m` is the simulator's newest state (`None` before the
    /// first pose); `targets_m` and `confidence` (one per node of the sheet) are written:
    /// confidence 0 means that the node has no target.
    pub fn register(
        &mut self,
        _cloud: &[ObservedPoint],
        _predicted_m: Option<&[[f32; 3]]>,
        _targets_m: &mut [[f32; 3]],
        _confidence: &mut [f32],
    ) -> RegisterReport {
        RegisterReport::default()
    }
}
