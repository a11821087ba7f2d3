//! Calibration beside a source: where its cameras stand, what their lenses are, how depth errs.
//!
//! * [`file`]: the calibration file that `orime calibrate` writes and a set names;
//! * [`kalibr`] and [`ros`]: the same from Kalibr's camchain and ROS's camera_info (YAML);
//! * [`depth`]: depth images corrected in place;
//! * [`doubts`]: cameras that cannot be right: units, frames, inverted poses.

pub mod depth;
pub mod doubts;
pub mod file;
pub mod kalibr;
pub mod ros;

pub use depth::DepthCorrection;
pub use doubts::{doubts, doubts_of_depth};
pub use file::{Calibration, CalibrationError, CameraEntry, DepthEntry, LensEntry, PoseEntry};
