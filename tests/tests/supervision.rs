//! Stages that are restarted, asked for and by themselves; logs; a second supervisor; systemd.

use orime_tests::{RunningSet, Scratch, program, root, wait_for};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::fs;
use std::os::unix::net::UnixDatagram;
use std::process::{Command, Stdio};
use std::time::Duration;

fn set(scratch: &Scratch, pace: &str) -> String {
    let path = scratch.path(&format!("{pace}.toml"));
    let text = format!(
        "pace = \"{pace}\"\n[capture]\nsource = \"rendered\"\nrepeat = true\nfps = 15\n\
         [capture.rendered]\nsize_px = [320, 240]\n"
    );
    fs::write(&path, text).unwrap();
    path
}

fn has_all_stages(run: &Value) -> bool {
    run["stages"].as_array().is_some_and(|stages| stages.len() == 5)
}

fn pid(run: &Value, stage: &str) -> u64 {
    let stages = run["stages"].as_array().unwrap();
    stages.iter().find(|pair| pair[0] == stage).unwrap()[1].as_u64().unwrap()
}

fn signal(pid: u64, signal: Signal) {
    kill_process(Pid::from_raw(pid as i32).unwrap(), signal).unwrap();
}

fn events(set: &RunningSet, kind: &str, stage: &str) -> usize {
    let text = fs::read_to_string(set.out("events.jsonl")).unwrap_or_default();
    let events = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    events.filter(|event| event["event"] == kind && event["stage"] == stage).count()
}

fn run_json(set: &RunningSet) -> Value {
    serde_json::from_str(&fs::read_to_string(set.out("run.json")).unwrap()).unwrap()
}

