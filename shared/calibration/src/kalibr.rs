//! Kalibr's camchain files.

use std::collections::BTreeMap;

use orime_geometry::nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use serde::Deserialize;

use crate::file::{Calibration, CameraEntry, LensEntry};

/// How far `RᵀR` may be from the identity, per entry.
const ROTATION_DEFECT_MAX: f64 = 1e-3;

/// One camera of a camchain; keys that are not listed are of no use here.
#[derive(Debug, Deserialize)]
struct Camera {
    camera_model: String,
    intrinsics: Vec<f64>,
    #[serde(default)]
    distortion_model: Option<String>,
    #[serde(default)]
    distortion_coeffs: Vec<f64>,
    resolution: [u32; 2],
    /// Maps the coordinates of the camera before into this one's.
    #[serde(rename = "T_cn_cnm1")]
    this_from_before: Option<Vec<Vec<f64>>>,
}

/// The cameras of a camchain; camera 0 is the world.
pub(crate) fn import(text: &str, names: &[&str]) -> Result<Calibration, String> {
    let cameras: BTreeMap<String, Camera> = serde_saphyr::from_str(text)
        .map_err(|error| format!("is neither Kalibr's camchain nor ROS's camera_info: {error}"))?;
    // cam10 comes after cam9.
    let mut cameras: Vec<(String, Camera)> = cameras.into_iter().collect();
    cameras.sort_by_key(|(name, _)| (name.len(), name.clone()));
    let by_name = cameras.iter().any(|(name, _)| names.contains(&name.as_str()));
    if !by_name && cameras.len() != names.len() {
        return Err(format!(
            "has {} cameras with other names than the source's {names:?}: name them alike, or \
             give as many in the same order",
            cameras.len()
        ));
    }
    let mut world_from_this = Isometry3::identity();
    let mut entries = Vec::new();
    for (k, (name, camera)) in cameras.iter().enumerate() {
        let wrong = |message: String| format!("`{name}`: {message}");
        if k > 0 {
            let rows = camera.this_from_before.as_ref().ok_or_else(|| {
                wrong("has no `T_cn_cnm1`: calibrate the cameras together".to_owned())
            })?;
            world_from_this *= rigid(rows).map_err(wrong)?.inverse();
        }
        entries.push(CameraEntry {
            name: if by_name { name.clone() } else { names[k].to_owned() },
            world_from_color: Some((&world_from_this).into()),
            color_lens: Some(lens(camera).map_err(wrong)?),
            depth: None,
        });
    }
    Ok(Calibration { camera: entries })
}

fn lens(camera: &Camera) -> Result<LensEntry, String> {
    if camera.camera_model != "pinhole" {
        let model = &camera.camera_model;
        return Err(format!("`camera_model` is `{model}`: calibrate it as `pinhole-radtan`"));
    }
    let [fx, fy, cx, cy] = camera.intrinsics[..] else {
        return Err("`intrinsics` must be fu, fv, pu, pv".to_owned());
    };
    let distortion = match (camera.distortion_model.as_deref(), &camera.distortion_coeffs[..]) {
        (None | Some("none"), _) => [0.0; 5],
        (Some("radtan"), [k1, k2, p1, p2]) => [*k1, *k2, *p1, *p2, 0.0],
        (Some("radtan"), [k1, k2, p1, p2, k3]) => [*k1, *k2, *p1, *p2, *k3],
        (Some(model), coefficients) => {
            let n = coefficients.len();
            return Err(format!(
                "`distortion_model` is `{model}` with {n} coefficients: calibrate it as `radtan`"
            ));
        }
    };
    Ok(LensEntry {
        size_px: camera.resolution,
        focal_px: [fx, fy],
        principal_px: [cx, cy],
        distortion,
    })
}

fn rigid(rows: &[Vec<f64>]) -> Result<Isometry3<f64>, String> {
    let flat: Vec<f64> = rows.iter().flatten().copied().collect();
    let (16, 4) = (flat.len(), rows.len()) else {
        return Err("`T_cn_cnm1` must be 4 × 4".to_owned());
    };
    let matrix = Matrix3::from_fn(|row, column| flat[4 * row + column]);
    let defect = (matrix.transpose() * matrix - Matrix3::identity()).amax();
    let holds = defect <= ROTATION_DEFECT_MAX && matrix.determinant() > 0.0;
    if !holds {
        return Err(format!("`T_cn_cnm1` holds no rotation: RᵀR − 1 is {defect}"));
    }
    let rotation = Rotation3::from_matrix_eps(&matrix, 1e-15, 100, Rotation3::identity());
    Ok(Isometry3::from_parts(
        Translation3::new(flat[3], flat[7], flat[11]),
        UnitQuaternion::from_rotation_matrix(&rotation),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::nalgebra::Point3;

    const CHAIN: &str = "\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.01, 0.02, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [460.1, 459.2, 320.5, 241.3]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.0, -1.0, 0.0, 0.1]
  - [1.0, 0.0, 0.0, 0.2]
  - [0.0, 0.0, 1.0, 0.3]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [461.0, 460.0, 319.5, 240.3]
  resolution: [640, 480]
  rostopic: /cam1/image_raw
";

    #[test]
    fn a_chain_is_turned_into_poses_in_the_world() {
        let found = import(CHAIN, &["left", "right"]).unwrap();
        assert_eq!(found.camera[1].name, "right");
        let pose = found.camera[1].world_from_color.unwrap().isometry().unwrap();
        // T_cn_cnm1 puts (1, 2, 3) of camera 0 at (-2 + 0.1, 1 + 0.2, 3 + 0.3) of camera 1.
        let back = pose * Point3::new(-1.9, 1.2, 3.3);
        assert!((back - Point3::new(1.0, 2.0, 3.0)).norm() < 1e-12, "{back}");
        let lens = found.camera[0].color_lens.unwrap();
        assert_eq!(lens.distortion, [-0.01, 0.02, 0.001, -0.002, 0.0]);
        assert_eq!(lens.focal_px, [460.1, 459.2]);
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let error = |text: &str, names: &[&str]| import(text, names).unwrap_err();
        assert!(error(CHAIN, &["a", "b", "c"]).contains("2 cameras"));
        let fisheye = CHAIN.replace("radtan", "equidistant");
        assert!(error(&fisheye, &["a", "b"]).contains("`radtan`"));
        let mirrored = CHAIN.replace("[0.0, 0.0, 1.0, 0.3]", "[0.0, 0.0, -1.0, 0.3]");
        assert!(error(&mirrored, &["a", "b"]).contains("no rotation"));
        assert!(error("just a text", &["a"]).contains("neither"));
    }
}
