//! The `[contact]` parameters.

use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

/// How layers of the sheet keep apart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ContactParams {
    /// Distance that two layers keep away from their common creases, metres: the sheet's
    /// thickness. Larger values are easier to keep and make stacks too thick. Default 0.0001.
    pub thickness_m: f64,
    /// Layers that hang together at a crease close linearly towards it: gap per metre from the
    /// crease. Too steep and a closed fold cannot lie flat. Default 0.016.
    pub gap_slope: f64,
    /// Smallest gap, at the crease itself, metres. It must stand out of f32 noise. Default 3e-6.
    pub gap_min_m: f64,
    /// Distance that a layer keeps from a crease that closes around it, and that two creases that
    /// meet back to back keep from each other, metres. Default 0.00015.
    pub spine_gap_m: f64,
    /// The same, per metre from a corner where the creases meet. Default 0.02.
    pub spine_slope: f64,
    /// Most times that contacts are sought anew in one projection. Default 10.
    pub rounds: u32,
    /// Sweeps over links and contacts per round; three more over the contacts alone follow.
    /// Default 6.
    pub sweeps: u32,
    /// Share of a push that resists sliding: Coulomb's coefficient between layers. Default 0.3.
    pub friction: f64,
    /// World z that no node may be below, metres; none by default.
    pub table_m: Option<f64>,
}

impl Default for ContactParams {
    fn default() -> Self {
        Self {
            thickness_m: 1e-4,
            gap_slope: 0.016,
            gap_min_m: 3e-6,
            spine_gap_m: 1.5e-4,
            spine_slope: 0.02,
            rounds: 10,
            sweeps: 6,
            friction: 0.3,
            table_m: None,
        }
    }
}

impl ContactParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<ContactConfig, Vec<Problem>> {
        let Self {
            thickness_m,
            gap_slope,
            gap_min_m,
            spine_gap_m,
            spine_slope,
            rounds,
            sweeps,
            friction,
            table_m,
        } = self;
        let mut checker = Checker::new();
        let mut within = |key: &str, value: f64, low: f64, high: f64, unit: &str| {
            let requirement = format!("must be {low} to {high} {unit}");
            checker.require(low <= value && value <= high, key, value, requirement.trim_end());
        };
        within("thickness_m", *thickness_m, 1e-5, 0.01, "m (is it in millimetres?)");
        within("gap_slope", *gap_slope, 1e-4, 1.0, "");
        within("gap_min_m", *gap_min_m, 1e-6, 1e-4, "m");
        within("spine_gap_m", *spine_gap_m, 1e-6, 0.01, "m");
        within("spine_slope", *spine_slope, 1e-4, 1.0, "");
        within("rounds", f64::from(*rounds), 1.0, 100.0, "");
        within("sweeps", f64::from(*sweeps), 1.0, 100.0, "");
        within("friction", *friction, 0.0, 10.0, "");
        within("table_m", table_m.unwrap_or(0.0), -100.0, 100.0, "m");
        checker.finish(|| ContactConfig { params: self.clone() })
    }
}

/// Checked [`ContactParams`]: the only form that contact accepts.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactConfig {
    pub(crate) params: ContactParams,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_pass_and_nonsense_is_reported_whole() {
        assert!(ContactParams::default().check().is_ok());
        let bad = ContactParams {
            thickness_m: 0.1,
            gap_min_m: 0.0,
            rounds: 0,
            table_m: Some(f64::NAN),
            ..ContactParams::default()
        };
        let keys: Vec<String> = bad.check().unwrap_err().into_iter().map(|p| p.key).collect();
        assert_eq!(keys, ["thickness_m", "gap_min_m", "rounds", "table_m"]);
    }
}
