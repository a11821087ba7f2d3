//! A camera under a sheet.

use orime_geometry::nalgebra::Isometry3;
use orime_geometry::{CameraModel, RgbdCamera};

/// A camera half a metre below the sheet that looks up at it.
pub fn camera() -> RgbdCamera {
    let lens = CameraModel {
        width: 640,
        height: 480,
        fx_px: 600.0,
        fy_px: 600.0,
        cx_px: 320.0,
        cy_px: 240.0,
        distortion: [0.0; 5],
    };
    RgbdCamera {
        name: "below".into(),
        color: lens.clone(),
        depth: lens,
        color_from_depth: Isometry3::identity(),
        world_from_color: Isometry3::translation(0.0, 0.0, -0.5),
        depth_m_per_unit: 0.001,
    }
}
