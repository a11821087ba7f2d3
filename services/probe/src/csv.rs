//! One line per record, for spreadsheets and data frames.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use orime_messages::{EFFECTS, RecordKind, Stage, StageRecord};

const HEAD: &str = "publish_ns,stage,kind,step,camera,incarnation,transport_us,queue_us,compute_us,\
                    end_to_end_us,bytes,status,frame_copies,queue_depth,loan_waits,drops_total,\
                    effects_asleep";

/// The effects that slept, with spaces between.
fn asleep(record: &StageRecord) -> String {
    let of =
        |(k, name): (usize, &'static str)| (record.effects_asleep >> k & 1 == 1).then_some(name);
    EFFECTS.into_iter().enumerate().filter_map(of).collect::<Vec<_>>().join(" ")
}

/// A file of comma-separated values.
#[derive(Debug)]
pub struct Csv {
    out: BufWriter<File>,
}

impl Csv {
    /// Begins the file.
    pub fn create(path: &Path) -> io::Result<Self> {
        let mut out = BufWriter::new(File::create(path)?);
        writeln!(out, "{HEAD}")?;
        Ok(Self { out })
    }

    /// Writes one record; what it does not tell stays blank.
    pub fn add(&mut self, record: &StageRecord) -> io::Result<()> {
        let (Some(stage), Some(kind)) = (Stage::from_number(record.header.stage), record.kind())
        else {
            return Ok(());
        };
        let us = |from_ns: u64, to_ns: u64| {
            let ns = to_ns.checked_sub(from_ns).filter(|_| from_ns > 0);
            ns.map_or(String::new(), |ns| format!("{:.3}", ns as f64 / 1e3))
        };
        let (kind, is_result) = match kind {
            RecordKind::Taken => ("taken", false),
            RecordKind::Published => ("published", true),
            RecordKind::Ended => ("ended", false),
        };
        let header = &record.header;
        let camera = match record.camera {
            orime_messages::WHOLE_SET => String::new(),
            camera => camera.to_string(),
        };
        let is_state = is_result && stage == Stage::Simulate;
        let arrival_ns = if is_state { header.arrival_ns } else { 0 };
        writeln!(
            self.out,
            "{},{},{kind},{},{camera},{:x},{},{},{},{},{},{},{},{},{},{},{}",
            header.publish_ns,
            stage.name(),
            header.step,
            header.incarnation,
            us(record.upstream_publish_ns, record.take_ns),
            if is_result { us(record.take_ns, record.start_ns) } else { String::new() },
            us(record.start_ns, record.end_ns),
            us(arrival_ns, header.publish_ns),
            record.bytes,
            record.status,
            record.frame_copies,
            record.queue_depth,
            record.loan_waits,
            record.drops.total(),
            asleep(record),
        )
    }

    /// Ends the file.
    pub fn finish(mut self) -> io::Result<()> {
        self.out.flush()
    }
}
