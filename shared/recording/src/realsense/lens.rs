//! RealSense's inverse lens model turned into the usual one.

use orime_geometry::CameraModel;
use orime_geometry::nalgebra::{SMatrix, SVector};

/// Places along each side of the image at which the two models are made to agree.
const GRID: usize = 21;

/// The Brown–Conrady lens that is nearest to an *inverse* Brown–Conrady one (the SDK's model of
/// colour lenses), whose coefficients `lens` holds: they map distorted coordinates to straight
/// ones. Least squares over the image, linear in the coefficients; a lens without distortion
/// stays as it is, to the bit.
pub fn forward_distortion(lens: &CameraModel) -> CameraModel {
    if !lens.is_distorted() {
        return lens.clone();
    }
    let [k1, k2, p1, p2, k3] = lens.distortion;
    let mut normal = SMatrix::<f64, 5, 5>::zeros();
    let mut right = SVector::<f64, 5>::zeros();
    for k in 0..GRID * GRID {
        let share = |n: usize| n as f64 / (GRID - 1) as f64;
        let x = (share(k % GRID) * f64::from(lens.width - 1) - lens.cx_px) / lens.fx_px;
        let y = (share(k / GRID) * f64::from(lens.height - 1) - lens.cy_px) / lens.fy_px;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let straight_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let straight_y = y * radial + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y);
        let (u, v) = (straight_x, straight_y);
        let s2 = u * u + v * v;
        let rows = [
            ([u * s2, u * s2 * s2, 2.0 * u * v, s2 + 2.0 * u * u, u * s2 * s2 * s2], x - u),
            ([v * s2, v * s2 * s2, s2 + 2.0 * v * v, 2.0 * u * v, v * s2 * s2 * s2], y - v),
        ];
        for (row, difference) in rows {
            let row = SVector::from(row);
            normal += row * row.transpose();
            right += row * difference;
        }
    }
    let found = normal.cholesky().map(|factor| factor.solve(&right));
    let distortion = found.map_or(lens.distortion, Into::into);
    CameraModel { distortion, ..lens.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::nalgebra::{Point3, Vector2};

    #[test]
    fn straight_lines_of_sight_are_those_of_the_inverse_model() {
        // A D455's colour lens.
        let lens = CameraModel {
            width: 640,
            height: 480,
            fx_px: 385.0,
            fy_px: 384.5,
            cx_px: 322.0,
            cy_px: 243.0,
            distortion: [-0.0552, 0.0653, -0.0002, 0.0006, -0.0211],
        };
        let forward = forward_distortion(&lens);
        let [k1, k2, p1, p2, k3] = lens.distortion;
        for px in [[0.0, 0.0], [639.0, 0.0], [100.0, 479.0], [322.0, 200.0], [639.0, 479.0]] {
            let (x, y) = ((px[0] - lens.cx_px) / lens.fx_px, (px[1] - lens.cy_px) / lens.fy_px);
            let r2 = x * x + y * y;
            let radial = 1.0 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2;
            let straight = Point3::new(
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y),
                1.0,
            );
            let back = forward.project(&straight).unwrap();
            let error_px = (back - Vector2::from(px)).norm();
            assert!(error_px < 0.1, "{px:?} is {error_px} px off");
        }
        assert!((forward.distortion[0] - lens.distortion[0]).abs() > 0.05, "they do differ");
    }

    #[test]
    fn a_straight_lens_stays_to_the_bit() {
        let lens = CameraModel {
            width: 640,
            height: 480,
            fx_px: 613.2,
            fy_px: 613.4,
            cx_px: 319.9,
            cy_px: 239.2,
            distortion: [0.0; 5],
        };
        assert_eq!(forward_distortion(&lens), lens);
    }
}
