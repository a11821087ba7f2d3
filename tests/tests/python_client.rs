//! Python reads the sheet's state from a running set, with layouts that are Rust's.

use orime_runtime::{Guest, RunEntry, Stop, channel};
use orime_tests::{RunningSet, Scratch, root};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

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

/// Reads a set's states until `client` ends: what that printed, and positions by step.
fn beside(
    mut client: Child,
    entry: &RunEntry,
) -> (std::process::Output, BTreeMap<u64, Vec<[f32; 3]>>) {
    let guest = Guest::attach_to(entry, Stop::new()).unwrap();
    let mut states = guest.subscribe(&channel::STATE).unwrap();
    let mut seen = BTreeMap::new();
    while client.try_wait().unwrap().is_none() {
        while let Some(state) = states.try_next().unwrap() {
            seen.insert(state.header.step, state.positions_m().to_vec());
        }
        std::thread::sleep(Duration::from_millis(5)); // A state comes every 100 ms.
    }
    (client.wait_with_output().unwrap(), seen)
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
    let client = Command::new(python)
        .arg(root().join("clients/python/orime_client.py"))
        .args(["--json", "--count", "5"])
        .env("XDG_RUNTIME_DIR", set.out("../runs"))
        // A file takes all of it without somebody who reads.
        .stdout(fs::File::create(scratch.path("states")).unwrap())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let id = run["run"].as_str().unwrap();
    let entry = set.out(&format!("../runs/orime/{id}.json"));
    let entry: RunEntry = serde_json::from_str(&fs::read_to_string(entry).unwrap()).unwrap();
    let (output, seen_by_rust) = beside(client, &entry);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    let states: Vec<Value> = fs::read_to_string(scratch.path("states"))
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
        let step = state["step"].as_u64().unwrap();
        let other = seen_by_rust.get(&step).expect("Rust saw every state that Python did");
        for (node, position) in other.iter().zip(positions) {
            let python = [0, 1, 2].map(|axis| position[axis].as_f64().unwrap() as f32);
            assert_eq!(node.map(f32::to_bits), python.map(f32::to_bits), "step {step}");
        }
        // Neighbours along v are as far apart as on the paper.
        let at = |k: usize| -> Vec<f64> {
            positions[k].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
        };
        let distance: f64 = at(300).iter().zip(at(301)).map(|(a, b)| (a - b).powi(2)).sum();
        assert!((distance.sqrt() - 0.15 / 24.0).abs() < 0.001, "{}", distance.sqrt());
    }
}
