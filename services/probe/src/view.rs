//! Figures as text.

use std::fmt::Write as _;

use orime_messages::Stage;
use orime_probe::{HopReport, Percentiles, Report};
use orime_runtime::RunEntry;

use crate::bench::Bench;

fn number(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.1}"))
}

/// A run's figures as a table.
pub fn report(entry: &RunEntry, report: &Report) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail, here and below.
    let _ = writeln!(text, "run {}  set {}  pace {:?}", entry.run, entry.name, entry.pace);
    let _ = writeln!(
        text,
        "steps {} ({} lost)  {} steps/s  age of the state {} ms  restarts {}\n",
        report.steps,
        report.lost_steps,
        number(report.hz),
        number(report.age_ms),
        report.restarts,
    );
    head(&mut text, "µs");
    row(&mut text, "capture: one frame", &report.capture_us);
    hop(&mut text, "capture → segment", &report.hops.capture_to_segment);
    hop(&mut text, "segment → register", &report.hops.segment_to_register);
    hop(&mut text, "register → simulate", &report.hops.register_to_simulate);
    row(&mut text, "step (segment+register+simulate)", &report.step_us);
    row(&mut text, "end to end (→ state)", &report.end_to_end_us);
    row(&mut text, "… omission corrected", &report.end_to_end_corrected_us);
    row(&mut text, "age of information", &report.age_us);
    row(&mut text, "camera skew (exposure)", &report.camera_skew_us);
    row(&mut text, "camera skew (arrival)", &report.arrival_skew_us);
    stages(&mut text, report);
    let _ = writeln!(
        text,
        "\nframes {} of {} bytes at most, {} copied  drops {}",
        report.frames, report.frame_bytes, report.frame_copies, report.drops_total
    );
    let _ = writeln!(text, "{}", effects(report));
    for (stage, causes) in &report.drops {
        for (cause, count) in causes {
            let _ = writeln!(text, "  {stage}: {cause} {count}");
        }
    }
    text
}

/// Which effects sleep, and of how many steps.
fn effects(report: &Report) -> String {
    let slept = report.effects.iter().filter(|(_, effect)| effect.asleep_steps > 0);
    let word = |(name, effect): (&String, &orime_probe::EffectReport)| {
        let now = if effect.asleep { "asleep" } else { "awake" };
        format!("{name} {now} ({} of {} steps)", effect.asleep_steps, report.steps)
    };
    let words: Vec<String> = slept.map(word).collect();
    if words.is_empty() {
        return format!("effects {}, none slept", report.effects.len());
    }
    format!("effects {}  {}", report.effects.len(), words.join(", "))
}

fn stages(text: &mut String, report: &Report) {
    let _ = writeln!(
        text,
        "\n{:10} {:>8} {:>8} {:>10} {:>9} {:>7} {:>6} {:>11} {:>9} {:>9}",
        "stage",
        "results",
        "Hz",
        "jitter ms",
        "MB/s",
        "queue",
        "high",
        "loan waits",
        "restarts",
        "silent s"
    );
    for name in Stage::PIPELINE.map(Stage::name) {
        let Some(stage) = report.stages.get(name) else { continue };
        let _ = writeln!(
            text,
            "{name:10} {:>8} {:>8} {:>10} {:>9} {:>7} {:>6} {:>11} {:>9} {:>9}",
            stage.published,
            number(stage.hz),
            number(stage.jitter_ms),
            number(stage.mb_per_s),
            stage.queue_depth,
            stage.queue_high,
            stage.loan_waits,
            stage.restarts,
            number(stage.silent_s),
        );
    }
}

/// A bench as a table.
pub fn bench(bench: &Bench) -> String {
    let mut text = String::new();
    for size in &bench.sizes {
        let _ = writeln!(text, "one way, {} bytes ({})", size.bytes, size.what);
        head(&mut text, "µs");
        row(&mut text, "iceoryx2, written in place", &size.iceoryx2_us);
        row(&mut text, "UDP over loopback", &size.udp_us);
        row(&mut text, "Unix socket", &size.unix_us);
        let _ = writeln!(text, "UDP messages lost: {}\n", size.udp_lost);
    }
    text
}

fn hop(text: &mut String, name: &str, hop: &HopReport) {
    row(text, &format!("{name}: transport"), &hop.transport_us);
    row(text, &format!("{name}: queue"), &hop.queue_us);
    row(text, &format!("{name}: compute"), &hop.compute_us);
}

fn head(text: &mut String, unit: &str) {
    let names = ["count", "p50", "p90", "p99", "p99.9", "max"];
    let _ = write!(text, "{unit:34}");
    for name in names {
        let _ = write!(text, " {name:>10}");
    }
    text.push('\n');
}

fn row(text: &mut String, name: &str, us: &Percentiles) {
    let _ = write!(text, "{name:34} {:>10}", us.count);
    for value in [us.p50, us.p90, us.p99, us.p99_9, us.max] {
        let _ = write!(text, " {:>10}", number(value));
    }
    text.push('\n');
}
