//! From a layout's calibration to a camera.

use orime_geometry::nalgebra::{
    Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3,
};
use orime_geometry::{CameraModel, RgbdCamera};
use orime_params::{Checker, Problem};

use super::layout::{CameraLayout, LensLayout, PoseLayout};
use super::numbers::JsonFiles;

/// How far `RᵀR` may be from the identity, per entry: calibration files round to 1e-6 or so.
const ROTATION_DEFECT_MAX: f64 = 1e-3;

/// Builds the camera; every problem at once, keys relative to the camera.
pub(super) fn camera(
    layout: &CameraLayout,
    files: &mut JsonFiles,
) -> Result<RgbdCamera, Vec<Problem>> {
    let CameraLayout {
        name,
        color: _,
        depth: _,
        depth_m_per_unit,
        color_lens,
        depth_lens,
        color_from_depth,
        world_from_color,
        exposure: _,
    } = layout;
    let mut checker = Checker::new();
    let unit_m = match files.exactly::<1>(depth_m_per_unit) {
        Ok([unit_m]) => {
            let holds = (1e-6..=0.1).contains(&unit_m);
            checker.require(holds, "depth_m_per_unit", unit_m, "must be 0.000001 to 0.1 metres");
            unit_m
        }
        Err(message) => {
            checker.problem("depth_m_per_unit", message);
            0.0
        }
    };
    let color = lens(color_lens, files).map_err(|p| checker.nested("color_lens", p)).ok();
    let depth = match depth_lens {
        Some(depth) => lens(depth, files).map_err(|p| checker.nested("depth_lens", p)).ok(),
        None => color.clone(),
    };
    if color_from_depth.is_some() != depth_lens.is_some() {
        checker.problem(
            "color_from_depth",
            "and `depth_lens` must both be given, or both be left out for registered depth",
        );
    }
    let mut pose = |key: &str, layout: &Option<PoseLayout>| match layout {
        None => Isometry3::identity(),
        Some(layout) => rigid(layout, files).unwrap_or_else(|problems| {
            checker.nested(key, problems);
            Isometry3::identity()
        }),
    };
    let color_from_depth = pose("color_from_depth", color_from_depth);
    let world_from_color = pose("world_from_color", world_from_color);
    match (color, depth) {
        (Some(color), Some(depth)) => checker.finish(|| RgbdCamera {
            name: name.clone(),
            color,
            depth,
            color_from_depth,
            world_from_color,
            depth_m_per_unit: unit_m,
        }),
        _ => Err(checker.finish(|| ()).err().unwrap_or_default()),
    }
}

fn lens(layout: &LensLayout, files: &mut JsonFiles) -> Result<CameraModel, Vec<Problem>> {
    let LensLayout { size_px: [width, height], k, fx_px, fy_px, cx_px, cy_px, distortion } = layout;
    let mut checker = Checker::new();
    let [fx_px, fy_px, cx_px, cy_px] = match (k, [fx_px, fy_px, cx_px, cy_px]) {
        (Some(k), [None, None, None, None]) => match files.exactly::<9>(k) {
            Ok([fx, skew, cx, zero, fy, cy, ..]) => {
                let holds = skew == 0.0 && zero == 0.0;
                checker.require(holds, "k", [skew, zero], "skewed lenses are not supported");
                [fx, fy, cx, cy]
            }
            Err(message) => {
                checker.problem("k", message);
                [1.0; 4]
            }
        },
        (None, [Some(fx), Some(fy), Some(cx), Some(cy)]) => {
            [("fx_px", fx), ("fy_px", fy), ("cx_px", cx), ("cy_px", cy)].map(|(key, numbers)| {
                files.exactly::<1>(numbers).map_or_else(
                    |message| {
                        checker.problem(key, message);
                        1.0
                    },
                    |[number]| number,
                )
            })
        }
        _ => {
            checker.problem("k", "or all of `fx_px`, `fy_px`, `cx_px`, `cy_px` must be given");
            [1.0; 4]
        }
    };
    checker.require(fx_px > 0.0 && fy_px > 0.0, "k", [fx_px, fy_px], "focal lengths are positive");
    let distortion = match distortion.as_ref().map(|numbers| files.numbers(numbers)) {
        None => [0.0; 5],
        Some(Ok(found)) => match found[..] {
            [k1, k2, p1, p2] => [k1, k2, p1, p2, 0.0],
            [k1, k2, p1, p2, k3] => [k1, k2, p1, p2, k3],
            _ => {
                let count = found.len();
                checker.problem("distortion", format!("holds {count} numbers, 4 or 5 are needed"));
                [0.0; 5]
            }
        },
        Some(Err(message)) => {
            checker.problem("distortion", message);
            [0.0; 5]
        }
    };
    let (width, height) = (*width, *height);
    checker.finish(|| CameraModel { width, height, fx_px, fy_px, cx_px, cy_px, distortion })
}

fn rigid(layout: &PoseLayout, files: &mut JsonFiles) -> Result<Isometry3<f64>, Vec<Problem>> {
    let mut checker = Checker::new();
    let (key, rotation, translation) = match layout {
        PoseLayout { matrix: Some(matrix), rotation: None, translation_m: None } => {
            match files.exactly::<16>(matrix) {
                Ok([a, b, c, x, d, e, f, y, g, h, i, z, last @ ..]) => {
                    let holds = last == [0.0, 0.0, 0.0, 1.0];
                    checker.require(holds, "matrix", last, "the last row must be 0 0 0 1");
                    ("matrix", [a, b, c, d, e, f, g, h, i], [x, y, z])
                }
                Err(message) => {
                    checker.problem("matrix", message);
                    return checker.finish(Isometry3::identity);
                }
            }
        }
        PoseLayout { matrix: None, rotation: Some(rotation), translation_m: Some(translation) } => {
            let rotation = files.exactly::<9>(rotation);
            let translation = files.exactly::<3>(translation);
            match (rotation, translation) {
                (Ok(rotation), Ok(translation)) => ("rotation", rotation, translation),
                (rotation, translation) => {
                    rotation.err().into_iter().for_each(|m| checker.problem("rotation", m));
                    translation.err().into_iter().for_each(|m| checker.problem("translation_m", m));
                    return checker.finish(Isometry3::identity);
                }
            }
        }
        _ => {
            checker.problem("matrix", "or `rotation` with `translation_m` must be given");
            return checker.finish(Isometry3::identity);
        }
    };
    let matrix = Matrix3::from_row_slice(&rotation);
    let defect = (matrix.transpose() * matrix - Matrix3::identity()).amax();
    let holds = defect <= ROTATION_DEFECT_MAX && matrix.determinant() > 0.0;
    checker.require(holds, key, defect, "RᵀR − 1 must vanish: this is no rotation");
    checker.finish(|| {
        // Nearest proper rotation, so that rounding in the file does not scale the world.
        let rotation = Rotation3::from_matrix_eps(&matrix, 1e-15, 100, Rotation3::identity());
        let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
        Isometry3::from_parts(Translation3::from(Vector3::from(translation)), rotation)
    })
}
