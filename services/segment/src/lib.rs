//! `segment`: RGB-D frames in, observed cloud and contour out. Knows no process, clock or file.
//!
//! The pixels' story, per camera (`camera`): the sheet's colours are learnt (`learn`, `cluster`)
//! into a table (`color_model`) that classifies pixels (`bits`); the result is opened and closed
//! (`morphology`) and split (`components`); depth pixels whose colour pixel lies in it (`depth`)
//! are cut at steps (`steps`) into patches, of which those that can be the sheet are chosen
//! (`select`); they make the mask (`mask`). What is near an occluder (`occluders`) or hidden from
//! the colour lens (`parallax`) is dropped, the rest is averaged (`voxels`), and the mask's outline
//! becomes edgels (`contour`, `inner_edge`).
//!
//! Where the sheet was a frame ago, all this happens in a window round it (`window`).
//!
//! The markers of a printed sheet (`features`) are found before all that: their ink counts as
//! sheet-coloured, and their corners, lifted by depth (`plane`), become features.

mod bits;
mod camera;
mod cluster;
mod color_model;
mod components;
mod contour;
mod depth;
mod features;
mod images;
mod inner_edge;
mod learn;
mod mask;
mod morphology;
mod occluders;
mod parallax;
mod params;
mod plane;
mod select;
mod steps;
mod told;
mod voxels;
mod window;

pub use params::{Markers, SegmentConfig, SegmentParams};

use camera::{CameraSegmenter, Outcome};
use orime_geometry::{Edgel, Feature, ObservedPoint, RgbdCamera, RgbdFrame, SheetGrid};
use rayon::prelude::*;
use told::{Known, Told};

/// Where a segmentation is written: the caller's memory, filled from the front.
#[derive(Debug)]
pub struct ObservedMut<'a> {
    /// Surface points of all cameras, world frame.
    pub points: &'a mut [ObservedPoint],
    /// Contour elements of all cameras.
    pub edgels: &'a mut [Edgel],
    /// Recognised points of a printed sheet, of all cameras.
    pub features: &'a mut [Feature],
}

/// What segmenting one frame set gave.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SegmentReport {
    /// Points written.
    pub points: usize,
    /// Edgels written.
    pub edgels: usize,
    /// Features written.
    pub features: usize,
    /// Cameras in which no sheet was found.
    pub cameras_without_sheet: u32,
    /// Cameras whose frame was missing or had the wrong size.
    pub cameras_without_frame: u32,
    /// Points that did not fit into the caller's memory; those written are spread evenly.
    pub points_left_out: u32,
    /// Edgels that did not fit into the caller's memory; those written are spread evenly.
    pub edgels_left_out: u32,
    /// Features that did not fit into the caller's memory; those written are spread evenly.
    pub features_left_out: u32,
    /// Depth pixels on the sheet that were dropped because a camera's cells were all taken.
    pub pixels_left_out: u32,
}

/// Segments frame sets; remembers the colour model of the sheet per camera.
#[derive(Debug)]
pub struct Segmenter {
    cameras: Vec<(CameraSegmenter, Outcome)>,
}

impl Segmenter {
    /// A segmenter for these cameras, which has not seen the sheet yet.
    ///
    /// Panics if [`SegmentConfig::check_sheet`] refuses the sheet.
    pub fn new(config: &SegmentConfig, cameras: &[RgbdCamera], sheet: &SheetGrid) -> Self {
        let start = |(index, camera): (usize, &RgbdCamera)| {
            let segmenter = CameraSegmenter::new(index, camera, &config.params, sheet);
            (segmenter, Outcome::NoFrame)
        };
        Self { cameras: cameras.iter().enumerate().map(start).collect() }
    }

    /// Segments one frame set; `frames[k]` belongs to camera `k`, `None` where it is missing.
    pub fn segment(
        &mut self,
        frames: &[Option<RgbdFrame<'_>>],
        out: ObservedMut<'_>,
    ) -> SegmentReport {
        // All are told the same, so that their order and the number of threads change nothing.
        let told = Told { alone: self.cameras.len() == 1, known: self.known() };
        self.cameras.par_iter_mut().enumerate().for_each(|(k, (camera, outcome))| {
            *outcome = camera.segment(frames.get(k).copied().flatten(), &told);
        });
        let mut report = SegmentReport::default();
        let counted = |wanted| self.cameras.iter().filter(|(_, o)| *o == wanted).count() as u32;
        report.cameras_without_sheet = counted(Outcome::NoSheet);
        report.cameras_without_frame = counted(Outcome::NoFrame);
        report.pixels_left_out = self.cameras.iter().map(|(c, _)| c.pixels_left_out()).sum();

        let cameras = || self.cameras.iter().map(|(camera, _)| camera);
        let total = cameras().map(|camera| camera.points.len()).sum();
        report.points = thin(cameras().flat_map(|camera| &camera.points), total, out.points);
        report.points_left_out = (total - report.points) as u32;

        let total = cameras().map(|camera| camera.edgels.len()).sum();
        report.edgels = thin(cameras().flat_map(|camera| &camera.edgels), total, out.edgels);
        let not_traced: u32 = cameras().map(|camera| camera.edgels_left_out).sum();
        report.edgels_left_out = (total - report.edgels) as u32 + not_traced;

        let total = cameras().map(|camera| camera.features().len()).sum();
        report.features = thin(cameras().flat_map(|camera| camera.features()), total, out.features);
        report.features_left_out = (total - report.features) as u32;
        report
    }

    /// What the cameras know that saw the sheet in the last frame.
    fn known(&self) -> Option<Known> {
        self.cameras.iter().filter_map(|(camera, _)| camera.known()).reduce(Known::or)
    }

    /// Whether pixel `(x, y)` of a camera's colour image showed the sheet in the last frame.
    /// False outside the image and where there is no such camera.
    pub fn is_sheet(&self, camera: usize, x: u32, y: u32) -> bool {
        let Some((camera, _)) = self.cameras.get(camera) else { return false };
        camera.is_sheet(x as usize, y as usize)
    }

    /// The part of a camera's colour image that was looked at last: `[x, y]` of its corner, and
    /// its size, pixels. `None` where there is no such camera.
    pub fn window(&self, camera: usize) -> Option<[[usize; 2]; 2]> {
        self.cameras.get(camera).map(|(camera, _)| camera.window())
    }
}

/// Writes as many of `total` items as fit, evenly spread, and returns their number.
fn thin<'a, T: Copy + 'a>(
    items: impl Iterator<Item = &'a T>,
    total: usize,
    out: &mut [T],
) -> usize {
    let room = out.len().min(total);
    let mut written = 0;
    for (k, item) in items.enumerate() {
        if (k + 1) * room / total > written {
            out[written] = *item;
            written += 1;
        }
    }
    written
}
