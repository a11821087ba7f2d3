//! The `[capture.rendered]` section of a set.

use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

use super::faults::{FaultParams, FaultPreset};
use super::ink::Printed;
use super::views::{self, ViewParams, Viewpoints};

/// What is folded.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SequenceKind {
    /// One fold along the line of `fold_point` and `fold_angle_deg` (by default a book fold).
    #[default]
    HalfFold,
    /// The same fold, and back.
    FoldUnfold,
    /// The square base of the paper, 580 steps.
    SquareBase,
    /// Two outer quarters to the middle.
    GateFold,
    /// Four corners to the centre.
    Blintz,
    /// Six pleats.
    Accordion,
    /// A book fold whose bend shrinks from 30 to 0.5 mm.
    SoftFold,
    /// A wave by hand, no crease.
    Wave,
}

/// The `[capture.rendered]` section of a set: a sheet is folded on a table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderedParams {
    /// What is folded. Default `"half_fold"`; others: `"fold_unfold"`, `"square_base"`,
    /// `"gate_fold"`, `"blintz"`, `"accordion"`, `"soft_fold"`, `"wave"`.
    pub sequence: SequenceKind,
    /// How many times faster than usual, 0.1 to 10. Default 1.
    pub speed: f64,
    /// Number of frame sets from first to last, 2 to 100 000. Default what `speed` makes of the
    /// sequence's own: a half fold has 120, the square base 581 (steps 0 to 580).
    pub steps: Option<u64>,
    /// Nominal rate of the frames' exposure times, Hz. Default 30.
    pub rate_hz: f64,
    /// Everything random follows from it. Default 1.
    pub seed: u64,
    /// Arrangement of the cameras: `"three"` (default) or `"five"`.
    pub viewpoints: Viewpoints,
    /// Virtual cameras instead of `viewpoints`, up to 8. Default none.
    pub views: Vec<ViewParams>,
    /// Whether cameras below the table see through it. Default true.
    pub glass_table: bool,
    /// Image width and height, pixels, both lenses. Default 640 × 480.
    pub size_px: [u32; 2],
    /// Whether depth is registered to colour; if not (default), the depth lens sits 15 mm beside
    /// the colour lens, slightly turned and slightly wider, as in a D415.
    pub depth_registered: bool,
    /// A point of the fold line, as shares of the sheet's sides. Default the middle.
    pub fold_point: [f64; 2],
    /// Direction of the fold line from u towards v, degrees; what lies on its left moves.
    /// Default 90: a book fold that moves the half with small u.
    pub fold_angle_deg: f64,
    /// Share of the steps at rest before a half fold. Default 0.15.
    pub rest_before: f64,
    /// Share of the steps at rest after a half fold. Default 0.10.
    pub rest_after: f64,
    /// Thickness of the sheet, metres. Default 0.0001.
    pub thickness_m: f64,
    /// Where the flat sheet's centre lies on the table, metres. Default the world's origin.
    pub sheet_center_m: [f64; 2],
    /// Turn of the flat sheet on the table, degrees. Default 10.
    pub sheet_yaw_deg: f64,
    /// Colour of the sheet, 0 to 255. Default a slightly warm white.
    pub sheet_rgb: [u8; 3],
    /// What is printed on both sides: `"none"` (default) or `"markers"`, an ArUco grid with corners
    /// at every other node.
    pub printed: Printed,
    /// Colour of the table, 0 to 255. Default wood.
    pub table_rgb: [u8; 3],
    /// Strength of the textures of table (in full) and sheet (a tenth of it), 0 (off) to 1.
    /// Default 0.25.
    pub texture: f64,
    /// Metres per unit of depth. Default 0.001, as D4xx cameras store it; a D405 has 0.0001 at
    /// most.
    pub depth_m_per_unit: f64,
    /// How faulty the cameras are: `"none"`, `"noise"` (default) or `"real"`.
    pub faults: FaultPreset,
    /// Single strengths instead of the preset's.
    pub fault: FaultParams,
    /// Whether the grippers' poses and held points are told, as a robot would. Default false.
    pub gripper_poses: bool,
    /// Whether it is told which lines will be folded and when, as a robot that folds would.
    /// Default false.
    pub fold_plan: bool,
}

