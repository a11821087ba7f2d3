//! Rows 7, 8, 13 and 14: shared memory, other users, other versions.

use std::fs;
use std::os::unix::process::CommandExt;
use std::time::Instant;

use anyhow::{Context, bail, ensure};
use orime_messages::PROTOCOL;
use orime_runtime::{now_ns, shared_memory_of, start_ticks};
use rustix::process::Signal;

use super::driver::{Bench, ms_since, said, signal, wait_for};
use super::{Seen, Skipped};

/// A user that is nobody.
const NOBODY: u32 = 65_534;

/// Row 7.
pub fn stale_memory(bench: &Bench) -> anyhow::Result<Seen> {
    let endless = bench.rendered("realtime", "fps = 15\nrepeat = true")?;
    let mut dead = bench.up("dead", &endless, &[])?;
    let entry = dead.running()?;
    let run = entry.run_id().context("a run")?;
    signal(dead.pid(), Signal::KILL)?;
    dead.wait()?;
    wait_for("the end of its stages", || {
        let ended = entry.stages.iter().all(|(_, pid)| start_ticks(*pid).is_none());
        Ok(ended.then_some(()))
    })?;
    let left = shared_memory_of(run)?.len();
    // Started with another registry, so that it does not clear up by itself.
    fs::create_dir_all(bench.path("other"))?;
    let mut orime = bench.program("orime");
    orime.env("XDG_RUNTIME_DIR", bench.path("other"));
    let living = bench.up_by(orime, "living", &endless, &[])?;
    wait_for("states of the living set", || Ok(living.said().contains("\nstep").then_some(())))?;
    let report = bench.run("orime", &["doctor"])?;
    let text = said(&report);
    ensure!(report.status.code() == Some(1) && text.contains(&entry.run), "doctor: {text}");
    ensure!(shared_memory_of(run)?.len() == left, "doctor changes nothing");
    let start_ns = now_ns();
    let clean = bench.run("orime", &["clean"])?;
    ensure!(clean.status.success() && said(&clean).contains(&entry.run), "{}", said(&clean));
    let ms = ms_since(start_ns, now_ns());
    ensure!(shared_memory_of(run)?.is_empty(), "clean removes what is dead");
    let events = fs::read_to_string(living.out("events.jsonl")).unwrap_or_default();
    ensure!(events.is_empty(), "the living set is not touched: {events}");
    let lines = living.said().lines().count();
    wait_for("more of its states", || Ok((living.said().lines().count() > lines).then_some(())))?;
    Ok(Seen {
        recovery_ms: ms,
        frames_lost: Some(0),
        what: format!(
            "doctor named the run, clean removed its {left} objects, a living set ran on"
        ),
    })
}

/// Row 8.
pub fn small_memory(bench: &Bench) -> anyhow::Result<Seen> {
    let set = bench.rendered("realtime", "")?;
    let script = "mount -t tmpfs -o size=8m tmpfs /dev/shm && exec \"$PROGRAMS/orime\" \"$@\"";
    let mut command = bench.in_own_mounts(script)?;
    command.arg("sh");
    let start = Instant::now();
    let mut set = bench.up_by(command, "set", &set, &[])?;
    let (code, _) = set.wait()?;
    let said = set.said();
    ensure!(code == 3 && said.contains("this set needs"), "{code}: {said}");
    let need = said.split("needs ").nth(1).and_then(|rest| rest.split(',').next()).unwrap_or("?");
    Ok(Seen {
        recovery_ms: start.elapsed().as_secs_f64() * 1e3,
        frames_lost: None,
        what: format!("refused: needs {need}, 8 MiB are there; nothing was started"),
    })
}

/// Row 13.
pub fn other_user(bench: &Bench) -> anyhow::Result<Seen> {
    if !rustix::process::getuid().is_root() {
        bail!(Skipped("only root can be another user".to_owned()));
    }
    let mut set = bench.up("set", &bench.rendered("realtime", "fps = 15\nrepeat = true")?, &[])?;
    let entry = set.running()?;
    let start = Instant::now();
    let output = bench
        .program("orime-probe")
        .args(["--once", "--run", &entry.run])
        .env_remove("XDG_RUNTIME_DIR")
        .current_dir("/")
        .uid(NOBODY)
        .gid(NOBODY)
        .output()
        .context("running orime-probe as nobody")?;
    let text = said(&output);
    let ms = start.elapsed().as_secs_f64() * 1e3;
    ensure!(output.status.code() == Some(1), "{:?}: {text}", output.status);
    ensure!(text.contains("belongs to user root"), "the owner is named: {text}");
    let summary = set.stop()?;
    ensure!(summary["restarts"].as_array().is_some_and(Vec::is_empty), "{summary}");
    Ok(Seen { recovery_ms: ms, frames_lost: Some(0), what: text.trim().to_owned() })
}

/// Row 14.
pub fn mismatch(bench: &Bench) -> anyhow::Result<Seen> {
    let programs = bench.other_programs()?;
    let program = programs.join("orime-segment");
    let mut bytes = fs::read(&program)?;
    // Another version: another hash of its layouts, wherever the program holds it.
    let other = match PROTOCOL.strip_suffix('0') {
        Some(most) => format!("{most}1"),
        None => format!("{}0", &PROTOCOL[..PROTOCOL.len() - 1]),
    };
    let (from, to) = (PROTOCOL.as_bytes(), other.as_bytes());
    let places: Vec<usize> = bytes
        .windows(from.len())
        .enumerate()
        .filter_map(|(k, window)| (window == from).then_some(k))
        .collect();
    ensure!(!places.is_empty(), "the program holds its protocol");
    for place in places {
        bytes[place..place + to.len()].copy_from_slice(to);
    }
    let permissions = fs::metadata(&program)?.permissions();
    fs::remove_file(&program)?;
    fs::write(&program, bytes)?;
    fs::set_permissions(&program, permissions)?;
    let set = bench.rendered("realtime", "")?;
    let orime = bench.program_in(&programs, "orime");
    let start = Instant::now();
    let mut set = bench.up_by(orime, "set", &set, &["--no-judge"])?;
    let (code, _) = set.wait()?;
    let said = set.said();
    ensure!(code == 1 && said.contains(PROTOCOL) && said.contains(&other), "{code}: {said}");
    Ok(Seen {
        recovery_ms: start.elapsed().as_secs_f64() * 1e3,
        frames_lost: None,
        what: format!("segment refused: it speaks {other}, the set {PROTOCOL}"),
    })
}
