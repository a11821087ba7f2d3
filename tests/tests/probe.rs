//! What the probe writes and serves, read by others.

use orime_tests::{RunningSet, Scratch, program, root};
use serde_json::Value;
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

    read_by_perfetto(&trace);
    let trace: Value = serde_json::from_str(&fs::read_to_string(trace).unwrap()).unwrap();
    let events = trace["traceEvents"].as_array().unwrap();
    let flow = |phase: &str| -> Vec<u64> {
        events.iter().filter(|e| e["ph"] == phase).map(|e| e["id"].as_u64().unwrap()).collect()
    };
    let (starts, ends) = (flow("s"), flow("f"));
    let whole = ends.iter().filter(|step| starts.contains(step)).count();
    assert!(whole > 3, "{whole} frames lead through all processes");
    for event in events.iter().filter(|event| event["ph"] == "X") {
        assert!(event["dur"].as_f64().is_some_and(|us| us >= 0.0), "{event}");
    }

    let csv = fs::read_to_string(csv).unwrap();
    let columns = csv.lines().next().unwrap().split(',').count();
    assert!(csv.lines().count() > 20 && csv.lines().all(|l| l.split(',').count() == columns));
    let log = fs::read_to_string(log).unwrap();
    assert!(log.lines().any(|line| line.starts_with("Tag=end_to_end,")), "{log}");
}

/// Has PyPI's prometheus-client read the page, where it is installed.
fn read_by_client(scratch: &Scratch, metrics: &str) {
    let python = root().join(".venv/bin/python");
    let script = "import sys\nfrom prometheus_client.parser import text_string_to_metric_families\n\
                  print(sum(len(f.samples) for f in text_string_to_metric_families(\
                  open(sys.argv[1]).read())))";
    let file = scratch.path("metrics.txt");
    fs::write(&file, metrics).unwrap();
    let output = Command::new(python).args(["-c", script, &file]).output();
    match output.ok().filter(|output| output.status.success()) {
        Some(output) => {
            let samples: usize = String::from_utf8_lossy(&output.stdout).trim().parse().unwrap();
            let lines = metrics.lines().filter(|line| !line.starts_with('#')).count();
            assert_eq!(samples, lines, "every line is a sample");
        }
        None => eprintln!("SKIPPED reading the page by prometheus-client: not in .venv"),
    }
}

/// Has Perfetto's trace processor read the trace, where PyPI's perfetto can fetch it.
fn read_by_perfetto(trace: &str) {
    let python = root().join(".venv/bin/python");
    let script = root().join("tests/perfetto_trace.py");
    let output = Command::new(python).arg(script).arg(trace).output();
    match output.ok().filter(|output| output.status.code() != Some(77)) {
        Some(output) => {
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        }
        None => eprintln!("SKIPPED reading the trace by Perfetto's trace processor: not here"),
    }
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
