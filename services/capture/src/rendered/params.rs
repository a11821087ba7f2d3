//! The `[capture.rendered]` section of a set.

use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

/// One virtual camera's place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewParams {
    /// Name for people, unique in the set.
    pub name: String,
    /// Where the colour lens is, world frame, metres; above the table.
    pub eye_m: [f64; 3],
    /// What the middle of the colour image shows, world frame, metres.
    pub look_at_m: [f64; 3],
}

/// The `[capture.rendered]` section of a set: a sheet is folded once on a table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderedParams {
    /// Number of frame sets from flat to folded, 2 to 100 000. Default 120.
    pub steps: u64,
    /// Nominal rate of the frames' exposure times, Hz. Default 30.
    pub rate_hz: f64,
    /// Everything random follows from it. Default 1.
    pub seed: u64,
    /// Virtual cameras, 1 to 8. Default: overhead and two oblique ones, 0.5 to 0.6 m away.
    pub views: Vec<ViewParams>,
    /// Image width and height, pixels, both lenses. The field of view does not change with it.
    /// Default 640 × 480.
    pub size_px: [u32; 2],
    /// Whether depth is registered to colour; if not (default), the depth lens sits 15 mm beside
    /// the colour lens, slightly turned and slightly wider, as in a D415.
    pub depth_registered: bool,
    /// A point of the fold line, as shares of the sheet's sides. Default the middle.
    pub fold_point: [f64; 2],
    /// Direction of the fold line from u towards v, degrees; what lies on its left moves.
    /// Default 90: a book fold that moves the half with small u.
    pub fold_angle_deg: f64,
    /// Share of the steps at rest before the fold. Default 0.15.
    pub rest_before: f64,
    /// Share of the steps at rest after the fold. Default 0.10.
    pub rest_after: f64,
    /// Thickness of the sheet, metres. Default 0.0001.
    pub thickness_m: f64,
    /// Where the flat sheet's centre lies on the table, metres. Default the world's origin.
    pub sheet_center_m: [f64; 2],
    /// Turn of the flat sheet on the table, degrees. Default 10.
    pub sheet_yaw_deg: f64,
    /// Colour of the sheet, 0 to 255. Default a slightly warm white.
    pub sheet_rgb: [u8; 3],
    /// Colour of the table, 0 to 255. Default wood.
    pub table_rgb: [u8; 3],
    /// Strength of the textures of table (in full) and sheet (a tenth of it), 0 (off) to 1.
    /// Default 0.25.
    pub texture: f64,
    /// Metres per unit of depth. Default 0.001, as D4xx cameras store it.
    pub depth_m_per_unit: f64,
    /// σ₀ of the depth noise σ² = σ₀² + (k z²)², metres; 0 is off. Default 0.00039 (fitted on
    /// real D415s).
    pub noise_floor_m: f64,
    /// k of the depth noise, 1/m; 0 is off. Default 0.0028 (fitted on real D415s).
    pub noise_per_m: f64,
    /// Distance at which the depth noise's correlation falls to 1/e, pixels; 0 makes it white.
    /// Real cameras show 3 to 6. Default 3.
    pub noise_correlation_px: f64,
    /// Share of depth pixels without return, in blobs of the noise's correlation, 0 (default,
    /// off) to 0.5.
    pub hole_rate: f64,
}

impl Default for RenderedParams {
    fn default() -> Self {
        let view = |name: &str, eye_m: [f64; 3]| ViewParams {
            name: name.to_owned(),
            eye_m,
            look_at_m: [0.0, 0.0, 0.02],
        };
        Self {
            steps: 120,
            rate_hz: 30.0,
            seed: 1,
            views: vec![
                view("overhead", [0.0, 0.0, 0.52]),
                view("left", [-0.34, -0.21, 0.34]),
                view("right", [0.36, -0.19, 0.35]),
            ],
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
            table_rgb: [132, 92, 60],
            texture: 0.25,
            depth_m_per_unit: 0.001,
            noise_floor_m: 0.000_39,
            noise_per_m: 0.0028,
            noise_correlation_px: 3.0,
            hole_rate: 0.0,
        }
    }
}

/// A checked `[capture.rendered]` section.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedConfig(RenderedParams);

impl RenderedConfig {
    /// The parameters, all in range.
    pub fn params(&self) -> &RenderedParams {
        &self.0
    }
}

