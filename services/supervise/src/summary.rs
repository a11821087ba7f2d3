//! What is said when a set has ended.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use orime_probe::Report;
use orime_record::Report as Recorded;
use serde::Serialize;
use serde_json::Value;

use crate::events::Event;
use crate::recovery::Recovery;

/// How a run went.
#[derive(Debug, Serialize)]
pub struct Summary {
    /// The run.
    pub run: String,
    /// The set's name.
    pub name: String,
    /// `finished`, `stopped` or `failed`.
    pub outcome: String,
    /// What failed, if anything did.
    pub failure: Option<String>,
    /// States published.
    pub steps: u64,
    /// … in which the tracker said that it did not follow the sheet.
    pub lost_steps: u64,
    /// States per second.
    pub hz: Option<f64>,
    /// Milliseconds that segment, register and simulate computed per step, median.
    pub ms_per_step_p50: Option<f64>,
    /// … 99th percentile.
    pub ms_per_step_p99: Option<f64>,
    /// Whole-image copies between capture and segment.
    pub frame_copies: u64,
    /// Losses by stage and cause.
    pub drops: BTreeMap<String, BTreeMap<String, u64>>,
    /// All of them.
    pub drops_total: u64,
    /// Shared-memory objects that the run's processes left when all had gone; they were removed.
    pub shared_memory_left: usize,
    /// The judge's own summary.
    pub judge: Option<Value>,
    /// The recording, if there is one.
    pub recording: Option<RecordingSummary>,
    /// Stages that were restarted.
    pub restarts: Vec<Recovery>,
    /// What happened besides the work, the first thousand.
    pub events: Vec<Event>,
    /// Latencies per hop.
    pub report: Report,
    /// Where everything was written.
    pub out: PathBuf,
    /// What was written there.
    pub written: Vec<PathBuf>,
}

/// How a recording went.
#[derive(Debug, Serialize)]
pub struct RecordingSummary {
    /// Whether all that was published is in the file.
    pub complete: bool,
    /// Why not, if not.
    pub incomplete_because: Option<String>,
    /// What the recorder said.
    #[serde(flatten)]
    pub report: Recorded,
}

impl RecordingSummary {
    /// The summary of a recording that has ended.
    pub fn of(report: Recorded) -> Self {
        let incomplete_because = report.incomplete();
        Self { complete: incomplete_because.is_none(), incomplete_because, report }
    }

    /// For a person.
    pub fn text(&self) -> String {
        let Recorded { file, bytes, recorded, frames_unreadable, .. } = &self.report;
        let (file, mb) = (file.display(), *bytes as f64 * 1e-6);
        let mut text = format!("{file}: {recorded}, {mb:.1} MB");
        if *frames_unreadable > 0 {
            text.push_str(&format!(", {frames_unreadable} unreadable frames left out"));
        }
        match &self.incomplete_because {
            Some(why) => format!("INCOMPLETE, {why}\n                 {text}"),
            None => text,
        }
    }
}

/// Name of the judge's summary in the output folder.
pub const JUDGE_SUMMARY_NAME: &str = "summary.json";

/// The judge's summary, if it wrote one.
pub fn judge_summary(out: &Path) -> Option<Value> {
    let text = std::fs::read_to_string(out.join(JUDGE_SUMMARY_NAME)).ok()?;
    serde_json::from_str(&text).ok()
}

/// Files and folders directly in `out`, with the one that is about to be written, sorted.
pub fn written(out: &Path, summary: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(out).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.push(out.join(summary));
    paths.sort();
    paths.dedup();
    paths
}

/// Most figures of the judge that are shown as text; the rest is in its file.
const JUDGE_FIGURES_MAX: usize = 24;

impl Summary {
    /// For a person.
    pub fn print(&self) {
        let number = |value: Option<f64>, unit: &str| {
            value.map_or("-".to_owned(), |value| format!("{value:.1}{unit}"))
        };
        println!("{} {}: {} after {} steps", self.name, self.run, self.outcome, self.steps);
        println!("  lost steps     {}", self.lost_steps);
        println!(
            "  time per step  p50 {}, p99 {} (segment + register + simulate); {}",
            number(self.ms_per_step_p50, " ms"),
            number(self.ms_per_step_p99, " ms"),
            number(self.hz, " steps/s"),
        );
        println!("  frame copies   {} between capture and segment", self.frame_copies);
        println!("  drops          {}{}", self.drops_total, causes(&self.drops));
        if let Some(Value::Object(judge)) = &self.judge {
            let figures = judge.iter().filter(|(_, value)| value.is_number() || value.is_string());
            let figures: Vec<String> = figures
                .take(JUDGE_FIGURES_MAX)
                .map(|(name, value)| match value.as_f64().filter(|_| !value.is_u64()) {
                    Some(value) => format!("{name} {value:.3}"),
                    None => format!("{name} {value}"),
                })
                .collect();
            for (k, line) in figures.chunks(4).enumerate() {
                let head = if k == 0 { "  judge          " } else { "                 " };
                println!("{head}{}", line.join(", "));
            }
        }
        if let Some(recording) = &self.recording {
            println!("  recording      {}", recording.text());
        }
        for restart in &self.restarts {
            println!(
                "  restarted      {}: {}; a state after {}, {} messages lost",
                restart.stage,
                restart.cause,
                number(restart.state_ms, " ms"),
                restart.messages_lost.unwrap_or(0),
            );
        }
        match self.shared_memory_left {
            0 => println!("  shared memory  nothing is left"),
            left => println!("  shared memory  {left} objects were left, and removed"),
        }
        println!("  written        {}", self.out.display());
        for path in &self.written {
            println!("                 {}", path.display());
        }
    }
}

fn causes(drops: &BTreeMap<String, BTreeMap<String, u64>>) -> String {
    let parts: Vec<String> = drops
        .iter()
        .flat_map(|(stage, causes)| {
            causes.iter().map(move |(cause, count)| format!("{stage} {cause} {count}"))
        })
        .collect();
    if parts.is_empty() { String::new() } else { format!(" ({})", parts.join(", ")) }
}
