//! What is known of one stage, over all the processes that it has had.

use orime_messages::{Drops, EFFECTS, StageRecord};

use crate::spread::Spread;

/// What is known of one stage.
#[derive(Debug, Clone, Default)]
pub struct StageFigures {
    /// Results published (frame sets for capture).
    pub published: u64,
    /// Messages published: frames for capture.
    pub messages: u64,
    /// Bytes published.
    pub bytes: u64,
    /// Step of the newest result.
    pub step: Option<u64>,
    /// Camera of the newest message, for capture.
    pub camera: u32,
    /// Whether its newest process has said that it ended in order.
    pub ended: bool,
    /// When its newest message was published, `CLOCK_MONOTONIC`, nanoseconds.
    pub newest_ns: u64,
    /// Newest status: tracking for register and simulate.
    pub status: u32,
    /// The process that its newest record came from.
    pub incarnation: u64,
    /// Processes that took the place of another one.
    pub restarts: u64,
    /// When the first result was published.
    pub first_ns: u64,
    /// Time from one result to the next.
    pub interval: Spread,
    /// Messages that its process had taken and not begun with.
    pub queue_depth: u32,
    /// The most of these.
    pub queue_high: u32,
    /// What its newest result says that acts on the sheet; a bit each.
    pub effects: u32,
    /// … and what of it slept.
    pub effects_asleep: u32,
    /// Results in which each slept.
    pub asleep_results: [u64; EFFECTS.len()],
    /// Losses of its newest process.
    drops: Drops,
    /// Losses of those before.
    drops_before: Drops,
    loan_waits: u64,
    loan_waits_before: u64,
}

impl StageFigures {
    /// Takes in what every record says.
    pub(crate) fn add(&mut self, record: &StageRecord) {
        let incarnation = record.header.incarnation;
        if incarnation != self.incarnation {
            if self.incarnation != 0 {
                self.restarts += 1;
                self.drops_before = self.drops_before.plus(&self.drops);
                self.loan_waits_before += self.loan_waits;
            }
            (self.incarnation, self.ended) = (incarnation, false);
        }
        self.drops = record.drops;
        self.loan_waits = record.loan_waits;
        self.queue_depth = record.queue_depth;
        self.queue_high = self.queue_high.max(record.queue_high);
    }

    /// Takes in that a message was published; whether it is the first of its step.
    pub(crate) fn add_published(&mut self, record: &StageRecord) -> bool {
        let (step, publish_ns) = (record.header.step, record.header.publish_ns);
        let is_first = self.step != Some(step);
        if is_first {
            self.published += 1;
            if self.newest_ns > 0 {
                self.interval.add_ns(publish_ns.saturating_sub(self.newest_ns));
            } else {
                self.first_ns = publish_ns;
            }
            self.newest_ns = publish_ns;
        }
        self.messages += 1;
        self.bytes += record.bytes;
        (self.effects, self.effects_asleep) = (record.effects, record.effects_asleep);
        for (k, results) in self.asleep_results.iter_mut().enumerate() {
            *results += u64::from(record.effects_asleep >> k & 1);
        }
        (self.step, self.camera, self.status) = (Some(step), record.camera, record.status);
        is_first
    }

    /// Losses so far, counted by its processes.
    pub fn drops(&self) -> Drops {
        self.drops_before.plus(&self.drops)
    }

    /// Loans that had to wait for a free message.
    pub fn loan_waits(&self) -> u64 {
        self.loan_waits_before + self.loan_waits
    }

    /// Results per second between the first and the newest one; `None` with fewer than two.
    pub fn hz(&self) -> Option<f64> {
        let seconds = self.newest_ns.checked_sub(self.first_ns)? as f64 * 1e-9;
        (seconds > 0.0 && self.published > 1).then(|| (self.published - 1) as f64 / seconds)
    }

    /// Megabytes per second, at that rate.
    pub fn mb_per_s(&self) -> Option<f64> {
        let per_result = self.bytes as f64 / self.published.max(1) as f64;
        self.hz().map(|hz| hz * per_result * 1e-6)
    }
}
