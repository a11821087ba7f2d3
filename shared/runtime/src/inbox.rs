//! A bounded queue between the thread that takes messages and the one that works on them.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use orime_messages::{Drops, Header};

use crate::gauge;

/// How often those who wait look whether they shall end.
pub(crate) const STOP_POLL: Duration = Duration::from_millis(50);

/// Something with a message's header.
pub(crate) trait Taken {
    fn header(&self) -> &Header;

    /// Messages of the same step that come before this one.
    fn place(&self) -> u64 {
        0
    }
}

/// The queue; `capacity` messages at most.
#[derive(Debug)]
pub(crate) struct Inbox<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
    capacity: usize,
    /// Whether a full inbox gives up its oldest message.
    newest_wins: bool,
    /// Whether this was there before any publisher, so that what precedes the first message
    /// taken is lost too.
    from_start: bool,
    /// Where a restarted stage goes on.
    resumed: Option<Resumed>,
}

/// What the first message must be for nothing to be missing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Resumed {
    /// Its step.
    pub wanted: u64,
    /// Messages per step.
    pub per_step: u64,
}

#[derive(Debug)]
struct State<T> {
    queue: VecDeque<T>,
    drops: Drops,
    /// Publishers' incarnations and the sequence that each should send next.
    expected: Vec<(u64, u64)>,
    /// Nothing will come any more.
    closed: bool,
    failure: Option<crate::RuntimeError>,
}

impl<T: Taken> Inbox<T> {
    pub(crate) fn new(
        capacity: usize,
        newest_wins: bool,
        from_start: bool,
        resumed: Option<Resumed>,
    ) -> Self {
        Self {
            state: Mutex::new(State {
                queue: VecDeque::with_capacity(capacity),
                drops: Drops::default(),
                expected: Vec::new(),
                closed: false,
                failure: None,
            }),
            changed: Condvar::new(),
            capacity,
            newest_wins,
            from_start,
            resumed,
        }
    }

    /// The state, even if the other thread panicked with it: the queue stays consistent.
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether another message may be taken.
    pub(crate) fn has_room(&self) -> bool {
        self.newest_wins || self.lock().queue.len() < self.capacity
    }

    /// Waits, a while at most, until a message has been worked off.
    pub(crate) fn wait_for_room(&self) {
        let state = self.lock();
        if state.queue.len() >= self.capacity {
            let _ = self.changed.wait_timeout(state, STOP_POLL);
        }
    }

    /// Puts in a message that was just taken, and counts those lost before it.
    pub(crate) fn put(&self, message: T) {
        let mut state = self.lock();
        let Header { incarnation, sequence, step, .. } = *message.header();
        if let Some(Resumed { wanted, per_step }) = self.resumed
            && state.expected.is_empty()
        {
            // What the predecessor had in hand, and what came while there was nobody.
            let missing = step.saturating_sub(wanted) * per_step;
            state.drops.restart += if step >= wanted { missing + message.place() } else { 0 };
        }
        let known = state.expected.iter().position(|(known, _)| *known == incarnation);
        let known = known.unwrap_or_else(|| {
            state.expected.push((incarnation, if self.from_start { 0 } else { sequence }));
            state.expected.len() - 1
        });
        state.drops.overflow += sequence.saturating_sub(state.expected[known].1);
        state.expected[known].1 = sequence + 1;
        if state.queue.len() >= self.capacity {
            state.queue.pop_front();
            gauge::unqueued();
            state.drops.superseded += 1;
        }
        state.queue.push_back(message);
        gauge::queued();
        self.changed.notify_all();
    }

    /// The oldest message, waiting for one for a while at most.
    pub(crate) fn get(&self, wait: Duration) -> Result<Option<T>, crate::RuntimeError> {
        let mut state = self.lock();
        if state.queue.is_empty() && !state.closed && !wait.is_zero() {
            state = match self.changed.wait_timeout(state, wait) {
                Ok((state, _)) => state,
                Err(poisoned) => poisoned.into_inner().0,
            };
        }
        let message = state.queue.pop_front();
        if message.is_some() {
            gauge::unqueued();
            self.changed.notify_all();
        } else if let Some(failure) = state.failure.take() {
            return Err(failure);
        }
        Ok(message)
    }

    /// Whether nothing is there and nothing will come.
    pub(crate) fn is_closed(&self) -> bool {
        let state = self.lock();
        state.closed && state.queue.is_empty() && state.failure.is_none()
    }

    /// Counts messages that were given up for a newer one.
    pub(crate) fn count_superseded(&self, messages: u64) {
        self.lock().drops.superseded += messages;
    }

    pub(crate) fn close(&self, failure: Option<crate::RuntimeError>) {
        let mut state = self.lock();
        state.closed = true;
        state.failure = failure;
        self.changed.notify_all();
    }

    pub(crate) fn drops(&self) -> Drops {
        self.lock().drops
    }
}
