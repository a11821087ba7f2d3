//! Folds that cannot be made.

use std::fmt;

use crate::FoldLine;

/// Why a fold cannot be made.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum FoldError {
    /// The line leaves the whole sheet on one side.
    LineMissesSheet {
        /// The line.
        line: FoldLine,
        /// The sheet's sides, metres.
        size_m: [f64; 2],
    },
    /// The fold needs a square.
    NotSquare {
        /// What was to be folded.
        fold: &'static str,
        /// The sheet's sides, metres.
        size_m: [f64; 2],
    },
    /// A side or the thickness is not a positive number.
    NotASheet {
        /// The sheet's sides, metres.
        size_m: [f64; 2],
        /// The sheet's thickness, metres.
        thickness_m: f64,
    },
}

impl fmt::Display for FoldError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LineMissesSheet { line, size_m } => write!(
                f,
                "the fold line through {:?} m at {:.2}° does not divide a sheet of {size_m:?} m",
                line.point_m,
                line.angle_rad.to_degrees()
            ),
            Self::NotSquare { fold, size_m } => {
                write!(f, "{fold} needs a square sheet, not one of {size_m:?} m")
            }
            Self::NotASheet { size_m, thickness_m } => {
                write!(f, "a sheet cannot have sides {size_m:?} m and thickness {thickness_m} m")
            }
        }
    }
}

impl std::error::Error for FoldError {}
