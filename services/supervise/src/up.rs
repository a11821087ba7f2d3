//! `orime up`: one set, in the foreground, from check to summary.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use orime_messages::{FrameExtent, PROTOCOL, Stage};
use orime_runtime::{
    Guest, Pace, RunEntry, RunId, Stop, clean, free_bytes, make_private_dir, needed_bytes, now_ns,
    registered, shared_memory_of, start_ticks,
};

use rustix::fs::{FlockOperation, flock};

use crate::args::Up;
use crate::asked::Asked;
use crate::check::{CheckedSet, check, exit_of};
use crate::ending::Ending;
use crate::events::Events;
use crate::exit::{Exit, Failure};
use crate::notify::Notify;
use crate::policy::Budget;
use crate::progress::Progress;
use crate::recording::Recording;
use crate::summary::{JUDGE_SUMMARY_NAME, RecordingSummary, Summary, judge_summary, written};
use crate::watch::{Deadlines, Watch};

/// The set that runs when none is named.
pub const DEFAULT_SET: &str = include_str!("../../../deploy/sets/half_fold.toml");
/// Name under which the embedded set is written beside what it gave.
const DEFAULT_NAME: &str = "half_fold.toml";

/// Name of the file whose lock says who writes to an output folder.
const LOCK_NAME: &str = ".lock";
/// The summary's name in the output folder.
const SUMMARY_NAME: &str = "run.json";

/// Runs a set to its end.
pub fn up(args: &Up, json: bool) -> Result<Exit, Failure> {
    let asked =
        Asked::listen().map_err(|error| Failure::machine(format!("handling signals: {error}")))?;
    clear_dead_runs()?;
    let (set, out) = prepare(args)?;
    let _own = own(&out)?;
    let record = args.record.as_deref().map(new_file).transpose()?;
    check_memory(&set)?;
    let run = RunId::new();
    let entry = register(&set, run, &out)?;
    if !json {
        println!("run {run}: set {}, writing to {}", set.file.name, out.display());
    }
    let ended = match begin(args, json, &set, &entry, run, record) {
        Ok(mut watch) => {
            let ending = watch.run(&set, run, &out, !args.no_judge, &asked);
            ending.map(|ending| (watch.leave(), ending))
        }
        Err(failure) => Err(failure),
    };
    let left = shared_memory_of(run).map_or(0, |left| holding(&left));
    let cleaned = clean(run).and_then(|_| shared_memory_of(run));
    let unregistered = entry.unregister();
    match cleaned {
        Ok(left) if left.is_empty() => {}
        Ok(left) => return Err(Failure::machine(format!("shared memory is left: {left:?}"))),
        Err(error) => return Err(Failure::machine(format!("removing shared memory: {error}"))),
    }
    unregistered.map_err(|error| Failure::machine(format!("clearing the registry: {error}")))?;
    let (mut watched, ending) = ended?;
    watched.progress.close();
    let is_lossy = set.file.pace == Pace::Lockstep
        && watched.recoveries.iter().any(|recovery| recovery.of() != Stage::Judge);
    let summary = Summary {
        restarts: watched.recoveries,
        events: watched.events.into_list(),
        recording: watched.recording.map(|recording| RecordingSummary::of(recording.close())),
        ..summarise(&set, run, &out, &watched.progress, &ending, left)
    };
    write_summary(&summary, &out, json)?;
    Ok(match ending {
        Ending::Finished | Ending::Stopped if is_lossy => {
            eprintln!(
                "orime: a stage was restarted: these are not the states that lockstep promises"
            );
            Exit::Lossy
        }
        Ending::Finished | Ending::Stopped => Exit::Good,
        Ending::Interrupted => Exit::Interrupted,
        Ending::Failed(message) => {
            eprintln!("orime: {message}");
            Exit::SetFailed
        }
    })
}

/// How many of these objects hold something: iceoryx2 leaves a file of 16 bytes for each run, its
/// list of nodes, whatever becomes of them.
fn holding(objects: &[PathBuf]) -> usize {
    let is_list = |path: &&PathBuf| path.extension().is_some_and(|name| name == "global_mgmt");
    objects.len() - objects.iter().filter(is_list).count()
}

