//! Where a caller takes part in a substep.

use crate::effect::Effect;
use orime_creases::Folds;

/// The nodes in the middle of a substep, for self-contact: after links and facets, before the
/// table. What is written to `x_m` is what the substep goes on with.
#[derive(Debug)]
pub struct ContactPass<'a> {
    /// Node positions, metres, index order, relative to an origin near the sheet.
    pub x_m: &'a mut [[f32; 3]],
    /// Node positions at the substep's start, same frame.
    pub before_m: &'a [[f32; 3]],
    /// Facets, creases and layer order.
    pub folds: &'a Folds,
    /// Length of the substep, seconds.
    pub dt_s: f64,
    /// To be cleared where layers cannot be parted: the substep is taken back, and the sheet rests
    /// where it was.
    pub holds: &'a mut bool,
}

/// A part of a substep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Inertia, with gravity and air; and what every substep begins and ends with.
    Inertia,
    /// A pass of an effect.
    Of(Effect),
}
