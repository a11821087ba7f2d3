//! Frame sets that are read into memory before the first is asked for.
//!
//! Decoding or rendering a frame takes longer than looking at it. Where it is the other stages
//! that are to be measured, the source must not be what they wait for.

use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid};
use orime_origami::Gripper;

use crate::{Advance, FrameError, FrameReport, FrameSource, Losses, PlannedFold};

/// One frame as it was read.
enum Kept {
    Read { color_rgb: Vec<u8>, depth_units: Vec<u16> },
    Failed(FrameError),
}

/// The source; see the module.
pub(crate) struct PreloadedSource {
    inner: Box<dyn FrameSource>,
    /// Camera by camera, step by step.
    frames: Vec<Kept>,
}

impl PreloadedSource {
    /// Reads the first frame sets of `inner`, as many whole ones as `room_bytes` hold; later ones
    /// are read when they are asked for.
    pub(crate) fn over(mut inner: Box<dyn FrameSource>, room_bytes: usize) -> Box<dyn FrameSource> {
        let cameras = inner.cameras().to_vec();
        let bytes = |camera: &RgbdCamera| 3 * camera.color.pixels() + 2 * camera.depth.pixels();
        let set_bytes = cameras.iter().map(bytes).sum::<usize>().max(1);
        let steps = ((room_bytes / set_bytes) as u64).min(inner.steps().unwrap_or(u64::MAX));
        let mut frames = Vec::new();
        for step in 0..steps {
            for (index, camera) in cameras.iter().enumerate() {
                let mut color_rgb = vec![0; 3 * camera.color.pixels()];
                let mut depth_units = vec![0; camera.depth.pixels()];
                let frame =
                    RgbdFrameMut { color_rgb: &mut color_rgb, depth_units: &mut depth_units };
                frames.push(match inner.read(step, index, frame) {
                    Ok(_) => Kept::Read { color_rgb, depth_units },
                    Err(error) => Kept::Failed(error),
                });
            }
        }
        Box::new(Self { inner, frames })
    }
}

impl FrameSource for PreloadedSource {
    fn cameras(&self) -> &[RgbdCamera] {
        self.inner.cameras()
    }

    fn steps(&self) -> Option<u64> {
        self.inner.steps()
    }

    fn advance(&mut self, step: u64) -> Advance {
        self.inner.advance(step)
    }

    fn losses(&self) -> Losses {
        self.inner.losses()
    }

    fn exposure_ns(&self, step: u64, camera: usize) -> u64 {
        self.inner.exposure_ns(step, camera)
    }

    fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<FrameReport, FrameError> {
        let cameras = self.inner.cameras().len() as u64;
        let at = step.saturating_mul(cameras).saturating_add(camera as u64);
        match usize::try_from(at).ok().and_then(|at| self.frames.get(at)) {
            Some(Kept::Read { color_rgb, depth_units }) => {
                frame.color_rgb.copy_from_slice(color_rgb);
                frame.depth_units.copy_from_slice(depth_units);
                Ok(FrameReport { copies: 1 })
            }
            Some(Kept::Failed(FrameError::Missing)) => Err(FrameError::Missing),
            Some(Kept::Failed(error)) => Err(FrameError::Unreadable(error.to_string())),
            None => self.inner.read(step, camera, frame),
        }
    }

    fn truth_m(&self, step: u64, sheet: &SheetGrid, nodes_m: &mut [[f32; 3]]) -> bool {
        self.inner.truth_m(step, sheet, nodes_m)
    }

    fn fold_plan(&self) -> Vec<PlannedFold> {
        self.inner.fold_plan()
    }

    fn tells_grippers(&self) -> bool {
        self.inner.tells_grippers()
    }

    fn grippers(&self, step: u64, out: &mut Vec<Gripper>) {
        self.inner.grippers(step, out);
    }
}
