//! From the stages' records to figures: latencies per hop, drops by cause, rates.

use std::collections::{BTreeMap, HashMap};

use orime_messages::{Drops, RecordKind, Stage, StageRecord};
use serde::Serialize;

use crate::spread::{Percentiles, Spread};

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

/// What is known of one stage.
#[derive(Debug, Clone, Default)]
pub struct StageFigures {
    /// Results published (frame sets for capture).
    pub published: u64,
    /// Messages published: frames for capture.
    pub messages: u64,
    /// Step of the newest result.
    pub step: Option<u64>,
    /// Losses so far, counted by the stage.
    pub drops: Drops,
    /// Whether it has said that it ended in order.
    pub ended: bool,
    /// When its newest record was about, `CLOCK_MONOTONIC`, nanoseconds.
    pub newest_ns: u64,
    /// Newest status: tracking for register and simulate.
    pub status: u32,
}

/// Figures of a run, from its records.
#[derive(Debug, Clone, Default)]
pub struct Figures {
    /// By the receiving stage's number.
    hops: [Hop; 4],
    stages: [StageFigures; 4],
    end_to_end: Spread,
    step_compute: Spread,
    /// Compute time and number of stages of steps that are on their way.
    partial: HashMap<u64, (u64, u32)>,
    frame_copies: u64,
    frames: u64,
    frame_bytes: u64,
    lost_steps: u64,
    first_state_ns: Option<u64>,
    newest_state_ns: u64,
    newest_arrival_ns: u64,
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
        figures.drops = record.drops;
        match kind {
            RecordKind::Ended => figures.ended = true,
            RecordKind::Taken => self.add_taken(stage, record),
            RecordKind::Published => self.add_published(stage, record),
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
        let step = record.header.step;
        let figures = &mut self.stages[stage as usize];
        if figures.step != Some(step) {
            figures.published += 1;
        }
        figures.messages += 1;
        figures.step = Some(step);
        figures.status = record.status;
        figures.newest_ns = record.header.publish_ns;
        if stage != Stage::Capture {
            self.add_to_step(step, compute_ns);
        }
        if stage == Stage::Simulate {
            self.add_state(record);
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
        self.end_to_end.add_ns(header.publish_ns.saturating_sub(header.arrival_ns));
        self.first_state_ns.get_or_insert(header.publish_ns);
        self.newest_state_ns = header.publish_ns;
        self.newest_arrival_ns = header.arrival_ns;
        // Searching and lost, by register's numbers.
        self.lost_steps += u64::from(matches!(record.status, 0 | 3));
    }

    /// What is known of a stage of the pipeline.
    pub fn stage(&self, stage: Stage) -> Option<&StageFigures> {
        self.stages.get(stage as usize)
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

    /// States per second between the first and the newest one; `None` with fewer than two.
    pub fn hz(&self) -> Option<f64> {
        let seconds = self.newest_state_ns.checked_sub(self.first_state_ns?)? as f64 * 1e-9;
        (seconds > 0.0).then(|| (self.steps() - 1) as f64 / seconds)
    }

    /// Age of the newest state: time since its frame set's arrival, nanoseconds.
    pub fn age_ns(&self, now_ns: u64) -> Option<u64> {
        (self.newest_arrival_ns > 0).then(|| now_ns.saturating_sub(self.newest_arrival_ns))
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
                let causes = figures.drops.by_cause().into_iter().filter(|(_, count)| *count > 0);
                let causes = causes.map(|(cause, count)| (cause.to_owned(), count)).collect();
                (stage.name().to_owned(), causes)
            })
            .filter(|(_, causes): &(String, BTreeMap<String, u64>)| !causes.is_empty())
            .collect()
    }

    /// Losses of all stages.
    pub fn drops_total(&self) -> u64 {
        self.stages.iter().map(|figures| figures.drops.total()).sum()
    }

    /// Everything as it is printed.
    pub fn report(&self, now_ns: u64) -> Report {
        let hop = |stage: Stage| {
            let hop = &self.hops[stage as usize];
            HopReport {
                transport_us: hop.transport.percentiles(),
                queue_us: hop.queue.percentiles(),
                compute_us: hop.compute.percentiles(),
            }
        };
        Report {
            steps: self.steps(),
            lost_steps: self.lost_steps,
            hz: self.hz(),
            age_ms: self.age_ns(now_ns).map(|ns| ns as f64 / 1e6),
            capture_us: self.hops[0].compute.percentiles(),
            hops: Hops {
                capture_to_segment: hop(Stage::Segment),
                segment_to_register: hop(Stage::Register),
                register_to_simulate: hop(Stage::Simulate),
            },
            step_us: self.step_compute.percentiles(),
            end_to_end_us: self.end_to_end.percentiles(),
            frames: self.frames,
            frame_bytes: self.frame_bytes,
            frame_copies: self.frame_copies,
            drops: self.drops(),
            drops_total: self.drops_total(),
        }
    }
}

