//! What a stage says about its own work, and what it lost.

use orime_messages::{Drops, Header, RecordKind, StageRecord, WHOLE_SET};

use crate::error::RuntimeError;
use crate::gauge;
use crate::publish::Publisher;

/// Times and facts of one piece of work; see [`StageRecord`] for their meaning.
#[derive(Debug, Clone, Copy, Default)]
pub struct Work {
    /// Camera, or `None` for the whole set.
    pub camera: Option<u32>,
    /// When the input was handed over by its publisher.
    pub upstream_publish_ns: u64,
    /// When the input was in hand.
    pub take_ns: u64,
    /// When work began.
    pub start_ns: u64,
    /// When work ended.
    pub end_ns: u64,
    /// Tracking or frame status.
    pub status: u32,
    /// Whole-image copies of this frame so far.
    pub frame_copies: u32,
    /// Bytes of the message.
    pub bytes: u64,
    /// What acts on the sheet, see [`StageRecord::effects`].
    pub effects: u32,
    /// What of it slept.
    pub effects_asleep: u32,
}

/// Publishes a stage's records.
#[derive(Debug)]
pub struct Recorder {
    records: Publisher<StageRecord>,
}

impl Recorder {
    pub(crate) fn new(records: Publisher<StageRecord>) -> Self {
        Self { records }
    }

    /// One message was taken in.
    pub fn taken(&mut self, of: &Header, work: Work, drops: Drops) -> Result<(), RuntimeError> {
        self.record(RecordKind::Taken, &Header { publish_ns: 0, ..*of }, work, drops)
    }

    /// One message was published, with header `result`.
    pub fn published(
        &mut self,
        result: &Header,
        work: Work,
        drops: Drops,
    ) -> Result<(), RuntimeError> {
        self.record(RecordKind::Published, result, work, drops)
    }

    /// This stage has ended in order.
    pub fn ended(&mut self, last: &Header, drops: Drops) -> Result<(), RuntimeError> {
        self.record(RecordKind::Ended, last, Work::default(), drops)
    }

    fn record(
        &mut self,
        kind: RecordKind,
        about: &Header,
        work: Work,
        drops: Drops,
    ) -> Result<(), RuntimeError> {
        // The record's own publish time is of no interest; that of the result is put in its place.
        self.records.send_stamped(about, |record| {
            record.kind = kind as u32;
            record.camera = work.camera.unwrap_or(WHOLE_SET);
            record.upstream_publish_ns = work.upstream_publish_ns;
            record.take_ns = work.take_ns;
            record.start_ns = work.start_ns;
            record.end_ns = work.end_ns;
            record.status = work.status;
            record.frame_copies = work.frame_copies;
            record.bytes = work.bytes;
            record.effects = work.effects;
            record.effects_asleep = work.effects_asleep;
            record.drops = drops;
            (record.loan_waits, record.queue_depth, record.queue_high) = gauge::read();
        })
    }
}
