//! `orime ps` and `orime down`.

use std::time::{Duration, Instant};

use orime_runtime::{RunEntry, foreign_owner, registered};
use rustix::process::{Pid, Signal, kill_process};

use crate::exit::{Exit, Failure};

/// Time that a run may take to stop in order.
const STOP: Duration = Duration::from_secs(15);
/// Time that it may take when it is asked for the second time.
const STOP_AT_ONCE: Duration = Duration::from_secs(5);

fn living() -> Result<Vec<RunEntry>, Failure> {
    let mut entries =
        registered().map_err(|error| Failure::machine(format!("reading the registry: {error}")))?;
    entries.retain(RunEntry::is_alive);
    Ok(entries)
}

/// Shows the runs of this user.
pub fn ps(json: bool) -> Result<Exit, Failure> {
    let entries = living()?;
    if json {
        let text = serde_json::to_string_pretty(&entries)
            .map_err(|error| Failure::machine(error.to_string()))?;
        println!("{text}");
    } else if entries.is_empty() {
        println!("nothing runs");
    } else {
        println!("{:8}  {:>8}  {:20}  OUT", "RUN", "PID", "SET");
        for entry in entries {
            println!(
                "{:8}  {:>8}  {:20}  {}",
                entry.run,
                entry.pid,
                entry.name,
                entry.out.display()
            );
        }
    }
    Ok(Exit::Good)
}

/// The run that is meant: the one named, or the only one.
pub fn find(run: Option<&str>) -> Result<RunEntry, Failure> {
    let mut entries = living()?;
    entries.retain(|entry| run.is_none_or(|run| entry.run == run));
    match (entries.pop(), entries.is_empty()) {
        (Some(entry), true) => Ok(entry),
        (None, _) => {
            let foreign = run.and_then(|run| Some((run, foreign_owner(run.parse().ok()?)?)));
            Err(Failure::usage(match foreign {
                Some((run, owner)) => {
                    format!("run {run} belongs to user {owner}: only they can attach to it")
                }
                None => "no such run: `orime ps` shows what runs".to_owned(),
            }))
        }
        _ => Err(Failure::usage("several sets run: name one, as `orime ps` shows it")),
    }
}

/// Stops a run, or the only one, and waits until it is gone.
pub fn down(run: Option<&str>, json: bool) -> Result<Exit, Failure> {
    let entry = &find(run)?;
    for (signal, patience) in [(Signal::TERM, STOP), (Signal::TERM, STOP_AT_ONCE)] {
        send(entry, signal)?;
        let deadline = Instant::now() + patience;
        while entry.is_alive() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(50));
        }
        if !entry.is_alive() {
            if json {
                println!("{{\"run\": \"{}\", \"stopped\": true}}", entry.run);
            } else {
                println!("run {} has stopped", entry.run);
            }
            return Ok(Exit::Good);
        }
    }
    send(entry, Signal::KILL)?;
    crate::up::clear_dead_runs()?;
    Err(Failure::set(format!("run {} did not stop and was killed", entry.run)))
}

fn send(entry: &RunEntry, signal: Signal) -> Result<(), Failure> {
    let pid = Pid::from_raw(entry.pid as i32).filter(|_| entry.is_alive());
    match pid.map(|pid| kill_process(pid, signal)) {
        Some(Err(error)) => Err(Failure::machine(format!("signalling run {}: {error}", entry.run))),
        // It has just ended by itself.
        None | Some(Ok(())) => Ok(()),
    }
}
