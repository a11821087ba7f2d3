//! What happens to a run besides its work: one JSON object per line in `OUT/events.jsonl`, and a
//! line for the person.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use orime_runtime::now_ns;
use serde::Serialize;

/// The log's name in the output folder.
pub const EVENTS_NAME: &str = "events.jsonl";

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A process of a stage has ended where it should not have.
    Died,
    /// A process was killed because it stood still, or did not get ready.
    Hung,
    /// Somebody asked for a restart.
    Asked,
    /// A successor was started.
    Started,
    /// It has opened its channels.
    Ready,
    /// The set has given a state that came through it.
    Recovered,
    /// A camera gives no frames.
    Degraded,
    /// It does again.
    Restored,
    /// The wall clock was set.
    ClockStep,
    /// The machine slept.
    Suspend,
    /// The set is given up.
    GaveUp,
}

/// One event.
#[derive(Debug, Clone, Serialize)]
pub struct Event {
    /// `CLOCK_MONOTONIC`, nanoseconds, as in messages and records.
    pub at_ns: u64,
    /// The run.
    pub run: String,
    /// What happened.
    pub event: Kind,
    /// To which stage, if it was one.
    pub stage: Option<&'static str>,
    /// Newest step of the set's states.
    pub step: Option<u64>,
    /// For the person.
    pub detail: String,
}

/// The log of one run.
#[derive(Debug)]
pub struct Events {
    run: String,
    file: File,
    /// What was logged so far, the newest last; as many as fit a summary.
    kept: Vec<Event>,
}

/// Most events that a summary holds.
const KEPT_MAX: usize = 1000;

impl Events {
    /// Begins the log in `out`.
    pub fn begin(out: &Path, run: String) -> io::Result<Self> {
        Ok(Self { run, file: File::create(out.join(EVENTS_NAME))?, kept: Vec::new() })
    }

    /// Logs one event, and tells the person.
    pub fn add(
        &mut self,
        event: Kind,
        stage: Option<&'static str>,
        step: Option<u64>,
        detail: String,
    ) {
        let event = Event { at_ns: now_ns(), run: self.run.clone(), event, stage, step, detail };
        if let Ok(line) = serde_json::to_string(&event) {
            // A full disk is no reason to stop the set.
            let _ = writeln!(self.file, "{line}");
        }
        let who = event.stage.map_or(String::new(), |stage| format!("stage `{stage}` "));
        let _ = writeln!(io::stderr(), "\norime: {who}{}", event.detail);
        if self.kept.len() < KEPT_MAX {
            self.kept.push(event);
        }
    }

    /// What was logged.
    pub fn into_list(self) -> Vec<Event> {
        self.kept
    }
}