impl Default for RenderedParams {
    fn default() -> Self {
        Self {
            sequence: SequenceKind::HalfFold,
            speed: 1.0,
            steps: None,
            rate_hz: 30.0,
            seed: 1,
            viewpoints: Viewpoints::Three,
            views: Vec::new(),
            glass_table: true,
            size_px: [640, 480],
            depth_registered: false,
            fold_point: [0.5, 0.5],
            fold_angle_deg: 90.0,
            rest_before: 0.15,
            rest_after: 0.10,
            thickness_m: 1e-4,
            sheet_center_m: [0.0, 0.0],
            sheet_yaw_deg: 10.0,
            sheet_rgb: [250, 247, 240],
            printed: Printed::None,
            table_rgb: [132, 92, 60],
            texture: 0.25,
            depth_m_per_unit: 0.001,
            faults: FaultPreset::Noise,
            fault: FaultParams::default(),
            gripper_poses: false,
            fold_plan: false,
        }
    }
}

/// A checked `[capture.rendered]` section.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedConfig(RenderedParams);

impl RenderedConfig {
    /// The parameters, all in range; `views` is never empty.
    pub fn params(&self) -> &RenderedParams {
        &self.0
    }
}

impl RenderedParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<RenderedConfig, Vec<Problem>> {
        let Self {
            sequence: _,
            speed,
            steps,
            rate_hz,
            seed: _,
            viewpoints,
            views,
            glass_table: _,
            size_px: [width, height],
            depth_registered: _,
            fold_point,
            fold_angle_deg,
            rest_before,
            rest_after,
            thickness_m,
            sheet_center_m,
            sheet_yaw_deg,
            sheet_rgb: _,
            printed: _,
            table_rgb: _,
            texture,
            depth_m_per_unit,
            faults: _,
            fault,
            gripper_poses: _,
            fold_plan: _,
        } = self;
        let mut checker = Checker::new();
        let mut range = |key: &str, value: f64, low: f64, high: f64| {
            let requirement = format!("must be {low} to {high}");
            checker.require(low <= value && value <= high, key, value, &requirement);
        };
        range("speed", *speed, 0.1, 10.0);
        range("steps", steps.map_or(2.0, |steps| steps as f64), 2.0, 1e5);
        range("rate_hz", *rate_hz, 0.1, 1000.0);
        range("fold_point[0]", fold_point[0], 0.0, 1.0);
        range("fold_point[1]", fold_point[1], 0.0, 1.0);
        range("fold_angle_deg", *fold_angle_deg, -1e6, 1e6);
        range("rest_before", *rest_before, 0.0, 1.0);
        range("rest_after", *rest_after, 0.0, 0.95 - rest_before);
        range("thickness_m", *thickness_m, 1e-6, 0.005);
        range("sheet_center_m[0]", sheet_center_m[0], -1.0, 1.0);
        range("sheet_center_m[1]", sheet_center_m[1], -1.0, 1.0);
        range("sheet_yaw_deg", *sheet_yaw_deg, -1e6, 1e6);
        range("texture", *texture, 0.0, 1.0);
        range("depth_m_per_unit", *depth_m_per_unit, 1e-5, 0.01);
        range("size_px[0]", f64::from(*width), 64.0, 1920.0);
        range("size_px[1]", f64::from(*height), 48.0, 1200.0);
        views::check(views, &mut checker);
        fault.check(&mut checker);
        checker.finish(|| {
            let views = if views.is_empty() { viewpoints.views() } else { views.clone() };
            RenderedConfig(Self { views, ..self.clone() })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_scenes_are_reported_whole() {
        let mut params = RenderedParams {
            steps: Some(1),
            rest_before: 0.6,
            rest_after: 0.6,
            thickness_m: 0.1,
            views: Viewpoints::Three.views(),
            ..RenderedParams::default()
        };
        params.fault.hole_rate = Some(f64::NAN);
        params.views[1].name = "overhead".into();
        params.views[2].eye_m = [0.0, 0.0, -0.05];
        let keys: Vec<String> = params.check().unwrap_err().into_iter().map(|p| p.key).collect();
        assert_eq!(
            keys,
            [
                "steps",
                "rest_after",
                "thickness_m",
                "views[1].name",
                "views[2].eye_m",
                "fault.hole_rate"
            ]
        );
    }

    #[test]
    fn documented_defaults_hold() {
        let p = RenderedParams::default();
        assert_eq!((p.steps, p.rate_hz, p.size_px), (None, 30.0, [640, 480]));
        assert_eq!((p.depth_m_per_unit, p.faults), (0.001, FaultPreset::Noise));
        let config = p.check().unwrap();
        assert_eq!(config.params().views.len(), 3);
        for view in &config.params().views {
            let distance_m = view.eye_m.iter().map(|x| x * x).sum::<f64>().sqrt();
            assert!((0.5..=0.6).contains(&distance_m), "{} at {distance_m} m", view.name);
        }
        assert_eq!(Viewpoints::Five.views().len(), 5);
    }
}
