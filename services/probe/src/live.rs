//! Looking at a running set: once, or for as long as somebody wants to.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use orime_messages::{Drops, RecordKind, Stage};
use orime_probe::{Figures, Report};
use orime_runtime::{Guest, RunEntry, Stop, foreign_owner, now_ns, registered};
use serde::Serialize;
use signal_hook::consts::{SIGINT, SIGTERM};

use crate::args::{Cli, Command};
use crate::bench::{self, Bench};
use crate::budget::Budget;
use crate::sinks::Sinks;
use crate::view;

/// Time between two looks at the records.
const TICK: Duration = Duration::from_millis(5);
/// How much less the probe is in a hurry than the stages.
const NICE: i32 = 10;
/// Time between two redraws.
const REDRAW: Duration = Duration::from_millis(500);

/// What `--once --json` prints.
#[derive(Debug, Serialize)]
struct Once {
    run: String,
    set: String,
    pace: orime_runtime::Pace,
    /// Seconds that were watched.
    seconds: f64,
    #[serde(flatten)]
    report: Report,
    /// Median transport of the set's frames over that of UDP, measured in the same seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    frame_transport_over_udp_p50: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    bench: Option<Bench>,
}

/// Why the probe ends with a status of its own.
#[derive(Debug, thiserror::Error)]
#[error("over the budget:\n{0}")]
pub struct OverBudget(String);

/// Runs the command.
pub fn run(cli: &Cli) -> anyhow::Result<()> {
    match &cli.command {
        Some(Command::Receive { run, frame_bytes, socket }) => {
            return bench::receive(run, *frame_bytes, socket);
        }
        Some(Command::Bench { frame_bytes, frames }) => {
            let bench = bench::run(*frame_bytes, *frames)?;
            if cli.json {
                return print_json(&bench);
            }
            print!("{}", view::bench(&bench));
            return Ok(());
        }
        None => {}
    }
    if !cli.bench {
        // Who watches gives way to what is watched; where that is refused, nothing is lost.
        let _ = rustix::process::nice(NICE);
    }
    let entry = find(cli.run.as_deref())?;
    let run = entry.run_id().context("the registry holds something else than runs")?;
    let stop = Stop::new();
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, stop.flag())?;
    }
    let budget = cli.budget.as_deref().map(Budget::load).transpose()?;
    entry.agrees("orime-probe")?;
    let guest = Guest::attach(run, entry.pace, false, stop.clone())?;
    let sinks = Sinks::open(cli, &entry.run)?;
    let (figures, since) = (Figures::new(), Instant::now());
    let mut watched = Watched { guest, figures, since, entry, sinks };
    match cli.once {
        true => once(cli, &mut watched, &stop)?,
        false => live(&mut watched, &stop)?,
    }
    let Watched { figures, sinks, .. } = watched;
    sinks.finish(&figures)?;
    let over = budget.map(|budget| budget.exceeded(&figures.report(now_ns()))).unwrap_or_default();
    if over.is_empty() { Ok(()) } else { Err(OverBudget(over.join("\n")).into()) }
}

/// The run that is meant.
fn find(run: Option<&str>) -> anyhow::Result<RunEntry> {
    let mut living = registered().context("reading the registry of runs")?;
    living.retain(|entry| entry.is_alive() && run.is_none_or(|run| entry.run == run));
    match (living.len(), run) {
        (1, _) => Ok(living.remove(0)),
        (0, Some(run)) if let Some(owner) = run.parse().ok().and_then(foreign_owner) => {
            bail!("run {run} belongs to user {owner}: only they can attach to it")
        }
        (0, Some(run)) => bail!("run {run} is not there: `orime ps` shows what runs"),
        (0, None) => bail!("no set runs: start one with `orime up` or `deploy/up`"),
        _ => {
            let runs: Vec<String> = living.into_iter().map(|entry| entry.run).collect();
            bail!("several sets run, name one with --run: {}", runs.join(", "))
        }
    }
}

