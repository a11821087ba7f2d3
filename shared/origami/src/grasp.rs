//! Where the sheet is held, and how the gripper stands.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::facet::FacetPose;

/// A material point that is held for a while.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grasp {
    /// The point, metres.
    pub uv_m: [f64; 2],
    /// First and last progress at which it is held.
    pub during: [f64; 2],
}

/// A gripper that holds the sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gripper {
    /// The material point between its fingers, metres.
    pub uv_m: [f64; 2],
    /// Its pose: origin in the held point, +X towards the sheet's middle, +Z out of the side that
    /// looks up while the sheet lies flat.
    pub world_from_gripper: Isometry3<f64>,
}

impl Gripper {
    /// A gripper that holds `uv_m` of a part at `pose`, coming from outside a sheet whose middle
    /// is at `middle_uv_m`.
    pub(crate) fn holding(uv_m: [f64; 2], middle_uv_m: [f64; 2], pose: &FacetPose) -> Self {
        let [du, dv] = [0, 1].map(|k| middle_uv_m[k] - uv_m[k]);
        let z = pose.normal();
        let along = pose.along_u * du + pose.along_v * dv;
        let x = (along - z * along.dot(&z)).try_normalize(1e-12).unwrap_or_else(Vector3::x);
        let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let place = Translation3::from(pose.position_m(uv_m).coords);
        Self { uv_m, world_from_gripper: Isometry3::from_parts(place, turn) }
    }
}
