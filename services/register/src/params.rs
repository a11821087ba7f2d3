//! The `[register]` section of a set.

use orime_creases::UNSEEN_CONFIDENCE;
use orime_geometry::SheetGrid;
use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

/// What the sheet is registered to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RegisterMode {
    /// The cloud and the contour, by Coherent Point Drift.
    #[default]
    Cpd,
    /// Recognised points of a printed sheet, by their number.
    Markers,
}

/// The `[register]` section of a set.
///
/// Lengths that are fractions of the sheet are fractions of its mean side, so that another sheet
/// needs no new tuning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RegisterParams {
    /// What the sheet is registered to: `"cpd"` (default), its cloud and contour; or `"markers"`,
    /// the features that `segment.markers` gives. The keys below, but for `isometry_sweeps` and
    /// `flatness`, are for the former.
    pub mode: RegisterMode,
    /// Confidence with which nodes that no camera recognises are carried along with what is seen
    /// near them in space, in mode `"markers"`, 0 to 1: layers that lie on one another move
    /// together. 0 gives them no targets, as the paper does. Default 0.
    pub carry_hidden: f64,
    /// How many times farther a feature's position errs along its camera's ray than across, 1 to
    /// 100: more trusts the rays of several cameras and less their depths. 1 takes the mean.
    /// Default 4.
    pub ray_error_ratio: f64,
    /// Most iterations of expectation maximisation per frame. Time grows with it. Default 8.
    pub iterations_max: u32,
    /// Stop once no node moves farther than this in an iteration, fraction of the sheet.
    /// Default 0.0003 (0.05 mm on 0.15 m).
    pub move_tolerance: f64,
    /// Width β of the motion-coherence kernel in material coordinates, fraction of the sheet:
    /// how far a node drags its neighbours along. Small values follow the kink of a new crease and
    /// overfit more. Default 0.2 (30 mm on 0.15 m).
    pub kernel_width: f64,
    /// Expected error τ of the prediction, fraction of the sheet (λ = 1/τ²): small values trust
    /// the prediction, large ones the cloud. Default 0.0115 (1.7 mm on 0.15 m).
    pub prediction_error: f64,
    /// Expected error of the prediction as a whole, fraction of the sheet, and half as far from its
    /// middle by a turn: the sheet moves as one rigid body before it bends. 0: it only bends.
    /// Default 0.033 (5 mm and 3.8° on 0.15 m).
    pub rigid_error: f64,
    /// Weight of the cloud against the prediction, 0 to 1: neighbouring depth pixels err
    /// together, so N points are worth less than N. Default 0.2.
    pub temper: f64,
    /// Smallest and largest σ that a frame starts with, fractions of the sheet. In between, 1.5
    /// times the last frame's final σ. Default 0.027 and 0.04 (4 and 6 mm on 0.15 m).
    pub sigma_start: [f64; 2],
    /// Floor of σ, fraction of the sheet. Default 0.0067 (1 mm on 0.15 m).
    pub sigma_floor: f64,
    /// Start of the outlier weight w, which then follows the share of unexplained points within
    /// 0.01 to 0.5. Default 0.05.
    pub outlier_weight: f64,
    /// Widest spacing of the mixture's components, fraction of the sheet; finer ones reach a
    /// smaller σ and cost their square. Default 0.021 (3.1 mm on 0.15 m).
    pub virtual_spacing: f64,
    /// Spacing of the control points, fraction of the sheet, rounded to grid cells. Default 0.083
    /// (13 × 13).
    pub control_spacing: f64,
    /// Eigenvectors of the kernel that may move, at most. Default 48.
    pub modes_max: usize,
    /// Sweeps of the isometry projection in every iteration; 0 lets the model stretch.
    /// Default 10.
    pub isometry_sweeps: u32,
    /// How strongly the sheet is straightened between creases, 0 to 1: paper resists bending,
    /// cloth (0) hardly does; large values hide new creases. Default 0.2.
    pub flatness: f64,
    /// Most points used of a cloud; more are thinned evenly. Default 2000.
    pub points_max: usize,
    /// Fewest points that can constrain the pose. Default 60.
    pub points_min: usize,
    /// Weight of the sheet's contour in the colour images, 0 to 4; 0 leaves it out, 1 takes a
    /// contour's error for one pixel. Default 1.
    pub outline_weight: f64,
    /// Let each camera's points pull only on what that camera can see of the predicted sheet, and
    /// give nodes that nobody sees little confidence (`unseen_confidence`). Needs layers in the
    /// right order: simulate's contact. Default true.
    pub visibility: bool,
    /// Confidence of the targets of nodes that nobody sees, 0 to 0.1: the registration carries them
    /// along with what is seen of the sheet, where the simulation alone would let hidden layers of
    /// a fast stack fall behind and through each other. 0 gives them no target. Default 0.1.
    pub unseen_confidence: f64,
    /// Learn what each camera's depth errs by as a whole, from contour and other cameras, and
    /// correct it. Default true.
    pub learn_depth_bias: bool,
    /// Learn while tracking how far each camera stands from where its calibration says, and take it
    /// to stand there; without a mean over the cameras. Default true.
    pub refine_cameras: bool,
    /// Give every node a target instead of the control points (every other node) alone.
    /// Default true; false is the paper.
    pub targets_everywhere: bool,
    /// A pose explains the cloud while at least this share of the points lies on it. Below, a
    /// fresh pose is tried. Default 0.85.
    pub explained_min: f64,
}

