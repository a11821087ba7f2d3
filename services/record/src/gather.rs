//! The first frames: a file names all its cameras before it holds any frame.

use orime_geometry::RgbdCamera;
use orime_messages::CAMERAS_MAX;
use orime_runtime::{FrameSubscription, ReceivedFrame, RuntimeError};

/// What the first frames say.
#[derive(Debug, Default)]
pub(crate) struct Gathered {
    /// All cameras of the set, in the order of their indices.
    pub(crate) cameras: Vec<RgbdCamera>,
    /// The frames of the newest step so far, not recorded yet.
    pub(crate) frames: Vec<ReceivedFrame>,
    /// Frames of earlier steps that were given up.
    pub(crate) given_up: u64,
}

/// Waits until every camera has sent a frame; `None` if the stream ends first.
///
/// Frames are held meanwhile, one step's at the most, for their number is bounded.
pub(crate) fn gather(frames: &mut FrameSubscription) -> Result<Option<Gathered>, RuntimeError> {
    let mut gathered = Gathered::default();
    let mut cameras: Vec<Option<RgbdCamera>> = Vec::new();
    while let Some(frame) = frames.next()? {
        let meta = frame.meta();
        if meta.header.is_end() {
            return Ok(None);
        }
        cameras.resize((meta.n_cameras as usize).min(CAMERAS_MAX), None);
        if let Some(camera) = cameras.get_mut(meta.camera as usize) {
            *camera = Some(RgbdCamera::from(&meta.calibration));
        }
        let step = meta.header.step;
        if gathered.frames.first().is_some_and(|first| first.meta().header.step != step) {
            gathered.given_up += gathered.frames.len() as u64;
            gathered.frames.clear();
        }
        gathered.frames.push(frame);
        if let Some(all) = cameras.iter().cloned().collect() {
            gathered.cameras = all;
            return Ok(Some(gathered));
        }
    }
    Ok(None)
}
