//! The `[simulate]` section of a set.

use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

/// The `[simulate]` section of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SimulateParams {
    /// Substeps per frame. Stretch falls about with their square, cost grows with them.
    /// Default 20.
    pub substeps: u32,
    /// Links reach nodes 1 … `link_steps` grid steps away, along the axes and the diagonals.
    /// 1 is a membrane; from 2 on the skip links resist bending. Default 2.
    pub link_steps: u32,
    /// Compliance of the links between neighbours, m/N. 0 is inextensible (paper). Default 0.
    pub stretch_compliance_m_per_n: f64,
    /// Compliance of the skip links, m/N: how willingly the sheet bends. Small values keep it
    /// smooth and make it refuse a sharp fold. Default 100.
    pub bend_compliance_m_per_n: f64,
    /// Damping time of the links, s: XPBD's `β/α` as one time scale, so that
    /// `γ = damping_s / dt`. Default 0.0005.
    pub damping_s: f64,
    /// Share of the velocity that is lost per second to the air, 1/s. Default 12.
    pub drag_per_s: f64,
    /// Natural frequency of the virtual springs to the targets, Hz. High values follow the
    /// targets and their noise, low ones lag. Default 48.
    pub track_hz: f64,
    /// Largest acceleration that a target may cause, m/s². A target that is far away pulls, it
    /// never teleports. Default 400.
    pub track_acceleration_max_m_per_s2: f64,
    /// Downward acceleration along world −z, m/s². The targets already carry gravity's effect,
    /// so 0 by default.
    pub gravity_m_per_s2: f64,
}

impl Default for SimulateParams {
    fn default() -> Self {
        Self {
            substeps: 20,
            link_steps: 2,
            stretch_compliance_m_per_n: 0.0,
            bend_compliance_m_per_n: 100.0,
            damping_s: 0.0005,
            drag_per_s: 12.0,
            track_hz: 48.0,
            track_acceleration_max_m_per_s2: 400.0,
            gravity_m_per_s2: 0.0,
        }
    }
}

impl SimulateParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<SimulateConfig, Vec<Problem>> {
        let Self {
            substeps,
            link_steps,
            stretch_compliance_m_per_n,
            bend_compliance_m_per_n,
            damping_s,
            drag_per_s,
            track_hz,
            track_acceleration_max_m_per_s2,
            gravity_m_per_s2,
        } = self;
        let mut checker = Checker::new();
        let mut within = |key: &str, value: f64, low: f64, high: f64, unit: &str| {
            let requirement = format!("must be {low} to {high} {unit}");
            checker.require(low <= value && value <= high, key, value, requirement.trim_end());
        };
        within("substeps", f64::from(*substeps), 1.0, 1000.0, "");
        within("link_steps", f64::from(*link_steps), 1.0, 4.0, "");
        within("stretch_compliance_m_per_n", *stretch_compliance_m_per_n, 0.0, 1e6, "m/N");
        within("bend_compliance_m_per_n", *bend_compliance_m_per_n, 0.0, 1e6, "m/N");
        within("damping_s", *damping_s, 0.0, 1.0, "s");
        within("drag_per_s", *drag_per_s, 0.0, 1000.0, "1/s");
        within("track_hz", *track_hz, 0.1, 10_000.0, "Hz");
        let acceleration = *track_acceleration_max_m_per_s2;
        within("track_acceleration_max_m_per_s2", acceleration, 0.1, 1e6, "m/s²");
        within("gravity_m_per_s2", *gravity_m_per_s2, -20.0, 20.0, "m/s²");
        checker.finish(|| SimulateConfig { params: self.clone() })
    }
}

/// Checked [`SimulateParams`]: the only form that the simulator accepts.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulateConfig {
    pub(crate) params: SimulateParams,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_pass_and_nonsense_is_reported_whole() {
        assert!(SimulateParams::default().check().is_ok());
        let bad = SimulateParams {
            substeps: 0,
            damping_s: f64::NAN,
            track_hz: -1.0,
            ..SimulateParams::default()
        };
        let keys: Vec<String> = bad.check().unwrap_err().into_iter().map(|p| p.key).collect();
        assert_eq!(keys, ["substeps", "damping_s", "track_hz"]);
    }
}
