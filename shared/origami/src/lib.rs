//! Exact, closed-form folding kinematics: where a material point is at a time.
//!
//! The truth that rendered sequences are judged by. It comes from geometry alone, never from the
//! simulator: every facet moves rigidly, so lengths inside a facet are exact to rounding.
//!
//! World frame: table at z = 0, z up, metres. A sheet's middle surface lies half a thickness
//! above whatever carries it.

mod error;
mod half_fold;
mod line;
mod timing;

pub use error::FoldError;
pub use half_fold::{Facet, HalfFold};
pub use line::FoldLine;
pub use timing::Timing;
