//! What each stage says about its own work; all that probe and supervisor read.

use bytemuck::{Pod, Zeroable};

use crate::{Header, layout, message};

/// Messages that never became a result, counted since the stage began, by cause.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Drops {
    /// Overwritten in shared memory before they were taken (a gap in the sequence).
    pub overflow: u64,
    /// Taken, but a newer one was there before work began.
    pub superseded: u64,
    /// Frames whose set was never complete.
    pub unmatched: u64,
    /// Not usable: unreadable frames.
    pub rejected: u64,
    /// Too old to be worth the work.
    pub expired: u64,
    /// Lost with a process of this stage that died, or sent before its successor was there.
    pub restart: u64,
}
layout!(Drops {
    overflow: u64,
    superseded: u64,
    unmatched: u64,
    rejected: u64,
    expired: u64,
    restart: u64,
});

impl Drops {
    /// Causes and counts, in a fixed order.
    pub fn by_cause(&self) -> [(&'static str, u64); 6] {
        [
            ("overflow", self.overflow),
            ("superseded", self.superseded),
            ("unmatched", self.unmatched),
            ("rejected", self.rejected),
            ("expired", self.expired),
            ("restart", self.restart),
        ]
    }

    /// These and those, cause by cause.
    pub fn plus(&self, other: &Drops) -> Drops {
        Drops {
            overflow: self.overflow + other.overflow,
            superseded: self.superseded + other.superseded,
            unmatched: self.unmatched + other.unmatched,
            rejected: self.rejected + other.rejected,
            expired: self.expired + other.expired,
            restart: self.restart + other.restart,
        }
    }

    /// All of them.
    pub fn total(&self) -> u64 {
        self.by_cause().iter().map(|(_, count)| count).sum()
    }
}

/// What a record is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum RecordKind {
    /// One message was taken in (a frame of one camera).
    Taken = 0,
    /// One message was published: the stage's result for a step, or one captured frame.
    Published = 1,
    /// The stage has ended in order.
    Ended = 2,
}

/// What may act on a sheet, by its bit in [`StageRecord::effects`]; simulate's own numbers.
pub const EFFECTS: [&str; 12] = [
    "stretch",
    "shear",
    "bend",
    "crease",
    "damping",
    "gravity",
    "air_drag",
    "table",
    "facets",
    "grippers",
    "track",
    "self_contact",
];

/// [`StageRecord::camera`] where a record is about the whole set.
pub const WHOLE_SET: u32 = u32::MAX;

message! {
    /// One piece of work of one stage.
    ///
    /// transport = take − upstream publish; queue = start − take; compute = end − start;
    /// end to end = publish − arrival. All times are `CLOCK_MONOTONIC`, nanoseconds.
    pub struct StageRecord as "orime.StageRecord.v1" {
        /// Lineage; `publish_ns` is that of the result, 0 for [`RecordKind::Taken`].
        pub header: Header,
        /// Number of a [`RecordKind`].
        pub kind: u32,
        /// Camera, or [`WHOLE_SET`].
        pub camera: u32,
        /// When the input was handed over by its publisher; 0 where there is none.
        pub upstream_publish_ns: u64,
        /// When this stage had the input in hand.
        pub take_ns: u64,
        /// When work on it began.
        pub start_ns: u64,
        /// When work on it ended.
        pub end_ns: u64,
        /// Tracking (register, simulate) or frame status (capture, segment).
        pub status: u32,
        /// Whole-image copies of this frame between its source and this stage.
        pub frame_copies: u32,
        /// Bytes of the message taken or published.
        pub bytes: u64,
        /// Losses of this process so far.
        pub drops: Drops,
        /// Loans of this process so far that had to wait for a free message.
        pub loan_waits: u64,
        /// Messages that this process has taken and not begun with.
        pub queue_depth: u32,
        /// The most of these that there ever were.
        pub queue_high: u32,
        /// Simulate: what the scene names, a bit per entry of [`EFFECTS`]; others 0.
        pub effects: u32,
        /// … and which of these proved idle in this step: nothing was paid for them.
        pub effects_asleep: u32,
    }
}

impl StageRecord {
    /// The kind, or `None` for a number that no version of this crate wrote.
    pub fn kind(&self) -> Option<RecordKind> {
        match self.kind {
            0 => Some(RecordKind::Taken),
            1 => Some(RecordKind::Published),
            2 => Some(RecordKind::Ended),
            _ => None,
        }
    }
}

const _: () = assert!(size_of::<StageRecord>() == 72 + 8 + 32 + 8 + 8 + 48 + 16 + 8);
