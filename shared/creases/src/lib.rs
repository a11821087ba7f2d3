//! Fold lines of a sheet: what is known of them (`folds`), in material coordinates.
//!
//! A sheet is a set of convex *facets* that tile it; where two of them meet is a *crease*. Facets
//! keep their numbers: a split gives the second part a new one.

mod folds;
mod line;

pub use folds::{Crease, FACETS_MAX, Facet, FacetFrame, Folds, ORDER_APART_M};
pub use line::Line;
