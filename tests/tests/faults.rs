//! What goes wrong, and what users must see. Real processes, really killed.

use orime_tests::{RunningSet, Scratch, program, run};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

fn signal(pid: u64, signal: Signal) {
    kill_process(Pid::from_raw(pid as i32).unwrap(), signal).unwrap();
}

/// A set that never ends.
fn endless(scratch: &Scratch) -> String {
    let path = scratch.path("endless.toml");
    fs::write(&path, "[capture]\nsource = \"rendered\"\nrepeat = true\n").unwrap();
    path
}

fn stage_pid(run: &Value, stage: &str) -> u64 {
    let stages = run["stages"].as_array().unwrap();
    let found = stages.iter().find(|pair| pair[0] == stage);
    found.unwrap_or_else(|| panic!("no {stage} in {run}"))[1].as_u64().unwrap()
}

fn has_all_stages(run: &Value) -> bool {
    run["stages"].as_array().is_some_and(|stages| stages.len() == 5)
}

fn assert_gone(run: &Value) {
    let left = RunningSet::shared_memory(run["run"].as_str().unwrap());
    assert!(left.is_empty(), "left in shared memory: {left:?}");
    for pair in run["stages"].as_array().unwrap() {
        let process = format!("/proc/{}", pair[1]);
        assert!(!Path::new(&process).exists(), "{} still runs", pair[0]);
    }
}

#[test]
fn ctrl_c_ends_in_order_with_a_summary() {
    let scratch = Scratch::new("ctrl-c");
    let mut set = RunningSet::start("ctrl-c-set", Some(&endless(&scratch)));
    let run = set.wait_until(has_all_stages);
    set.wait_for_pictures();
    signal(set.pid().into(), Signal::INT);
    let ended = set.wait();
    assert_eq!(ended.code, 0, "{}{}", ended.stdout, ended.stderr);
    assert!(ended.stdout.contains("stopped after"), "{}", ended.stdout);
    let judged = fs::read_to_string(set.out("summary.json")).unwrap();
    let judged: Value = serde_json::from_str(&judged).unwrap();
    assert!(judged["steps"].as_u64().unwrap() > 0, "what was tracked is not lost");
    assert_gone(&run);
}

#[test]
fn a_killed_stage_ends_a_set_without_budget_and_is_named() {
    let scratch = Scratch::new("killed");
    for stage in ["register", "capture", "judge"] {
        let no_restart = ["--restarts", "0"];
        let set = endless(&scratch);
        let mut set = RunningSet::start_with("killed-set", Some(&set), &no_restart);
        let run = set.wait_until(has_all_stages);
        set.wait_for_pictures();
        signal(stage_pid(&run, stage), Signal::KILL);
        let ended = set.wait();
        assert_eq!(ended.code, 1, "{}{}", ended.stdout, ended.stderr);
        assert!(ended.stderr.contains(stage), "{stage} is not named: {}", ended.stderr);
        assert_gone(&run);
    }
}

#[test]
fn a_killed_supervisor_leaves_no_children_and_its_memory_is_cleared_at_the_next_start() {
    let scratch = Scratch::new("orphans");
    let endless = endless(&scratch);
    let mut set = RunningSet::start("orphans-set", Some(&endless));
    let run = set.wait_until(has_all_stages);
    set.wait_for_pictures();
    signal(set.pid().into(), Signal::KILL);
    assert_eq!(set.wait().code, -1);
    let start = Instant::now();
    let alive = |pair: &Value| Path::new(&format!("/proc/{}", pair[1])).exists();
    while run["stages"].as_array().unwrap().iter().any(alive) {
        assert!(start.elapsed() < Duration::from_secs(20), "children outlive their supervisor");
        std::thread::sleep(Duration::from_millis(50));
    }
    // The next supervisor of the same user clears up; any set will do, even one that is stopped.
    let arguments = ["up", &endless, "--out", &scratch.path("next")];
    let mut next = Command::new(program("orime"))
        .args(arguments)
        .env("XDG_RUNTIME_DIR", set.out("../runs"))
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while !RunningSet::shared_memory(run["run"].as_str().unwrap()).is_empty() {
        assert!(start.elapsed() < Duration::from_secs(30), "the dead run's memory stays");
        std::thread::sleep(Duration::from_millis(50));
    }
    while !Path::new(&scratch.path("next/pictures/step_0000.png")).exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "the next set does not start");
        std::thread::sleep(Duration::from_millis(50));
    }
    signal(next.id().into(), Signal::TERM);
    assert!(next.wait().unwrap().success());
}

