//! `orime restart`: a wish that one process leaves for the supervisor of a run.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use orime_geometry::SheetParams;
use orime_messages::Stage;
use orime_runtime::{Pace, RunEntry, SetFile, registered, registry_dir};

use crate::check::{check, exit_of};
use crate::exit::{Exit, Failure};
use crate::runs::find;

/// Time that a restart may take, the stage's own readiness deadline not counted.
const RESTART: Duration = Duration::from_secs(45);

/// Every stage that can be restarted.
pub const STAGES: [Stage; 5] =
    [Stage::Capture, Stage::Segment, Stage::Register, Stage::Simulate, Stage::Judge];

/// What somebody wants restarted.
#[derive(Debug)]
pub struct Wish {
    /// The stage.
    pub stage: Stage,
    /// The set file whose source capture is to take.
    pub source: Option<PathBuf>,
}

fn place(run: &str, stage: Stage) -> PathBuf {
    registry_dir().join(format!("{run}.restart.{}", stage.name()))
}

/// What somebody wants restarted; each wish is told once.
pub fn take_wishes(run: &str) -> Vec<Wish> {
    let wish = |stage: Stage| {
        let text = fs::read_to_string(place(run, stage)).ok()?;
        fs::remove_file(place(run, stage)).ok()?;
        Some(Wish { stage, source: (!text.is_empty()).then(|| text.into()) })
    };
    STAGES.into_iter().filter_map(wish).collect()
}

/// Leaves a wish, whole at once: the supervisor may look at any time.
fn leave(run: &str, stage: Stage, source: Option<&Path>) -> io::Result<()> {
    let text = source.map_or("".into(), Path::to_string_lossy);
    let draft = place(run, stage).with_extension("draft");
    fs::write(&draft, text.as_bytes())?;
    fs::rename(&draft, place(run, stage))
}

/// Looks whether another set's source can take the place of a run's; its path, made absolute.
fn another_source(entry: &RunEntry, path: &Path) -> Result<PathBuf, Failure> {
    let read = |path: &Path| {
        std::fs::read_to_string(path).map_err(|error| {
            Failure::usage(format!("reading set file `{}`: {error}", path.display()))
        })
    };
    let other = check(path, &read(path)?).map_err(|problems| {
        let list: Vec<String> = problems.iter().map(ToString::to_string).collect();
        Failure { exit: exit_of(&problems), message: list.join("\n") }
    })?;
    let own = SetFile::load(&entry.set).map_err(|error| Failure::machine(error.to_string()))?;
    let sheet = |set: &SetFile| -> Result<SheetParams, Failure> {
        set.section("sheet").map_err(|error| Failure::usage(error.to_string()))
    };
    let differs = |key: &str, theirs: String, ours: String| {
        let (name, run) = (path.display(), &entry.run);
        let message = format!("`{name}`: `{key}` is {theirs}, but run {run} has {ours}: make them");
        Err(Failure::usage(format!("{message} the same, or start that set with `orime up`")))
    };
    if other.file.pace != entry.pace {
        let pace = |pace: Pace| format!("{pace:?}").to_lowercase();
        return differs("pace", pace(other.file.pace), pace(entry.pace));
    }
    if other.cameras.len() != entry.cameras {
        let cameras = |n: usize| format!("{n} cameras");
        return differs("capture", cameras(other.cameras.len()), cameras(entry.cameras));
    }
    let (theirs, ours) = (sheet(&other.file)?, sheet(&own)?);
    if theirs != ours {
        return differs("sheet", format!("{theirs:?}"), format!("{ours:?}"));
    }
    path.canonicalize().map_err(|error| Failure::usage(format!("`{}`: {error}", path.display())))
}

fn pid_of(entry: &RunEntry, stage: Stage) -> Option<u32> {
    entry.stages.iter().find(|(name, _)| name == stage.name()).map(|(_, pid)| *pid)
}

/// Asks for a restart, and waits until there is another process.
pub fn restart(
    stage: &str,
    run: Option<&str>,
    source: Option<&Path>,
    json: bool,
) -> Result<Exit, Failure> {
    let entry = find(run)?;
    let names = STAGES.map(Stage::name).join(", ");
    let unknown = || Failure::usage(format!("there is no stage `{stage}` to restart: {names} are"));
    let stage = STAGES.into_iter().find(|known| known.name() == stage).ok_or_else(unknown)?;
    let before = pid_of(&entry, stage).ok_or_else(|| {
        Failure::usage(format!("run {} has no process `{}` now", entry.run, stage.name()))
    })?;
    if source.is_some() && stage != Stage::Capture {
        let name = stage.name();
        return Err(Failure::usage(format!("--source is for `capture`; `{name}` has no source")));
    }
    let source = source.map(|path| another_source(&entry, path)).transpose()?;
    let asked = Instant::now();
    leave(&entry.run, stage, source.as_deref())
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
    let _ = fs::remove_file(place(&entry.run, stage));
    Err(Failure::set(format!("run {} has not restarted {}", entry.run, stage.name())))
}
