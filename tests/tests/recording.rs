//! Recording a set, playing what was recorded, and what goes wrong with either.

use orime_messages::{Grippers, Message, Stage};
use orime_runtime::{Guest, RunEntry, Stop, channel};
use orime_tests::{Ended, RunningSet, Scratch, run, wait_for};
use rustix::process::{Pid, Resource, Rlimit, Signal, kill_process, prlimit};
use serde_json::Value;
use std::fs;
use std::process::Output;
use std::time::{Duration, Instant};

/// A set that plays `file`, which lies beside it.
fn replay(scratch: &Scratch, file: &str, more: &str) -> String {
    let set = scratch.path(&format!("replay_{file}.toml"));
    let text = format!(
        "[sheet]\nsize_m = [0.15, 0.15]\nnodes = [25, 25]\n\n[capture]\nsource = \"recording\"\n\n\
         [capture.recording]\nfile = \"{file}\"\n{more}"
    );
    fs::write(&set, text).unwrap();
    set
}

/// A rendered set that never ends.
fn endless(scratch: &Scratch, head: &str, rendered: &str) -> String {
    let path = scratch.path("endless.toml");
    let text = format!(
        "{head}[capture]\nsource = \"rendered\"\nrepeat = true\nfps = 20\n[capture.rendered]\n\
         {rendered}"
    );
    fs::write(&path, text).unwrap();
    path
}

fn json(path: std::path::PathBuf) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn finished(set: &mut RunningSet) -> Ended {
    let ended = set.wait();
    assert_eq!(ended.code, 0, "{}{}", ended.stdout, ended.stderr);
    let run = json(set.out("run.json"));
    let left = RunningSet::shared_memory(run["run"].as_str().unwrap());
    assert!(left.is_empty(), "left in shared memory: {left:?}");
    ended
}

fn hashes(set: &RunningSet) -> Vec<Value> {
    let judged = json(set.out("summary.json"));
    let steps = judged["per_step"].as_array().unwrap();
    steps.iter().map(|step| step["state_hash"].clone()).collect()
}

fn has_recorder(run: &Value) -> bool {
    run["stages"].as_array().is_some_and(|stages| stages.len() == 6)
}

fn recorder(run: &Value) -> Pid {
    let stages = run["stages"].as_array().unwrap();
    let found = stages.iter().find(|pair| pair[0] == "record").unwrap();
    Pid::from_raw(found[1].as_i64().unwrap() as i32).unwrap()
}

fn stop(set: &RunningSet) {
    kill_process(Pid::from_raw(set.pid() as i32).unwrap(), Signal::TERM).unwrap();
}

