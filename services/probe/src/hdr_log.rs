//! An HdrHistogram interval log: one line per second and quantity, for `HistogramLogProcessor` and
//! its kin. Values are nanoseconds.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::time::{Duration, SystemTime};

use hdrhistogram::Histogram;
use hdrhistogram::serialization::interval_log::{IntervalLogWriterBuilder, Tag};
use hdrhistogram::serialization::{Serializer, V2DeflateSerializer};
use orime_messages::Stage;
use orime_probe::{Figures, Spread};

/// What is logged, and its histogram up to the last line.
struct Quantity {
    tag: &'static str,
    of: fn(&Figures) -> &Spread,
    before: Histogram<u64>,
}

/// A log that is being written.
pub struct HdrLog {
    out: BufWriter<File>,
    begun: SystemTime,
    quantities: Vec<Quantity>,
    serializer: V2DeflateSerializer,
    /// One line, kept between calls.
    line: Vec<u8>,
}

fn hop(figures: &Figures, stage: Stage) -> &orime_probe::Hop {
    figures.hop(stage).expect("the stage is one of the pipeline")
}

impl HdrLog {
    /// Begins the file.
    pub fn create(path: &Path) -> io::Result<Self> {
        type Tagged = (&'static str, fn(&Figures) -> &Spread);
        let all: [Tagged; 5] = [
            ("end_to_end", |figures| figures.end_to_end()),
            ("step_compute", |figures| figures.step_compute()),
            ("frame_transport", |figures| &hop(figures, Stage::Segment).transport),
            ("cloud_transport", |figures| &hop(figures, Stage::Register).transport),
            ("targets_transport", |figures| &hop(figures, Stage::Simulate).transport),
        ];
        let quantity = |(tag, of)| Quantity { tag, of, before: Spread::new().histogram().clone() };
        let mut log = Self {
            out: BufWriter::new(File::create(path)?),
            begun: SystemTime::now(),
            quantities: all.into_iter().map(quantity).collect(),
            serializer: V2DeflateSerializer::new(),
            line: Vec::new(),
        };
        let mut head = Vec::new();
        IntervalLogWriterBuilder::new()
            .add_comment("orime-probe, values in nanoseconds")
            .with_start_time(log.begun)
            .with_base_time(log.begun)
            .with_max_value_divisor(1e6)
            .begin_log_with(&mut head, &mut V2DeflateSerializer::new())?;
        log.out.write_all(&head)?;
        Ok(log)
    }

    /// Writes what came within the last `interval`.
    pub fn add(&mut self, figures: &Figures, interval: Duration) -> io::Result<()> {
        let since = self.begun.elapsed().unwrap_or_default();
        let from_s = since.saturating_sub(interval).as_secs_f64();
        for Quantity { tag, of, before } in &mut self.quantities {
            let now = of(figures).histogram();
            let mut within = now.clone();
            if within.subtract(&*before).is_err() || within.is_empty() {
                continue;
            }
            before.clone_from(now);
            self.line.clear();
            let mut encoded = Vec::new();
            self.serializer.serialize(&within, &mut encoded).map_err(io::Error::other)?;
            // The log's own form: tag, start, length, largest value in ms, histogram.
            debug_assert!(Tag::new(tag).is_some());
            let max_ms = within.max() as f64 / 1e6;
            let text = base64(&encoded);
            writeln!(
                self.line,
                "Tag={tag},{from_s:.3},{:.3},{max_ms:.3},{text}",
                interval.as_secs_f64()
            )?;
            self.out.write_all(&self.line)?;
        }
        self.out.flush()
    }
}

/// Base 64 with padding, RFC 4648.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let byte = |k: usize| u32::from(chunk.get(k).copied().unwrap_or(0));
        let word = byte(0) << 16 | byte(1) << 8 | byte(2);
        for k in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * k) & 63) as usize];
            text.push(if k <= chunk.len() { digit as char } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use hdrhistogram::serialization::interval_log::{IntervalLogIterator, LogEntry};

    #[test]
    fn base64_is_that_of_the_standard() {
        let check = |bytes: &[u8], text: &str| assert_eq!(base64(bytes), text);
        check(b"", "");
        check(b"f", "Zg==");
        check(b"fo", "Zm8=");
        check(b"foobar", "Zm9vYmFy");
    }

    #[test]
    fn a_log_reads_back_interval_by_interval() {
        let path = std::env::temp_dir().join(format!("orime-hdr-{}.hlog", std::process::id()));
        let mut log = HdrLog::create(&path).unwrap();
        let mut figures = Figures::new();
        let add = |figures: &mut Figures, step: u64, compute_ns: u64| {
            let mut record: orime_messages::StageRecord = bytemuck::Zeroable::zeroed();
            record.header.stage = Stage::Register as u32;
            record.kind = 1;
            record.header.step = step;
            (record.upstream_publish_ns, record.take_ns) = (100, 100 + compute_ns);
            figures.add(&record);
        };
        add(&mut figures, 1, 5_000);
        log.add(&figures, Duration::from_secs(1)).unwrap();
        add(&mut figures, 2, 7_000);
        add(&mut figures, 3, 7_000);
        log.add(&figures, Duration::from_secs(1)).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let entries = IntervalLogIterator::new(&bytes);
        let mut counts = Vec::new();
        for entry in entries {
            if let LogEntry::Interval(interval) = entry.unwrap() {
                assert_eq!(interval.tag().unwrap().as_str(), "cloud_transport");
                let mut encoded = interval.encoded_histogram().as_bytes().to_vec();
                encoded.retain(|byte| *byte != b'=');
                counts.push(interval.max());
            }
        }
        assert_eq!(counts.len(), 2, "{}", String::from_utf8_lossy(&bytes));
        assert!(counts[0] < counts[1], "{counts:?}");
    }
}