#[test]
fn another_source_takes_the_place_of_the_first_while_the_other_stages_run_on() {
    let scratch = Scratch::new("source");
    let own = set(&scratch, "realtime");
    let other = |name: &str, from: &str, to: &str| {
        let text = fs::read_to_string(&own).unwrap();
        assert!(text.contains(from));
        let path = scratch.path(name);
        fs::write(&path, text.replace(from, to)).unwrap();
        path
    };
    // Smaller images of another sheet that waves: nothing of the first source fits it.
    let wave = "[capture.rendered]\nsequence = \"wave\"\nsheet_rgb = [60, 110, 220]\nseed = 7\n\
                size_px = [240, 180]";
    let wave = other("wave.toml", "[capture.rendered]\nsize_px = [320, 240]", wave);
    let five = other("five.toml", "size_px", "viewpoints = \"five\"\nsize_px");
    let wide = other("wide.toml", "[capture]", "[sheet]\nnodes = [13, 13]\n[capture]");
    let mut set = RunningSet::start("source-set", Some(&own));
    let before = set.wait_until(has_all_stages);
    set.wait_for_states();
    let refused = |arguments: &[&str], why: &str| {
        let output = set.beside("orime", &[&["restart"], arguments].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && said.contains(why), "{said}");
    };
    refused(&["capture", "--source", &five], "`capture` is 5 cameras");
    refused(&["capture", "--source", &wide], "`sheet` is");
    refused(&["register", "--source", &wave], "`register` has no source");
    refused(&["capture", "--source", "absent.toml"], "absent.toml");
    let output = set.beside("orime", &["restart", "capture", "--source", &wave]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    wait_for("states of the other source", || events(&set, "recovered", "capture") == 1);
    let probe = set.beside("orime-probe", &["--once", "--json", "--seconds", "4"]);
    let seen: Value = serde_json::from_slice(&probe.stdout).unwrap();
    // Two bytes of depth and three of colour for each pixel.
    assert_eq!(seen["frame_bytes"], 240 * 180 * 5, "{seen}");
    assert!(seen["steps"].as_u64() > Some(5), "{seen}");
    let after = set.wait_until(has_all_stages);
    for stage in ["segment", "register", "simulate", "judge"] {
        assert_eq!(pid(&after, stage), pid(&before, stage), "{stage} runs on");
    }
    assert_ne!(pid(&after, "capture"), pid(&before, "capture"));
    // One that dies goes on with the source that it has now, where it was.
    signal(pid(&after, "capture"), Signal::KILL);
    wait_for("capture comes back", || events(&set, "recovered", "capture") == 2);
    let probe = set.beside("orime-probe", &["--once", "--json", "--seconds", "2"]);
    let seen: Value = serde_json::from_slice(&probe.stdout).unwrap();
    assert_eq!(seen["frame_bytes"], 240 * 180 * 5, "{seen}");
    signal(set.pid().into(), Signal::TERM);
    let ended = set.wait();
    assert_eq!(ended.code, 0, "{}{}", ended.stdout, ended.stderr);
    let run = run_json(&set);
    let steps = run["judge"]["per_step"].as_array().unwrap();
    assert_eq!(steps.last().unwrap()["tracking"], "tracking", "the other sheet is found");
}

#[test]
fn orime_restart_hands_over_without_loss_of_the_sheet_or_of_the_budget() {
    let scratch = Scratch::new("handover");
    let no_budget = ["--restarts", "0", "--log-json"];
    let mut set =
        RunningSet::start_with("handover-set", Some(&set(&scratch, "realtime")), &no_budget);
    let before = set.wait_until(has_all_stages);
    set.wait_for_states();
    for (n, stage) in ["register", "capture", "simulate", "segment"].into_iter().enumerate() {
        let output = set.beside("orime", &["restart", stage, "--json"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let said: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_ne!(said["pid"], pid(&before, stage), "{said}");
        wait_for(stage, || events(&set, "recovered", stage) == 1);
        assert_eq!(events(&set, "gave_up", stage), 0, "after {n}");
    }
    let unknown = set.beside("orime", &["restart", "robot"]);
    assert_eq!(unknown.status.code(), Some(2));
    let logs = set.beside("orime", &["logs", "capture", "-n", "100"]);
    let text = String::from_utf8(logs.stdout).unwrap();
    let lines: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|_| panic!("{line}")))
        .collect();
    for line in &lines {
        assert_eq!((&line["run"], &line["stage"]), (&before["run"], &"capture".into()), "{line}");
        assert!(line.get("step").is_some(), "{line}");
    }
    signal(set.pid().into(), Signal::TERM);
    let ended = set.wait();
    assert_eq!(ended.code, 0, "{}{}", ended.stdout, ended.stderr);
    let run = run_json(&set);
    assert_eq!(run["restarts"].as_array().unwrap().len(), 4, "{}", run["restarts"]);
    // On a busy machine the sheet moves far in the time that a process takes to start.
    let last = run["judge"]["per_step"].as_array().and_then(|steps| steps.last().cloned());
    assert_eq!(last.unwrap()["tracking"], "tracking", "the sheet is found again");
}

#[test]
fn a_stage_that_stands_still_is_killed_and_replaced() {
    let scratch = Scratch::new("stalled");
    let soon = ["--stall-s", "2"];
    for pace in ["realtime", "lockstep"] {
        let mut set = RunningSet::start_with("stalled-set", Some(&set(&scratch, pace)), &soon);
        let run = set.wait_until(has_all_stages);
        set.wait_for_states();
        signal(pid(&run, "register"), Signal::STOP);
        wait_for("the hung stage", || events(&set, "hung", "register") == 1);
        wait_for("recovery", || events(&set, "recovered", "register") == 1);
        let after = set.wait_until(has_all_stages);
        assert_ne!(pid(&run, "register"), pid(&after, "register"));
        assert_eq!(pid(&run, "segment"), pid(&after, "segment"), "the others go on");
        signal(set.pid().into(), Signal::TERM);
        let code = if pace == "lockstep" { 6 } else { 0 };
        let ended = set.wait();
        assert_eq!(ended.code, code, "{}{}", ended.stdout, ended.stderr);
    }
}

#[test]
fn the_budget_ends_a_set_whose_stage_dies_again_and_again() {
    let scratch = Scratch::new("budget");
    let budget = ["--restarts", "2"];
    let mut set = RunningSet::start_with("budget-set", Some(&set(&scratch, "realtime")), &budget);
    set.wait_until(has_all_stages);
    for n in 0..3 {
        let run = set.wait_until(has_all_stages);
        signal(pid(&run, "segment"), Signal::KILL);
        let wanted = if n < 2 { "recovered" } else { "gave_up" };
        let count = if n < 2 { n + 1 } else { 1 };
        wait_for(wanted, || events(&set, wanted, "segment") == count);
    }
    let ended = set.wait();
    assert_eq!(ended.code, 1, "{}{}", ended.stdout, ended.stderr);
    assert!(ended.stderr.contains("stage `segment`"), "{}", ended.stderr);
}

#[test]
fn a_second_supervisor_of_one_folder_is_refused_also_with_another_registry() {
    let scratch = Scratch::new("second");
    let mut set = RunningSet::start("second-set", Some(&set(&scratch, "realtime")));
    set.wait_until(has_all_stages);
    let out = set.out("").to_string_lossy().into_owned();
    let second = Command::new(program("orime"))
        .args(["up", &scratch.path("realtime.toml"), "--out", &out])
        .env("XDG_RUNTIME_DIR", scratch.path("elsewhere"))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&second.stderr).into_owned();
    assert_eq!(second.status.code(), Some(2), "{text}");
    assert!(text.contains(&format!("process {}", set.pid())), "{text}");
}

