//! Where the grippers are that hold the sheet.

use bytemuck::{Pod, Zeroable};

use crate::{Header, PoseMeta, layout, message};

/// Most grippers that hold a sheet at a time.
pub const GRIPPERS_MAX: usize = 4;

/// One gripper, as the robot that moves it knows it.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct GripperMeta {
    /// Its pose in the world: origin in the held point, +X towards the sheet's middle, +Z out of
    /// the side that looks up while the sheet lies flat.
    pub world_from_gripper: PoseMeta,
    /// The material point (u, v) between its fingers, metres; means nothing while it holds none.
    pub grasped_uv_m: [f64; 2],
    /// 1 while it holds the sheet, 0 while it does not.
    pub is_holding: u32,
    /// Always 0.
    pub reserved: u32,
}
layout!(GripperMeta {
    world_from_gripper: PoseMeta,
    grasped_uv_m: [f64; 2],
    is_holding: u32,
    reserved: u32,
});

message! {
    /// The grippers at one step, at the exposure of camera 0.
    pub struct Grippers as "orime.Grippers.v1" {
        /// Lineage and times.
        pub header: Header,
        /// Used elements of `grippers`.
        pub n_grippers: u32,
        /// Always 0.
        pub reserved: u32,
        /// The grippers.
        pub grippers: [GripperMeta; GRIPPERS_MAX],
    }
}

impl Grippers {
    /// The grippers.
    pub fn grippers(&self) -> &[GripperMeta] {
        &self.grippers[..(self.n_grippers as usize).min(GRIPPERS_MAX)]
    }
}

const _: () = assert!(size_of::<GripperMeta>() == 56 + 16 + 8);
const _: () = assert!(size_of::<Grippers>() == 72 + 8 + 80 * GRIPPERS_MAX);
