//! Rows 9 to 12: set files, clocks, recordings, disks.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, bail, ensure};
use orime_runtime::now_ns;

use super::driver::{Bench, ms_since, said};
use super::{Seen, Skipped};

/// Row 9.
pub fn wrong_config(bench: &Bench) -> anyhow::Result<Seen> {
    let text = "pace = \"slow\"\n[sheet]\nsize_m = [210, 297]\n[segment]\nvoxel_mm = 3\n\
                [simulate]\nsubsteps = 0\n";
    let set = bench.write("bad.toml", text)?;
    let start = Instant::now();
    let output = bench.run("orime", &["up", &set.to_string_lossy()])?;
    let (text, ms) = (said(&output), start.elapsed().as_secs_f64() * 1e3);
    ensure!(output.status.code() == Some(2), "{:?}: {text}", output.status);
    for word in [":1:8", ":3:1", ":5:1", ":7:1", "4 problem(s), nothing was started"] {
        ensure!(text.contains(word), "`{word}` is not said: {text}");
    }
    ensure!(bench.ps()?.is_empty(), "nothing runs");
    Ok(Seen {
        recovery_ms: ms,
        frames_lost: None,
        what: "4 problems, each with line and column; nothing was started".to_owned(),
    })
}

/// What moves a process' wall clock by an hour from the moment that a file exists.
const SHIM: &str = r#"#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>
int clock_gettime(clockid_t clock, struct timespec *time) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int result = real(clock, time);
    const char *path = getenv("ORIME_FAULTS_STEP");
    if (clock == CLOCK_REALTIME && path && access(path, F_OK) == 0) time->tv_sec += 3600;
    return result;
}
"#;

/// Row 10: the wall clock of all processes of a set jumps by an hour.
pub fn clock_step(bench: &Bench) -> anyhow::Result<Seen> {
    let (source, shim) = (bench.write("shim.c", SHIM)?, bench.path("shim.so"));
    let compiled = Command::new("cc")
        .args(["-shared", "-fPIC", "-o"])
        .args([shim.as_path(), source.as_path(), Path::new("-ldl")])
        .output();
    if !compiled.is_ok_and(|output| output.status.success()) {
        bail!(Skipped("no C compiler makes what would step the clock".to_owned()));
    }
    let marker = bench.path("stepped");
    let mut orime = bench.program("orime");
    orime.env("LD_PRELOAD", &shim).env("ORIME_FAULTS_STEP", &marker);
    let endless = bench.rendered("realtime", "fps = 15\nrepeat = true")?;
    let mut set = bench.up_by(orime, "set", &endless, &[])?;
    set.running()?;
    let stepped_ns = now_ns();
    fs::write(&marker, b"")?;
    let event_ns = set.await_event("clock_step", "", 0)?;
    // States go on for a while, and their latencies know nothing of the hour.
    std::thread::sleep(std::time::Duration::from_secs(1));
    let summary = set.stop()?;
    let max_us = summary["report"]["end_to_end_us"]["max"].as_f64().context("a latency")?;
    ensure!(max_us < 600e6, "an hour is in the latencies: {max_us} µs");
    ensure!(summary["restarts"].as_array().is_some_and(Vec::is_empty), "{summary}");
    let detail = set.events("clock_step", "")[0]["detail"].to_string();
    ensure!(detail.contains("3600") || detail.contains("3599"), "{detail}");
    Ok(Seen {
        recovery_ms: ms_since(stepped_ns, event_ns),
        frames_lost: Some(0),
        what: format!("{detail}; the largest latency is {:.0} ms", max_us / 1e3),
    })
}

/// Row 11.
pub fn damaged_recording(bench: &Bench) -> anyhow::Result<Seen> {
    let (lockstep, file) = (bench.rendered("lockstep", "")?, bench.path("fold.mcap"));
    let record = ["--record", &file.to_string_lossy()];
    let (code, summary) = bench.up("record", &lockstep, &record)?.wait()?;
    ensure!(code == 0 && summary["recording"]["complete"] == true, "{code}: {summary}");
    let whole = fs::OpenOptions::new().write(true).open(&file)?;
    whole.set_len(whole.metadata()?.len() / 2)?;
    let replay = |name: &str, more: &str| {
        let text = format!(
            "[capture]\nsource = \"recording\"\n[capture.recording]\nfile = \"fold.mcap\"\n{more}"
        );
        bench.write(name, &text)
    };
    let start = Instant::now();
    let mut refused = bench.up("refused", &replay("refused.toml", "")?, &[])?;
    let (code, _) = refused.wait()?;
    let (text, ms) = (refused.said(), start.elapsed().as_secs_f64() * 1e3);
    ensure!(code == 5 && text.contains("damaged = true"), "{code}: {text}");
    let mut played = bench.up("played", &replay("played.toml", "damaged = true\n")?, &[])?;
    let (code, summary) = played.wait()?;
    let steps = summary["steps"].as_u64().unwrap_or(0);
    ensure!(code == 0 && 0 < steps && steps < 40, "{code}: {steps} steps; {}", played.said());
    Ok(Seen {
        recovery_ms: ms,
        // Three cameras.
        frames_lost: Some((40 - steps) * 3),
        what: format!("half the file: status 5 and the loss named; {steps} of 40 steps play"),
    })
}

/// Row 12.
pub fn disk_full(bench: &Bench) -> anyhow::Result<Seen> {
    let full = bench.path("full");
    fs::create_dir_all(&full)?;
    let script = "mount -t tmpfs -o size=4m tmpfs \"$FULL\" && exec \"$PROGRAMS/orime\" \"$@\"";
    let mut command = bench.in_own_mounts(script)?;
    command.env("FULL", &full).arg("sh");
    let file = full.join("fold.mcap");
    let start = Instant::now();
    let lockstep = bench.rendered("lockstep", "")?;
    let arguments = ["--record", &file.to_string_lossy()];
    let mut set = bench.up_by(command, "set", &lockstep, &arguments)?;
    let (code, summary) = set.wait()?;
    ensure!(code == 0 && summary["steps"] == 40, "{code}: {}", set.said());
    let recording = &summary["recording"];
    let why = recording["incomplete_because"].as_str().unwrap_or_default().to_owned();
    ensure!(recording["complete"] == false && why.contains("No space left"), "{recording}");
    let recorded = recording["recorded"]["frames"].as_u64().unwrap_or(0);
    Ok(Seen {
        recovery_ms: start.elapsed().as_secs_f64() * 1e3,
        frames_lost: Some(0),
        what: format!("40 of 40 steps tracked, {recorded} frames recorded, then: {why}"),
    })
}
