//! Rows 1 to 6: cameras, stages and the supervisor itself.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use orime_runtime::{Guest, RunId, Stop, channel, now_ns, shared_memory_of};
use rustix::process::Signal;
use serde_json::Value;

use super::Seen;
use super::driver::{Bench, ms_since, signal, wait_for};

/// Coasting, as register says it in states.
const COASTING: u32 = 2;

/// One camera, a white sheet of 0.1 m at 0.5 m on black: a folder that can be taken away.
fn folder(bench: &Bench) -> anyhow::Result<std::path::PathBuf> {
    const SIZE: [u32; 2] = [320, 240];
    let images = bench.path("images");
    fs::create_dir_all(&images)?;
    let inside = |x: u32, y: u32| (100..220).contains(&x) && (60..180).contains(&y);
    let pixels = || (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y)));
    let write = |name: &str, color, depth, data: &[u8]| -> anyhow::Result<()> {
        let mut encoder = png::Encoder::new(fs::File::create(images.join(name))?, SIZE[0], SIZE[1]);
        encoder.set_color(color);
        encoder.set_depth(depth);
        Ok(encoder.write_header()?.write_image_data(data)?)
    };
    let rgb: Vec<u8> =
        pixels().flat_map(|(x, y)| if inside(x, y) { [235; 3] } else { [20, 24, 30] }).collect();
    let mm: Vec<u8> =
        pixels().flat_map(|(x, y)| u16::to_be_bytes(500 + 30 * u16::from(!inside(x, y)))).collect();
    for frame in 0..8 {
        let (eight, sixteen) = (png::BitDepth::Eight, png::BitDepth::Sixteen);
        write(&format!("color_{frame}.png"), png::ColorType::Rgb, eight, &rgb)?;
        write(&format!("depth_{frame}.png"), png::ColorType::Grayscale, sixteen, &mm)?;
    }
    let layout = "rate_hz = 15.0\nframes = { first = 0, last = 7 }\n[[camera]]\nname = \"one\"\n\
         color = \"images/color_{frame}.png\"\ndepth = \"images/depth_{frame}.png\"\n\
         depth_m_per_unit = 0.001\n[camera.color_lens]\nsize_px = [320, 240]\nfx_px = 600\n\
         fy_px = 600\ncx_px = 159.5\ncy_px = 119.5\n";
    bench.write("layout.toml", layout)?;
    bench.write(
        "folder.toml",
        "pace = \"realtime\"\n[sheet]\nsize_m = [0.1, 0.1]\n[capture]\nsource = \"folder\"\n\
         fps = 15\nrepeat = true\n[capture.folder]\nlayout = \"layout.toml\"\n",
    )
}

/// Row 1.
pub fn camera_unplugged(bench: &Bench) -> anyhow::Result<Seen> {
    let mut set = bench.up("set", &folder(bench)?, &[])?;
    let entry = set.running()?;
    let capture = set.stage_pid("capture")?;
    let guest = Guest::attach_to(&entry, Stop::new())?;
    let mut states = guest.subscribe(&channel::STATE)?;
    let tracking = |states: &mut orime_runtime::Subscription<_>, wanted: u32| {
        wait_for(&format!("tracking {wanted}"), || {
            let state: Option<orime_runtime::Received<orime_messages::SheetState>> =
                states.try_newest()?;
            Ok(state.filter(|state| state.figures.tracking == wanted).map(|_| ()))
        })
    };
    let (here, away) = (bench.path("images"), bench.path("unplugged"));
    fs::rename(&here, &away)?;
    set.await_event("degraded", "capture", 0)?;
    tracking(&mut states, COASTING)?;
    // It stays away for a while: a blink would not show that the set lives on without it.
    std::thread::sleep(Duration::from_millis(500));
    let plugged_ns = now_ns();
    fs::rename(&away, &here)?;
    let restored_ns = set.await_event("restored", "capture", 0)?;
    tracking(&mut states, 1)?;
    ensure!(set.stage_pid("capture")? == capture, "capture lives");
    drop((states, guest));
    let summary = set.stop()?;
    let lost = summary["drops"]["capture"]["rejected"].as_u64();
    ensure!(lost.is_some_and(|lost| lost > 0), "missing frames are counted: {}", summary["drops"]);
    Ok(Seen {
        recovery_ms: ms_since(plugged_ns, restored_ns),
        frames_lost: lost,
        what: "DEGRADED, states coast, restored; capture is the same process".to_owned(),
    })
}