#[test]
fn the_probe_sees_every_hop_of_a_running_set_and_leaves_no_trace() {
    let scratch = Scratch::new("probe");
    let mut set = RunningSet::start("probe-set", Some(&endless(&scratch)));
    let run = set.wait_until(has_all_stages);
    set.wait_for_pictures();
    let before = RunningSet::shared_memory(run["run"].as_str().unwrap()).len();
    let look = || -> Value {
        let output = set.beside("orime-probe", &["--once", "--json", "--bench", "--seconds", "3"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    // The live frames' transport beside UDP with frames of the same size, in one run. Other work
    // on the cores only ever adds to either, so that the best of a few looks counts.
    let ratio = |report: &Value| report["frame_transport_over_udp_p50"].as_f64().unwrap();
    let mut report = look();
    for _ in 0..3 {
        if ratio(&report) < 0.5 {
            break;
        }
        report = look();
    }
    assert!(ratio(&report) < 0.5, "frames take {} of UDP's time", ratio(&report));
    for hop in ["capture_to_segment", "segment_to_register", "register_to_simulate"] {
        for part in ["transport_us", "queue_us", "compute_us"] {
            let count = report["hops"][hop][part]["count"].as_u64();
            assert!(count.is_some_and(|count| count > 0), "{hop} {part}: {report}");
        }
    }
    assert!(report["end_to_end_us"]["p50"].as_f64().is_some_and(|us| us > 0.0));
    assert_eq!((&report["frame_copies"], &report["drops_total"]), (&0.into(), &0.into()));
    // Publishers give up what connected them to the probe when they send next.
    let start = Instant::now();
    loop {
        let after = RunningSet::shared_memory(run["run"].as_str().unwrap()).len();
        if after <= before {
            break;
        }
        assert!(start.elapsed() < Duration::from_secs(20), "it left {} objects", after - before);
        std::thread::sleep(Duration::from_millis(100));
    }
    let ended = set.beside("orime", &["down"]);
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    assert_eq!(set.wait().code, 0);
    assert_gone(&run);
}

#[test]
fn wrong_words_are_answered_before_anything_starts() {
    let scratch = Scratch::new("words");
    let runs = scratch.path("runs");
    let check = |arguments: &[&str], code: i32, words: &[&str]| {
        let output = Command::new(program(arguments[0]))
            .args(&arguments[1..])
            .env("XDG_RUNTIME_DIR", &runs)
            .output()
            .unwrap();
        let text = [output.stdout, output.stderr].concat();
        let text = String::from_utf8_lossy(&text);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {text}");
        for word in words {
            assert!(text.contains(word), "{arguments:?} does not say `{word}`: {text}");
        }
    };
    fs::create_dir_all(&runs).unwrap();
    let bad = scratch.path("bad.toml");
    let text = "pace = \"slow\"\n[sheet]\nsize_m = [210, 297]\n[segment]\nvoxel_mm = 3\n\
                [simulate]\nsubsteps = 0\n";
    fs::write(&bad, text).unwrap();
    let problems =
        ["bad.toml:1:8", "bad.toml:3:1", "millimetres", "bad.toml:5:1", "bad.toml:7:1", "4 prob"];
    check(&["orime", "check", &bad], 2, &problems);
    check(&["orime", "up", &bad], 2, &problems);
    check(&["orime", "up", "nowhere.toml"], 2, &["nowhere.toml", "No such file"]);
    check(&["orime", "--nonsense"], 2, &["--nonsense"]);
    check(&["orime", "ps"], 0, &[]);
    check(&["orime", "down"], 2, &["no"]);
    check(&["orime-probe", "--once"], 1, &["no set runs"]);
    check(&["orime-evaluate", "track", "nowhere.toml"], 2, &["nowhere.toml"]);
    check(&["orime-segment"], 1, &["orime up"]);
}

/// One camera, a white sheet of 0.1 m at 0.5 m on black; `frames` frames as PNG.
fn recording(scratch: &Scratch, frames: usize) -> String {
    const SIZE: [u32; 2] = [320, 240];
    let inside = |x: u32, y: u32| (100..220).contains(&x) && (60..180).contains(&y);
    let pixels = || (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y)));
    let write = |name: String, color, depth, data: &[u8]| {
        let file = fs::File::create(scratch.path(&name)).unwrap();
        let mut encoder = png::Encoder::new(file, SIZE[0], SIZE[1]);
        encoder.set_color(color);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(data).unwrap();
    };
    let rgb: Vec<u8> =
        pixels().flat_map(|(x, y)| if inside(x, y) { [235; 3] } else { [20, 24, 30] }).collect();
    let mm: Vec<u8> =
        pixels().flat_map(|(x, y)| u16::to_be_bytes(500 + 30 * u16::from(!inside(x, y)))).collect();
    for frame in 0..frames {
        let (eight, sixteen) = (png::BitDepth::Eight, png::BitDepth::Sixteen);
        write(format!("color_{frame}.png"), png::ColorType::Rgb, eight, &rgb);
        write(format!("depth_{frame}.png"), png::ColorType::Grayscale, sixteen, &mm);
    }
    let layout = format!(
        "rate_hz = 30.0\nframes = {{ first = 0, last = {} }}\n[[camera]]\nname = \"one\"\n\
         color = \"color_{{frame}}.png\"\ndepth = \"depth_{{frame}}.png\"\n\
         depth_m_per_unit = 0.001\n[camera.color_lens]\nsize_px = [320, 240]\nfx_px = 600\n\
         fy_px = 600\ncx_px = 159.5\ncy_px = 119.5\n",
        frames - 1
    );
    fs::write(scratch.path("layout.toml"), layout).unwrap();
    let set = scratch.path("set.toml");
    let text = "[sheet]\nsize_m = [0.1, 0.1]\n[capture]\nsource = \"folder\"\n\
                [capture.folder]\nlayout = \"layout.toml\"\n";
    fs::write(&set, text).unwrap();
    set
}

#[test]
fn damaged_frames_are_named_counted_and_survived() {
    let scratch = Scratch::new("damaged");
    let set = recording(&scratch, 8);
    let cut = fs::read(scratch.path("color_2.png")).unwrap();
    fs::write(scratch.path("color_2.png"), &cut[..cut.len() / 2]).unwrap();
    fs::remove_file(scratch.path("depth_4.png")).unwrap();
    let small = fs::File::create(scratch.path("color_5.png")).unwrap();
    png::Encoder::new(small, 4, 4).write_header().unwrap().write_image_data(&[9; 16]).unwrap();

    let mut running = RunningSet::start("damaged-set", Some(&set));
    let ended = running.wait();
    assert_eq!(ended.code, 0, "{}{}", ended.stdout, ended.stderr);
    let figures = fs::read_to_string(running.out("summary.json")).unwrap();
    let figures: Value = serde_json::from_str(&figures).unwrap();
    let tracking: Vec<&str> = figures["per_step"]
        .as_array()
        .unwrap()
        .iter()
        .map(|step| step["tracking"].as_str().unwrap())
        .collect();
    let (t, c) = ("tracking", "coasting");
    assert_eq!(tracking, [t, t, c, t, c, c, t, t]);
    let report: Value =
        serde_json::from_str(&fs::read_to_string(running.out("run.json")).unwrap()).unwrap();
    assert_eq!(report["drops"]["capture"]["rejected"], 3, "{report}");
    let log = fs::read_to_string(running.out("logs/capture.log")).unwrap();
    for name in ["color_2.png", "depth_4.png", "color_5.png"] {
        assert!(log.contains(name), "capture's log does not name {name}: {log}");
    }
}

#[test]
fn a_camera_without_calibration_is_refused_at_the_check() {
    let scratch = Scratch::new("uncalibrated");
    let set = recording(&scratch, 2);
    let layout = fs::read_to_string(scratch.path("layout.toml")).unwrap();
    fs::write(scratch.path("layout.toml"), layout.replace("fx_px = 600\n", "")).unwrap();
    let output = run("orime", &["check", &set]);
    let text = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("layout.toml") && text.contains("fx_px"), "{text}");
}
