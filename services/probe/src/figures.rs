//! From the stages' records to figures: latencies per hop, drops by cause, rates.

use std::collections::{BTreeMap, HashMap};

use orime_messages::{ClockDomain, RecordKind, Stage, StageRecord};

use crate::spread::Spread;
use crate::stage::StageFigures;

/// Steps whose parts have not all come yet, at most.
const PARTIAL_MAX: usize = 256;

/// One way between two stages.
#[derive(Debug, Clone, Default)]
pub struct Hop {
    /// In hand minus handed over.
    pub transport: Spread,
    /// Begun minus in hand.
    pub queue: Spread,
    /// Done minus begun, in the receiving stage.
    pub compute: Spread,
}

/// Figures of a run, from its records.
#[derive(Debug, Clone, Default)]
pub struct Figures {
    /// By the receiving stage's number.
    pub(crate) hops: [Hop; 4],
    pub(crate) stages: [StageFigures; 4],
    pub(crate) end_to_end: Spread,
    pub(crate) age: Spread,
    pub(crate) camera_skew: Spread,
    pub(crate) arrival_skew: Spread,
    step_compute: Spread,
    /// Compute time and number of stages of steps that are on their way.
    partial: HashMap<u64, (u64, u32)>,
    /// Step, first and last exposure, first and last arrival of the set that capture is at.
    set: Option<CaptureSet>,
    pub(crate) frame_copies: u64,
    pub(crate) frames: u64,
    pub(crate) frame_bytes: u64,
    pub(crate) lost_steps: u64,
    newest_instant_ns: u64,
}

/// When the frames of one set were taken and arrived.
#[derive(Debug, Clone, Copy)]
struct CaptureSet {
    step: u64,
    cameras: u32,
    exposure_ns: [u64; 2],
    arrival_ns: [u64; 2],
}

impl Figures {
    /// Nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes in one record; those of a kind or stage of a later version are left out.
    pub fn add(&mut self, record: &StageRecord) {
        let Some(stage) = Stage::from_number(record.header.stage) else { return };
        let Some(kind) = record.kind() else { return };
        let Some(figures) = self.stages.get_mut(stage as usize) else { return };
        figures.add(record);
        match kind {
            RecordKind::Ended => figures.ended = true,
            RecordKind::Taken => self.add_taken(stage, record),
            RecordKind::Published => self.add_published(stage, record),
        }
    }

    /// Samples what only time changes; call it at regular intervals.
    pub fn tick(&mut self, now_ns: u64) {
        if let Some(age_ns) = self.age_ns(now_ns) {
            self.age.add_ns(age_ns);
        }
    }

    /// A frame came over: the only input that is taken in parts.
    fn add_taken(&mut self, stage: Stage, record: &StageRecord) {
        let hop = &mut self.hops[stage as usize];
        hop.transport.add_ns(record.take_ns.saturating_sub(record.upstream_publish_ns));
        self.frames += 1;
        self.frame_copies += u64::from(record.frame_copies);
        self.frame_bytes = self.frame_bytes.max(record.bytes);
    }

    fn add_published(&mut self, stage: Stage, record: &StageRecord) {
        let compute_ns = record.end_ns.saturating_sub(record.start_ns);
        let hop = &mut self.hops[stage as usize];
        hop.compute.add_ns(compute_ns);
        if stage != Stage::Capture {
            hop.queue.add_ns(record.start_ns.saturating_sub(record.take_ns));
        }
        if matches!(stage, Stage::Register | Stage::Simulate) {
            hop.transport.add_ns(record.take_ns.saturating_sub(record.upstream_publish_ns));
        }
        self.stages[stage as usize].add_published(record);
        match stage {
            Stage::Capture => self.add_to_set(record),
            _ => self.add_to_step(record.header.step, compute_ns),
        }
        if stage == Stage::Simulate {
            self.add_state(record);
        }
    }

