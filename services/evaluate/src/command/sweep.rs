//! `orime-evaluate sweep`: every knob's price and gain around one set's settings.

mod knobs;
mod ledger;
mod report;

use std::fs;
use std::io::{IsTerminal, Write as _};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context, ensure};
use orime_capture::CaptureParams;
use orime_evaluate::summary::fnv1a;
use orime_evaluate::sweep::{Row, RunFigures};
use orime_runtime::SetFile;
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;
use toml::Value;

use self::knobs::{Knob, Point};
use self::ledger::Ledger;
use super::judged::{Run, judged};
use super::variant::{Variant, assignment};

/// What accuracy costs in time: vary every knob of a set, and draw error over time.
///
/// Exit codes: 0 done, 1 failed, 2 wrong usage or set file, 3 interrupted: the same command goes
/// on.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct SweepArguments {
    /// The set file; its source must be rendered, so that the truth is known.
    set: PathBuf,
    /// Folder for runs.jsonl (what is done), runs.csv, settings.csv, front.md, and the pictures
    /// error_over_time and knobs (SVG and PNG).
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write everything as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Runs of every setting: the set's seed, and those after it.
    #[arg(long, value_name = "N", default_value_t = 2)]
    #[arg(value_parser = clap::value_parser!(u64).range(1..=100))]
    seeds: u64,
    /// Stop each run after this many steps (of the set's own frame rate).
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Only these knobs, by the beginning of their names; the set's own settings always run.
    #[arg(long, value_name = "A,B,…", value_delimiter = ',')]
    knobs: Vec<String>,
    /// Another key of the set, for all runs.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    keys: Vec<String>,
    /// Another setting beside the knobs, as `orime-evaluate compare --variants` takes it.
    #[arg(long, value_name = "NAME:KEY=VALUE;…")]
    also: Vec<String>,
    /// What a step's time is: `wall`, or `cpu`, the processor time on one thread, which other
    /// work on the machine hardly changes.
    #[arg(long, value_enum, default_value = "wall")]
    clock: Clock,
    /// What ../shared/baseline/paper_loop.py printed on this machine, to be drawn beside.
    #[arg(long, value_name = "FILE")]
    paper_loop: Option<PathBuf>,
    /// Print the knobs, their values and every run as JSON, and run nothing.
    #[arg(long)]
    list: bool,
    /// Draw what is done, by this program or an older one, and run nothing.
    #[arg(long, conflicts_with = "list")]
    draw: bool,
}

const EXAMPLES: &str = "\
Examples:
  orime-evaluate sweep deploy/sets/half_fold.toml --out out/sweep --seeds 3
  orime-evaluate sweep deploy/sets/square_base.toml --out out/square --clock cpu \\
      --set capture.rendered.speed=2 --knobs grid,cameras,together
  orime-evaluate sweep deploy/sets/half_fold.toml --out out/sweep --list
  orime-evaluate sweep deploy/sets/half_fold.toml --out out/sweep --draw --paper-loop paper.json

A finished run is a line of DIR/runs.jsonl with hashes over the set with its keys, seed and steps,
and over this program: the same command goes on where it was interrupted, and runs nothing twice.";

/// What a step's time is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Clock {
    /// Time on the wall.
    Wall,
    /// Processor time on one thread.
    Cpu,
}

/// The sweep was interrupted; what is done is kept.
#[derive(Debug, thiserror::Error)]
#[error("interrupted after {done} of {planned} runs: the same command goes on")]
pub struct Interrupted {
    done: usize,
    planned: usize,
}

/// One run that is to be made.
#[derive(Serialize)]
struct Planned {
    key: String,
    knob: String,
    value: String,
    seed: u64,
    steps: Option<u64>,
    /// The set with all keys.
    #[serde(skip)]
    text: String,
}

