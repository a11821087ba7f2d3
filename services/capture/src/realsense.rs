//! The `realsense` source: live cameras through the SDK, or recordings that the SDK plays.
//!
//! A thread a camera waits for its frames ([`feed`]), maps their stamps to the machine's clock
//! ([`clock`]) and opens it again when it is gone; frames of one time become a set
//! (`matching.rs`). Pixels stay in the SDK's memory until they are written into the loan.

mod clock;
mod feed;
mod pairing;
mod params;
mod sdk;

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid};

use crate::matching::{MatchedSet, SetMatcher};
use crate::source::{Advance, Losses};
use crate::{FrameError, FrameReport, FrameSource, OpenError};
use feed::{Feed, FeedConfig, Pair, Shared, monotonic_ns};
pub use params::{LiveCameraParams, RealsenseConfig, RealsenseParams};
pub use sdk::SdkError;
use sdk::{Opened, Sdk};

/// How long one call of [`FrameSource::advance`] waits.
const ADVANCE: Duration = Duration::from_millis(50);
/// How long a read waits for a step that nobody has advanced to.
const READ: Duration = Duration::from_secs(10);

/// The source; see the module.
pub(crate) struct RealsenseSource {
    cameras: Vec<RgbdCamera>,
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
    /// The set at hand and its step.
    set: MatchedSet<Pair>,
    step: Option<u64>,
    exposures_ns: Vec<u64>,
}

impl RealsenseSource {
    pub(crate) fn open(config: &RealsenseConfig) -> Result<Self, OpenError> {
        let sdk = Sdk::load(config.library.as_deref(), &config.preload)?;
        let n = config.cameras.len();
        let patience_ns = if config.lossless { u64::MAX } else { config.wait_ns };
        let shared = Shared::new(SetMatcher::new(n, config.set_ns, patience_ns));
        let mut source = Self {
            cameras: Vec::with_capacity(n),
            shared: Arc::clone(&shared),
            threads: Vec::with_capacity(n),
            set: Vec::new(),
            step: None,
            exposures_ns: vec![0; n],
        };
        for (index, wanted) in config.cameras.iter().enumerate() {
            let opened = Opened::start(&sdk, wanted)?;
            source.cameras.push(opened.camera.clone());
            let config = FeedConfig {
                index,
                wanted: wanted.clone(),
                stall: config.stall,
                lossless: config.lossless,
                reopen: config.reopen,
            };
            let feed = Feed::new(&sdk, &shared, config, opened);
            source.threads.push(std::thread::spawn(move || feed.run()));
        }
        Ok(source)
    }

    /// Takes a set as the one of `step`.
    fn take(&mut self, step: u64, set: MatchedSet<Pair>) {
        let opened_ns = set.iter().flatten().map(|(time_ns, _)| *time_ns).min().unwrap_or(0);
        for (last_ns, part) in self.exposures_ns.iter_mut().zip(&set) {
            let time_ns = part.as_ref().map_or(opened_ns, |(time_ns, _)| *time_ns);
            *last_ns = time_ns.max(*last_ns + 1);
        }
        self.set = set;
        self.step = Some(step);
    }
}

impl Drop for RealsenseSource {
    fn drop(&mut self) {
        self.shared.lock().stop = true;
        self.shared.tell();
        for thread in self.threads.drain(..) {
            // A thread that panicked has nothing left to close.
            let _ = thread.join();
        }
    }
}

impl FrameSource for RealsenseSource {
    fn cameras(&self) -> &[RgbdCamera] {
        &self.cameras
    }

    fn steps(&self) -> Option<u64> {
        None
    }

    fn advance(&mut self, step: u64) -> Advance {
        if self.step.is_some_and(|at| step <= at) {
            return Advance::Ready;
        }
        // The SDK has its frames back before more are waited for.
        self.set.clear();
        let due = Instant::now() + ADVANCE;
        let shared = Arc::clone(&self.shared);
        let mut state = shared.lock();
        loop {
            if let Some(set) = state.matcher.pop(monotonic_ns()) {
                drop(state);
                shared.tell();
                self.take(step, set);
                return Advance::Ready;
            }
            if state.matcher.is_over() && self.threads.iter().all(JoinHandle::is_finished) {
                return Advance::Ended;
            }
            let Some(left) = due.checked_duration_since(Instant::now()) else {
                return Advance::Waiting;
            };
            // Patience runs out without news.
            state = shared.wait(state, left.min(Duration::from_millis(5)));
        }
    }

    fn losses(&self) -> Losses {
        let state = self.shared.lock();
        let unmatched = state.losses.unmatched + state.matcher.unmatched();
        Losses { unmatched, ..state.losses }
    }

    fn exposure_ns(&self, _step: u64, camera: usize) -> u64 {
        self.exposures_ns[camera]
    }

    fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<FrameReport, FrameError> {
        let due = Instant::now() + READ;
        while self.advance(step) == Advance::Waiting && Instant::now() < due {}
        let here = self.step == Some(step);
        let part = self.set.get(camera).and_then(Option::as_ref).filter(|_| here);
        let Some((_, pair)) = part else { return Err(FrameError::Missing) };
        let RgbdCamera { color, depth, .. } = &self.cameras[camera];
        pair.depth.write_depth(depth, frame.depth_units).map_err(FrameError::Unreadable)?;
        pair.color.write_color(color, frame.color_rgb).map_err(FrameError::Unreadable)?;
        // Out of the SDK's memory into the loan.
        Ok(FrameReport { copies: 1 })
    }

    fn truth_m(&self, _step: u64, _sheet: &SheetGrid, _nodes_m: &mut [[f32; 3]]) -> bool {
        false
    }
}