impl Default for RegisterParams {
    fn default() -> Self {
        Self {
            mode: RegisterMode::Cpd,
            carry_hidden: 0.0,
            ray_error_ratio: 4.0,
            iterations_max: 8,
            move_tolerance: 0.0003,
            kernel_width: 0.2,
            prediction_error: 0.0115,
            rigid_error: 0.033,
            temper: 0.2,
            sigma_start: [0.027, 0.04],
            sigma_floor: 0.0067,
            outlier_weight: 0.05,
            virtual_spacing: 0.021,
            control_spacing: 0.083,
            modes_max: 48,
            isometry_sweeps: 10,
            flatness: 0.2,
            points_max: 2000,
            points_min: 60,
            outline_weight: 1.0,
            visibility: true,
            unseen_confidence: f64::from(UNSEEN_CONFIDENCE),
            learn_depth_bias: true,
            refine_cameras: true,
            targets_everywhere: true,
            explained_min: 0.85,
        }
    }
}

impl RegisterParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<RegisterConfig, Vec<Problem>> {
        let Self {
            mode: _,
            carry_hidden,
            ray_error_ratio,
            iterations_max,
            move_tolerance,
            kernel_width,
            prediction_error,
            rigid_error,
            temper,
            sigma_start,
            sigma_floor,
            outlier_weight,
            virtual_spacing,
            control_spacing,
            modes_max,
            isometry_sweeps,
            flatness,
            points_max,
            points_min,
            outline_weight,
            visibility: _,
            unseen_confidence,
            learn_depth_bias: _,
            refine_cameras: _,
            targets_everywhere: _,
            explained_min,
        } = self;
        let mut checker = Checker::new();
        let mut within = |key: &str, value: f64, low: f64, high: f64| {
            let requirement = format!("must be {low} to {high}");
            checker.require(low <= value && value <= high, key, value, &requirement);
        };
        within("carry_hidden", *carry_hidden, 0.0, 1.0);
        within("ray_error_ratio", *ray_error_ratio, 1.0, 100.0);
        within("iterations_max", f64::from(*iterations_max), 1.0, 1000.0);
        within("move_tolerance", *move_tolerance, 0.0, 0.1);
        within("kernel_width", *kernel_width, 0.02, 10.0);
        within("prediction_error", *prediction_error, 1e-4, 10.0);
        within("rigid_error", *rigid_error, 0.0, 10.0);
        within("temper", *temper, 1e-3, 1.0);
        within("sigma_floor", *sigma_floor, 1e-4, 0.1);
        within("sigma_start", sigma_start[0], *sigma_floor, 1.0);
        within("sigma_start", sigma_start[1], sigma_start[0], 1.0);
        within("outlier_weight", *outlier_weight, 0.001, 0.9);
        within("virtual_spacing", *virtual_spacing, 0.005, 0.5);
        within("control_spacing", *control_spacing, 0.01, 0.5);
        within("modes_max", *modes_max as f64, 3.0, 400.0);
        within("isometry_sweeps", f64::from(*isometry_sweeps), 0.0, 200.0);
        within("flatness", *flatness, 0.0, 1.0);
        within("unseen_confidence", *unseen_confidence, 0.0, f64::from(UNSEEN_CONFIDENCE));
        within("points_max", *points_max as f64, 100.0, 1e6);
        within("points_min", *points_min as f64, 3.0, *points_max as f64);
        within("outline_weight", *outline_weight, 0.0, 4.0);
        within("explained_min", *explained_min, 0.0, 1.0);
        checker.finish(|| RegisterConfig { params: self.clone() })
    }
}

impl RegisterParams {
    /// Components per grid cell and direction.
    pub(crate) fn virtual_per_cell(&self, sheet: &SheetGrid) -> usize {
        let [h_u, h_v] = sheet.spacing_m();
        let side_m = (sheet.size_m[0] + sheet.size_m[1]) / 2.0;
        // A hair's breadth more spacing is no reason for twice the components.
        ((h_u.max(h_v) / (self.virtual_spacing * side_m) - 1e-2).ceil() as usize).clamp(1, 12)
    }

    /// Control points along u and v.
    pub(crate) fn controls(&self, sheet: &SheetGrid) -> [usize; 2] {
        let side_m = (sheet.size_m[0] + sheet.size_m[1]) / 2.0;
        let spacing = sheet.spacing_m();
        [0, 1].map(|axis| {
            let cells = (self.control_spacing * side_m / spacing[axis]).round().max(1.0) as usize;
            (sheet.nodes[axis] - 1).div_ceil(cells).max(1) + 1
        })
    }
}

/// Checked [`RegisterParams`]: the only form that the registrar accepts.
#[derive(Debug, Clone, PartialEq)]
pub struct RegisterConfig {
    pub(crate) params: RegisterParams,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_pass_and_nonsense_is_reported_whole() {
        assert!(RegisterParams::default().check().is_ok());
        let bad = RegisterParams {
            temper: f64::NAN,
            sigma_start: [0.05, 0.01],
            points_min: 1,
            ..RegisterParams::default()
        };
        let keys: Vec<String> = bad.check().unwrap_err().into_iter().map(|p| p.key).collect();
        assert_eq!(keys, ["temper", "sigma_start", "points_min"]);
    }
}
