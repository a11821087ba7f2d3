//! Does a pose explain what is seen?

use crate::mixture::{Cloud, Mixture};

/// How well a pose and a cloud agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Score {
    /// Share of the points that lie on the sheet.
    pub explained: f64,
    /// Share of the sheet on which points lie.
    pub supported: f64,
}

impl Score {
    /// Judges the pose that `mixture` is placed at; "on" is within 5 % of the sheet's side.
    pub fn of(mixture: &mut Mixture, cloud: &Cloud, cell_m: f32, side_m: f32) -> Self {
        let (explained, supported) = mixture.coverage(cloud, cell_m, 0.05 * side_m);
        Self { explained, supported }
    }

    /// Larger is better. A sheet can be half hidden, but what is seen must be explained.
    pub fn value(&self) -> f64 {
        self.explained + 0.5 * self.supported
    }
}