struct Watched {
    guest: Guest,
    figures: Figures,
    since: Instant,
    entry: RunEntry,
    sinks: Sinks,
}

impl Watched {
    /// Takes in all records that are there; `false` once the set has ended.
    fn read(&mut self) -> anyhow::Result<bool> {
        while let Some(record) = self.guest.records.try_next()? {
            self.figures.add(&record);
            self.sinks.add(&record)?;
            if record.kind() == Some(RecordKind::Ended)
                && record.header.stage == Stage::Simulate as u32
            {
                return Ok(false);
            }
        }
        self.figures.tick(now_ns());
        self.sinks.tick(&self.figures, false)?;
        Ok(self.entry.is_alive())
    }

    /// Records that came faster than they were read; figures then miss some steps.
    fn missed(&self) -> u64 {
        let Drops { overflow, superseded, .. } = self.guest.records.drops();
        overflow + superseded
    }
}

fn once(cli: &Cli, watched: &mut Watched, stop: &Stop) -> anyhow::Result<()> {
    let watch = Duration::from_secs_f64(cli.seconds.clamp(0.1, 86_400.0));
    let mut goes_on = true;
    let mut running_bench = None;
    while goes_on && !stop.requested() {
        let bench_runs = running_bench.as_ref().is_some_and(|b: &bench::Background| b.runs());
        if watched.since.elapsed() > watch && !bench_runs {
            break;
        }
        goes_on = watched.read()?;
        let frame_bytes = watched.figures.frame_bytes() as usize;
        if cli.bench && running_bench.is_none() && frame_bytes > 0 {
            running_bench = Some(bench::Background::start(frame_bytes)?);
        }
        std::thread::sleep(TICK);
    }
    let bench = running_bench.map(bench::Background::finish).transpose()?;
    if cli.bench && bench.is_none() {
        bail!("no frame was seen in {:.1} s, so there is no size to measure with", cli.seconds);
    }
    if watched.missed() > 0 {
        eprintln!("orime-probe: {} records came too fast and were missed", watched.missed());
    }
    let report = watched.figures.report(now_ns());
    if cli.json {
        let transport_us = report.hops.capture_to_segment.transport_us.p50;
        let udp_us = bench.as_ref().and_then(|bench| bench.sizes.first()?.udp_us.p50);
        return print_json(&Once {
            frame_transport_over_udp_p50: transport_us.zip(udp_us).map(|(ours, udp)| ours / udp),
            run: watched.entry.run.clone(),
            set: watched.entry.name.clone(),
            pace: watched.entry.pace,
            seconds: watched.since.elapsed().as_secs_f64(),
            report,
            bench,
        });
    }
    print!("{}", view::report(&watched.entry, &report));
    if let Some(bench) = &bench {
        print!("\n{}", view::bench(bench));
    }
    Ok(())
}

fn live(watched: &mut Watched, stop: &Stop) -> anyhow::Result<()> {
    let mut out = std::io::stdout();
    let is_terminal = out.is_terminal();
    if !is_terminal && !watched.sinks.is_any() {
        bail!("the live view needs a terminal; use --once (and --json) elsewhere");
    }
    let mut shown: Option<Instant> = None;
    loop {
        let goes_on = watched.read()?;
        let is_due = shown.is_none_or(|shown| shown.elapsed() > REDRAW) || !goes_on;
        if is_terminal && is_due {
            shown = Some(Instant::now());
            let text = view::report(&watched.entry, &watched.figures.report(now_ns()));
            // Home, text with each line cleared to its end, the rest of the screen cleared.
            write!(out, "\x1b[H{}\x1b[J", text.replace('\n', "\x1b[K\n"))?;
            out.flush()?;
        }
        if !goes_on {
            println!("the set has ended");
            return Ok(());
        }
        if stop.requested() {
            println!();
            return Ok(());
        }
        std::thread::sleep(TICK);
    }
}

fn print_json<T: Serialize>(value: &T) -> anyhow::Result<()> {
    println!("{}", serde_json::to_string_pretty(value)?);
    Ok(())
}
