//! `simulate`: soft targets in, sheet state out. Knows no process, clock or file.
//!
//! The paper's model: point masses on a grid, distance links to neighbours and to nodes `n` steps
//! away, substep XPBD with damping, and virtual zero-rest-length springs to the tracked targets.
//! Beyond it: stiff facets between creases, grippers, a table, and the prediction of the next
//! pose. A scene names the effects that it wants ([`Effect`]); the solver is built from those and
//! from nothing else.

mod alignment;
mod contact;
mod effect;
#[cfg(feature = "gpu")]
mod gpu;
mod grips;
mod model;
mod params;
mod place;
mod plan;
mod simulator;
mod solver;

pub use contact::{ContactPass, Part};
pub use effect::{Effect, Effects};
#[cfg(feature = "gpu")]
pub use gpu::{GpuError, Path};
pub use grips::{Grip, GripLog};
pub use model::{ModelReport, NewPose, SheetModel};
pub use params::{
    AirDragParams, Backend, BendKind, BendParams, ComplianceParams, CreaseKind, CreaseParams,
    DampingKind, DampingParams, FacetsParams, GravityParams, GrippersParams, PredictParams,
    SimulateConfig, SimulateParams, TableParams, TrackParams,
};
pub use plan::{PlanLog, PlannedLine};
#[cfg(feature = "gpu")]
pub use simulator::Chosen;
pub use simulator::{
    Batch, FRAME_S_MAX, FRAME_S_MIN, FRAME_S_NOMINAL, GRIPS_MAX, Pulls, SimulateReport, Simulator,
    Taking, frame_s,
};
