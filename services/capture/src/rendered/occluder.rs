//! What holds the sheet and hides it from the cameras.

use orime_geometry::nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use orime_origami::{FacetPose, Gripper};
use serde::{Deserialize, Serialize};

use super::scene::Face;

/// What holds the moving corner or edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Occluder {
    /// Nothing that a camera sees.
    None,
    /// A parallel gripper for each held point.
    Grippers,
    /// A hand for each held point.
    Hand,
}

/// Most faces that the occluders add: two hands.
pub(super) const FACES_MAX: usize = 2 * HAND.len() * 6;

/// One block of an occluder in the gripper's frame (+X towards the sheet's middle, +Z up).
struct Block {
    center_m: [f64; 3],
    half_m: [f64; 3],
    /// Turn about +Z, radians.
    yaw_rad: f64,
}

const fn block(center_m: [f64; 3], half_m: [f64; 3], yaw_rad: f64) -> Block {
    Block { center_m, half_m, yaw_rad }
}

/// Two fingers and a body behind them.
const GRIPPER: [Block; 3] = [
    block([-0.017, 0.0, 0.0035], [0.021, 0.004, 0.003], 0.0),
    block([-0.017, 0.0, -0.0035], [0.021, 0.004, 0.003], 0.0),
    block([-0.068, 0.0, 0.0], [0.030, 0.016, 0.012], 0.0),
];

/// Thumb and forefinger on the sheet, three bent fingers, the back of the hand, the forearm.
const HAND: [Block; 7] = [
    block([-0.022, 0.004, 0.009], [0.028, 0.008, 0.008], 0.15),
    block([-0.022, -0.004, -0.009], [0.028, 0.009, 0.008], -0.25),
    block([-0.042, 0.024, -0.004], [0.022, 0.008, 0.009], 0.1),
    block([-0.046, 0.040, -0.006], [0.020, 0.008, 0.009], 0.1),
    block([-0.050, 0.055, -0.008], [0.017, 0.007, 0.008], 0.1),
    block([-0.098, 0.022, 0.002], [0.046, 0.040, 0.013], 0.1),
    block([-0.195, 0.030, 0.006], [0.070, 0.028, 0.022], 0.05),
];

const STEEL_RGB: [f32; 3] = [74.0, 78.0, 84.0];
const SKIN_RGB: [f32; 3] = [198.0, 146.0, 118.0];

/// How far an occluder comes from above the sheet's plane, radians, so that it clears the table.
const RAISED_RAD: f64 = 0.45;

impl Occluder {
    /// Adds the faces of whatever holds the sheet.
    pub(super) fn add_faces(self, grippers: impl Iterator<Item = Gripper>, faces: &mut Vec<Face>) {
        let (blocks, rgb): (&[Block], _) = match self {
            Self::None => return,
            Self::Grippers => (&GRIPPER, STEEL_RGB),
            Self::Hand => (&HAND, SKIN_RGB),
        };
        for gripper in grippers.take(2) {
            let world_from_gripper = raised(&gripper.world_from_gripper);
            for block in blocks {
                add_block(block, &world_from_gripper, rgb, faces);
            }
        }
    }
}

/// Turned about the held point so that the body (behind, along −X) comes from above.
fn raised(world_from_gripper: &Isometry3<f64>) -> Isometry3<f64> {
    let behind = world_from_gripper * -Vector3::x();
    let level = Vector3::new(behind.x, behind.y, 0.0);
    // Straight up or down there is no level direction to come from.
    let Some(level) = level.try_normalize(1e-6) else { return *world_from_gripper };
    let slope = behind.z.atan2(behind.dot(&level));
    let up = (RAISED_RAD - slope).max(0.0);
    let axis = Unit::new_normalize(level.cross(&Vector3::z()));
    let turn = UnitQuaternion::from_axis_angle(&axis, up);
    Isometry3::from_parts(world_from_gripper.translation, turn * world_from_gripper.rotation)
}

fn add_block(block: &Block, pose: &Isometry3<f64>, rgb: [f32; 3], faces: &mut Vec<Face>) {
    let center = Vector3::from(block.center_m);
    let world_from_block = pose * Isometry3::new(center, Vector3::new(0.0, 0.0, block.yaw_rad));
    let half = Vector3::from(block.half_m);
    for axis in 0..3 {
        let [across, along] = [(axis + 1) % 3, (axis + 2) % 3];
        let (a, b) = (half[across], half[along]);
        let corners = [[-a, -b], [a, -b], [a, b], [-a, b]];
        let unit = |k: usize| Vector3::ith(k, 1.0);
        for side in [half[axis], -half[axis]] {
            let face = FacetPose {
                origin_m: (world_from_block * Point3::from(unit(axis) * side)).coords,
                along_u: world_from_block * unit(across),
                along_v: world_from_block * unit(along),
            };
            faces.push(Face::new(&corners, face, rgb, false));
        }
    }
}
