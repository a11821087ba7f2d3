//! What every message begins with: who sent it, where it comes from, and when.

use bytemuck::{Pod, Zeroable};

use crate::layout;

/// A process of the set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u32)]
pub enum Stage {
    /// Publishes frames.
    Capture = 0,
    /// Frames to clouds.
    Segment = 1,
    /// Clouds to targets.
    Register = 2,
    /// Targets to states.
    Simulate = 3,
    /// Scores the set from outside the loop.
    Judge = 4,
    /// Records the set from outside the loop.
    Record = 5,
}

impl Stage {
    /// The four stages of the pipeline, in the order of the data.
    pub const PIPELINE: [Stage; 4] =
        [Stage::Capture, Stage::Segment, Stage::Register, Stage::Simulate];

    /// Lower-case name, as in set files, logs and program names.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Capture => "capture",
            Stage::Segment => "segment",
            Stage::Register => "register",
            Stage::Simulate => "simulate",
            Stage::Judge => "judge",
            Stage::Record => "record",
        }
    }

    /// The stage with this number, if any.
    pub fn from_number(number: u32) -> Option<Self> {
        let outside = [Stage::Judge, Stage::Record];
        Self::PIPELINE.into_iter().chain(outside).find(|stage| *stage as u32 == number)
    }
}

/// Whose clock an exposure time was read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum ClockDomain {
    /// The source's own: a recording's or a rendering's time.
    Source = 0,
    /// `CLOCK_MONOTONIC` of this machine.
    Monotonic = 1,
}

/// Set in [`Header::flags`] of the last message of a stream, which carries nothing else.
pub const FLAG_END: u32 = 1;

/// Set in [`Header::flags`] of a state that nothing was observed for yet: where the sheet is
/// expected at `exposure_ns`.
pub const FLAG_PREDICTION: u32 = 2;

/// First field of every message.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Header {
    /// The run of the set, the same in all its processes.
    pub run_id: u64,
    /// The publishing process; a restarted stage has another one and counts from 0 again.
    pub incarnation: u64,
    /// Messages that this publisher sent before this one.
    pub sequence: u64,
    /// Lineage: number of the frame set that this message is about.
    pub step: u64,
    /// Exposure of camera 0 of that frame set, in the clock of `clock_domain`, nanoseconds.
    pub exposure_ns: u64,
    /// When capture had the last pixel of the frame set, `CLOCK_MONOTONIC`, nanoseconds.
    pub arrival_ns: u64,
    /// When this message was handed over, `CLOCK_MONOTONIC`, nanoseconds.
    pub publish_ns: u64,
    /// Number of the publishing [`Stage`].
    pub stage: u32,
    /// Number of the [`ClockDomain`] of `exposure_ns`.
    pub clock_domain: u32,
    /// [`FLAG_END`], [`FLAG_PREDICTION`] or 0.
    pub flags: u32,
    /// Always 0.
    pub reserved: u32,
}

layout!(Header {
    run_id: u64,
    incarnation: u64,
    sequence: u64,
    step: u64,
    exposure_ns: u64,
    arrival_ns: u64,
    publish_ns: u64,
    stage: u32,
    clock_domain: u32,
    flags: u32,
    reserved: u32,
});
const _: () = assert!(size_of::<Header>() == 72);

impl Header {
    /// Whether this is the last message of its stream, without content.
    pub fn is_end(&self) -> bool {
        self.flags & FLAG_END != 0
    }

    /// Whether this is about an instant for which nothing was observed yet.
    pub fn is_prediction(&self) -> bool {
        self.flags & FLAG_PREDICTION != 0
    }
}
