//! What a running set says about itself, from its stages' records.

mod figures;
mod spread;

pub use figures::{Figures, Hop, HopReport, Hops, Report, StageFigures};
pub use spread::{Percentiles, Spread};
