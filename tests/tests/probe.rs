//! What the probe writes and serves, read by others.

use orime_tests::{RunningSet, Scratch, program, root};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn set(scratch: &Scratch) -> String {
    let path = scratch.path("set.toml");
    let text = "pace = \"realtime\"\n[capture]\nsource = \"rendered\"\nrepeat = true\nfps = 15\n\
                [capture.rendered]\nsize_px = [320, 240]\n";
    fs::write(&path, text).unwrap();
    path
}

fn page(port: u16) -> Option<String> {
    let mut client = TcpStream::connect(("127.0.0.1", port)).ok()?;
    client.write_all(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n").ok()?;
    let mut text = String::new();
    client.read_to_string(&mut text).ok()?;
    text.split_once("\r\n\r\n").map(|(_, body)| body.to_owned())
}

#[test]
fn files_and_page_tell_a_frames_way_through_all_processes() {
    let scratch = Scratch::new("probe-files");
    let mut set = RunningSet::start("probe-files-set", Some(&set(&scratch)));
    set.wait_until(|run| run["stages"].as_array().is_some_and(|s| s.len() == 5));
    set.wait_for_states();
    let [csv, trace, log] = ["a.csv", "a.json", "a.hlog"].map(|name| scratch.path(name));
    // A free port, by the system's choice.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let mut probe = Command::new(program("orime-probe"))
        .args(["--once", "--json", "--seconds", "6", "--csv", &csv, "--trace", &trace])
        .args(["--hdr-log", &log, "--prometheus", &format!("127.0.0.1:{port}")])
        .env("XDG_RUNTIME_DIR", set.out("../runs"))
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    let metrics = loop {
        match page(port).filter(|text| text.contains("orime_states_total{")) {
            Some(text) => break text,
            None => assert!(start.elapsed() < Duration::from_secs(60), "no page"),
        }
        std::thread::sleep(Duration::from_millis(100));
    };
    assert!(probe.wait().unwrap().success());
    for line in metrics.lines().filter(|line| !line.starts_with('#')) {
        let (name, value) = line.rsplit_once(' ').unwrap();
        assert!(name.starts_with("orime_") && value.parse::<f64>().is_ok(), "{line}");
    }
    let sleeps = metrics.lines().find(|line| {
        line.starts_with("orime_effect_asleep{") && line.contains("effect=\"grippers\"")
    });
    // The scene names grippers by default, and nobody tells any.
    assert!(sleeps.is_some_and(|line| line.ends_with(" 1")), "{sleeps:?}");
    read_by_client(&scratch, &metrics);

    look_at_trace(&fs::read_to_string(&trace).unwrap());
    read_by_perfetto(&scratch, &trace);

    let csv = fs::read_to_string(csv).unwrap();
    let columns = csv.lines().next().unwrap().split(',').count();
    assert!(csv.lines().count() > 20 && csv.lines().all(|l| l.split(',').count() == columns));
    let log = fs::read_to_string(log).unwrap();
    assert!(log.lines().any(|line| line.starts_with("Tag=end_to_end,")), "{log}");
}

/// Frames lead through all processes, and no slices of one track overlap.
fn look_at_trace(text: &str) {
    let trace: Value = serde_json::from_str(text).unwrap();
    let events = trace["traceEvents"].as_array().unwrap();
    let flow = |phase: &str| -> Vec<u64> {
        events.iter().filter(|e| e["ph"] == phase).map(|e| e["id"].as_u64().unwrap()).collect()
    };
    let (starts, ends) = (flow("s"), flow("f"));
    let whole = ends.iter().filter(|step| starts.contains(step)).count();
    assert!(whole > 3, "{whole} frames lead through all processes");
    let mut tracks: BTreeMap<[u64; 2], Vec<[f64; 2]>> = BTreeMap::new();
    for event in events.iter().filter(|event| event["ph"] == "X") {
        let number = |key: &str| event[key].as_f64().unwrap();
        assert!(number("dur") >= 0.0, "{event}");
        let track = ["pid", "tid"].map(|key| event[key].as_u64().unwrap());
        tracks.entry(track).or_default().push([number("ts"), number("ts") + number("dur")]);
    }
    for (track, slices) in &mut tracks {
        slices.sort_by(|a, b| a[0].total_cmp(&b[0]));
        for pair in slices.windows(2) {
            // What is written in microseconds is rounded to the nearest double.
            assert!(pair[0][1] <= pair[1][0] + 1e-3, "track {track:?}: {pair:?}");
        }
    }
}

/// A program of the Python environment that needs `package`, or `None` after saying loudly that
/// `what` is skipped.
fn python_with(package: &str, what: &str) -> Option<Command> {
    let python = root().join(".venv/bin/python");
    let imports = Command::new(&python).args(["-c", &format!("import {package}")]).output();
    if imports.is_ok_and(|output| output.status.success()) {
        return Some(Command::new(python));
    }
    eprintln!("SKIPPED {what}: {package} is not in .venv (deploy/python-env)");
    None
}

/// Has PyPI's prometheus-client read the page, where it is installed.
fn read_by_client(scratch: &Scratch, metrics: &str) {
    let what = "reading the page by prometheus-client";
    let Some(mut python) = python_with("prometheus_client", what) else { return };
    let script = "import sys\nfrom prometheus_client.parser import text_string_to_metric_families\n\
                  print(sum(len(f.samples) for f in text_string_to_metric_families(\
                  open(sys.argv[1]).read())))";
    let file = scratch.path("metrics.txt");
    fs::write(&file, metrics).unwrap();
    let output = python.args(["-c", script, &file]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let samples: usize = String::from_utf8_lossy(&output.stdout).trim().parse().unwrap();
    let lines = metrics.lines().filter(|line| !line.starts_with('#')).count();
    assert_eq!(samples, lines, "every line is a sample");
}

/// Has Perfetto's trace processor read the trace, where there is one, and refuse worse ones.
fn read_by_perfetto(scratch: &Scratch, trace: &str) {
    let Some(_) = python_with("perfetto", "reading the trace by Perfetto") else { return };
    let read = |trace: &str| {
        let python = root().join(".venv/bin/python");
        let script = root().join("tests/perfetto_trace.py");
        let output = Command::new(python).arg(script).arg(trace).output().unwrap();
        let text = [output.stdout.as_slice(), &output.stderr].concat();
        (output.status.code(), String::from_utf8_lossy(&text).into_owned())
    };
    let (code, text) = read(trace);
    if code == Some(77) {
        eprintln!("SKIPPED reading the trace by Perfetto's trace processor: {text}");
        return;
    }
    assert_eq!(code, Some(0), "{text}");
    eprintln!("{text}");
    let whole: Value = serde_json::from_str(&fs::read_to_string(trace).unwrap()).unwrap();
    let worse = |why: &str, change: &dyn Fn(&mut Vec<Value>)| {
        let mut trace = whole.clone();
        change(trace["traceEvents"].as_array_mut().unwrap());
        let file = scratch.path("worse.json");
        fs::write(&file, trace.to_string()).unwrap();
        let (code, text) = read(&file);
        assert!(code == Some(1) && text.contains(why), "not refused for {why}: {code:?} {text}");
    };
    worse("every slice is read", &|events| {
        let way = |event: &Value| event["ph"] == "X" && event["cat"] == "on the way";
        let at = events.iter().position(way).unwrap();
        let mut late = events[at].clone();
        late["ts"] = (late["ts"].as_f64().unwrap() + late["dur"].as_f64().unwrap() / 2.0).into();
        events.insert(at + 1, late);
    });
    worse("orime-register", &|events| {
        events.retain(|event| event["args"]["name"] != "orime-register");
    });
    worse("frames lead through all processes", &|events| {
        events.retain(|event| !matches!(event["ph"].as_str(), Some("s" | "t" | "f")));
    });
}

#[test]
fn a_budget_names_what_is_over_and_only_the_loopback_is_served() {
    let scratch = Scratch::new("probe-budget");
    let mut set = RunningSet::start("probe-budget-set", Some(&set(&scratch)));
    set.wait_until(|run| run["stages"].as_array().is_some_and(|s| s.len() == 5));
    set.wait_for_states();
    let budget = |text: &str| {
        let file = scratch.path("budget.toml");
        fs::write(&file, text).unwrap();
        let output = set.beside("orime-probe", &["--once", "--seconds", "2", "--budget", &file]);
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, text) = budget("[stage.register]\ncompute_p99_ms = 0.000001\n");
    assert_eq!(code, Some(4), "{text}");
    assert!(text.contains("stage `register`: compute p99 is"), "{text}");
    assert_eq!(budget("[stage.register]\ncompute_p99_ms = 1e9\n").0, Some(0));
    let (code, text) = budget("[stage.registre]\ncompute_p99_ms = 1\n");
    assert_eq!(code, Some(1));
    assert!(text.contains("no stage is called `registre`"), "{text}");
    let open = set.beside("orime-probe", &["--prometheus", "0.0.0.0:0"]);
    assert_eq!(open.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&open.stderr).contains("loopback"));
}
