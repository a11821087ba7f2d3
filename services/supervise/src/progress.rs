//! What a running set is doing, from its records and the judge's lines.

use std::fmt::Write as _;
use std::io::{self, IsTerminal, Write as _};
use std::time::Duration;

use orime_messages::{FrameStatus, RecordKind, Stage, StageRecord};
use orime_probe::Figures;
use orime_runtime::{Guest, Resume, RuntimeError, now_ns};
use serde::Deserialize;

use crate::process::Process;

/// Time between two redraws of the live line in a terminal, nanoseconds.
const TERMINAL_NS: u64 = 200_000_000;
/// Time between two lines where the output is no terminal, nanoseconds.
const FILE_NS: u64 = 2_000_000_000;
/// Periods without a frame after which a camera counts as degraded.
const DEGRADED_PERIODS: u64 = 5;
/// … and the least time, nanoseconds.
const DEGRADED_MIN_NS: u64 = 500_000_000;

/// The state of a running set.
#[derive(Debug)]
pub struct Progress {
    /// Figures from the records.
    pub figures: Figures,
    /// Newest distance between observation and model that the judge said, millimetres.
    pub e_mm: Option<f64>,
    /// When anything last moved, `CLOCK_MONOTONIC`, nanoseconds.
    pub moved_ns: u64,
    /// Newest step that the judge said something of.
    judge_step: Option<u64>,
    /// Of judge, simulate, register and segment: the step that they are at, and since when they
    /// have had input for another one.
    behind: [Option<(Option<u64>, u64)>; 4],
    /// Per camera: when it gave its newest frame with pixels, and whether it gives none.
    good: Vec<(u64, bool)>,
    cameras: u64,
    steps_max: Option<u64>,
    shown_ns: u64,
    is_terminal: bool,
    line_is_open: bool,
}

/// What the judge prints per step.
#[derive(Debug, Deserialize)]
struct JudgeLine {
    step: Option<u64>,
    e_mm: Option<f64>,
}

/// Names of [`orime_register::Tracking`]'s numbers.
fn tracking_name(status: u32) -> &'static str {
    match status {
        0 => "searching",
        1 => "tracking",
        2 => "coasting",
        _ => "lost",
    }
}

impl Progress {
    /// A set of so many steps and cameras that has not begun.
    pub fn new(steps_max: Option<u64>, cameras: usize) -> Self {
        Self {
            figures: Figures::new(),
            e_mm: None,
            moved_ns: now_ns(),
            judge_step: None,
            behind: [None; 4],
            good: vec![(0, false); cameras.max(1)],
            cameras: cameras.max(1) as u64,
            steps_max,
            shown_ns: 0,
            is_terminal: io::stdout().is_terminal(),
            line_is_open: false,
        }
    }

    /// Takes in all records that are there.
    pub fn read(&mut self, guest: &mut Guest) -> Result<(), RuntimeError> {
        while let Some(record) = guest.records.try_next()? {
            self.figures.add(&record);
            self.look_at_frame(&record);
            if record.kind() != Some(RecordKind::Taken) {
                self.moved_ns = now_ns();
            }
        }
        Ok(())
    }

    /// Takes in a line of the judge; others than its figures are left out.
    pub fn judge_said(&mut self, line: &str) {
        if let Ok(JudgeLine { step, e_mm }) = serde_json::from_str(line) {
            self.judge_step = step.or(self.judge_step);
            self.e_mm = e_mm.or(self.e_mm);
            self.moved_ns = now_ns();
        }
    }

    fn look_at_frame(&mut self, record: &StageRecord) {
        let is_frame = record.header.stage == Stage::Capture as u32
            && record.kind() == Some(RecordKind::Published)
            && record.status == FrameStatus::Ok as u32;
        if let Some(good) = self.good.get_mut(record.camera as usize).filter(|_| is_frame) {
            good.0 = record.header.publish_ns;
        }
    }

    /// Cameras that have just ceased to give frames, or begun again (`false`).
    pub fn cameras_changed(&mut self, now: u64) -> Vec<(usize, bool)> {
        let capture = self.figures.stage(Stage::Capture);
        let period_ns = capture.and_then(|capture| capture.interval.quantile_ns(0.5)).unwrap_or(0);
        let limit_ns = (DEGRADED_PERIODS * period_ns).max(DEGRADED_MIN_NS);
        let mut changed = Vec::new();
        for (camera, (newest_ns, is_degraded)) in self.good.iter_mut().enumerate() {
            let is_missing = *newest_ns > 0 && now.saturating_sub(*newest_ns) > limit_ns;
            if is_missing != *is_degraded {
                *is_degraded = is_missing;
                changed.push((camera, is_missing));
            }
        }
        changed
    }

    /// Whether a process that has ended did so because its stream had.
    pub fn ended_in_order(&self, process: &mut Process) -> bool {
        let said_so = match process.stage {
            Stage::Judge | Stage::Record => process.ended_because.is_none(),
            stage => self.figures.stage(stage).is_some_and(|figures| figures.ended),
        };
        said_so && process.poll().is_some_and(|status| status.success())
    }

