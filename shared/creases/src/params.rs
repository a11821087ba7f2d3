//! Parameters of the crease finder.

use crate::folds::FACETS_MAX;
use crate::line::Line;
use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

/// How creases are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CreaseMode {
    /// Never: the sheet stays one facet.
    Off,
    /// Persistent lines in (u, v) between rigid facets.
    #[default]
    Lines,
    /// The paper's clustering of nodes.
    Paper,
}

/// Where creases come from. Lengths in units of the node spacing `h` (the wider of the two), so
/// that another sheet needs no other numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CreaseParams {
    /// `"lines"`, `"paper"` or `"off"`. Default `"lines"`.
    pub mode: CreaseMode,
    /// Smallest fold angle that makes a crease, degrees. Lower values free a crease earlier and
    /// mistake more bends for one. Default 12.
    pub angle_min_deg: f64,
    /// The same for a crease whose ends are not both at landmarks (see `snap`): most creases go
    /// through corners, middles and other creases, and a sheet that is held where a crease is not
    /// known yet bends anywhere. Default 35.
    pub angle_off_landmarks_deg: f64,
    /// Steps in which it must look like a fold. More are surer and later. Default 2.
    pub hits: u32,
    /// Log-likelihood ratio by which a narrow bend must beat wide and smooth ones, summed over
    /// steps. Higher values are surer and later. Default 7.
    pub evidence: f64,
    /// Bends narrower than this many spacings count as creases. Default 2.5.
    pub bend_width: f64,
    /// Ends of a crease that lie nearer than this many spacings to a landmark (corner or middle of
    /// a side of a facet or the sheet, end of another crease), or as near as they are known, are
    /// put there; 0 snaps nothing. Default 0.3.
    pub snap: f64,
    /// Most facets, 1 to 32. Default 32.
    pub facets_max: usize,
    /// Lines that are about to be folded: two material points each, metres. Such a crease is freed
    /// at half the angle, where bending is seen at it. Default none.
    pub plan: Vec<[[f64; 2]; 2]>,
    /// The paper's clustering, for mode `"paper"`.
    pub paper: PaperParams,
}

/// When a cluster may split again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lock {
    /// After any split none, until the whole sheet is thin.
    #[default]
    Global,
    /// After its own split, until it is thin itself.
    Cluster,
    /// At once.
    None,
}

/// The paper's clustering.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PaperParams {
    /// Replaces the three small variances, m². Default 1e-6, the paper's (1 mm)².
    pub s_m2: f64,
    /// A cluster that is less flat than this splits: √((λ₃ + λ₄ + λ₅)/(λ₁ + λ₂)). Default 0.13.
    pub r_div: f64,
    /// Third spatial variance below which nodes count as fixed, m². Default 6.4e-5, (8 mm)².
    pub r_fix_m2: f64,
    /// `"global"`, `"cluster"` or `"none"`. Default `"global"`.
    pub lock: Lock,
    /// Most k-means iterations of a step; more converge sooner and cost more. Default 20.
    pub iterations: u32,
}

impl Default for PaperParams {
    fn default() -> Self {
        Self { s_m2: 1e-6, r_div: 0.13, r_fix_m2: 6.4e-5, lock: Lock::Global, iterations: 20 }
    }
}

impl PaperParams {
    fn check(&self) -> Result<(), Vec<Problem>> {
        let Self { s_m2, r_div, r_fix_m2, lock: _, iterations } = self;
        let mut checker = Checker::new();
        let mut within = |key: &str, value: f64, low: f64, high: f64, unit: &str| {
            let requirement = format!("must be {low} to {high} {unit}");
            checker.require(low <= value && value <= high, key, value, requirement.trim_end());
        };
        within("s_m2", *s_m2, 1e-12, 1.0, "m²");
        within("r_div", *r_div, 0.01, 1.0, "");
        within("r_fix_m2", *r_fix_m2, 1e-12, 1.0, "m²");
        within("iterations", f64::from(*iterations), 1.0, 1000.0, "");
        checker.finish(|| ())
    }
}

