//! How a set came back after one of its stages died.

use orime_messages::Stage;
use orime_probe::Figures;
use serde::Serialize;

/// One restart of one stage.
#[derive(Debug, Clone, Serialize)]
pub struct Recovery {
    /// The stage.
    pub stage: &'static str,
    /// Why it was restarted.
    pub cause: String,
    /// When that was seen, `CLOCK_MONOTONIC`, nanoseconds.
    pub died_ns: u64,
    /// Newest step of the set's states then.
    pub step: Option<u64>,
    /// Time until the successor had opened its channels, milliseconds.
    pub ready_ms: Option<f64>,
    /// Time until its first result; `None` for a stage that publishes none.
    pub result_ms: Option<f64>,
    /// Time until the first state that came through it.
    pub state_ms: Option<f64>,
    /// Messages that were lost with it or sent before its successor was there.
    pub messages_lost: Option<u64>,
    #[serde(skip)]
    of: Stage,
    #[serde(skip)]
    incarnation: u64,
    #[serde(skip)]
    published: Option<u64>,
    #[serde(skip)]
    lost_before: u64,
}

fn lost(figures: &Figures, stage: Stage) -> u64 {
    figures.stage(stage).map_or(0, |stage| stage.drops().restart)
}

impl Recovery {
    /// A stage has died.
    pub fn begin(stage: Stage, cause: String, died_ns: u64, figures: &Figures) -> Self {
        let own = figures.stage(stage);
        Self {
            stage: stage.name(),
            cause,
            died_ns,
            step: figures.stage(Stage::Simulate).and_then(|simulate| simulate.step),
            ready_ms: None,
            result_ms: None,
            state_ms: None,
            messages_lost: None,
            of: stage,
            incarnation: own.map_or(0, |own| own.incarnation),
            published: own.and_then(|own| own.step),
            lost_before: lost(figures, stage),
        }
    }

    /// Which stage it is.
    pub fn of(&self) -> Stage {
        self.of
    }

    /// Its successor is ready.
    pub fn is_ready(&mut self, now_ns: u64) {
        self.ready_ms = Some(self.since_ms(now_ns));
    }

    /// Whether there is something to wait for still.
    pub fn is_open(&self) -> bool {
        let is_pipeline = Stage::PIPELINE.contains(&self.of);
        self.ready_ms.is_none() || (is_pipeline && self.state_ms.is_none())
    }

    /// Looks what the records say meanwhile; whether the set has just recovered.
    pub fn look(&mut self, figures: &Figures) -> bool {
        let (Some(own), Some(simulate)) = (figures.stage(self.of), figures.stage(Stage::Simulate))
        else {
            return false;
        };
        if own.incarnation == self.incarnation || own.step.is_none() {
            return false;
        }
        if self.result_ms.is_none() && own.newest_ns > self.died_ns {
            self.result_ms = Some(self.since_ms(own.newest_ns));
            self.messages_lost = Some(lost(figures, self.of) - self.lost_before);
        }
        let came_through = simulate.step > self.published && simulate.newest_ns > self.died_ns;
        if self.result_ms.is_some() && self.state_ms.is_none() && came_through {
            self.state_ms = Some(self.since_ms(simulate.newest_ns));
            return true;
        }
        false
    }

    fn since_ms(&self, ns: u64) -> f64 {
        ns.saturating_sub(self.died_ns) as f64 / 1e6
    }
}
