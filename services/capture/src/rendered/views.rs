//! Which cameras look from where.

use orime_geometry::CameraModel;
use orime_geometry::nalgebra::{Isometry3, Vector3};
use orime_params::Checker;
use serde::{Deserialize, Serialize};

/// A depth camera's make.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Model {
    /// 55 mm baseline, narrow; the noise's figures were measured on it.
    #[default]
    D415,
    /// 50 mm baseline, wide depth, colour lens of its own 15 mm beside.
    D435,
    /// 18 mm baseline, wide, for near objects; colour is the left depth imager's.
    D405,
}

impl Model {
    /// Distance between the two depth imagers, metres.
    pub(super) fn baseline_m(self) -> f64 {
        match self {
            Self::D415 => 0.055,
            Self::D435 => 0.050,
            Self::D405 => 0.018,
        }
    }

    /// Metres per unit of depth, unless the set asks for finer ones.
    pub(super) fn depth_m_per_unit(self, asked_m: f64) -> f64 {
        if self == Self::D405 { asked_m.min(0.0001) } else { asked_m }
    }

    /// k of the depth noise as a multiple of a D415's: 1/(focal length · baseline).
    pub(super) fn noise_ratio(self, depth: &CameraModel) -> f64 {
        if self == Self::D415 {
            return 1.0;
        }
        let at_640 = depth.fx_px * 640.0 / f64::from(depth.width);
        598.0 * Self::D415.baseline_m() / (at_640 * self.baseline_m())
    }

    /// Colour lens, depth lens, and where the depth lens is. `registered` makes depth look
    /// through the colour lens.
    pub(super) fn lenses(
        self,
        size_px: [u32; 2],
        registered: bool,
    ) -> (CameraModel, CameraModel, Isometry3<f64>) {
        let [width, height] = size_px;
        // Principal points of a real D415 at 640 × 480, scaled to the image's width.
        let scale = f64::from(width) / 640.0;
        let lens = |f_px: f64, center_px: [f64; 2]| CameraModel {
            width,
            height,
            fx_px: f_px,
            fy_px: f_px,
            cx_px: (f64::from(width) - 1.0) / 2.0 + center_px[0] * scale,
            cy_px: (f64::from(height) - 1.0) / 2.0 + center_px[1] * scale,
            distortion: [0.0; 5],
        };
        // The wide imagers cut 640 × 480 out of a larger part than 848 × 480.
        let is_wide = f64::from(width) > 1.4 * f64::from(height);
        let imager_px = if is_wide { 424.0 * f64::from(width) / 848.0 } else { 383.0 * scale };
        let (color, depth) = match self {
            Self::D415 => (lens(610.0 * scale, [4.2, 1.7]), lens(598.0 * scale, [-1.3, 3.1])),
            Self::D435 => {
                let color_px = 615.0 * f64::from(height) / 480.0;
                (lens(color_px, [2.9, -3.4]), lens(imager_px, [1.6, 0.7]))
            }
            Self::D405 => (lens(imager_px, [-2.2, 1.1]), lens(imager_px, [-2.2, 1.1])),
        };
        if registered || self == Self::D405 {
            return (color.clone(), color, Isometry3::identity());
        }
        let turn = Vector3::new(-0.0049, 0.0061, 0.0008);
        (color, depth, Isometry3::new(Vector3::new(0.015, 0.0, 0.0), turn))
    }
}

/// One virtual camera's place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewParams {
    /// Name for people, unique in the set.
    pub name: String,
    /// Make. Default `"D415"`.
    #[serde(default)]
    pub model: Model,
    /// Where the colour lens is, world frame, metres; at least 0.1 above or below the table.
    pub eye_m: [f64; 3],
    /// What the middle of the colour image shows, world frame, metres.
    pub look_at_m: [f64; 3],
}

/// A usual arrangement of cameras.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Viewpoints {
    /// D415s overhead, left and right, 0.5 to 0.6 m away.
    #[default]
    Three,
    /// As in the paper: D435 overhead and rear, D405 left, right and below.
    Five,
}

impl Viewpoints {
    /// The cameras, in the order of their indices.
    pub fn views(self) -> Vec<ViewParams> {
        let view = |name: &str, model: Model, eye_m: [f64; 3]| ViewParams {
            name: name.to_owned(),
            model,
            eye_m,
            look_at_m: [0.0, 0.0, 0.02],
        };
        match self {
            Self::Three => vec![
                view("overhead", Model::D415, [0.0, 0.0, 0.52]),
                view("left", Model::D415, [-0.34, -0.21, 0.34]),
                view("right", Model::D415, [0.36, -0.19, 0.35]),
            ],
            Self::Five => vec![
                view("overhead", Model::D435, [0.0, 0.0, 0.52]),
                view("rear", Model::D435, [0.03, 0.40, 0.33]),
                view("left", Model::D405, [-0.27, -0.10, 0.19]),
                view("right", Model::D405, [0.28, -0.08, 0.20]),
                view("below", Model::D405, [0.0, 0.0, -0.28]),
            ],
        }
    }
}

/// Notes what is wrong with these cameras.
pub(super) fn check(views: &[ViewParams], checker: &mut Checker) {
    let within = |value: f64, low: f64, high: f64| low <= value && value <= high;
    checker.require(views.len() <= 8, "views", views.len(), "at most 8 cameras");
    for (k, view) in views.iter().enumerate() {
        let ViewParams { name, model: _, eye_m, look_at_m } = view;
        let key = |field: &str| format!("views[{k}].{field}");
        if name.is_empty() || views[..k].iter().any(|other| other.name == *name) {
            checker.require(false, &key("name"), name, "must be unique and not empty");
        }
        checker.require(
            eye_m.iter().all(|x| within(*x, -3.0, 3.0)) && eye_m[2].abs() >= 0.1,
            &key("eye_m"),
            eye_m,
            "must lie within 3 metres of the origin and at least 0.1 above or below the table",
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