    /// How far the cameras of a set are apart, once all its frames are known.
    fn add_to_set(&mut self, record: &StageRecord) {
        let header = &record.header;
        let (step, exposure_ns, arrival_ns) = (header.step, header.exposure_ns, header.arrival_ns);
        let widen = |[first, last]: [u64; 2], ns: u64| [first.min(ns), last.max(ns)];
        match &mut self.set {
            Some(set) if set.step == step => {
                set.cameras += 1;
                set.exposure_ns = widen(set.exposure_ns, exposure_ns);
                set.arrival_ns = widen(set.arrival_ns, arrival_ns);
            }
            other => {
                let set = CaptureSet {
                    step,
                    cameras: 1,
                    exposure_ns: [exposure_ns; 2],
                    arrival_ns: [arrival_ns; 2],
                };
                if let Some(whole) = other.replace(set).filter(|set| set.cameras > 1) {
                    self.camera_skew.add_ns(whole.exposure_ns[1] - whole.exposure_ns[0]);
                    self.arrival_skew.add_ns(whole.arrival_ns[1] - whole.arrival_ns[0]);
                }
            }
        }
    }

    /// A step's time is what segment, register and simulate computed for it.
    fn add_to_step(&mut self, step: u64, compute_ns: u64) {
        let (sum_ns, parts) = self.partial.entry(step).or_default();
        *sum_ns += compute_ns;
        *parts += 1;
        if *parts == 3 {
            self.step_compute.add_ns(*sum_ns);
            self.partial.remove(&step);
        } else if self.partial.len() > PARTIAL_MAX {
            // Steps that were dropped on their way.
            self.partial.retain(|other, _| *other + PARTIAL_MAX as u64 > step);
        }
    }

    fn add_state(&mut self, record: &StageRecord) {
        let header = &record.header;
        // A recording's or a rendering's exposure is of another time: its arrival stands for it.
        let is_live = header.clock_domain == ClockDomain::Monotonic as u32;
        let instant_ns = if is_live { header.exposure_ns } else { header.arrival_ns };
        self.end_to_end.add_ns(header.publish_ns.saturating_sub(instant_ns));
        self.newest_instant_ns = instant_ns;
        // Searching and lost, by register's numbers.
        self.lost_steps += u64::from(matches!(record.status, 0 | 3));
    }

    /// What is known of a stage of the pipeline.
    pub fn stage(&self, stage: Stage) -> Option<&StageFigures> {
        self.stages.get(stage as usize)
    }

    /// One way into a stage of the pipeline; capture has none, only its compute time.
    pub fn hop(&self, stage: Stage) -> Option<&Hop> {
        self.hops.get(stage as usize)
    }

    /// States seen.
    pub fn steps(&self) -> u64 {
        self.stages[Stage::Simulate as usize].published
    }

    /// States seen in which the sheet was not followed.
    pub fn lost_steps(&self) -> u64 {
        self.lost_steps
    }

    /// Times that a step took: segment, register and simulate together.
    pub fn step_compute(&self) -> &Spread {
        &self.step_compute
    }

    /// States handed over minus their exposure, or arrival where the source is no live one.
    pub fn end_to_end(&self) -> &Spread {
        &self.end_to_end
    }

    /// States per second between the first and the newest one; `None` with fewer than two.
    pub fn hz(&self) -> Option<f64> {
        self.stages[Stage::Simulate as usize].hz()
    }

    /// Age of information: time since the exposure (or arrival) of what the newest state is
    /// about, nanoseconds. It grows while the set stalls.
    pub fn age_ns(&self, now_ns: u64) -> Option<u64> {
        (self.newest_instant_ns > 0).then(|| now_ns.saturating_sub(self.newest_instant_ns))
    }

    /// Whole-image copies between the source and segment.
    pub fn frame_copies(&self) -> u64 {
        self.frame_copies
    }

    /// Bytes of the largest frame seen; 0 before the first.
    pub fn frame_bytes(&self) -> u64 {
        self.frame_bytes
    }

    /// Losses of all stages, by stage and cause, without those that did not happen.
    pub fn drops(&self) -> BTreeMap<String, BTreeMap<String, u64>> {
        Stage::PIPELINE
            .iter()
            .zip(&self.stages)
            .map(|(stage, figures)| {
                let drops = figures.drops();
                let causes = drops.by_cause().into_iter().filter(|(_, count)| *count > 0);
                let causes = causes.map(|(cause, count)| (cause.to_owned(), count)).collect();
                (stage.name().to_owned(), causes)
            })
            .filter(|(_, causes): &(String, BTreeMap<String, u64>)| !causes.is_empty())
            .collect()
    }

    /// Losses of all stages.
    pub fn drops_total(&self) -> u64 {
        self.stages.iter().map(|figures| figures.drops().total()).sum()
    }
}
