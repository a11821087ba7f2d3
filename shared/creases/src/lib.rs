//! Fold lines of a sheet: what is known of them (`folds`), in material coordinates, and how they
//! are found from positions of nodes (`finder`).
//!
//! A sheet is a set of convex *facets* that tile it; where two of them meet is a *crease*. Facets
//! keep their numbers: a split gives the second part a new one.

mod finder;
mod folds;
mod frame;
mod line;
mod lines;
mod paper;
mod params;
#[cfg(feature = "trial")]
pub mod trial;

pub use finder::{CreaseFinder, UNSEEN_CONFIDENCE};
pub use folds::{Crease, FACETS_MAX, Facet, Folds, ORDER_APART_M};
pub use frame::{FacetFrame, polar};
pub use line::Line;
pub use paper::ClusterFit;
pub use params::{CreaseConfig, CreaseMode, CreaseParams, Lock, PaperParams};
