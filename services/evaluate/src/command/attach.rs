//! `orime-evaluate attach`: what an attached probe changes of the times that it measures.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use orime_runtime::{Guest, Stop, now_ns};
use serde::Serialize;
use serde_json::Value;

use super::faults::driver::Bench;

/// Watch a running set in turn alone, with `orime-probe` attached, and alone again.
///
/// The times are read from the stages' records by this program, all the time. What others run on
/// the machine hits the three parts of one turn alike. Exit codes: 0 the p99 from frame to state
/// changed by less than two parts without a probe differ, 1 not.
#[derive(Debug, clap::Args)]
pub struct AttachArguments {
    /// The set; a small one that leaves the machine time, if left out. It must not end by itself.
    set: Option<PathBuf>,
    /// Turns.
    #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u32).range(2..=1000))]
    turns: u32,
    /// Length of each part of a turn, seconds.
    #[arg(long, default_value_t = 10.0)]
    seconds: f64,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Three small cameras at 15 Hz: half of what two cores can do.
const SET: &str = "pace = \"realtime\"\n[capture]\nsource = \"rendered\"\nrepeat = true\n\
                   fps = 15\n[capture.rendered]\nsize_px = [320, 240]\n";

/// Time before the first turn: what begins is slower.
const WARM_UP: Duration = Duration::from_secs(5);
/// Time between two looks at the records.
const LOOK: Duration = Duration::from_millis(5);

/// One part of a turn, milliseconds.
#[derive(Debug, Clone, Copy, Serialize)]
struct Part {
    states: u64,
    end_to_end_p50_ms: f64,
    end_to_end_p99_ms: f64,
    transport_p99_ms: f64,
}

/// One turn: alone, attached, alone.
#[derive(Debug, Clone, Copy, Serialize)]
struct Turn {
    parts: [Part; 3],
    /// Processes that wanted a core at its end (the first number of /proc/loadavg).
    load: f64,
}

/// What one quantity did, milliseconds; medians over the turns.
#[derive(Debug, Serialize)]
struct Change {
    alone_ms: f64,
    /// By how much the part with the probe was slower than the mean of the two beside it.
    change_ms: f64,
    /// By how much the two parts without it differed.
    noise_ms: f64,
}

#[derive(Debug, Serialize)]
struct Figures {
    end_to_end_p50: Change,
    end_to_end_p99: Change,
    transport_p99: Change,
    turns: Vec<Turn>,
}

/// Runs the command.
pub fn run(arguments: &AttachArguments) -> anyhow::Result<()> {
    let bench = Bench::new(101)?;
    let set = match &arguments.set {
        Some(set) => {
            set.canonicalize().with_context(|| format!("finding the set `{}`", set.display()))?
        }
        None => bench.write("small.toml", SET)?,
    };
    let seconds = arguments.seconds.clamp(1.0, 3600.0);
    let mut running = bench.up("attach", &set, &["--no-judge"])?;
    let entry = running.entry(4)?;
    let run = entry.run_id().context("a run")?;
    let mut guest = Guest::attach(run, entry.pace, false, Stop::new())?;
    std::thread::sleep(WARM_UP);
    let mut turns = Vec::new();
    for _ in 0..arguments.turns {
        let mut part = |is_attached| part(&bench, &mut guest, is_attached, seconds);
        let parts = [part(false)?, part(true)?, part(false)?];
        let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
        let load = load.split(' ').next().and_then(|load| load.parse().ok()).unwrap_or(0.0);
        let p99 = parts.map(|part| format!("{:.2}", part.end_to_end_p99_ms));
        let states: u64 = parts.iter().map(|part| part.states).sum();
        println!("p99 of frame to state, ms: {}  {states} states, load {load}", p99.join(", "));
        turns.push(Turn { parts, load });
    }
    drop(guest);
    running.stop()?;
    let figures = Figures {
        end_to_end_p50: change(&turns, |part| part.end_to_end_p50_ms),
        end_to_end_p99: change(&turns, |part| part.end_to_end_p99_ms),
        transport_p99: change(&turns, |part| part.transport_p99_ms),
        turns,
    };
    tell(&figures, arguments.json.as_deref())
}

fn tell(figures: &Figures, json: Option<&Path>) -> anyhow::Result<()> {
    for (name, change) in [
        ("frame to state, p50", &figures.end_to_end_p50),
        ("frame to state, p99", &figures.end_to_end_p99),
        ("transport of a frame, p99", &figures.transport_p99),
    ] {
        let Change { alone_ms, change_ms, noise_ms } = change;
        println!(
            "{name:25}  alone {alone_ms:.3} ms, attached {change_ms:+.3}; without a probe two \
             parts differ by {noise_ms:.3}"
        );
    }
    if let Some(path) = json {
        let text = serde_json::to_string_pretty(figures)?;
        fs::write(path, text).with_context(|| format!("writing `{}`", path.display()))?;
    }
    let Change { change_ms, noise_ms, .. } = figures.end_to_end_p99;
    ensure!(change_ms < noise_ms, "attaching costs {change_ms:.3} ms, more than {noise_ms:.3}");
    Ok(())
}

/// Reads the records for so long, beside a probe if there is to be one.
fn part(bench: &Bench, guest: &mut Guest, is_attached: bool, seconds: f64) -> anyhow::Result<Part> {
    while guest.records.try_next()?.is_some() {} // Of the part before.
    let mut probe = None;
    if is_attached {
        let mut command = bench.program("orime-probe");
        command.args(["--once", "--json", "--seconds", &seconds.to_string()]);
        probe = Some(command.stdout(Stdio::null()).spawn().context("running orime-probe")?);
    }
    let (start, mut figures) = (Instant::now(), orime_probe::Figures::new());
    while start.elapsed().as_secs_f64() < seconds {
        while let Some(record) = guest.records.try_next()? {
            figures.add(&record);
        }
        std::thread::sleep(LOOK);
    }
    if let Some(mut probe) = probe {
        let status = probe.wait()?;
        ensure!(status.success(), "orime-probe ended with {status}");
    }
    let report = serde_json::to_value(figures.report(now_ns()))?;
    let ms = |value: &Value| value.as_f64().map(|us| us / 1e3).context("too few states");
    Ok(Part {
        states: figures.steps(),
        end_to_end_p50_ms: ms(&report["end_to_end_us"]["p50"])?,
        end_to_end_p99_ms: ms(&report["end_to_end_us"]["p99"])?,
        transport_p99_ms: ms(&report["hops"]["capture_to_segment"]["transport_us"]["p99"])?,
    })
}

fn change(turns: &[Turn], of: impl Fn(&Part) -> f64) -> Change {
    let times: Vec<[f64; 3]> = turns.iter().map(|turn| turn.parts.each_ref().map(&of)).collect();
    let over = |of: fn(&[f64; 3]) -> f64| median(times.iter().map(of).collect());
    Change {
        alone_ms: over(|[before, _, after]| (before + after) / 2.0),
        change_ms: over(|[before, attached, after]| attached - (before + after) / 2.0),
        noise_ms: over(|[before, _, after]| (before - after).abs()),
    }
}

/// The mean of the two in the middle where there are two.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 { 0.0 } else { (values[(n - 1) / 2] + values[n / 2]) / 2.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_told_from_noise() {
        let turns = |attached: [f64; 3]| -> Vec<Turn> {
            let part = |ms: f64| Part {
                states: 1,
                end_to_end_p50_ms: 0.0,
                end_to_end_p99_ms: ms,
                transport_p99_ms: 0.0,
            };
            let alone = [[10.0, 12.0], [11.0, 11.5], [40.0, 36.0]];
            let turn = |([before, after], attached): ([f64; 2], f64)| Turn {
                parts: [before, attached, after].map(part),
                load: 0.0,
            };
            alone.into_iter().zip(attached).map(turn).collect()
        };
        let figures = |attached| change(&turns(attached), |part| part.end_to_end_p99_ms);
        let same = figures([11.5, 11.0, 38.0]);
        assert_eq!((same.alone_ms, same.change_ms, same.noise_ms), (11.25, 0.0, 2.0));
        let slower = figures([14.0, 15.0, 42.0]);
        assert!(slower.change_ms > slower.noise_ms, "{slower:?}");
    }
}
