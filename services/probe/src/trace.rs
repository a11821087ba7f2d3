//! A trace in Chrome's JSON format, which Perfetto opens: a frame's way through all processes.
//!
//! Each stage is a process with three kinds of tracks: messages on their way, messages that wait,
//! work. Slices of one track must not overlap, else Perfetto drops them: messages that are on their
//! way at once lie in lanes. An arrow leads from the frame to its cloud, targets and state.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use orime_messages::{RecordKind, Stage, StageRecord};
use serde_json::json;

/// What a slice of a stage shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Work,
    Waiting,
    OnTheWay,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Work => "work",
            Self::Waiting => "waiting",
            Self::OnTheWay => "on the way",
        }
    }
}

/// Numbers of one kind's lanes follow each other; the next kind's begin here.
const LANES_MAX: u32 = 100;

/// A trace that is being written.
#[derive(Debug)]
pub struct Trace {
    out: BufWriter<File>,
    is_first: bool,
    /// Per process and kind: until when each of its lanes is taken. There are never more than
    /// messages that can be on their way at once.
    lanes: BTreeMap<(u32, Kind), Vec<u64>>,
}

impl Trace {
    /// Begins the file.
    pub fn create(path: &Path) -> io::Result<Self> {
        let mut out = BufWriter::new(File::create(path)?);
        out.write_all(b"{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n")?;
        let mut trace = Self { out, is_first: true, lanes: BTreeMap::new() };
        for stage in Stage::PIPELINE {
            let pid = stage as u32 + 1;
            trace.event(&json!({"ph": "M", "pid": pid, "tid": 0, "name": "process_name",
                "args": {"name": format!("orime-{}", stage.name())}}))?;
            trace.event(&json!({"ph": "M", "pid": pid, "tid": 0, "name": "process_sort_index",
                "args": {"sort_index": pid}}))?;
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
            let way_ns = [record.upstream_publish_ns, record.take_ns];
            self.slice(stage, Kind::OnTheWay, &name, record, way_ns)?;
        }
        if !is_result {
            return Ok(());
        }
        if stage != Stage::Capture {
            let wait_ns = [record.take_ns, record.start_ns];
            self.slice(stage, Kind::Waiting, &name, record, wait_ns)?;
        }
        let work_ns = [record.start_ns, record.end_ns];
        let tid = self.slice(stage, Kind::Work, &name, record, work_ns)?;
        let phase = match stage {
            Stage::Capture if record.camera > 0 => return Ok(()),
            Stage::Capture => "s",
            Stage::Simulate => "f",
            _ => "t",
        };
        self.event(&json!({"ph": phase, "bp": "e", "id": record.header.step, "cat": "frame",
            "name": "frame", "pid": stage as u32 + 1, "tid": tid,
            "ts": record.start_ns as f64 / 1e3}))
    }

    /// Writes a slice into the first lane that is free then, and returns that lane's number.
    fn slice(
        &mut self,
        stage: Stage,
        kind: Kind,
        name: &str,
        record: &StageRecord,
        [from_ns, to_ns]: [u64; 2],
    ) -> io::Result<u32> {
        let (pid, to_ns) = (stage as u32 + 1, to_ns.max(from_ns));
        let lanes = self.lanes.entry((pid, kind)).or_default();
        let lane = lanes.iter().position(|end_ns| *end_ns <= from_ns).unwrap_or(lanes.len());
        let is_new = lane == lanes.len();
        match lanes.get_mut(lane) {
            Some(end_ns) => *end_ns = to_ns,
            None => lanes.push(to_ns),
        }
        let tid = (kind as u32 + 1) * LANES_MAX + lane as u32;
        if is_new {
            self.event(&json!({"ph": "M", "pid": pid, "tid": tid, "name": "thread_name",
                "args": {"name": kind.name()}}))?;
        }
        let us = (to_ns - from_ns) as f64 / 1e3;
        self.event(&json!({"ph": "X", "cat": kind.name(), "name": name, "pid": pid, "tid": tid,
            "ts": from_ns as f64 / 1e3, "dur": us,
            "args": {"step": record.header.step, "bytes": record.bytes,
                "incarnation": format!("{:x}", record.header.incarnation)}}))?;
        Ok(tid)
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
