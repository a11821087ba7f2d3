//! `simulate`: soft targets in, sheet state out. Knows no process, clock or file.
//!
//! The paper's model: point masses on a grid, distance links to neighbours and to nodes `n` steps
//! away, substep XPBD with damping, and virtual zero-rest-length springs to the tracked targets.

mod links;
mod params;
mod simulator;

pub use params::{SimulateConfig, SimulateParams};
pub use simulator::{
    FRAME_S_MAX, FRAME_S_MIN, FRAME_S_NOMINAL, SimulateReport, Simulator, frame_s,
};
