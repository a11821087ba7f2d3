//! Frames on their way from the SDK's threads to ours.

use std::collections::VecDeque;
use std::ffi::c_void;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::{Frame, Sdk};

/// Most frames of a stream that wait: the SDK lends sixteen.
const WAITING_MAX: usize = 4;

/// Where the SDK's callbacks put frames.
pub(super) struct Inbox {
    sdk: Arc<Sdk>,
    state: Mutex<State>,
    news: Condvar,
    /// Whether the SDK's threads wait until there is room (recordings), or the oldest frame goes.
    lossless: bool,
}

#[derive(Default)]
struct State {
    /// Depth, then colour.
    queues: [VecDeque<Frame>; 2],
    closed: bool,
}

impl Inbox {
    pub fn new(sdk: &Arc<Sdk>, lossless: bool) -> Arc<Self> {
        let (sdk, state) = (Arc::clone(sdk), Mutex::new(State::default()));
        Arc::new(Self { sdk, state, news: Condvar::new(), lossless })
    }

    /// Nobody panics while holding the state, and nothing in it can be half done.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes no more frames, and lets the SDK's threads go.
    pub fn close(&self) {
        let mut state = self.lock();
        state.closed = true;
        let frames = std::mem::take(&mut state.queues);
        drop(state);
        self.news.notify_all();
        // Frames are given back without the lock: the SDK locks, too.
        drop(frames);
    }

    fn put(&self, frame: Frame) {
        let stream = match (frame.is_depth(), frame.is_color()) {
            (true, _) => 0,
            (_, true) => 1,
            _ => return,
        };
        let mut state = self.lock();
        while self.lossless && !state.closed && state.queues[stream].len() >= WAITING_MAX {
            state = self.news.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        if state.closed {
            drop(state);
            return;
        }
        let full = state.queues[stream].len() >= WAITING_MAX;
        let oldest = if full { state.queues[stream].pop_front() } else { None };
        state.queues[stream].push_back(frame);
        drop(state);
        self.news.notify_all();
        drop(oldest);
    }

    /// The next frame of the wanted stream, or of either where none is wanted more; `None` if
    /// none came. After waiting in vain for one stream, the other may come, too.
    pub fn take(&self, wanted: Option<usize>, longest: Duration) -> Option<Frame> {
        let due = Instant::now() + longest;
        let mut state = self.lock();
        loop {
            let streams = wanted.map_or(0..2, |stream| stream..stream + 1);
            let left = due.checked_duration_since(Instant::now());
            let streams = if left.is_none() { 0..2 } else { streams };
            let frame = streams.into_iter().find_map(|k| state.queues[k].pop_front());
            if frame.is_some() || left.is_none() {
                drop(state);
                self.news.notify_all();
                return frame;
            }
            let wait = left.unwrap_or_default();
            state = self.news.wait_timeout(state, wait).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// What the SDK calls with each frame; `inbox` is an [`Inbox`] that outlives the stream.
pub(super) unsafe extern "C" fn on_frame(frame: *mut c_void, inbox: *mut c_void) {
    // SAFETY: `Opened` keeps the inbox until the sensor is stopped, and the SDK calls nobody then.
    let inbox = unsafe { &*inbox.cast_const().cast::<Inbox>() };
    let handle = inbox.sdk.handle(frame, inbox.sdk.api.release_frame);
    // A frame that says nothing of itself is of no use; the camera counts as silent.
    if let Ok(frame) = Frame::new(handle) {
        inbox.put(frame);
    }
}
