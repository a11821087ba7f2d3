//! What a running set says about itself, from its stages' records.

mod figures;
mod report;
mod spread;
mod stage;

pub use figures::{Figures, Hop};
pub use report::{EffectReport, HopReport, Hops, Report, StageReport};
pub use spread::{Percentiles, Spread};
pub use stage::StageFigures;