/// Row 2.
pub fn slow_subscriber(bench: &Bench) -> anyhow::Result<Seen> {
    let endless = bench.rendered("realtime", "fps = 15\nrepeat = true")?;
    let mut set = bench.up("realtime", &endless, &[])?;
    let entry = set.running()?;
    let guest = Guest::attach_to(&entry, Stop::new())?;
    let mut states = guest.subscribe(&channel::STATE)?;
    let mut sequences: Vec<u64> = Vec::new();
    while sequences.len() < 6 {
        let state = states.newest()?.context("a state")?;
        sequences.push(state.header.sequence);
        drop(state);
        // This is the fault: six frames come while it does something else.
        std::thread::sleep(Duration::from_millis(400));
    }
    let ascend = sequences.windows(2).all(|pair| pair[0] < pair[1]);
    ensure!(ascend, "newest wins: {sequences:?}");
    let lost = states.drops().total();
    // Of what was published: what earlier stages had to drop on a busy machine is not in it.
    let published = sequences.last().unwrap_or(&0) - sequences[0] + 1;
    ensure!(lost > 0 && lost + 6 >= published, "{lost} counted of {published} states, 6 seen");
    drop((states, guest));
    set.stop()?;

    let mut hashes = Vec::new();
    let mut paused_ms = 0.0;
    for name in ["alone", "paused"] {
        let lockstep = bench.rendered("lockstep", "")?;
        let mut set = bench.up(name, &lockstep, &[])?;
        if name == "paused" {
            let register = set.stage_pid("register")?;
            let paused_ns = now_ns();
            signal(register, Signal::STOP)?;
            // This is the fault.
            std::thread::sleep(Duration::from_millis(1500));
            signal(register, Signal::CONT)?;
            paused_ms = ms_since(paused_ns, now_ns());
        }
        let (code, summary) = set.wait()?;
        ensure!(code == 0 && summary["drops_total"] == 0, "{name}: {code}, {}", summary["drops"]);
        ensure!(summary["steps"] == 40, "{name}: {} steps", summary["steps"]);
        hashes.push(summary["judge"]["states_hash"].clone());
    }
    ensure!(hashes[0] == hashes[1] && !hashes[0].is_null(), "the same states: {hashes:?}");
    Ok(Seen {
        recovery_ms: 0.0,
        frames_lost: Some(0),
        what: format!(
            "realtime: {lost} of {published} states given up and counted; lockstep: 0 lost, the \
             same states after {paused_ms:.0} ms of pause"
        ),
    })
}

/// Row 3.
pub fn killed_mid_loan(bench: &Bench) -> anyhow::Result<Seen> {
    // Capture renders most of the time, into a loan; segment works on frames that it holds.
    let busy = bench.rendered("realtime", "fps = 40\nrepeat = true")?;
    let mut set = bench.up("set", &busy, &[])?;
    let run: RunId = set.running()?.run_id().context("a run")?;
    let before = shared_memory_of(run)?.len();
    let mut slowest_ms: f64 = 0.0;
    for stage in ["capture", "segment"] {
        slowest_ms = slowest_ms.max(set.kill_and_recover(stage)?);
    }
    let settled = wait_for("memory given back", || {
        let after = shared_memory_of(run)?.len();
        Ok((after <= before).then_some(after))
    })?;
    let summary = set.stop()?;
    Ok(Seen {
        recovery_ms: slowest_ms,
        frames_lost: lost_by_restart(&summary),
        what: format!("capture and segment killed; {settled} objects after, {before} before"),
    })
}