/// Runs the command.
pub fn run(arguments: &SweepArguments) -> anyhow::Result<()> {
    let set = base(arguments)?;
    let knobs = chosen(arguments, knobs::all(&set)?)?;
    let planned = plan(arguments, &set, &knobs)?;
    if arguments.list {
        let knobs: Vec<_> = knobs.iter().map(Knob::listed).collect();
        let list = serde_json::json!({ "knobs": knobs, "runs": planned });
        println!("{}", serde_json::to_string_pretty(&list)?);
        return Ok(());
    }
    let paper_loop_step_ms = arguments.paper_loop.as_deref().map(paper_loop_ms).transpose()?;
    let mut ledger = Ledger::open(&arguments.out)?;
    let program = format!("{:016x}", fnv1a(this_program()?.into_iter()));
    let known = planned.iter().filter(|run| ledger.row(&run.key, &program).is_some()).count();
    let others = ledger.len() - known;
    if others > 0 && !arguments.draw {
        eprintln!("{others} rows are of another program, set or number of steps: left alone");
    }
    let whole = arguments.draw || run_all(arguments, &planned, &program, &mut ledger)?;
    let row = |run: &Planned| match arguments.draw {
        true => ledger.row_of_any(&run.key, &program),
        false => ledger.row(&run.key, &program),
    };
    let rows: Vec<Row> = planned.iter().filter_map(row).cloned().collect();
    let foreign = rows.iter().filter(|row| row.program != program).count();
    if foreign > 0 {
        eprintln!("{foreign} rows were made by another build of this program");
    }
    ensure!(!rows.is_empty(), "there is nothing to draw: no run of this sweep is done");
    let clock = match arguments.clock {
        Clock::Wall => "on the wall",
        Clock::Cpu => "of the processor, one thread",
    };
    let input = report::Input {
        set: &arguments.set,
        clock,
        rows: &rows,
        planned: planned.len(),
        knobs: &knobs,
        paper_loop_step_ms,
    };
    let (table, report) = report::write(&arguments.out, &input)?;
    println!("{table}");
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&report)? + "\n";
        fs::write(path, text).with_context(|| format!("writing `{}`", path.display()))?;
    }
    ensure!(whole, Interrupted { done: rows.len(), planned: planned.len() });
    Ok(())
}

/// The set with the keys of all runs.
fn base(arguments: &SweepArguments) -> anyhow::Result<SetFile> {
    let text = fs::read_to_string(&arguments.set)
        .with_context(|| format!("reading set file `{}`", arguments.set.display()))?;
    let keys = arguments.keys.iter().map(|key| assignment(key)).collect::<Result<_, _>>();
    let keys = keys.context("--set")?;
    let text = Variant::new("all".to_owned(), keys).apply(&text)?;
    Ok(SetFile::parse(&arguments.set, text)?)
}

/// The knobs that were asked for.
fn chosen(arguments: &SweepArguments, all: Vec<Knob>) -> anyhow::Result<Vec<Knob>> {
    let names: Vec<&str> = all.iter().map(|knob| knob.name).collect();
    for asked in &arguments.knobs {
        let is_known = names.iter().any(|name| name.starts_with(asked.as_str()));
        ensure!(is_known, "--knobs: `{asked}` begins no name of {}", names.join(", "));
    }
    let wanted = |knob: &Knob| {
        let asked = &arguments.knobs;
        asked.is_empty() || asked.iter().any(|name| knob.name.starts_with(name.as_str()))
    };
    Ok(all.into_iter().filter(wanted).collect())
}

/// All runs, seed by seed, so that an interrupted sweep has something of every knob.
fn plan(arguments: &SweepArguments, set: &SetFile, knobs: &[Knob]) -> anyhow::Result<Vec<Planned>> {
    let capture: CaptureParams = set.section("capture")?;
    let own = Point { value: String::new(), keys: Vec::new(), steps_ratio: 1.0 };
    let mut points: Vec<(String, Point)> = vec![("base".to_owned(), own)];
    for knob in knobs {
        points.extend(knob.points.iter().map(|point| (knob.name.to_owned(), point.clone())));
    }
    for text in &arguments.also {
        for variant in Variant::parse_all(text)? {
            let keys = variant.keys().to_vec();
            points.push(("also".to_owned(), Point { value: variant.name, keys, steps_ratio: 1.0 }));
        }
    }
    let mut planned = Vec::new();
    for seed in (0..arguments.seeds).map(|k| capture.rendered.seed + k) {
        for (knob, point) in &points {
            let mut keys = point.keys.clone();
            let seed_value = Value::Integer(i64::try_from(seed)?);
            keys.push(("capture.rendered.seed".to_owned(), seed_value));
            let name = format!("{knob} {}", point.value);
            let text = Variant::new(name.clone(), keys).apply(&set.text)?;
            let ratio = point.steps_ratio;
            let steps = arguments.steps.map(|steps| (steps as f64 * ratio).round() as u64);
            // What cannot run is said before hours have gone into what can.
            let varied = SetFile::parse(&set.path, text.clone()).context(name.clone())?;
            super::set::pipeline(&varied).context(name.clone())?;
            varied.checked("capture", CaptureParams::check).context(name)?;
            let all = format!("{steps:?} {:?} {text}", arguments.clock);
            let key = format!("{:016x}", fnv1a(all.bytes()));
            let (knob, value) = (knob.clone(), point.value.clone());
            planned.push(Planned { key, knob, value, seed, steps, text });
        }
    }
    Ok(planned)
}

