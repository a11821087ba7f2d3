//! Python reads the sheet's state from a running set, with layouts that are Rust's.

use orime_tests::{RunningSet, Scratch, root};
use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

/// A Python that has iceoryx2, or `None` after saying loudly that the test is skipped.
fn python() -> Option<PathBuf> {
    let python = root().join(".venv/bin/python");
    let named = std::env::var_os("ORIME_PYTHON").map(PathBuf::from);
    for python in named.into_iter().chain([python]) {
        let has_it = Command::new(&python).args(["-c", "import iceoryx2"]).output();
        if has_it.is_ok_and(|output| output.status.success()) {
            return Some(python);
        }
    }
    eprintln!("SKIPPED python_reads_the_state: no Python with iceoryx2 (deploy/python-env)");
    None
}

#[test]
fn python_reads_the_state() {
    let Some(python) = python() else { return };
    let scratch = Scratch::new("python");
    let path = scratch.path("set.toml");
    let text = "pace = \"realtime\"\n[capture]\nsource = \"rendered\"\nrepeat = true\nfps = 10\n\
                [capture.rendered]\nsize_px = [320, 240]\n";
    fs::write(&path, text).unwrap();
    let mut set = RunningSet::start("python-set", Some(&path));
    let run = set.wait_until(|run| run["stages"].as_array().is_some_and(|s| s.len() == 5));
    set.wait_for_states();
    let output = Command::new(python)
        .arg(root().join("clients/python/orime_client.py"))
        .args(["--json", "--count", "5"])
        .env("XDG_RUNTIME_DIR", set.out("../runs"))
        .output()
        .unwrap();
    let said =
        String::from_utf8_lossy(&[output.stdout.as_slice(), &output.stderr].concat()).into_owned();
    assert!(output.status.success(), "{said}");
    let states: Vec<Value> = String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(states.len(), 5, "{said}");
    for pair in states.windows(2) {
        assert!(pair[0]["step"].as_u64() < pair[1]["step"].as_u64(), "{said}");
    }
    for state in &states {
        assert_eq!((&state["run"], &state["tracking"]), (&run["run"], &"tracking".into()));
        let positions = state["positions_m"].as_array().unwrap();
        assert_eq!(positions.len(), 625, "25 × 25 nodes");
        // Neighbours along v are as far apart as on the paper.
        let at = |k: usize| -> Vec<f64> {
            positions[k].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
        };
        let distance: f64 = at(300).iter().zip(at(301)).map(|(a, b)| (a - b).powi(2)).sum();
        assert!((distance.sqrt() - 0.15 / 24.0).abs() < 0.001, "{}", distance.sqrt());
    }
}
