//! A trace in Chrome's JSON format, which Perfetto opens: a frame's way through all processes.
//!
//! Each stage is a process with three tracks: messages on their way, messages that wait, work. An
//! arrow leads from the frame to its cloud, targets and state.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use orime_messages::{RecordKind, Stage, StageRecord};
use serde_json::json;

/// Tracks of a stage.
const TRACKS: [(u32, &str); 3] = [(1, "work"), (2, "waiting"), (3, "on the way")];

/// A trace that is being written.
#[derive(Debug)]
pub struct Trace {
    out: BufWriter<File>,
    is_first: bool,
}

impl Trace {
    /// Begins the file.
    pub fn create(path: &Path) -> io::Result<Self> {
        let mut out = BufWriter::new(File::create(path)?);
        out.write_all(b"{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n")?;
        let mut trace = Self { out, is_first: true };
        for stage in Stage::PIPELINE {
            let pid = stage as u32 + 1;
            trace.event(&json!({"ph": "M", "pid": pid, "tid": 0, "name": "process_name",
                "args": {"name": format!("orime-{}", stage.name())}}))?;
            trace.event(&json!({"ph": "M", "pid": pid, "tid": 0, "name": "process_sort_index",
                "args": {"sort_index": pid}}))?;
            for (tid, name) in TRACKS {
                trace.event(&json!({"ph": "M", "pid": pid, "tid": tid, "name": "thread_name",
                    "args": {"name": name}}))?;
            }
        }
        Ok(trace)
    }

    /// Adds what a record tells.
    pub fn add(&mut self, record: &StageRecord) -> io::Result<()> {
        let Some(stage) = Stage::from_number(record.header.stage) else { return Ok(()) };
        let Some(RecordKind::Published | RecordKind::Taken) = record.kind() else { return Ok(()) };
        let is_result = record.kind() == Some(RecordKind::Published);
        let name = match record.camera {
            orime_messages::WHOLE_SET => format!("step {}", record.header.step),
            camera => format!("step {} camera {camera}", record.header.step),
        };
        let frames_come_one_by_one = stage == Stage::Segment && is_result;
        if record.upstream_publish_ns > 0 && !frames_come_one_by_one {
            self.slice(stage, 3, &name, record, [record.upstream_publish_ns, record.take_ns])?;
        }
        if !is_result {
            return Ok(());
        }
        if stage != Stage::Capture {
            self.slice(stage, 2, &name, record, [record.take_ns, record.start_ns])?;
        }
        self.slice(stage, 1, &name, record, [record.start_ns, record.end_ns])?;
        let phase = match stage {
            Stage::Capture if record.camera > 0 => return Ok(()),
            Stage::Capture => "s",
            Stage::Simulate => "f",
            _ => "t",
        };
        self.event(&json!({"ph": phase, "bp": "e", "id": record.header.step, "cat": "frame",
            "name": "frame", "pid": stage as u32 + 1, "tid": 1,
            "ts": record.start_ns as f64 / 1e3}))
    }

    fn slice(
        &mut self,
        stage: Stage,
        tid: u32,
        name: &str,
        record: &StageRecord,
        [from_ns, to_ns]: [u64; 2],
    ) -> io::Result<()> {
        let us = to_ns.saturating_sub(from_ns) as f64 / 1e3;
        self.event(&json!({"ph": "X", "cat": TRACKS[tid as usize - 1].1, "name": name,
            "pid": stage as u32 + 1, "tid": tid, "ts": from_ns as f64 / 1e3, "dur": us,
            "args": {"step": record.header.step, "bytes": record.bytes,
                "incarnation": format!("{:x}", record.header.incarnation)}}))
    }

    fn event(&mut self, event: &serde_json::Value) -> io::Result<()> {
        if !std::mem::take(&mut self.is_first) {
            self.out.write_all(b",\n")?;
        }
        write!(self.out, "{event}")
    }

    /// Ends the file; one that was not ended is no JSON.
    pub fn finish(mut self) -> io::Result<()> {
        self.out.write_all(b"\n]}\n")?;
        self.out.flush()
    }
}
