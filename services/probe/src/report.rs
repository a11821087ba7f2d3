//! Figures as they are printed.

use std::collections::BTreeMap;

use orime_messages::{EFFECTS, Stage};
use serde::Serialize;

use crate::figures::Figures;
use crate::spread::Percentiles;

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

/// One stage as it is printed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageReport {
    /// Results published (frame sets for capture).
    pub published: u64,
    /// Results per second.
    pub hz: Option<f64>,
    /// Standard deviation of the time between two results, milliseconds.
    pub jitter_ms: Option<f64>,
    /// Time between two results.
    pub interval_us: Percentiles,
    /// Megabytes per second.
    pub mb_per_s: Option<f64>,
    /// Messages taken and waiting, when the newest record was written.
    pub queue_depth: u32,
    /// The most that ever waited.
    pub queue_high: u32,
    /// Loans that found no free message and waited for one.
    pub loan_waits: u64,
    /// Processes that took the place of another one.
    pub restarts: u64,
    /// Seconds since its newest result.
    pub silent_s: Option<f64>,
    /// Losses by cause, those that did not happen too.
    pub drops: BTreeMap<String, u64>,
}

/// One effect that the scene names, as it is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct EffectReport {
    /// Whether it slept in the newest step.
    pub asleep: bool,
    /// Steps in which it slept.
    pub asleep_steps: u64,
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
    /// Age of the newest state, sampled at regular intervals: it grows while the set stalls.
    pub age_us: Percentiles,
    /// Reading or rendering one frame, microseconds.
    pub capture_us: Percentiles,
    /// Per hop.
    pub hops: Hops,
    /// Computing one step: segment, register and simulate, microseconds.
    pub step_us: Percentiles,
    /// State handed over minus exposure (arrival where the source is no live one), microseconds.
    pub end_to_end_us: Percentiles,
    /// The same, with the samples that a stalled set did not give (coordinated omission).
    pub end_to_end_corrected_us: Percentiles,
    /// The period that this is corrected with: capture's median, milliseconds.
    pub period_ms: Option<f64>,
    /// Exposures of one set: last minus first.
    pub camera_skew_us: Percentiles,
    /// Arrivals of one set: last minus first.
    pub arrival_skew_us: Percentiles,
    /// Frames seen.
    pub frames: u64,
    /// Bytes of the largest.
    pub frame_bytes: u64,
    /// Whole-image copies between the source and segment.
    pub frame_copies: u64,
    /// Per stage.
    pub stages: BTreeMap<String, StageReport>,
    /// What the scene lets act on the sheet, by name, and whether it sleeps.
    pub effects: BTreeMap<String, EffectReport>,
    /// Processes that took the place of another one.
    pub restarts: u64,
    /// Losses since the run began, by stage and cause.
    pub drops: BTreeMap<String, BTreeMap<String, u64>>,
    /// All of them.
    pub drops_total: u64,
}

