//! One camera's thread: waits for its frames, opens it again when it is gone.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::clock::ClockMap;
use super::pairing::Pairing;
use super::sdk::{Frame, Opened, Sdk, Wanted};
use crate::matching::SetMatcher;
use crate::source::Losses;

/// Longest wait for a frame before the thread looks whether it shall end.
const POLL: Duration = Duration::from_millis(100);
/// Waits before a camera that is gone is tried again: doubled from the first to the last.
const BACKOFF: [Duration; 2] = [Duration::from_millis(250), Duration::from_secs(4)];
/// Most frames of a camera that wait for their set: the SDK has few to lend.
const WAITING_MAX: usize = 4;

/// Depth and colour of one instant.
pub(super) struct Pair {
    pub depth: Frame,
    pub color: Frame,
}

/// What the threads and the source share.
pub(super) struct Shared {
    state: Mutex<State>,
    news: Condvar,
}

pub(super) struct State {
    pub matcher: SetMatcher<Pair>,
    pub losses: Losses,
    pub stop: bool,
}

impl Shared {
    pub fn new(matcher: SetMatcher<Pair>) -> Arc<Self> {
        let state = State { matcher, losses: Losses::default(), stop: false };
        Arc::new(Self { state: Mutex::new(state), news: Condvar::new() })
    }

    /// Nobody panics while holding the state, and nothing in it can be half done.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn tell(&self) {
        self.news.notify_all();
    }

    /// Waits for news, for `longest` at most.
    pub fn wait<'a>(
        &self,
        state: MutexGuard<'a, State>,
        longest: Duration,
    ) -> MutexGuard<'a, State> {
        self.news.wait_timeout(state, longest).unwrap_or_else(PoisonError::into_inner).0
    }
}

/// CLOCK_MONOTONIC, nanoseconds.
pub(super) fn monotonic_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// How a camera is fed.
#[derive(Debug, Clone)]
pub(super) struct FeedConfig {
    pub index: usize,
    pub wanted: Wanted,
    pub stall: Duration,
    pub lossless: bool,
    pub reopen: bool,
}

/// The thread's own part.
pub(super) struct Feed {
    sdk: Arc<Sdk>,
    shared: Arc<Shared>,
    config: FeedConfig,
    opened: Option<Opened>,
    clock: ClockMap,
    pairing: Pairing<Frame>,
    /// Frames without partner that were told.
    unmatched: u64,
    heard: Instant,
    backoff: Duration,
}

impl Feed {
    pub fn new(sdk: &Arc<Sdk>, shared: &Arc<Shared>, config: FeedConfig, opened: Opened) -> Self {
        Self {
            pairing: Pairing::new(opened.period_ns, config.lossless),
            unmatched: 0,
            sdk: Arc::clone(sdk),
            shared: Arc::clone(shared),
            config,
            opened: Some(opened),
            clock: ClockMap::default(),
            heard: Instant::now(),
            backoff: BACKOFF[0],
        }
    }

    /// Feeds until asked to stop, or until a recording has ended.
    pub fn run(mut self) {
        while !self.shared.lock().stop {
            let Some(opened) = &self.opened else {
                self.reopen();
                continue;
            };
            if let Some(frame) = opened.wait(self.pairing.needs(), POLL) {
                self.take(frame);
            } else if opened.is_at_end() {
                self.leave();
                if !self.config.reopen {
                    return;
                }
            } else if self.heard.elapsed() >= self.config.stall {
                self.leave();
            }
        }
    }

    /// Takes one frame, and gives the pairs that are certain then.
    fn take(&mut self, frame: Frame) {
        self.heard = Instant::now();
        let stream = match (frame.is_depth(), frame.is_color()) {
            (true, _) => 0,
            (_, true) => 1,
            _ => return,
        };
        self.pairing.push(stream, frame.time_ns(), frame);
        self.give_pairs(false);
    }

    fn give_pairs(&mut self, ended: bool) {
        while let Some([(_, depth), (_, color)]) = self.pairing.pop(ended) {
            self.give(Pair { depth, color });
        }
        let new = self.pairing.unmatched() - self.unmatched;
        self.unmatched += new;
        self.shared.lock().losses.unmatched += new;
    }

    fn give(&mut self, pair: Pair) {
        let stamp_ns = pair.depth.time_ns();
        let time_ns =
            if self.config.lossless { stamp_ns } else { self.clock.map(stamp_ns, monotonic_ns()) };
        let index = self.config.index;
        let mut state = self.shared.lock();
        while state.matcher.waiting(index) >= WAITING_MAX && !state.stop {
            if self.config.lossless {
                state = self.shared.wait(state, POLL);
            } else {
                state.matcher.drop_oldest(index);
                state.losses.superseded += 1;
            }
        }
        state.matcher.push(index, time_ns, pair);
        drop(state);
        self.shared.tell();
    }

    /// The camera is gone: closes it, and lets nobody wait for it.
    fn leave(&mut self) {
        self.give_pairs(true);
        self.pairing = Pairing::new(self.pairing.period_ns(), self.config.lossless);
        self.unmatched = 0;
        self.opened = None;
        let mut state = self.shared.lock();
        state.matcher.set_ended(self.config.index, true);
        let is_end = self.config.wanted.file.is_some() && !self.config.reopen;
        state.losses.stalls += u64::from(!is_end);
        drop(state);
        self.shared.tell();
        self.backoff = BACKOFF[0];
    }

    /// Tries to open the camera again after a wait.
    fn reopen(&mut self) {
        let due = Instant::now() + self.backoff;
        while Instant::now() < due {
            if self.shared.lock().stop {
                return;
            }
            std::thread::sleep(POLL.min(self.backoff));
        }
        match Opened::start(&self.sdk, &self.config.wanted) {
            Ok(opened) => {
                self.opened = Some(opened);
                self.heard = Instant::now();
                // The clock of a camera that was unplugged begins anew.
                self.clock.restart();
                let mut state = self.shared.lock();
                state.matcher.set_ended(self.config.index, false);
                state.losses.returns += 1;
            }
            Err(_) => self.backoff = (2 * self.backoff).min(BACKOFF[1]),
        }
    }
}
