//! `orime doctor` and `orime clean`: what could keep sets from running, and what dead ones left.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use orime_messages::{PROTOCOL, Stage};
use orime_runtime::Pace;
use orime_runtime::{
    RunEntry, RunId, SHARED_MEMORY_DIR, clean as clean_run, free_bytes, ipc_dirs, needed_bytes,
    registered, user_name,
};
use serde::Serialize;

use crate::exit::{Exit, Failure};
use crate::process::program;

/// A run that left something on this machine.
#[derive(Debug, Clone, Serialize)]
struct Found {
    run: String,
    /// Objects in shared memory.
    objects: usize,
    /// Their size.
    bytes: u64,
    /// Whose they are.
    owner: String,
    /// `running`, `dead` (its supervisor and all its processes are gone), `in use` (some process
    /// still holds its memory), or `foreign`.
    state: &'static str,
}

/// What the doctor says.
#[derive(Debug, Serialize)]
struct Diagnosis {
    protocol: &'static str,
    shared_memory_free_mib: u64,
    /// What the embedded set needs at pace `realtime`, the larger one.
    shared_memory_needed_mib: u64,
    missing_programs: Vec<String>,
    runs: Vec<Found>,
    problems: Vec<String>,
}

/// Runs that left something: those with shared memory, those with a directory, those registered.
fn found() -> Result<Vec<Found>, Failure> {
    let failed = |error: std::io::Error| Failure::machine(format!("looking for runs: {error}"));
    let mut objects: BTreeMap<String, (usize, u64, u32)> = BTreeMap::new();
    let own = rustix::process::getuid().as_raw();
    for entry in fs::read_dir(SHARED_MEMORY_DIR).map_err(failed)?.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let Some(run) = run_of(&name) else { continue };
        // It may just have been removed.
        let Ok(meta) = entry.metadata() else { continue };
        let found = objects.entry(run).or_insert((0, 0, meta.uid()));
        (found.0, found.1) = (found.0 + 1, found.1 + meta.blocks() * 512);
    }
    let entries = registered().map_err(failed)?;
    for run in entries.iter().map(|entry| entry.run.clone()).chain(ipc_dirs().map_err(failed)?) {
        objects.entry(run).or_insert((0, 0, own));
    }
    let held = held();
    let state = |run: &str, uid: u32| {
        let entry = entries.iter().find(|entry| entry.run == *run);
        match () {
            () if uid != own => "foreign",
            () if entry.is_some_and(RunEntry::is_alive) => "running",
            () if held.contains(run) => "in use",
            () => "dead",
        }
    };
    let found = objects.into_iter().map(|(run, (objects, bytes, uid))| Found {
        state: state(&run, uid),
        owner: user_name(uid),
        run,
        objects,
        bytes,
    });
    Ok(found.collect())
}

/// The run that an object in shared memory bears in its name.
fn run_of(name: &str) -> Option<String> {
    let run = name.strip_prefix("orime_")?.split('_').next()?;
    run.parse::<RunId>().ok().map(|run| run.to_string())
}

/// Runs whose shared memory, or directory, some process of this user holds.
fn held() -> BTreeSet<String> {
    let mut held = BTreeSet::new();
    for process in fs::read_dir("/proc").into_iter().flatten().flatten() {
        let path = process.path();
        if !process.file_name().to_string_lossy().bytes().all(|byte| byte.is_ascii_digit()) {
            continue;
        }
        let maps = fs::read_to_string(path.join("maps")).unwrap_or_default();
        held.extend(maps.lines().filter_map(|line| run_of(object_of(line)?)));
        for link in fs::read_dir(path.join("fd")).into_iter().flatten().flatten() {
            let target = fs::read_link(link.path()).unwrap_or_default();
            held.extend(run_in_path(&target));
        }
    }
    held
}

fn object_of(line: &str) -> Option<&str> {
    line.split_once(SHARED_MEMORY_DIR)?.1.strip_prefix('/')
}

/// The run whose object or directory a path lies in.
fn run_in_path(path: &Path) -> Option<String> {
    let mut parts = path.iter().map(|part| part.to_string_lossy());
    parts.find_map(|part| {
        run_of(&part).or_else(|| part.parse::<RunId>().ok().map(|run| run.to_string()))
    })
}

