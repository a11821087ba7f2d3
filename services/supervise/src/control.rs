//! `orime restart`: a wish that one process leaves for the supervisor of a run.

use std::fs;
use std::io;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use orime_messages::Stage;
use orime_runtime::{RunEntry, registered, registry_dir};

use crate::exit::{Exit, Failure};
use crate::runs::find;

/// Time that a restart may take, the stage's own readiness deadline not counted.
const RESTART: Duration = Duration::from_secs(45);

/// Every stage that can be restarted.
pub const STAGES: [Stage; 5] =
    [Stage::Capture, Stage::Segment, Stage::Register, Stage::Simulate, Stage::Judge];

fn wish(run: &str, stage: Stage) -> PathBuf {
    registry_dir().join(format!("{run}.restart.{}", stage.name()))
}

/// The stages that somebody wants restarted; each wish is told once.
pub fn take_wishes(run: &str) -> Vec<Stage> {
    let is_wanted = |stage: &Stage| match fs::remove_file(wish(run, *stage)) {
        Ok(()) => true,
        Err(error) => error.kind() != io::ErrorKind::NotFound && wish(run, *stage).exists(),
    };
    STAGES.into_iter().filter(is_wanted).collect()
}

fn pid_of(entry: &RunEntry, stage: Stage) -> Option<u32> {
    entry.stages.iter().find(|(name, _)| name == stage.name()).map(|(_, pid)| *pid)
}

/// Asks for a restart, and waits until there is another process.
pub fn restart(stage: &str, run: Option<&str>, json: bool) -> Result<Exit, Failure> {
    let entry = find(run)?;
    let names = STAGES.map(Stage::name).join(", ");
    let unknown = || Failure::usage(format!("there is no stage `{stage}` to restart: {names} are"));
    let stage = STAGES.into_iter().find(|known| known.name() == stage).ok_or_else(unknown)?;
    let before = pid_of(&entry, stage).ok_or_else(|| {
        Failure::usage(format!("run {} has no process `{}` now", entry.run, stage.name()))
    })?;
    let asked = Instant::now();
    fs::write(wish(&entry.run, stage), b"")
        .map_err(|error| Failure::machine(format!("asking run {}: {error}", entry.run)))?;
    while asked.elapsed() < RESTART {
        std::thread::sleep(Duration::from_millis(20));
        let entries = registered()
            .map_err(|error| Failure::machine(format!("reading the registry: {error}")))?;
        let now = entries.iter().find(|other| other.run == entry.run && other.is_alive());
        let Some(now) = now else {
            return Err(Failure::set(format!("run {} has ended meanwhile", entry.run)));
        };
        if let Some(pid) = pid_of(now, stage).filter(|pid| *pid != before) {
            let (run, name, ms) = (&entry.run, stage.name(), asked.elapsed().as_millis());
            if json {
                println!(
                    "{{\"run\": \"{run}\", \"stage\": \"{name}\", \"pid\": {pid}, \"ms\": {ms}}}"
                );
            } else {
                println!("run {run}: {name} is process {pid} now, after {ms} ms");
            }
            return Ok(Exit::Good);
        }
    }
    let _ = fs::remove_file(wish(&entry.run, stage));
    Err(Failure::set(format!("run {} has not restarted {}", entry.run, stage.name())))
}
