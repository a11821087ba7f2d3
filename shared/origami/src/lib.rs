//! Exact, closed-form folding kinematics: where a material point is at a time.
//!
//! The truth that rendered sequences are judged by. It comes from geometry alone, never from the
//! simulator: every part moves rigidly or bends about parallel lines, so lengths are exact to
//! rounding (the square base's layers of finite thickness change them by 0.12 % at most).
//!
//! World frame: table at z = 0, z up, metres. A sheet's middle surface lies half a thickness
//! above whatever carries it.

mod accordion;
mod error;
mod facet;
mod flaps;
mod grasp;
mod line;
mod sequence;
mod soft_fold;
mod square_base;
mod strips;
mod timing;
mod wave;

pub use error::FoldError;
pub use facet::{Crease, Facet, FacetPose, Sheet, Stack};
pub use grasp::{Grasp, Gripper};
pub use line::FoldLine;
pub use sequence::{Pose, Sequence};
pub use timing::Timing;
