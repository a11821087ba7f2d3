//! What every source of frames is to the rest of the system.

use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid};
use orime_origami::Gripper;

/// What reading one frame took.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FrameReport {
    /// Whole-image copies made on the way into the given buffers (0 when decoded in place).
    pub copies: u32,
}

/// Why one frame could not be read; the source itself lives on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// The file, its decoding or its size is at fault.
    #[error("{0}")]
    Unreadable(String),
    /// The camera has no frame of this set's time.
    #[error("the camera has no frame of this set's time")]
    Missing,
}

/// Whether a frame set is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Advance {
    /// It can be read.
    Ready,
    /// Not yet: ask again. Live cameras that stall keep saying so.
    Waiting,
    /// There will be no more.
    Ended,
}

/// What a source lost, since it was opened.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Losses {
    /// Frames that found no partners of their time.
    pub unmatched: u64,
    /// Frames that newer ones pushed out before anyone took them.
    pub superseded: u64,
    /// How often a camera stopped sending.
    pub stalls: u64,
    /// How often one came back.
    pub returns: u64,
}

/// A line that will be folded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedFold {
    /// Two points of it, (u, v), metres.
    pub ends_uv_m: [[f64; 2]; 2],
    /// From which exposure of camera 0 on it may be folded, nanoseconds.
    pub valid_from_ns: u64,
}

/// A source of RGB-D frames: rendered, recorded or live.
pub trait FrameSource: Send {
    /// The cameras, in the order of their indices; constant over the source's life.
    fn cameras(&self) -> &[RgbdCamera];

    /// Number of frame sets, or `None` for an endless source.
    fn steps(&self) -> Option<u64>;

    /// Makes frame set `step` the one to be read, waiting for it a moment at most. Steps come in
    /// order. Default: all frames are there from the beginning.
    fn advance(&mut self, step: u64) -> Advance {
        match self.steps() {
            Some(steps) if step >= steps => Advance::Ended,
            _ => Advance::Ready,
        }
    }

    /// What was lost so far. Default: nothing ever is.
    fn losses(&self) -> Losses {
        Losses::default()
    }

    /// Exposure time of `camera` at `step` in the source's own clock, nanoseconds.
    ///
    /// Strictly increasing over `step` for each camera.
    fn exposure_ns(&self, step: u64, camera: usize) -> u64;

    /// Writes one frame in place. On an error the buffers' contents are unspecified.
    fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<FrameReport, FrameError>;

    /// Writes where the sheet's nodes truly are at `step`, world frame, metres, index order of
    /// `sheet`, at the exposure of camera 0; `false` where the source does not know.
    fn truth_m(&self, step: u64, sheet: &SheetGrid, nodes_m: &mut [[f32; 3]]) -> bool;

    /// The lines that will be folded, as a robot that folds knows them; empty where nobody does.
    fn fold_plan(&self) -> Vec<PlannedFold> {
        Vec::new()
    }

    /// Whether [`Self::grippers`] says anything, at any step. Default: it does not.
    fn tells_grippers(&self) -> bool {
        false
    }

    /// Writes what a robot knows of the grippers that hold the sheet at `step`: where they are
    /// and which material points they hold, at camera 0's exposure. Nothing by default.
    fn grippers(&self, step: u64, out: &mut Vec<Gripper>) {
        let _ = step;
        out.clear();
    }
}
