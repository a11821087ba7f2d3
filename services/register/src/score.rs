//! Does a pose explain what is seen?

use crate::cloud::Cloud;
use crate::mixture::Mixture;
use crate::outline::Outline;

/// How well a pose and an observation agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Score {
    /// Share of the points that lie on the sheet.
    pub explained: f64,
    /// Share of the sheet on which points lie.
    pub supported: f64,
    /// Share of the seen contour that lies on the sheet's border; 0 where none is seen.
    pub outlined: f64,
    /// Elements of the contour that were seen.
    pub edgels: usize,
}

/// "On" the sheet is within this share of its side.
const ON_SHEET: f32 = 0.04;

impl Score {
    /// Judges the pose that `mixture` is placed at.
    pub fn of(
        mixture: &mut Mixture,
        outline: &mut Outline,
        nodes_m: &[[f32; 3]],
        cloud: &Cloud,
        side_m: f32,
    ) -> Self {
        let (explained, supported) = mixture.coverage(cloud, ON_SHEET * side_m);
        let [on_border, edgels] = outline.explained(nodes_m);
        let outlined = on_border as f64 / edgels.max(1) as f64;
        Self { explained, supported, outlined, edgels }
    }

    /// Larger is better. A sheet can be half hidden, but what is seen must be explained.
    pub fn value(&self) -> f64 {
        self.explained + 0.5 * self.supported + 0.5 * self.outlined
    }
}
