//! Pinhole cameras with Brown–Conrady distortion, and the RGB-D pair of them.

use nalgebra::{Isometry3, Point3, Vector2, Vector3};

/// Pinhole camera with Brown–Conrady distortion (OpenCV's five-parameter model).
#[derive(Debug, Clone, PartialEq)]
pub struct CameraModel {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Horizontal focal length in pixels.
    pub fx_px: f64,
    /// Vertical focal length in pixels.
    pub fy_px: f64,
    /// Principal point, column; pixel centres are integers.
    pub cx_px: f64,
    /// Principal point, row; pixel centres are integers.
    pub cy_px: f64,
    /// `k1, k2, p1, p2, k3`, on normalised coordinates; all zero means none.
    pub distortion: [f64; 5],
}

impl CameraModel {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether any distortion coefficient is non-zero.
    pub fn is_distorted(&self) -> bool {
        self.distortion.iter().any(|k| *k != 0.0)
    }

    /// Pixel of a point in this camera's optical frame, or `None` at or behind the image plane.
    pub fn project(&self, point_in_camera: &Point3<f64>) -> Option<Vector2<f64>> {
        if point_in_camera.z <= 1e-9 {
            return None;
        }
        let x = point_in_camera.x / point_in_camera.z;
        let y = point_in_camera.y / point_in_camera.z;
        let (x, y) = self.distort(x, y);
        Some(Vector2::new(self.fx_px * x + self.cx_px, self.fy_px * y + self.cy_px))
    }

    /// Viewing ray of a pixel in the optical frame, scaled so that `z = 1`.
    ///
    /// Inverts the distortion by fixed-point iteration (ten rounds; RealSense and Xtion lenses
    /// converge below 1e-6 of a pixel in five).
    pub fn ray(&self, pixel: Vector2<f64>) -> Vector3<f64> {
        let target_x = (pixel.x - self.cx_px) / self.fx_px;
        let target_y = (pixel.y - self.cy_px) / self.fy_px;
        if !self.is_distorted() {
            return Vector3::new(target_x, target_y, 1.0);
        }
        let (mut x, mut y) = (target_x, target_y);
        for _ in 0..10 {
            let (distorted_x, distorted_y) = self.distort(x, y);
            x += target_x - distorted_x;
            y += target_y - distorted_y;
        }
        Vector3::new(x, y, 1.0)
    }

    /// Brown–Conrady: normalised coordinates to distorted normalised coordinates.
    fn distort(&self, x: f64, y: f64) -> (f64, f64) {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }
}

/// One RGB-D camera: two lenses, the transform between them, and where it stands.
#[derive(Debug, Clone, PartialEq)]
pub struct RgbdCamera {
    /// Name for people, unique in a set.
    pub name: String,
    /// The colour lens.
    pub color: CameraModel,
    /// The depth lens; equal to `color` where depth is registered to colour.
    pub depth: CameraModel,
    /// Maps depth-optical coordinates into colour-optical ones, metres.
    pub color_from_depth: Isometry3<f64>,
    /// Maps colour-optical coordinates into the world, metres.
    pub world_from_color: Isometry3<f64>,
    /// Metres per unit of a raw depth value; raw 0 means no return.
    pub depth_m_per_unit: f64,
}

impl RgbdCamera {
    /// Maps depth-optical coordinates into the world.
    pub fn world_from_depth(&self) -> Isometry3<f64> {
        self.world_from_color * self.color_from_depth
    }

    /// Whether one pixel of depth and one of colour see along the same ray (registered depth).
    pub fn depth_is_registered(&self) -> bool {
        self.color == self.depth && self.color_from_depth == Isometry3::identity()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn xtion() -> CameraModel {
        CameraModel {
            width: 640,
            height: 480,
            fx_px: 534.3,
            fy_px: 534.7,
            cx_px: 309.6,
            cy_px: 243.1,
            distortion: [-0.0438, 0.0517, 0.0004, -0.0021, -0.0912],
        }
    }

    #[test]
    fn ray_inverts_project_over_the_whole_image() {
        let camera = xtion();
        for pixel in [(0.0, 0.0), (639.0, 0.0), (0.0, 479.0), (639.0, 479.0), (311.25, 99.5)] {
            let pixel = Vector2::new(pixel.0, pixel.1);
            let point = Point3::from(camera.ray(pixel) * 0.7);
            let back = camera.project(&point).unwrap();
            assert!((back - pixel).norm() < 1e-6, "{pixel} came back as {back}");
        }
    }

    #[test]
    fn a_known_point_lands_on_its_hand_computed_pixel() {
        let camera = CameraModel { distortion: [0.1, 0.0, 0.01, 0.02, 0.0], ..xtion() };
        // x = 0.2, y = -0.1: r² = 0.05, radial = 1.005,
        // x' = 0.201 + 2·0.01·(-0.02) + 0.02·(0.05 + 0.08) = 0.2032
        // y' = -0.1005 + 0.01·(0.05 + 0.02) + 2·0.02·(-0.02) = -0.1006
        let pixel = camera.project(&Point3::new(0.1, -0.05, 0.5)).unwrap();
        assert!((pixel.x - (534.3 * 0.2032 + 309.6)).abs() < 1e-9);
        assert!((pixel.y - (534.7 * -0.1006 + 243.1)).abs() < 1e-9);
    }

    #[test]
    fn points_behind_the_camera_have_no_pixel() {
        assert_eq!(xtion().project(&Point3::new(0.0, 0.0, 0.0)), None);
        assert_eq!(xtion().project(&Point3::new(0.1, 0.0, -1.0)), None);
    }
}
