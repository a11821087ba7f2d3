//! What a robot is about to fold.

use bytemuck::{Pod, Zeroable};

use crate::{Header, layout, message};

/// Most lines of a plan.
pub const PLAN_LINES_MAX: usize = 32;

/// One line that is about to be folded.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct PlanLineMeta {
    /// Two points of it, (u, v), metres.
    pub ends_uv_m: [[f64; 2]; 2],
    /// From which exposure on it may be folded, in the clock of the message's `exposure_ns`,
    /// nanoseconds.
    pub valid_from_ns: u64,
}
layout!(PlanLineMeta { ends_uv_m: [[f64; 2]; 2], valid_from_ns: u64 });

message! {
    /// The whole plan from an exposure on, in place of the one before.
    pub struct FoldPlan as "orime.FoldPlan.v1" {
        /// Lineage and times: the plan holds for targets from `exposure_ns` on.
        pub header: Header,
        /// Used elements of `lines`; 0 where nothing is planned any more.
        pub n_lines: u32,
        /// Always 0.
        pub reserved: u32,
        /// The lines.
        pub lines: [PlanLineMeta; PLAN_LINES_MAX],
    }
}

impl FoldPlan {
    /// The lines; `None` where the sender's number is not one.
    pub fn lines(&self) -> Option<&[PlanLineMeta]> {
        self.lines.get(..self.n_lines as usize)
    }
}

const _: () = assert!(size_of::<PlanLineMeta>() == 40);
const _: () = assert!(size_of::<FoldPlan>() == 72 + 8 + 40 * PLAN_LINES_MAX);
