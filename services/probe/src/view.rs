//! Figures as text.

use std::fmt::Write as _;

use orime_probe::{HopReport, Percentiles, Report};
use orime_runtime::RunEntry;

use crate::bench::Bench;

/// A run's figures as a table.
pub fn report(entry: &RunEntry, report: &Report) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail, here and below.
    let _ = writeln!(text, "run {}  set {}  pace {:?}", entry.run, entry.name, entry.pace);
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.1}"));
    let _ = writeln!(
        text,
        "steps {} ({} lost)  {} steps/s  age of the state {} ms\n",
        report.steps,
        report.lost_steps,
        number(report.hz),
        number(report.age_ms),
    );
    let _ = writeln!(text, "{:34} {:>8} {:>12} {:>12} {:>12}", "µs", "count", "p50", "p99", "max");
    row(&mut text, "capture: one frame", &report.capture_us);
    hop(&mut text, "capture → segment", &report.hops.capture_to_segment);
    hop(&mut text, "segment → register", &report.hops.segment_to_register);
    hop(&mut text, "register → simulate", &report.hops.register_to_simulate);
    row(&mut text, "step (segment+register+simulate)", &report.step_us);
    row(&mut text, "end to end (arrival → state)", &report.end_to_end_us);
    let _ = writeln!(
        text,
        "\nframes {} of {} bytes at most, {} copied  drops {}",
        report.frames, report.frame_bytes, report.frame_copies, report.drops_total
    );
    for (stage, causes) in &report.drops {
        for (cause, count) in causes {
            let _ = writeln!(text, "  {stage}: {cause} {count}");
        }
    }
    text
}

/// A bench as a table.
pub fn bench(bench: &Bench) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{:34} {:>8} {:>12} {:>12} {:>12}",
        format!("one way, {} bytes, µs", bench.frame_bytes),
        "count",
        "p50",
        "p99",
        "max"
    );
    row(&mut text, "iceoryx2, written in place", &bench.iceoryx2_us);
    row(&mut text, "UDP over loopback", &bench.udp_us);
    let _ = writeln!(text, "UDP frames lost: {}", bench.udp_lost);
    text
}

fn hop(text: &mut String, name: &str, hop: &HopReport) {
    row(text, &format!("{name}: transport"), &hop.transport_us);
    row(text, &format!("{name}: queue"), &hop.queue_us);
    row(text, &format!("{name}: compute"), &hop.compute_us);
}

fn row(text: &mut String, name: &str, percentiles: &Percentiles) {
    let Percentiles { count, p50, p99, max, .. } = percentiles;
    let number = |value: &Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.1}"));
    let (p50, p99, max) = (number(p50), number(p99), number(max));
    let _ = writeln!(text, "{name:34} {count:>8} {p50:>12} {p99:>12} {max:>12}");
}
