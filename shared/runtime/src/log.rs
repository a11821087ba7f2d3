//! Logs: one line per event, as text or as JSON, with the run, the stage and the step in each.

use std::fmt::{self, Write as _};
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use orime_messages::Stage;
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

/// Environment variable: `json` for one JSON object per line, anything else for text.
pub const LOG_VARIABLE: &str = "ORIME_LOG";

/// The step that this process published last, plus one; 0 before the first.
static STEP: AtomicU64 = AtomicU64::new(0);

/// Notes the step that this process works on, for its logs.
pub(crate) fn note_step(step: u64) {
    STEP.store(step + 1, Ordering::Relaxed);
}

/// Begins logging to the standard error; `RUST_LOG` decides what (default `info`).
pub fn begin(run: &str, stage: Stage) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    let format = Format {
        run: run.to_owned(),
        stage: stage.name(),
        is_json: std::env::var(LOG_VARIABLE).is_ok_and(|value| value == "json"),
    };
    // Whoever has begun already keeps its own way.
    let _ = tracing_subscriber::fmt()
        .with_writer(io::stderr)
        .with_ansi(false)
        .with_env_filter(filter)
        .event_format(format)
        .try_init();
}

/// How a line looks.
struct Format {
    run: String,
    stage: &'static str,
    is_json: bool,
}

impl<S, N> FormatEvent<S, N> for Format
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        _: &FmtContext<'_, S, N>,
        mut out: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let mut fields = Fields::default();
        event.record(&mut fields);
        let step = STEP.load(Ordering::Relaxed).checked_sub(1);
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let line = if self.is_json {
            self.json(event, step, unix.as_secs_f64(), fields)
        } else {
            self.text(event, step, unix.as_secs(), unix.subsec_millis(), &fields)
        };
        writeln!(out, "{line}")
    }
}

impl Format {
    fn json(&self, event: &Event<'_>, step: Option<u64>, unix_s: f64, fields: Fields) -> String {
        let mut line = serde_json::Map::new();
        line.insert("unix_s".to_owned(), unix_s.into());
        line.insert("level".to_owned(), event.metadata().level().as_str().into());
        line.insert("run".to_owned(), self.run.as_str().into());
        line.insert("stage".to_owned(), self.stage.into());
        line.insert("step".to_owned(), step.into());
        line.insert("message".to_owned(), fields.message.into());
        // An event's own `step` is nearer to the truth than the process'.
        line.extend(fields.others.into_iter().map(|(name, value)| (name.to_owned(), value)));
        serde_json::Value::Object(line).to_string()
    }

    fn text(
        &self,
        event: &Event<'_>,
        step: Option<u64>,
        unix_s: u64,
        ms: u32,
        fields: &Fields,
    ) -> String {
        let [h, m, s] = [unix_s / 3600 % 24, unix_s / 60 % 60, unix_s % 60];
        let level = event.metadata().level();
        let (run, stage) = (&self.run, self.stage);
        let mut line = format!("{h:02}:{m:02}:{s:02}.{ms:03}Z {level:>5} run={run} stage={stage}");
        // Writing to a string cannot fail.
        if !fields.others.iter().any(|(name, _)| *name == "step") {
            let _ = match step {
                Some(step) => write!(line, " step={step}"),
                None => write!(line, " step=-"),
            };
        }
        for (name, value) in &fields.others {
            let _ = match value {
                serde_json::Value::String(text) if !text.contains(' ') => {
                    write!(line, " {name}={text}")
                }
                value => write!(line, " {name}={value}"),
            };
        }
        let _ = write!(line, " {}", fields.message);
        line
    }
}

/// What an event says.
#[derive(Default)]
struct Fields {
    message: String,
    others: Vec<(&'static str, serde_json::Value)>,
}

impl Fields {
    fn put(&mut self, field: &Field, value: serde_json::Value) {
        self.others.push((field.name(), value));
    }
}

impl Visit for Fields {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        let text = format!("{value:?}");
        if field.name() == "message" {
            self.message = text;
        } else {
            self.put(field, text.into());
        }
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        self.put(field, value.into());
    }

    fn record_u64(&mut self, field: &Field, value: u64) {
        self.put(field, value.into());
    }

    fn record_i64(&mut self, field: &Field, value: i64) {
        self.put(field, value.into());
    }

    fn record_f64(&mut self, field: &Field, value: f64) {
        self.put(field, value.into());
    }

    fn record_bool(&mut self, field: &Field, value: bool) {
        self.put(field, value.into());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{Arc, Mutex};

    #[derive(Clone, Default)]
    struct Sink(Arc<Mutex<Vec<u8>>>);

    impl io::Write for Sink {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn logged(is_json: bool) -> String {
        let sink = Sink::default();
        let writer = sink.clone();
        let format = Format { run: "00c0ffee".to_owned(), stage: "segment", is_json };
        let subscriber = tracing_subscriber::fmt()
            .with_writer(move || writer.clone())
            .event_format(format)
            .finish();
        tracing::subscriber::with_default(subscriber, || {
            tracing::warn!(step = 7, camera = "left one", "frame left out");
        });
        let bytes = sink.0.lock().unwrap().clone();
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn every_line_names_run_stage_and_step() {
        let text = logged(false);
        let says = " WARN run=00c0ffee stage=segment step=7 camera=\"left one\" frame left out\n";
        assert!(text.ends_with(says), "{text}");
        let line: serde_json::Value = serde_json::from_str(&logged(true)).unwrap();
        assert_eq!((&line["run"], &line["step"]), (&"00c0ffee".into(), &7.into()), "{line}");
        assert_eq!(line["message"], "frame left out");
    }
}