    /// Where the successor of a stage goes on.
    pub fn resume(&self, stage: Stage) -> Resume {
        let figures = |stage: Stage| self.figures.stage(stage);
        let next_set = figures(Stage::Capture).map_or(0, |capture| match capture.step {
            Some(step) if u64::from(capture.camera) + 1 >= self.cameras => step + 1,
            step => step.unwrap_or(0),
        });
        let at = Stage::PIPELINE.iter().position(|other| *other == stage);
        let before = match stage {
            Stage::Judge => figures(Stage::Simulate),
            _ => at.and_then(|at| at.checked_sub(1)).and_then(|at| figures(Stage::PIPELINE[at])),
        };
        Resume {
            next_set,
            source_began: 0,
            published: figures(stage).and_then(|figures| figures.step),
            asked: before.and_then(|before| before.step),
            input_ended: before.is_some_and(|before| before.ended),
        }
    }

    /// Nobody is behind: whoever was had to wait for a stage that was replaced.
    pub fn begin_anew(&mut self) {
        self.moved_ns = now_ns();
        self.behind = [None; 4];
    }

    /// Stages that have had input for so long and given no result, most downstream first. To be
    /// called at every look: how long somebody is behind is known from the looks before.
    pub fn stalled(&mut self, stall: Duration) -> Vec<Stage> {
        let (now, stall_ns) = (now_ns(), stall.as_nanos() as u64);
        let step = |stage: Stage| self.figures.stage(stage).and_then(|figures| figures.step);
        let [capture, segment, register, simulate] = Stage::PIPELINE.map(step);
        let pairs = [
            (Stage::Judge, simulate, self.judge_step),
            (Stage::Simulate, register, simulate),
            (Stage::Register, segment, register),
            (Stage::Segment, capture, segment),
        ];
        let mut stalled = Vec::new();
        for ((stage, input, own), behind) in pairs.into_iter().zip(&mut self.behind) {
            // A result that came meanwhile, or nothing to do, begins anew.
            match behind {
                Some((at, since_ns)) if input > own && *at == own => {
                    if now.saturating_sub(*since_ns) > stall_ns {
                        stalled.push(stage);
                    }
                }
                _ => *behind = (input > own).then_some((own, now)),
            }
        }
        stalled
    }

    /// The process that holds the others up: the recorder or the judge if they are behind, else
    /// the most downstream one that has not given what its predecessor gave it; capture if none
    /// has anything to do. `recorded`: the newest step of a recorder, if there is one.
    pub fn holdup(&self, judge: bool, recorded: Option<Option<u64>>) -> Stage {
        let step = |stage| {
            let figures = self.figures.stage(stage)?;
            // A frame set is no result before its last frame.
            let is_whole = stage != Stage::Capture || figures.messages % self.cameras == 0;
            if is_whole { figures.step } else { figures.step?.checked_sub(1) }
        };
        if recorded.is_some_and(|recorded| step(Stage::Capture) > recorded) {
            return Stage::Record;
        }
        if judge && step(Stage::Simulate) > self.judge_step {
            return Stage::Judge;
        }
        Stage::PIPELINE
            .windows(2)
            .rev()
            .find(|pair| step(pair[0]) > step(pair[1]))
            .map_or(Stage::Capture, |pair| pair[1])
    }

    /// Shows the live line if it is time to.
    pub fn show(&mut self) {
        let now = now_ns();
        let pause_ns = if self.is_terminal { TERMINAL_NS } else { FILE_NS };
        if now < self.shown_ns + pause_ns || self.figures.steps() == 0 {
            return;
        }
        self.shown_ns = now;
        let line = self.line(now);
        let mut out = io::stdout().lock();
        // A terminal that is gone shows nothing: no reason to stop the set.
        let _ = if self.is_terminal {
            self.line_is_open = true;
            write!(out, "\r\x1b[2K{line}")
        } else {
            writeln!(out, "{line}")
        };
        let _ = out.flush();
    }

    /// Ends the live line, so that what follows begins a line of its own.
    pub fn close(&mut self) {
        if self.line_is_open {
            println!();
            self.line_is_open = false;
        }
    }

    fn line(&self, now: u64) -> String {
        let figures = &self.figures;
        let simulate = figures.stage(Stage::Simulate);
        let mut line = format!("step {}", simulate.and_then(|f| f.step).map_or(0, |step| step + 1));
        // Writing to a string cannot fail.
        if let Some(steps) = self.steps_max {
            let _ = write!(line, "/{steps}");
        }
        match self.e_mm {
            Some(e_mm) => drop(write!(line, "  E {e_mm:.2} mm")),
            None => line.push_str("  E -"),
        }
        if let Some(ns) = figures.step_compute().quantile_ns(0.5) {
            let _ = write!(line, "  {:.1} ms/step", ns as f64 / 1e6);
        }
        if let Some(hz) = figures.hz() {
            let _ = write!(line, "  {hz:.1}/s");
        }
        if let Some(age_ns) = figures.age_ns(now) {
            let _ = write!(line, "  age {:.0} ms", age_ns as f64 / 1e6);
        }
        let _ = write!(line, "  drops {}", figures.drops_total());
        let _ = write!(line, "  {}", tracking_name(simulate.map_or(0, |f| f.status)));
        line
    }
}
