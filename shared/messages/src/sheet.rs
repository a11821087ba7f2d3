//! What register and simulate publish, and where the sheet truly is.

use orime_geometry::sheet::NODES_MAX;

use crate::folds::FoldsMeta;
use crate::{Header, layout, message};

/// What registration said about a step; copied through into the state.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct RegisterFigures {
    /// 0 searching, 1 tracking, 2 coasting, 3 lost.
    pub tracking: u32,
    /// 1 where the targets are a new pose for every node, to be taken over at once; 2 where that
    /// pose is the folded sheet's elsewhere, which keeps its folds.
    pub reset: u32,
    /// Iterations of expectation maximisation.
    pub iterations: u32,
    /// Standard deviation of the mixture at the end, metres.
    pub sigma_m: f32,
    /// Share of the observed points that the model explains.
    pub inlier_ratio: f32,
    /// Observed points that were not finite.
    pub points_rejected: u32,
    /// Share of the full work that there was time for, 0 to 1.
    pub effort: f32,
    /// 1 where the deadline ended the iterations.
    pub cut_short: u32,
}
layout!(RegisterFigures {
    tracking: u32,
    reset: u32,
    iterations: u32,
    sigma_m: f32,
    inlier_ratio: f32,
    points_rejected: u32,
    effort: f32,
    cut_short: u32,
});

message! {
    /// A soft target for every node of the sheet.
    pub struct Targets as "orime.Targets.v1" {
        /// Lineage and times.
        pub header: Header,
        /// What registration said.
        pub figures: RegisterFigures,
        /// Used elements of the arrays: nodes of the sheet.
        pub n_nodes: u32,
        /// Always 0.
        pub reserved: u32,
        /// World frame, metres.
        pub targets_m: [[f32; 3]; NODES_MAX],
        /// 0 means that the node has no target; up to 0.1, that nobody saw it
        /// (`register.unseen_confidence`).
        pub confidence: [f32; NODES_MAX],
    }
}

message! {
    /// The tracked sheet after one step.
    pub struct SheetState as "orime.SheetState.v3" {
        /// Lineage and times.
        pub header: Header,
        /// What registration said about this step.
        pub figures: RegisterFigures,
        /// Used elements of `positions_m`.
        pub n_nodes: u32,
        /// 1 once a first pose has been taken over; before, the positions mean nothing.
        pub has_pose: u32,
        /// Nodes along u and v.
        pub nodes: [u32; 2],
        /// Targets that were not finite and were left out.
        pub targets_rejected: u32,
        /// How far what the cameras see was moved because grippers hold the sheet elsewhere, or the
        /// table lies elsewhere, metres (`align_cameras` of `simulate.grippers` and `.table`).
        pub camera_offset_m: f32,
        /// Extent along u and v, metres.
        pub size_m: [f64; 2],
        /// Facets, creases and layer order; none where nothing is known yet.
        pub folds: FoldsMeta,
        /// World frame, metres.
        pub positions_m: [[f32; 3]; NODES_MAX],
        /// Where the nodes are expected one step later, metres, world frame as the cameras are
        /// calibrated: without `camera_offset_m`.
        pub predicted_m: [[f32; 3]; NODES_MAX],
    }
}

message! {
    /// Where the nodes truly are, from a source that knows.
    pub struct Truth as "orime.Truth.v1" {
        /// Lineage and times.
        pub header: Header,
        /// Used elements of `positions_m`; 0 where the source does not know.
        pub n_nodes: u32,
        /// Always 0.
        pub reserved: u32,
        /// World frame, metres.
        pub positions_m: [[f32; 3]; NODES_MAX],
    }
}

impl SheetState {
    /// The nodes' positions.
    pub fn positions_m(&self) -> &[[f32; 3]] {
        &self.positions_m[..(self.n_nodes as usize).min(NODES_MAX)]
    }

    /// Where the nodes are expected one step later.
    pub fn predicted_m(&self) -> &[[f32; 3]] {
        &self.predicted_m[..(self.n_nodes as usize).min(NODES_MAX)]
    }
}

impl Targets {
    /// The nodes' targets.
    pub fn targets_m(&self) -> &[[f32; 3]] {
        &self.targets_m[..(self.n_nodes as usize).min(NODES_MAX)]
    }

    /// The targets' confidences.
    pub fn confidence(&self) -> &[f32] {
        &self.confidence[..(self.n_nodes as usize).min(NODES_MAX)]
    }
}

impl Truth {
    /// The nodes' true positions; empty where the source does not know.
    pub fn positions_m(&self) -> &[[f32; 3]] {
        &self.positions_m[..(self.n_nodes as usize).min(NODES_MAX)]
    }
}

const _: () = assert!(size_of::<Targets>() == 72 + 32 + 8 + 16 * NODES_MAX);
const _: () =
    assert!(size_of::<SheetState>() == 72 + 32 + 24 + 16 + size_of::<FoldsMeta>() + 24 * NODES_MAX);
const _: () = assert!(size_of::<Truth>() == 72 + 8 + 12 * NODES_MAX);