/// Makes the runs that are missing; `false` if interrupted.
fn run_all(
    arguments: &SweepArguments,
    planned: &[Planned],
    program: &str,
    ledger: &mut Ledger,
) -> anyhow::Result<bool> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // The second one ends it at once.
        signal_hook::flag::register_conditional_shutdown(signal, 3, Arc::clone(&stop))?;
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let clock = (arguments.clock == Clock::Cpu).then_some(processor_s as fn() -> f64);
    if clock.is_some() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build_global();
        pool.context("making one thread for the stages")?;
    }
    let missing: Vec<&Planned> =
        planned.iter().filter(|run| ledger.row(&run.key, program).is_none()).collect();
    let done = planned.len() - missing.len();
    if done > 0 {
        eprintln!("{done} of {} runs are done already", planned.len());
    }
    let start = Instant::now();
    for (k, run) in missing.iter().enumerate() {
        let what = format!("{}/{} {} {}", done + k + 1, planned.len(), run.knob, run.value);
        let Some(figures) = one(arguments, run, &what, clock, &stop)? else { return Ok(false) };
        let left_s =
            start.elapsed().as_secs_f64() / (k + 1) as f64 * (missing.len() - k - 1) as f64;
        eprintln!(
            "{what}, seed {}: {} mm, {:.1} ms, {} of {} lost; {:.0} min left",
            run.seed,
            figures.vertex_error_mm_mean.map_or("-".to_owned(), |mm| format!("{mm:.2}")),
            figures.step_ms_p50,
            figures.lost_steps,
            figures.steps,
            left_s / 60.0
        );
        ledger.add(Row {
            key: run.key.clone(),
            program: program.to_owned(),
            knob: run.knob.clone(),
            value: run.value.clone(),
            seed: run.seed,
            figures,
        })?;
    }
    Ok(true)
}

/// One run; `None` if interrupted.
fn one(
    arguments: &SweepArguments,
    run: &Planned,
    what: &str,
    clock: Option<fn() -> f64>,
    stop: &AtomicBool,
) -> anyhow::Result<Option<RunFigures>> {
    let set = SetFile::parse(&arguments.set, run.text.clone())?;
    let live = std::io::stderr().is_terminal();
    let mut goes_on = |done: u64, steps: u64| {
        if live && (done.is_multiple_of(10) || done == steps) {
            eprint!("\r{what}: step {done}/{steps}\r");
            // A terminal that is gone is no reason to stop.
            let _ = std::io::stderr().flush();
        }
        !stop.load(Ordering::Relaxed)
    };
    let judge = judged(&set, Run { limit: run.steps, clock, goes_on: &mut goes_on })
        .with_context(|| format!("{what}, seed {}", run.seed))?;
    Ok(judge.map(|judge| RunFigures::of(judge.steps(), &judge.summary())))
}

fn this_program() -> anyhow::Result<Vec<u8>> {
    fs::read(std::env::current_exe()?).context("reading this program")
}

/// Processor time of this process so far, seconds.
fn processor_s() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Milliseconds per step from what paper_loop.py printed.
fn paper_loop_ms(path: &std::path::Path) -> anyhow::Result<f64> {
    let text = fs::read_to_string(path).with_context(|| format!("reading `{}`", path.display()))?;
    let value: serde_json::Value =
        serde_json::from_str(&text).with_context(|| format!("`{}` is no JSON", path.display()))?;
    let seconds = value["seconds_per_step"].as_f64().filter(|seconds| *seconds > 0.0);
    let seconds = seconds.with_context(|| {
        format!("`{}` lacks seconds_per_step: give what paper_loop.py prints", path.display())
    })?;
    Ok(seconds * 1e3)
}