fn lost_by_restart(summary: &Value) -> Option<u64> {
    let drops = summary["drops"].as_object()?;
    Some(drops.values().filter_map(|causes| causes["restart"].as_u64()).sum())
}

/// Row 4.
pub fn single_restarts(bench: &Bench) -> anyhow::Result<Seen> {
    let mut slowest_ms: f64 = 0.0;
    let mut lost = 0;
    for pace in ["realtime", "lockstep"] {
        let set = bench.rendered(pace, "fps = 15\nrepeat = true")?;
        let mut set = bench.up(pace, &set, &[])?;
        set.running()?;
        for stage in ["segment", "register", "simulate", "capture"] {
            let before = set.entry(5)?.stages;
            let ms = set.kill_and_recover(stage)?;
            slowest_ms = slowest_ms.max(ms);
            let after = set.entry(5)?.stages;
            for (name, pid) in &before {
                let same = after.contains(&(name.clone(), *pid));
                ensure!(same != (name == stage), "{stage} killed: {before:?}, {after:?}");
            }
        }
        signal(set.pid(), Signal::TERM)?;
        let (code, summary) = set.wait()?;
        let good = if pace == "lockstep" { 6 } else { 0 };
        ensure!(code == good, "{pace}: ended with {code}: {}", set.said());
        ensure!(summary["restarts"].as_array().is_some_and(|list| list.len() == 4), "{summary}");
        lost += lost_by_restart(&summary).unwrap_or(0);
    }
    Ok(Seen {
        recovery_ms: slowest_ms,
        frames_lost: Some(lost),
        what: "each of four stages at both paces; the others are the same processes; lockstep \
               says by its status that states differ"
            .to_owned(),
    })
}

/// Row 5.
pub fn hangs_at_start(bench: &Bench) -> anyhow::Result<Seen> {
    let programs = bench.other_programs()?;
    replace_by_script(&programs.join("orime-segment"), "#!/bin/sh\nexec sleep 600\n")?;
    let set = bench.rendered("realtime", "")?;
    let start = Instant::now();
    let orime = bench.program_in(&programs, "orime");
    let mut set = bench.up_by(orime, "set", &set, &["--ready-s", "4", "--no-judge"])?;
    let (code, _) = set.wait()?;
    let (said, seconds) = (set.said(), start.elapsed().as_secs_f64());
    ensure!(code == 1 && said.contains("stage `segment`: did not get ready"), "{code}: {said}");
    Ok(Seen {
        recovery_ms: seconds * 1e3,
        frames_lost: None,
        what: "refused after --ready-s 4, segment named".to_owned(),
    })
}

fn replace_by_script(program: &Path, script: &str) -> anyhow::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    fs::remove_file(program)?;
    fs::write(program, script)?;
    Ok(fs::set_permissions(program, fs::Permissions::from_mode(0o755))?)
}

/// Row 6.
pub fn supervisor_killed(bench: &Bench) -> anyhow::Result<Seen> {
    let endless = bench.rendered("realtime", "fps = 15\nrepeat = true")?;
    let mut set = bench.up("first", &endless, &[])?;
    let entry = set.running()?;
    let run = entry.run_id().context("a run")?;
    let killed_ns = now_ns();
    signal(set.pid(), Signal::KILL)?;
    set.wait()?;
    let alive = |pid: u32| orime_runtime::start_ticks(pid).is_some();
    wait_for("the end of all children", || {
        Ok((!entry.stages.iter().any(|(_, pid)| alive(*pid))).then_some(()))
    })?;
    let ms = ms_since(killed_ns, now_ns());
    let left = shared_memory_of(run)?.len();
    ensure!(left > 0, "a killed supervisor cleans nothing: what would the next one clear?");
    let mut next = bench.up("next", &endless, &[])?;
    next.running()?;
    ensure!(shared_memory_of(run)?.is_empty(), "the next start clears: {}", next.said());
    ensure!(next.said().contains(&entry.run), "and says so: {}", next.said());
    next.stop()?;
    Ok(Seen {
        recovery_ms: ms,
        frames_lost: None,
        what: format!("children gone; the next start cleared {left} objects and said so"),
    })
}