impl RenderedParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<RenderedConfig, Vec<Problem>> {
        let mut checker = Checker::new();
        self.check_motion(&mut checker);
        self.check_views(&mut checker);
        self.check_faults(&mut checker);
        checker.finish(|| RenderedConfig(self.clone()))
    }

    fn check_motion(&self, checker: &mut Checker) {
        let Self {
            steps,
            rate_hz,
            seed: _,
            fold_point,
            fold_angle_deg,
            rest_before,
            rest_after,
            thickness_m,
            sheet_center_m,
            sheet_yaw_deg,
            // The rest is for `check_views` and `check_faults`.
            views: _,
            size_px: _,
            depth_registered: _,
            sheet_rgb: _,
            table_rgb: _,
            texture: _,
            depth_m_per_unit: _,
            noise_floor_m: _,
            noise_per_m: _,
            noise_correlation_px: _,
            hole_rate: _,
        } = self;
        let share = |s: &f64| 0.0 <= *s && *s <= 1.0;
        checker.require((2..=100_000).contains(steps), "steps", steps, "must be 2 to 100000");
        checker.require(within(*rate_hz, 0.1, 1000.0), "rate_hz", rate_hz, "must be 0.1 to 1000");
        checker.require(
            fold_point.iter().all(share),
            "fold_point",
            fold_point,
            "both must be shares of the sheet's sides, 0 to 1",
        );
        checker.require(
            fold_angle_deg.is_finite(),
            "fold_angle_deg",
            fold_angle_deg,
            "must be a number of degrees",
        );
        checker.require(
            share(rest_before) && share(rest_after) && rest_before + rest_after <= 0.95,
            "rest_before",
            [rest_before, rest_after],
            "with `rest_after` must leave a share of at least 0.05 for the move",
        );
        checker.require(
            within(*thickness_m, 1e-6, 0.005),
            "thickness_m",
            thickness_m,
            "must be 0.000001 to 0.005 metres",
        );
        checker.require(
            sheet_center_m.iter().all(|x| within(*x, -1.0, 1.0)),
            "sheet_center_m",
            sheet_center_m,
            "must lie within 1 metre of the origin",
        );
        checker.require(
            sheet_yaw_deg.is_finite(),
            "sheet_yaw_deg",
            sheet_yaw_deg,
            "must be a number of degrees",
        );
    }

    fn check_views(&self, checker: &mut Checker) {
        let [width, height] = self.size_px;
        checker.require(
            (64..=1920).contains(&width) && (48..=1200).contains(&height),
            "size_px",
            self.size_px,
            "must be 64 × 48 to 1920 × 1200 pixels",
        );
        let count = self.views.len();
        checker.require((1..=8).contains(&count), "views", count, "1 to 8 cameras");
        for (k, view) in self.views.iter().enumerate() {
            let ViewParams { name, eye_m, look_at_m } = view;
            let key = |field: &str| format!("views[{k}].{field}");
            if name.is_empty() || self.views[..k].iter().any(|other| other.name == *name) {
                checker.require(false, &key("name"), name, "must be unique and not empty");
            }
            checker.require(
                eye_m.iter().all(|x| within(*x, -3.0, 3.0)) && eye_m[2] >= 0.1,
                &key("eye_m"),
                eye_m,
                "must lie within 3 metres of the origin and at least 0.1 above the table",
            );
            let distance_m = (0..3).map(|i| (eye_m[i] - look_at_m[i]).powi(2)).sum::<f64>().sqrt();
            checker.require(
                within(distance_m, 0.05, 10.0),
                &key("look_at_m"),
                look_at_m,
                "must be 0.05 to 10 metres away from `eye_m`",
            );
        }
    }

    fn check_faults(&self, checker: &mut Checker) {
        for (key, value, low, high) in [
            ("texture", self.texture, 0.0, 1.0),
            ("depth_m_per_unit", self.depth_m_per_unit, 1e-5, 0.01),
            ("noise_floor_m", self.noise_floor_m, 0.0, 0.05),
            ("noise_per_m", self.noise_per_m, 0.0, 0.1),
            ("noise_correlation_px", self.noise_correlation_px, 0.0, 20.0),
            ("hole_rate", self.hole_rate, 0.0, 0.5),
        ] {
            let range = format!("must be {low} to {high}");
            checker.require(within(value, low, high), key, value, &range);
        }
    }
}

/// Phrased so that NaN is outside.
fn within(value: f64, low: f64, high: f64) -> bool {
    low <= value && value <= high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_scenes_are_reported_whole() {
        let mut params = RenderedParams {
            steps: 1,
            rest_before: 0.6,
            rest_after: 0.6,
            hole_rate: f64::NAN,
            thickness_m: 0.1,
            ..RenderedParams::default()
        };
        params.views[1].name = "overhead".into();
        params.views[2].eye_m = [0.0, 0.0, -0.5];
        let keys: Vec<String> = params.check().unwrap_err().into_iter().map(|p| p.key).collect();
        assert_eq!(
            keys,
            ["steps", "rest_before", "thickness_m", "views[1].name", "views[2].eye_m", "hole_rate"]
        );
    }

    #[test]
    fn documented_defaults_hold() {
        let p = RenderedParams::default();
        assert_eq!((p.steps, p.rate_hz, p.size_px), (120, 30.0, [640, 480]));
        assert_eq!((p.noise_floor_m, p.noise_per_m, p.hole_rate), (0.00039, 0.0028, 0.0));
        assert_eq!((p.depth_m_per_unit, p.noise_correlation_px), (0.001, 3.0));
        for view in &p.views {
            let distance_m = view.eye_m.iter().map(|x| x * x).sum::<f64>().sqrt();
            assert!((0.5..=0.6).contains(&distance_m), "{} at {distance_m} m", view.name);
        }
        assert!(p.check().is_ok());
    }
}
