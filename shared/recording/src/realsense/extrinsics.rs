//! Extrinsics of a stream, in the numbers that the SDK uses.

use orime_geometry::nalgebra::{
    Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3,
};

/// A rotation and a translation as `rs2_extrinsics` has them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extrinsics {
    /// Column by column.
    pub rotation: [f32; 9],
    /// Metres.
    pub translation_m: [f32; 3],
}

impl Extrinsics {
    /// No motion.
    pub const IDENTITY: Self =
        Self { rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], translation_m: [0.0; 3] };

    /// From a quaternion `x, y, z, w`, rounded as the SDK rounds.
    pub fn from_quaternion([x, y, z, w]: [f64; 4], translation_m: [f64; 3]) -> Self {
        let rotation = [
            1.0 - 2.0 * y * y - 2.0 * z * z,
            2.0 * x * y + 2.0 * z * w,
            2.0 * x * z - 2.0 * y * w,
            2.0 * x * y - 2.0 * z * w,
            1.0 - 2.0 * x * x - 2.0 * z * z,
            2.0 * y * z + 2.0 * x * w,
            2.0 * x * z + 2.0 * y * w,
            2.0 * y * z - 2.0 * x * w,
            1.0 - 2.0 * x * x - 2.0 * y * y,
        ];
        Self {
            rotation: rotation.map(|r| r as f32),
            translation_m: translation_m.map(|t| t as f32),
        }
    }

    /// The motion, its rotation made proper: single precision leaves it 1e-7 off.
    pub fn isometry(&self) -> Isometry3<f64> {
        if *self == Self::IDENTITY {
            return Isometry3::identity();
        }
        let matrix = Matrix3::from_column_slice(&self.rotation.map(f64::from));
        let rotation = Rotation3::from_matrix_eps(&matrix, 1e-15, 100, Rotation3::identity());
        Isometry3::from_parts(
            Translation3::from(Vector3::from(self.translation_m.map(f64::from))),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    }
}
