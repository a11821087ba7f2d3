//! Depth images corrected in place for a camera's bias and scale.

use orime_geometry::RgbdCamera;

/// Unit of corrected depth, metres: a bias of millimetres is not rounded to whole ones. It
/// reaches 6.55 m; what is farther counts as no return.
const UNIT_M: f64 = 1e-4;

/// Maps a camera's raw depth to corrected raw depth.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthCorrection {
    /// Corrected value per raw value.
    table: Vec<u16>,
}

impl DepthCorrection {
    /// The correction of a camera that measures `scale · true + bias_m`; gives `camera` the unit
    /// that its corrected depth has.
    pub fn new(camera: &mut RgbdCamera, bias_m: f64, scale: f64) -> Self {
        let old_m = camera.depth_m_per_unit;
        // Units that are finer already stay.
        let new_m = old_m.min(UNIT_M);
        camera.depth_m_per_unit = new_m;
        let corrected = |raw: u32| {
            let units = ((f64::from(raw) * old_m - bias_m) / scale / new_m).round();
            let is_return = raw > 0 && 0.0 < units && units <= f64::from(u16::MAX);
            if is_return { units as u16 } else { 0 }
        };
        Self { table: (0..=u32::from(u16::MAX)).map(corrected).collect() }
    }

    /// Corrects an image; no return stays none.
    pub fn apply(&self, depth_units: &mut [u16]) {
        for raw in depth_units {
            *raw = self.table[usize::from(*raw)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::CameraModel;
    use orime_geometry::nalgebra::Isometry3;

    fn camera(depth_m_per_unit: f64) -> RgbdCamera {
        let lens = CameraModel {
            width: 4,
            height: 1,
            fx_px: 4.0,
            fy_px: 4.0,
            cx_px: 1.5,
            cy_px: 0.0,
            distortion: [0.0; 5],
        };
        RgbdCamera {
            name: "a".into(),
            color: lens.clone(),
            depth: lens,
            color_from_depth: Isometry3::identity(),
            world_from_color: Isometry3::identity(),
            depth_m_per_unit,
        }
    }

    #[test]
    fn depth_is_put_right_to_a_tenth_of_a_millimetre() {
        let mut camera = camera(0.001);
        let correction = DepthCorrection::new(&mut camera, -0.0045, 1.01);
        let mut image = [0, 300, 1000, 7000];
        correction.apply(&mut image);
        let metres = image.map(|raw| f64::from(raw) * camera.depth_m_per_unit);
        assert_eq!((image[0], image[3]), (0, 0), "no return, and out of reach");
        for (found, raw_m) in metres[1..3].iter().zip([0.3, 1.0]) {
            let expected = (raw_m + 0.0045) / 1.01;
            assert!((found - expected).abs() <= 0.5e-4, "{found} is not {expected}");
        }
    }

    #[test]
    fn a_fine_unit_stays() {
        let mut camera = camera(5e-5);
        DepthCorrection::new(&mut camera, 0.001, 1.0);
        assert_eq!(camera.depth_m_per_unit, 5e-5);
    }
}