/// Reports; exit status 1 where there is a problem.
pub fn doctor(json: bool) -> Result<Exit, Failure> {
    let diagnosis = diagnose()?;
    let is_well = diagnosis.problems.is_empty();
    if json {
        let text = serde_json::to_string_pretty(&diagnosis)
            .map_err(|error| Failure::machine(error.to_string()))?;
        println!("{text}");
        return Ok(if is_well { Exit::Good } else { Exit::SetFailed });
    }
    let Diagnosis { protocol, shared_memory_free_mib, shared_memory_needed_mib, .. } = &diagnosis;
    println!("protocol       {protocol}");
    println!(
        "shared memory  {shared_memory_free_mib} MiB free; the embedded set needs \
         {shared_memory_needed_mib}"
    );
    for Found { run, objects, bytes, owner, state } in &diagnosis.runs {
        let mib = bytes >> 20;
        println!("run {run}   {state}, {objects} objects, {mib} MiB, of user {owner}");
    }
    for problem in &diagnosis.problems {
        println!("PROBLEM        {problem}");
    }
    if is_well {
        println!("all is well");
    }
    Ok(if is_well { Exit::Good } else { Exit::SetFailed })
}

fn diagnose() -> Result<Diagnosis, Failure> {
    let free = free_bytes()
        .map_err(|error| Failure::machine(format!("looking at {SHARED_MEMORY_DIR}: {error}")))?;
    // Three cameras of 640 × 480, colour and depth.
    let needed = needed_bytes(Pace::Realtime, 3, 640 * 480 * 5);
    let all = Stage::PIPELINE.into_iter().chain([Stage::Judge, Stage::Record]);
    let missing: Vec<String> = all
        .filter_map(|stage| program(stage).err().map(|Failure { message, .. }| message))
        .collect();
    let runs = found()?;
    let mut problems = missing.clone();
    if needed > free {
        problems.push(format!(
            "{SHARED_MEMORY_DIR} has {} MiB free, the embedded set needs {}: make it larger",
            free >> 20,
            needed.div_ceil(1 << 20)
        ));
    }
    for Found { run, objects, bytes, .. } in runs.iter().filter(|found| found.state == "dead") {
        let mib = bytes >> 20;
        problems.push(format!(
            "run {run} is dead and left {objects} objects, {mib} MiB: `orime clean` removes them"
        ));
    }
    Ok(Diagnosis {
        protocol: PROTOCOL,
        shared_memory_free_mib: free >> 20,
        shared_memory_needed_mib: needed.div_ceil(1 << 20),
        missing_programs: missing,
        runs,
        problems,
    })
}

/// Removes what dead runs of this user left; what any process still holds stays.
pub fn clean(dry_run: bool, json: bool) -> Result<Exit, Failure> {
    let mut dead = found()?;
    dead.retain(|found| found.state == "dead");
    let failed = |error: std::io::Error| Failure::machine(format!("removing: {error}"));
    for found in dead.iter().filter(|_| !dry_run) {
        let Ok(run) = found.run.parse::<RunId>() else { continue };
        clean_run(run).map_err(failed)?;
        let entries = registered().map_err(failed)?;
        for entry in entries.iter().filter(|entry| entry.run == found.run) {
            entry.unregister().map_err(failed)?;
        }
    }
    if json {
        let text = serde_json::to_string_pretty(&dead)
            .map_err(|error| Failure::machine(error.to_string()))?;
        println!("{text}");
        return Ok(Exit::Good);
    }
    let what = if dry_run { "would remove" } else { "removed" };
    for Found { run, objects, bytes, .. } in &dead {
        println!("{what} run {run}: {objects} objects, {} MiB", bytes >> 20);
    }
    if dead.is_empty() {
        println!("nothing to remove");
    }
    Ok(Exit::Good)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_runs_are_names_of_runs() {
        assert_eq!(run_of("orime_00c0ffee_1234.data"), Some("00c0ffee".to_owned()));
        for other in ["orime_", "orime_nothex00_1", "iox2_00c0ffee_1", "orime_0c0ffee_1", "x"] {
            assert_eq!(run_of(other), None, "{other}");
        }
        let line = "7f00-7f10 rw-s 00000000 00:1a 7  /dev/shm/orime_00c0ffee_9.data (deleted)";
        assert_eq!(object_of(line).and_then(run_of), Some("00c0ffee".to_owned()));
        let socket = Path::new("/tmp/orime-0/00c0ffee/nodes/1.lock");
        assert_eq!(run_in_path(socket), Some("00c0ffee".to_owned()));
    }
}
