//! `orime-evaluate soak`: a set that runs for long while its stages are killed one after the other.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use orime_runtime::now_ns;
use rustix::process::Signal;
use serde::Serialize;

use super::faults::driver::{Bench, Set, ms_since, signal};

/// Kill stages of a running set again and again, and look whether it comes back each time.
///
/// Exit codes: 0 it always came back, nothing grew, every drop had a cause; 1 not.
#[derive(Debug, clap::Args)]
pub struct SoakArguments {
    /// The set; it must not end by itself.
    #[arg(default_value = "deploy/sets/five_cameras.toml")]
    set: PathBuf,
    /// How long, seconds.
    #[arg(long, default_value_t = 1200.0)]
    seconds: f64,
    /// Time from one kill to the next, seconds.
    #[arg(long, default_value_t = 30.0)]
    kill_every_s: f64,
    /// Recoveries that take longer count as slow, milliseconds.
    #[arg(long, default_value_t = 1000.0)]
    slow_ms: f64,
    /// Slow recoveries that are forgiven; without it they are named, and only a set that does not
    /// come back at all fails: on a busy machine processes start slowly.
    #[arg(long, value_name = "N")]
    slow_max: Option<usize>,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Who is killed, in turn.
const VICTIMS: [&str; 4] = ["segment", "register", "simulate", "capture"];
/// Growth of memory between the first and the last quarter that counts as a leak.
const GROWTH_MAX: f64 = 1.25;
/// … and its least size, KiB: allocators keep a little.
const GROWTH_MIN_KIB: u64 = 8_192;

/// One kill.
#[derive(Debug, Serialize)]
struct Kill {
    at_s: f64,
    stage: String,
    recovery_ms: f64,
}

/// Memory and open files of one process name over the run.
#[derive(Debug, Default, Serialize)]
struct Held {
    /// Medians of the first and the last quarter, KiB that are the process' own.
    memory_kib: [u64; 2],
    /// The same for open file descriptors.
    files: [u64; 2],
    #[serde(skip)]
    samples: Vec<[u64; 2]>,
}

/// What was seen.
#[derive(Debug, Serialize)]
struct Figures {
    seconds: f64,
    kills: usize,
    slow: usize,
    recovery_ms_median: f64,
    recovery_ms_max: f64,
    states: u64,
    hz: Option<f64>,
    drops: serde_json::Value,
    /// Frames that capture published and that are neither in a cloud nor counted as lost.
    frames_without_cause: i64,
    held: BTreeMap<String, Held>,
    grew: Vec<String>,
    each: Vec<Kill>,
}

/// Runs the command.
pub fn run(arguments: &SoakArguments) -> anyhow::Result<()> {
    let bench = Bench::new(100)?;
    let path = arguments.set.canonicalize();
    let path = path.with_context(|| format!("finding the set `{}`", arguments.set.display()))?;
    let cameras = cameras(&path)?;
    // More kills than a stage's budget in a window would end the set, as they should.
    let window_s = (arguments.kill_every_s * 4.0).max(1.0).to_string();
    let mut set = bench.up("soak", &path, &["--no-judge", "--restart-window-s", &window_s])?;
    set.entry(4)?;
    let start = Instant::now();
    let total = Duration::from_secs_f64(arguments.seconds.clamp(1.0, 1e6));
    let pause = Duration::from_secs_f64(arguments.kill_every_s.clamp(0.5, 1e6));
    let mut held: BTreeMap<String, Held> = BTreeMap::new();
    let (mut kills, mut next, mut sampled) = (Vec::new(), pause, Duration::ZERO);
    while start.elapsed() < total {
        std::thread::sleep(Duration::from_millis(100)); // Between looks.
        if start.elapsed() >= sampled {
            sampled = start.elapsed() + Duration::from_secs(1);
            sample(&mut set, &mut held)?;
        }
        if start.elapsed() >= next {
            next += pause;
            let kill = kill(&mut set, VICTIMS[kills.len() % VICTIMS.len()], start)?;
            println!(
                "{:7.1} of {:.0} s  {:9} {:6.0} ms",
                kill.at_s, arguments.seconds, kill.stage, kill.recovery_ms
            );
            kills.push(kill);
        }
    }
    let summary = set.stop()?;
    ensure!(bench.left_behind() == 0, "{} objects are left", bench.left_behind());
    let figures = figures(kills, held, &summary, start.elapsed(), arguments.slow_ms, cameras);
    let text = serde_json::to_string_pretty(&figures)?;
    if let Some(path) = &arguments.json {
        fs::write(path, &text).with_context(|| format!("writing `{}`", path.display()))?;
    }
    println!("{text}");
    ensure!(figures.grew.is_empty(), "memory or open files grew: {:?}", figures.grew);
    let (slow, slow_ms) = (figures.slow, arguments.slow_ms);
    let forgiven = arguments.slow_max.unwrap_or(usize::MAX);
    ensure!(slow <= forgiven, "{slow} recoveries took more than {slow_ms} ms");
    // What is on its way at the end, and sets that a restarted capture publishes again.
    let tolerated = (cameras * (figures.kills as u64 + 4)) as i64;
    let without = figures.frames_without_cause;
    ensure!(without.abs() <= tolerated, "{without} frames were lost without a cause");
    Ok(())
}

fn cameras(set: &Path) -> anyhow::Result<u64> {
    let set = orime_runtime::SetFile::load(set)?;
    let sheet = set.checked("sheet", orime_geometry::SheetParams::check)?;
    let capture = set.checked("capture", orime_capture::CaptureParams::check)?;
    let source = orime_capture::open(&capture, &sheet)?;
    ensure!(source.steps().is_none(), "this set ends by itself: `repeat = true` is missing");
    Ok(source.cameras().len() as u64)
}

fn kill(set: &mut Set<'_>, stage: &str, start: Instant) -> anyhow::Result<Kill> {
    let before = set.events("recovered", stage).len();
    let pid = set.stage_pid_of(stage, 4)?;
    let (killed_ns, at_s) = (now_ns(), start.elapsed().as_secs_f64());
    signal(pid, Signal::KILL)?;
    let recovered_ns = set.await_event("recovered", stage, before)?;
    Ok(Kill { at_s, stage: stage.to_owned(), recovery_ms: ms_since(killed_ns, recovered_ns) })
}

/// What the set's processes hold now.
fn sample(set: &mut Set<'_>, held: &mut BTreeMap<String, Held>) -> anyhow::Result<()> {
    let mut processes = set.entry(4)?.stages;
    processes.push(("supervisor".to_owned(), set.pid()));
    for (name, pid) in processes {
        // One that was just killed has nothing to tell.
        let Ok(status) = fs::read_to_string(format!("/proc/{pid}/status")) else { continue };
        let Ok(files) = fs::read_dir(format!("/proc/{pid}/fd")) else { continue };
        let own = status.lines().find_map(|line| line.strip_prefix("RssAnon:"));
        let kib = own.and_then(|rest| rest.trim().split(' ').next()?.parse().ok());
        if let Some(kib) = kib {
            held.entry(name).or_default().samples.push([kib, files.count() as u64]);
        }
    }
    Ok(())
}

fn median(mut values: Vec<u64>) -> u64 {
    values.sort_unstable();
    values.get(values.len() / 2).copied().unwrap_or(0)
}

fn figures(
    kills: Vec<Kill>,
    mut held: BTreeMap<String, Held>,
    summary: &serde_json::Value,
    elapsed: Duration,
    slow_ms: f64,
    cameras: u64,
) -> Figures {
    let mut grew = Vec::new();
    for (name, held) in &mut held {
        let quarter = (held.samples.len() / 4).max(1);
        let of = |samples: &[[u64; 2]], k: usize| median(samples.iter().map(|s| s[k]).collect());
        let first = &held.samples[..quarter.min(held.samples.len())];
        let last = &held.samples[held.samples.len() - quarter.min(held.samples.len())..];
        held.memory_kib = [of(first, 0), of(last, 0)];
        held.files = [of(first, 1), of(last, 1)];
        let [before, after] = held.memory_kib;
        if after as f64 > before as f64 * GROWTH_MAX && after > before + GROWTH_MIN_KIB {
            grew.push(format!("{name}: {before} KiB, then {after}"));
        }
        // Connections to processes that were replaced are closed by the next message.
        if held.files[1] > held.files[0] + 8 {
            grew.push(format!("{name}: {} files, then {}", held.files[0], held.files[1]));
        }
    }
    let mut recoveries: Vec<f64> = kills.iter().map(|kill| kill.recovery_ms).collect();
    recoveries.sort_by(f64::total_cmp);
    let report = &summary["report"];
    let count = |stage: &str| report["stages"][stage]["published"].as_u64().unwrap_or(0);
    let lost: u64 = summary["drops"]["segment"]
        .as_object()
        .map_or(0, |causes| causes.values().filter_map(serde_json::Value::as_u64).sum());
    Figures {
        seconds: elapsed.as_secs_f64(),
        slow: recoveries.iter().filter(|ms| **ms > slow_ms).count(),
        recovery_ms_median: recoveries.get(recoveries.len() / 2).copied().unwrap_or(0.0),
        recovery_ms_max: recoveries.last().copied().unwrap_or(0.0),
        kills: kills.len(),
        states: summary["steps"].as_u64().unwrap_or(0),
        hz: summary["hz"].as_f64(),
        drops: summary["drops"].clone(),
        frames_without_cause: (count("capture") * cameras) as i64
            - (count("segment") * cameras + lost) as i64,
        held,
        grew,
        each: kills,
    }
}