/// Takes the output folder for this supervisor alone, as long as the file is open: two that write
/// to one folder would destroy each other's figures, also where their registries differ.
fn own(out: &Path) -> Result<File, Failure> {
    let path = out.join(LOCK_NAME);
    let cannot =
        |error: std::io::Error| Failure::machine(format!("writing `{}`: {error}", path.display()));
    let mut file = OpenOptions::new()
        .create(true)
        .read(true)
        .write(true)
        .truncate(false)
        .open(&path)
        .map_err(cannot)?;
    if flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
        let mut holder = String::new();
        // Who it is helps, but is not needed to refuse.
        let _ = file.read_to_string(&mut holder);
        return Err(Failure::usage(format!(
            "another supervisor, process {}, writes to `{}` already: give another folder with \
             --out, or stop that one with `orime down`",
            holder.trim(),
            out.display()
        )));
    }
    file.set_len(0).map_err(cannot)?;
    writeln!(file, "{}", std::process::id()).map_err(cannot)?;
    Ok(file)
}

/// Finds, checks and, where it is the embedded one, writes the set; makes its output folder.
fn prepare(args: &Up) -> Result<(CheckedSet, PathBuf), Failure> {
    let (path, text) = match &args.set {
        Some(path) => {
            let text = std::fs::read_to_string(path).map_err(|error| {
                Failure::usage(format!("reading set file `{}`: {error}", path.display()))
            })?;
            (path.clone(), text)
        }
        None => (PathBuf::from(DEFAULT_NAME), DEFAULT_SET.to_owned()),
    };
    let mut set = check(&path, &text).map_err(|problems| {
        let list: Vec<String> = problems.iter().map(ToString::to_string).collect();
        let message =
            format!("{}\n{} problem(s), nothing was started", list.join("\n"), list.len());
        Failure { exit: exit_of(&problems), message }
    })?;
    let out = args.out.clone().unwrap_or_else(|| Path::new("out").join(&set.file.name));
    let cannot = |error| Failure::machine(format!("writing to `{}`: {error}", out.display()));
    std::fs::create_dir_all(out.join("logs")).map_err(cannot)?;
    for stale in [SUMMARY_NAME, JUDGE_SUMMARY_NAME] {
        // What an earlier run said must not be taken for this one's.
        match std::fs::remove_file(out.join(stale)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(cannot(error));
            }
            _ => {}
        }
    }
    let out = out.canonicalize().map_err(cannot)?;
    set.file.path = if args.set.is_none() {
        let path = out.join(DEFAULT_NAME);
        std::fs::write(&path, &set.file.text).map_err(cannot)?;
        path
    } else {
        path.canonicalize().map_err(cannot)?
    };
    Ok((set, out))
}

/// Removes what runs left whose supervisor was killed; their stages ended with it.
pub fn clear_dead_runs() -> Result<(), Failure> {
    let failed = |error| Failure::machine(format!("clearing what dead runs left: {error}"));
    for entry in registered().map_err(failed)?.iter().filter(|entry| !entry.is_alive()) {
        if let Some(run) = entry.run_id() {
            let left = clean(run).map_err(failed)?;
            eprintln!("orime: cleared run {run}, whose supervisor is gone ({left} objects)");
        }
        entry.unregister().map_err(failed)?;
    }
    Ok(())
}

/// Refuses a set that does not fit into shared memory, before it would die of it.
fn check_memory(set: &CheckedSet) -> Result<(), Failure> {
    let frame_bytes = set.cameras.iter().map(|camera| FrameExtent::of(camera).total_bytes()).max();
    let needed = needed_bytes(set.file.pace, set.cameras.len(), frame_bytes.unwrap_or(0));
    let free =
        free_bytes().map_err(|error| Failure::machine(format!("looking at /dev/shm: {error}")))?;
    if needed <= free {
        return Ok(());
    }
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    Err(Failure::machine(format!(
        "/dev/shm is too small: this set needs {} MiB, {} MiB are free; make it larger (Docker: \
         --shm-size={}m; else: mount -o remount,size=… /dev/shm) or use smaller images",
        mib(needed),
        free >> 20,
        mib(needed + needed / 2),
    )))
}