/// One hop as it is printed, microseconds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HopReport {
    /// In hand minus handed over.
    pub transport_us: Percentiles,
    /// Begun minus in hand.
    pub queue_us: Percentiles,
    /// Done minus begun, in the receiving stage.
    pub compute_us: Percentiles,
}

/// The three hops.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Hops {
    /// Frames.
    pub capture_to_segment: HopReport,
    /// Clouds.
    pub segment_to_register: HopReport,
    /// Targets.
    pub register_to_simulate: HopReport,
}

/// Figures as they are printed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// States seen.
    pub steps: u64,
    /// … in which the sheet was not followed.
    pub lost_steps: u64,
    /// States per second.
    pub hz: Option<f64>,
    /// Age of the newest state, milliseconds.
    pub age_ms: Option<f64>,
    /// Reading or rendering one frame, microseconds.
    pub capture_us: Percentiles,
    /// Per hop.
    pub hops: Hops,
    /// Computing one step: segment, register and simulate, microseconds.
    pub step_us: Percentiles,
    /// State handed over minus frame set arrived, microseconds.
    pub end_to_end_us: Percentiles,
    /// Frames seen.
    pub frames: u64,
    /// Bytes of the largest.
    pub frame_bytes: u64,
    /// Whole-image copies between the source and segment.
    pub frame_copies: u64,
    /// Losses since the run began, by stage and cause.
    pub drops: BTreeMap<String, BTreeMap<String, u64>>,
    /// All of them.
    pub drops_total: u64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_messages::{Header, WHOLE_SET};

    fn record(stage: Stage, kind: RecordKind, step: u64, times_ns: [u64; 5]) -> StageRecord {
        let [upstream_publish_ns, take_ns, start_ns, end_ns, publish_ns] = times_ns;
        StageRecord {
            header: Header {
                run_id: 1,
                incarnation: 1,
                sequence: 0,
                step,
                exposure_ns: 0,
                arrival_ns: 500,
                publish_ns,
                stage: stage as u32,
                clock_domain: 0,
                flags: 0,
                reserved: 0,
            },
            kind: kind as u32,
            camera: WHOLE_SET,
            upstream_publish_ns,
            take_ns,
            start_ns,
            end_ns,
            status: 1,
            frame_copies: 0,
            bytes: 10,
            drops: Drops { overflow: 2, ..Drops::default() },
        }
    }

    #[test]
    fn hops_and_steps_come_out_as_they_were_made() {
        let mut figures = Figures::new();
        let published = RecordKind::Published;
        figures.add(&record(Stage::Segment, RecordKind::Taken, 4, [1000, 1300, 0, 0, 0]));
        // Records of two publishers may come in any order.
        let simulate = [9000, 9100, 9200, 9900, 10_500];
        figures.add(&record(Stage::Simulate, published, 4, simulate));
        figures.add(&record(Stage::Segment, published, 4, [1000, 1300, 1400, 3400, 3500]));
        figures.add(&record(Stage::Register, published, 4, [3500, 3700, 3800, 8800, 9000]));
        let report = figures.report(20_500);
        let p50 = |percentiles: &Percentiles| percentiles.p50.map(|us| (us * 10.0).round() / 10.0);
        let hop = &report.hops.capture_to_segment;
        assert_eq!((p50(&hop.transport_us), p50(&hop.queue_us)), (Some(0.3), Some(0.1)));
        assert_eq!(p50(&report.hops.segment_to_register.transport_us), Some(0.2));
        // 2000 + 5000 + 700 of compute, 10 µs from arrival to state.
        assert_eq!(p50(&report.step_us), Some(7.7));
        assert_eq!(p50(&report.end_to_end_us), Some(10.0));
        assert_eq!(report.age_ms, Some(0.02));
        assert_eq!((report.steps, report.lost_steps, report.drops_total), (1, 0, 6));
        assert_eq!(report.drops["register"]["overflow"], 2);
        assert_eq!(report.capture_us.p50, None);
    }
}
