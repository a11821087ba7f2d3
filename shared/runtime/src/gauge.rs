//! What a process counts of itself, for its records.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

static LOAN_WAITS: AtomicU64 = AtomicU64::new(0);
static QUEUED: AtomicU32 = AtomicU32::new(0);
static QUEUED_HIGH: AtomicU32 = AtomicU32::new(0);

/// A loan found no free message.
pub(crate) fn loan_waited() {
    LOAN_WAITS.fetch_add(1, Ordering::Relaxed);
}

/// A message was taken and waits for work.
pub(crate) fn queued() {
    let depth = QUEUED.fetch_add(1, Ordering::Relaxed) + 1;
    QUEUED_HIGH.fetch_max(depth, Ordering::Relaxed);
}

/// A waiting message went into work, or was given up.
pub(crate) fn unqueued() {
    QUEUED.fetch_sub(1, Ordering::Relaxed);
}

/// Loans that had to wait, messages that wait, the most that ever did.
pub(crate) fn read() -> (u64, u32, u32) {
    let read = |gauge: &AtomicU32| gauge.load(Ordering::Relaxed);
    (LOAN_WAITS.load(Ordering::Relaxed), read(&QUEUED), read(&QUEUED_HIGH))
}