fn register(set: &CheckedSet, run: RunId, out: &Path) -> Result<RunEntry, Failure> {
    let failed = |error| Failure::machine(format!("registering the run: {error}"));
    let others = registered().map_err(failed)?;
    if let Some(other) = others.iter().find(|other| other.is_alive() && other.out == out) {
        return Err(Failure::usage(format!(
            "run {} writes to `{}` already: give another folder with --out, or `orime down {}`",
            other.run,
            out.display(),
            other.run
        )));
    }
    let pid = std::process::id();
    let entry = RunEntry {
        run: run.to_string(),
        protocol: PROTOCOL.to_owned(),
        pid,
        start_ticks: start_ticks(pid).unwrap_or(0),
        name: set.file.name.clone(),
        set: set.file.path.clone(),
        out: out.to_owned(),
        pace: set.file.pace,
        cameras: set.cameras.len(),
        stages: Vec::new(),
    };
    make_private_dir(&run.ipc_dir()).map_err(failed)?;
    entry.register().map_err(failed)?;
    Ok(entry)
}

/// What is needed to watch a set, before any of its processes is there.
fn begin(
    args: &Up,
    json: bool,
    set: &CheckedSet,
    entry: &RunEntry,
    run: RunId,
    record: Option<PathBuf>,
) -> Result<Watch, Failure> {
    let guest = Guest::attach(run, set.file.pace, true, Stop::new())
        .map_err(|error| Failure::machine(error.to_string()))?;
    let seconds = |s: f64| Duration::from_secs_f64(s.clamp(0.1, 86_400.0));
    Ok(Watch {
        progress: Progress::new(set.steps, set.cameras.len()),
        guest,
        recording: record.map(Recording::new),
        deadlines: Deadlines {
            ready: seconds(args.ready_s),
            stall: seconds(args.stall_s),
            budget: Budget { restarts: args.restarts, window: seconds(args.restart_window_s) },
        },
        events: Events::begin(&entry.out, run.to_string())
            .map_err(|error| Failure::machine(format!("writing the events: {error}")))?,
        recoveries: Vec::new(),
        entry: entry.clone(),
        notify: Notify::from_environment(),
        frozen: Vec::new(),
        ending_since: [None; 2],
        record_stages: args.record_stages,
        log_json: args.log_json,
        spares: !args.no_spares,
        quiet: json,
    })
}

/// The whole path of a file that can be made, and is not there yet.
pub fn new_file(path: &Path) -> Result<PathBuf, Failure> {
    let wrong = |why: &str| Failure::usage(format!("recording `{}`: {why}", path.display()));
    let name = path.file_name().ok_or_else(|| wrong("name a file"))?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder
        .unwrap_or(Path::new("."))
        .canonicalize()
        .map_err(|error| wrong(&format!("its folder: {error}")))?;
    let file = folder.join(name);
    if file.symlink_metadata().is_ok() {
        return Err(wrong("it is there already; name a file that is not"));
    }
    Ok(file)
}

fn summarise(
    set: &CheckedSet,
    run: RunId,
    out: &Path,
    progress: &Progress,
    ending: &Ending,
    left: usize,
) -> Summary {
    let figures = &progress.figures;
    let ms = |quantile| figures.step_compute().quantile_ns(quantile).map(|ns| ns as f64 / 1e6);
    let (outcome, failure) = match ending {
        Ending::Finished => ("finished", None),
        Ending::Stopped | Ending::Interrupted => ("stopped", None),
        Ending::Failed(message) => ("failed", Some(message.clone())),
    };
    Summary {
        run: run.to_string(),
        name: set.file.name.clone(),
        outcome: outcome.to_owned(),
        failure,
        steps: figures.steps(),
        lost_steps: figures.lost_steps(),
        hz: figures.hz(),
        ms_per_step_p50: ms(0.5),
        ms_per_step_p99: ms(0.99),
        frame_copies: figures.frame_copies(),
        drops: figures.drops(),
        drops_total: figures.drops_total(),
        shared_memory_left: left,
        judge: judge_summary(out),
        recording: None,
        restarts: Vec::new(),
        events: Vec::new(),
        report: figures.report(now_ns()),
        out: out.to_owned(),
        written: written(out, SUMMARY_NAME),
    }
}

/// Writes the summary and prints it.
fn write_summary(summary: &Summary, out: &Path, json: bool) -> Result<(), Failure> {
    let failed = |error| Failure::machine(format!("writing the summary: {error}"));
    let text = serde_json::to_string_pretty(summary).map_err(|e| failed(e.into()))?;
    std::fs::write(out.join(SUMMARY_NAME), format!("{text}\n")).map_err(failed)?;
    if json {
        println!("{text}");
    } else {
        summary.print();
    }
    Ok(())
}