#[test]
fn systemd_is_told_when_the_set_is_ready_alive_and_stopping() {
    let scratch = Scratch::new("notify");
    let path = scratch.path("notify.socket");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    fs::create_dir_all(scratch.path("runs")).unwrap();
    let mut set = Command::new(program("orime"))
        .args(["up", &set(&scratch, "realtime"), "--no-judge", "--out", &scratch.path("out")])
        .env("XDG_RUNTIME_DIR", scratch.path("runs"))
        .env("NOTIFY_SOCKET", &path)
        .env("WATCHDOG_USEC", "400000")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let hear = || {
        let mut bytes = [0; 512];
        let length = socket.recv(&mut bytes).expect("the supervisor says something");
        String::from_utf8_lossy(&bytes[..length]).into_owned()
    };
    assert!(hear().starts_with("READY=1"));
    assert!(hear().starts_with("WATCHDOG=1"));
    assert!(hear().starts_with("WATCHDOG=1"));
    signal(set.id().into(), Signal::TERM);
    wait_for("STOPPING=1", || hear().starts_with("STOPPING=1"));
    assert!(set.wait().unwrap().success());
}

#[test]
fn the_systemd_unit_is_one() {
    let Ok(found) = Command::new("systemd-analyze").arg("--version").output() else {
        eprintln!("SKIPPED the_systemd_unit_is_one: no systemd-analyze here");
        return;
    };
    assert!(found.status.success());
    let scratch = Scratch::new("unit");
    let unit = fs::read_to_string(root().join("deploy/systemd/orime@.service")).unwrap();
    for line in ["Type=notify", "WatchdogSec=", "RestartPreventExitStatus="] {
        assert!(unit.contains(line), "{line}");
    }
    // The programs are not installed here.
    let file = scratch.path("orime@five_cameras.service");
    fs::write(&file, unit.replace("/opt/orime/bin/orime", "/bin/true")).unwrap();
    let output = Command::new("systemd-analyze").args(["verify", &file]).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && !text.contains("orime@"), "{text}");
    let logind = fs::read_to_string(root().join("deploy/systemd/orime-logind.conf")).unwrap();
    assert!(logind.lines().any(|line| line == "RemoveIPC=no"));
}