impl Figures {
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
        let stage = |stage: &Stage| (stage.name().to_owned(), self.stage_report(*stage, now_ns));
        let period_ns = self.stages[Stage::Capture as usize].interval.quantile_ns(0.5);
        let corrected = period_ns.map(|period_ns| self.end_to_end.corrected(period_ns));
        Report {
            steps: self.steps(),
            lost_steps: self.lost_steps,
            hz: self.hz(),
            age_ms: self.age_ns(now_ns).map(|ns| ns as f64 / 1e6),
            age_us: self.age.percentiles(),
            capture_us: self.hops[0].compute.percentiles(),
            hops: Hops {
                capture_to_segment: hop(Stage::Segment),
                segment_to_register: hop(Stage::Register),
                register_to_simulate: hop(Stage::Simulate),
            },
            step_us: self.step_compute().percentiles(),
            end_to_end_us: self.end_to_end.percentiles(),
            end_to_end_corrected_us: corrected.map(|c| c.percentiles()).unwrap_or_default(),
            period_ms: period_ns.map(|ns| ns as f64 / 1e6),
            camera_skew_us: self.camera_skew.percentiles(),
            arrival_skew_us: self.arrival_skew.percentiles(),
            frames: self.frames,
            frame_bytes: self.frame_bytes,
            frame_copies: self.frame_copies,
            stages: Stage::PIPELINE.iter().map(stage).collect(),
            effects: self.effects(),
            restarts: self.stages.iter().map(|stage| stage.restarts).sum(),
            drops: self.drops(),
            drops_total: self.drops_total(),
        }
    }

    fn effects(&self) -> BTreeMap<String, EffectReport> {
        let simulate = &self.stages[Stage::Simulate as usize];
        let named = EFFECTS.iter().enumerate().filter(|(k, _)| simulate.effects >> k & 1 == 1);
        let report = |(k, name): (usize, &&str)| {
            let asleep = simulate.effects_asleep >> k & 1 == 1;
            let asleep_steps = simulate.asleep_results[k];
            ((*name).to_owned(), EffectReport { asleep, asleep_steps })
        };
        named.map(report).collect()
    }

    fn stage_report(&self, stage: Stage, now_ns: u64) -> StageReport {
        let figures = &self.stages[stage as usize];
        let causes = figures.drops().by_cause();
        let since_ns = now_ns.saturating_sub(figures.newest_ns);
        StageReport {
            published: figures.published,
            hz: figures.hz(),
            jitter_ms: figures.interval.deviation_ns().map(|ns| ns / 1e6),
            interval_us: figures.interval.percentiles(),
            mb_per_s: figures.mb_per_s(),
            queue_depth: figures.queue_depth,
            queue_high: figures.queue_high,
            loan_waits: figures.loan_waits(),
            restarts: figures.restarts,
            silent_s: (figures.newest_ns > 0).then_some(since_ns as f64 * 1e-9),
            drops: causes.into_iter().map(|(cause, count)| (cause.to_owned(), count)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_messages::{Drops, Header, RecordKind, StageRecord, WHOLE_SET};

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
            loan_waits: 1,
            queue_depth: 0,
            queue_high: 2,
            effects: 0,
            effects_asleep: 0,
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
        figures.tick(15_500);
        let report = figures.report(20_500);
        let p50 = |percentiles: &Percentiles| percentiles.p50.map(|us| (us * 10.0).round() / 10.0);
        let hop = &report.hops.capture_to_segment;
        assert_eq!((p50(&hop.transport_us), p50(&hop.queue_us)), (Some(0.3), Some(0.1)));
        assert_eq!(p50(&report.hops.segment_to_register.transport_us), Some(0.2));
        // 2000 + 5000 + 700 of compute, 10 µs from arrival to state.
        assert_eq!(p50(&report.step_us), Some(7.7));
        assert_eq!(p50(&report.end_to_end_us), Some(10.0));
        assert_eq!((report.age_ms, p50(&report.age_us)), (Some(0.02), Some(15.0)));
        assert_eq!((report.steps, report.lost_steps, report.drops_total), (1, 0, 6));
        assert_eq!(report.drops["register"]["overflow"], 2);
        assert_eq!(report.capture_us.p50, None);
        assert_eq!((report.restarts, report.stages["segment"].queue_high), (0, 2));
    }

    #[test]
    fn what_a_process_lost_is_not_forgotten_with_it() {
        let mut figures = Figures::new();
        let of = |incarnation: u64, drops: u64, step: u64| {
            let mut record = record(Stage::Register, RecordKind::Published, step, [1, 2, 3, 4, 5]);
            record.header.incarnation = incarnation;
            record.drops = Drops { restart: drops, ..Drops::default() };
            record
        };
        figures.add(&of(7, 3, 1));
        figures.add(&of(7, 4, 2));
        figures.add(&of(8, 1, 5));
        let report = figures.report(10);
        assert_eq!(report.drops["register"]["restart"], 5);
        assert_eq!((report.restarts, report.stages["register"].loan_waits), (1, 2));
    }

    #[test]
    fn effects_that_the_scene_names_are_told_with_how_often_they_slept() {
        let mut figures = Figures::new();
        for (step, asleep) in [0b1000_0000_0000, 0b1001_0000_0000, 0b1_0000_0000].iter().enumerate()
        {
            let times_ns = [1, 2, 3, 4, 5 + step as u64];
            let mut record = record(Stage::Simulate, RecordKind::Published, step as u64, times_ns);
            (record.effects, record.effects_asleep) = (0b1001_0000_0001, *asleep);
            figures.add(&record);
        }
        let report = figures.report(10).effects;
        let told: Vec<(&str, bool, u64)> =
            report.iter().map(|(name, e)| (name.as_str(), e.asleep, e.asleep_steps)).collect();
        let expected = [("facets", true, 2), ("self_contact", false, 2), ("stretch", false, 0)];
        assert_eq!(told, expected);
    }

    #[test]
    fn the_skew_of_a_set_is_between_its_first_and_last_camera() {
        let mut figures = Figures::new();
        for (step, exposures_ns) in [[1000, 4000, 2000], [9000, 9000, 9000]].iter().enumerate() {
            for ns in exposures_ns {
                let mut frame =
                    record(Stage::Capture, RecordKind::Published, step as u64, [0, 0, 1, 2, 3]);
                frame.header.exposure_ns = *ns;
                figures.add(&frame);
            }
        }
        // The second set may not be whole yet.
        let skew = figures.report(10).camera_skew_us;
        assert_eq!((skew.count, skew.max), (1, Some(3.001)));
    }
}