impl Default for CreaseParams {
    fn default() -> Self {
        Self {
            mode: CreaseMode::Lines,
            angle_min_deg: 12.0,
            angle_off_landmarks_deg: 35.0,
            hits: 2,
            evidence: 7.0,
            bend_width: 2.5,
            snap: 0.3,
            facets_max: FACETS_MAX,
            plan: Vec::new(),
            paper: PaperParams::default(),
        }
    }
}

impl CreaseParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<CreaseConfig, Vec<Problem>> {
        let Self {
            mode: _,
            angle_min_deg,
            angle_off_landmarks_deg,
            hits,
            evidence,
            bend_width,
            snap,
            facets_max,
            plan,
            paper,
        } = self;
        let mut checker = Checker::new();
        let mut within = |key: &str, value: f64, low: f64, high: f64, unit: &str| {
            let requirement = format!("must be {low} to {high} {unit}");
            checker.require(low <= value && value <= high, key, value, requirement.trim_end());
        };
        within("angle_min_deg", *angle_min_deg, 2.0, 120.0, "degrees");
        within("angle_off_landmarks_deg", *angle_off_landmarks_deg, 0.0, 180.0, "degrees");
        within("hits", f64::from(*hits), 1.0, 100.0, "");
        within("evidence", *evidence, 1.0, 1000.0, "");
        within("bend_width", *bend_width, 0.5, 8.0, "spacings");
        within("snap", *snap, 0.0, 2.0, "spacings");
        within("facets_max", *facets_max as f64, 1.0, FACETS_MAX as f64, "");
        let distinct = |[a, b]: &[[f64; 2]; 2]| (a[0] - b[0]).hypot(a[1] - b[1]) > 1e-4;
        checker.require(
            plan.iter().all(distinct),
            "plan",
            plan,
            "the two points of a line must be at least 0.1 mm apart",
        );
        if let Err(problems) = paper.check() {
            checker.nested("paper", problems);
        }
        checker.finish(|| CreaseConfig {
            params: self.clone(),
            plan: plan.iter().map(|[a, b]| Line::through(*a, *b)).collect(),
        })
    }
}

/// Checked [`CreaseParams`]: the only form that the finder accepts.
#[derive(Debug, Clone, PartialEq)]
pub struct CreaseConfig {
    pub(crate) params: CreaseParams,
    pub(crate) plan: Vec<Line>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_pass_and_are_the_documented_ones() {
        let CreaseParams {
            mode, angle_min_deg, hits, evidence, bend_width, snap, facets_max, ..
        } = CreaseParams::default();
        assert_eq!(CreaseParams::default().angle_off_landmarks_deg, 35.0);
        assert_eq!((mode, hits, facets_max), (CreaseMode::Lines, 2, 32));
        assert_eq!((angle_min_deg, evidence, bend_width, snap), (12.0, 7.0, 2.5, 0.3));
        let PaperParams { s_m2, r_div, r_fix_m2, lock, iterations } = PaperParams::default();
        assert_eq!((s_m2, r_div, r_fix_m2), (1e-6, 0.13, 6.4e-5));
        assert_eq!((lock, iterations), (Lock::Global, 20));
        assert!(CreaseParams::default().check().is_ok());
    }

    #[test]
    fn nonsense_is_reported_whole() {
        let params = CreaseParams {
            angle_min_deg: f64::NAN,
            hits: 0,
            facets_max: 33,
            plan: vec![[[0.1, 0.1], [0.1, 0.1]]],
            paper: PaperParams { s_m2: 0.0, iterations: 0, ..Default::default() },
            ..Default::default()
        };
        let keys: Vec<String> = params.check().unwrap_err().into_iter().map(|p| p.key).collect();
        let expected =
            ["angle_min_deg", "hits", "facets_max", "plan", "paper.s_m2", "paper.iterations"];
        assert_eq!(keys, expected);
    }
}