/// The newest step on the supervisor's live line.
fn step(set: &RunningSet) -> u64 {
    let text = fs::read_to_string(set.out("../stdout")).unwrap_or_default();
    let last = text.lines().rev().find_map(|line| line.strip_prefix("step "));
    last.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

fn said(output: &Output) -> String {
    let text = [output.stdout.as_slice(), &output.stderr].concat();
    String::from_utf8_lossy(&text).into_owned()
}

#[test]
fn a_recording_plays_to_the_same_states_and_its_valid_prefix_to_their_beginning() {
    let scratch = Scratch::new("record-replay");
    let file = scratch.path("fold.mcap");
    let mut set = RunningSet::start_with("record", None, &["--record", &file]);
    finished(&mut set);
    let report = &json(set.out("run.json"))["recording"];
    assert_eq!(report["complete"], true, "{report}");
    let counts = [("frames", 360), ("clouds", 120), ("states", 120), ("truths", 120)];
    for (kind, count) in counts {
        assert_eq!(report["recorded"][kind], count, "{report}");
        assert_eq!(report["missed"][kind], 0, "{report}");
    }
    let original = json(set.out("summary.json"));

    let mut replayed = RunningSet::start("replay", Some(&replay(&scratch, "fold.mcap", "")));
    finished(&mut replayed);
    let judged = json(replayed.out("summary.json"));
    assert_eq!(judged["states_hash"], original["states_hash"], "bit for bit the same states");
    assert_eq!(judged["vertex_error_mm_mean"], original["vertex_error_mm_mean"], "and truth");

    // Recordings are never overwritten.
    let again = run("orime", &["up", "--record", &file, "--out", &scratch.path("again")]);
    assert_eq!(again.status.code(), Some(2), "{}", said(&again));
    assert!(said(&again).contains("there already"), "{}", said(&again));

    let whole = fs::OpenOptions::new().write(true).open(&file).unwrap();
    whole.set_len(whole.metadata().unwrap().len() / 5).unwrap();
    let refused = replay(&scratch, "fold.mcap", "");
    for arguments in [vec!["check", &refused], vec!["up", &refused, "--out", &file]] {
        let output = run("orime", &arguments);
        let text = said(&output);
        assert_eq!(output.status.code(), Some(5), "{arguments:?}: {text}");
        for word in ["replay_fold.mcap.toml:9:1: ", "bytes are lost", "end is missing", "damaged"] {
            assert!(text.contains(word), "{arguments:?} does not say `{word}`: {text}");
        }
    }
    let accepted = replay(&scratch, "fold.mcap", "damaged = true\n");
    let mut prefix = RunningSet::start("prefix", Some(&accepted));
    finished(&mut prefix);
    let (all, some) = (hashes(&set), hashes(&prefix));
    assert!((10..60).contains(&some.len()), "{} steps are left", some.len());
    // The last step may have lost a camera.
    let whole = some.len() - 1;
    assert_eq!(some[..whole], all[..whole]);
}

#[test]
fn faults_of_a_recording_are_reported_at_its_key() {
    let scratch = Scratch::new("record-faults");
    fs::write(scratch.path("text.mcap"), "not a recording").unwrap();
    for file in ["nowhere.mcap", "text.mcap"] {
        let set = replay(&scratch, file, "");
        let output = run("orime", &["check", &set, "--json"]);
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        let problems: Value = serde_json::from_slice(&output.stdout).unwrap();
        let problem = &problems[0];
        assert_eq!(problem["key"], "capture.recording.file", "{problems}");
        assert_eq!((&problem["line"], &problem["column"]), (&9.into(), &1.into()));
        assert!(problem["message"].as_str().unwrap().contains(file), "{problems}");
    }
}

/// Runs an endless set with a recorder until `harm` has ended the recorder, and some steps more.
fn outlive(test: &str, harm: impl FnOnce(Pid)) -> (Value, Ended) {
    let scratch = Scratch::new(&format!("{test}-file"));
    let file = scratch.path("endless.mcap");
    let endless = endless(&scratch, "", "");
    let mut set = RunningSet::start_with(test, Some(&endless), &["--record", &file]);
    let run = set.wait_until(has_recorder);
    let recorder = recorder(&run);
    wait_for("steps", || step(&set) > 4);
    harm(recorder);
    let process = format!("/proc/{}", recorder.as_raw_nonzero());
    wait_for("the recorder's end", || !std::path::Path::new(&process).exists());
    let before = step(&set);
    wait_for("steps without a recorder", || step(&set) > before + 20);
    stop(&set);
    let ended = finished(&mut set);
    let report = json(set.out("run.json"))["recording"].clone();
    assert_eq!(report["complete"], false, "{report}");
    assert!(ended.stdout.contains("INCOMPLETE"), "{}", ended.stdout);
    // What was written until then plays.
    let prefix = replay(&scratch, "endless.mcap", "damaged = true\n");
    let check = orime_tests::run("orime", &["check", &prefix]);
    assert!(check.status.success(), "{}", said(&check));
    (report, ended)
}

#[test]
fn a_full_disk_ends_the_recording_and_not_the_set() {
    let (report, ended) = outlive("record-full", |recorder| {
        let limit = Rlimit { current: Some(20_000_000), maximum: Some(20_000_000) };
        prlimit(Some(recorder), Resource::Fsize, limit).unwrap();
    });
    let why = report["incomplete_because"].as_str().unwrap();
    assert!(why.contains("writing recording") && why.contains("File too large"), "{why}");
    assert!(report["recorded"]["frames"].as_u64().unwrap() > 0, "{report}");
    assert!(ended.stderr.contains("the recording has stopped, the set goes on"));
}

#[test]
fn a_killed_recorder_does_not_hold_up_a_set_in_lockstep() {
    let (report, _) = outlive("record-killed", |recorder| {
        kill_process(recorder, Signal::KILL).unwrap();
    });
    let why = report["incomplete_because"].as_str().unwrap();
    assert!(why.contains("signal: 9"), "{why}");
}

#[test]
fn guests_record_a_set_in_realtime_and_are_refused_by_one_in_lockstep() {
    let scratch = Scratch::new("record-guest");
    let set = endless(&scratch, "pace = \"realtime\"\n", "");
    let mut set = RunningSet::start("record-guest-set", Some(&set));
    wait_for("steps", || step(&set) > 4);
    let arguments = ["record", "--out", &scratch.path("a.mcap"), "--seconds", "2", "--json"];
    let output = set.beside("orime", &arguments);
    assert!(output.status.success(), "{}", said(&output));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    for kind in ["frames", "clouds", "states", "truths"] {
        assert!(report["recorded"][kind].as_u64().unwrap() > 0, "{kind}: {report}");
    }
    // Gaps are no damage: the file is whole.
    let check = run("orime", &["check", &replay(&scratch, "a.mcap", "")]);
    assert!(check.status.success(), "{}", said(&check));
    stop(&set);
    finished(&mut set);

    let set = endless(&scratch, "", "");
    let mut set = RunningSet::start("record-guest-lockstep", Some(&set));
    wait_for("steps", || step(&set) > 4);
    let refused = set.beside("orime", &["record", "--out", &scratch.path("b.mcap")]);
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert!(said(&refused).contains("orime up SET --record FILE"), "{}", said(&refused));
    assert!(!std::path::Path::new(&scratch.path("b.mcap")).exists());
    stop(&set);
    finished(&mut set);
}

#[test]
fn grippers_are_published_where_the_source_tells_them() {
    let scratch = Scratch::new("grippers");
    let set = endless(&scratch, "pace = \"realtime\"\n", "gripper_poses = true\n");
    let mut set = RunningSet::start("grippers-set", Some(&set));
    let found = set.wait_until(|run| !run["stages"].as_array().unwrap().is_empty());
    wait_for("steps", || step(&set) > 4);
    let entry: RunEntry = serde_json::from_value(found).unwrap();
    let guest = Guest::attach_to(&entry, Stop::new()).unwrap();
    let mut grippers = guest.subscribe::<Grippers>(&channel::GRIPPER).unwrap();
    let mut steps = Vec::new();
    let mut holding = 0;
    while steps.len() < 20 {
        let message = grippers.next().unwrap().unwrap();
        assert_eq!(Message::header(&*message).stage, Stage::Capture as u32);
        steps.push(message.header.step);
        for gripper in message.grippers() {
            let norm: f64 = gripper.world_from_gripper.rotation_ijkw.iter().map(|q| q * q).sum();
            assert!((norm - 1.0).abs() < 1e-9, "{gripper:?}");
            let inside = gripper.grasped_uv_m.iter().all(|x| (-0.01..0.16).contains(x));
            assert!(inside && gripper.is_holding == 1, "{gripper:?}");
            holding += 1;
        }
    }
    assert!(holding > 0, "somebody folds the sheet");
    assert!(steps.windows(2).all(|pair| pair[0] < pair[1]), "{steps:?}");
    drop((grippers, guest));
    stop(&set);
    finished(&mut set);
}

#[test]
fn a_stop_in_the_first_moment_is_heard() {
    for _ in 0..5 {
        let mut set = RunningSet::start("early-stop", None);
        let runs = set.out("../runs/orime");
        let start = Instant::now();
        while fs::read_dir(&runs).map_or(0, Iterator::count) == 0 {
            assert!(start.elapsed() < Duration::from_secs(60), "the run is not registered");
        }
        stop(&set);
        let ended = finished(&mut set);
        assert!(ended.stdout.contains("stopped after 0 steps"), "{}", ended.stdout);
    }
}
