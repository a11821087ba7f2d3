//! `segment`: RGB-D frames in, observed cloud and contour out. Knows no process, clock or file.

use orime_geometry::{Edgel, ObservedPoint, RgbdCamera, RgbdFrame, SheetGrid};
use orime_params::Problem;
use serde::{Deserialize, Serialize};

/// The `[segment]` section of a set.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SegmentParams {}

impl SegmentParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<SegmentConfig, Vec<Problem>> {
        Ok(SegmentConfig {})
    }
}

/// Checked [`SegmentParams`].
#[derive(Debug, Clone)]
pub struct SegmentConfig {}

/// Where a segmentation is written: the caller's memory, filled from the front.
#[derive(Debug)]
pub struct ObservedMut<'a> {
    /// Surface points of all cameras, world frame.
    pub points: &'a mut [ObservedPoint],
    /// Contour elements of all cameras.
    pub edgels: &'a mut [Edgel],
}

/// What segmenting one frame set gave.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SegmentReport {
    /// Points written.
    pub points: usize,
    /// Edgels written.
    pub edgels: usize,
    /// Cameras in which no sheet was found.
    pub cameras_without_sheet: u32,
    /// Cameras whose frame was missing or had the wrong size.
    pub cameras_without_frame: u32,
    /// Points that did not fit into the caller's memory.
    pub points_left_out: u32,
}

/// Segments frame sets; remembers the colour model of the sheet per camera.
#[derive(Debug)]
pub struct Segmenter {}

impl Segmenter {
    /// A segmenter for these cameras, which has not seen the sheet yet.
    pub fn new(_config: &SegmentConfig, _cameras: &[RgbdCamera], _sheet: &SheetGrid) -> Self {
        Self {}
    }

    /// Segments one frame set; `frames[k]` belongs to camera `k`, `None` where it is missing.
    pub fn segment(
        &mut self,
        _frames: &[Option<RgbdFrame<'_>>],
        _out: ObservedMut<'_>,
    ) -> SegmentReport {
        SegmentReport::default()
    }
}
