//! Recorded messages into one later stage alone, bit for bit.

use orime_record::TapeContent;
use orime_tests::{RunningSet, Scratch, run};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Output;

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&[output.stdout.as_slice(), &output.stderr].concat()).into_owned()
}

#[test]
fn a_tape_replays_into_register_and_into_simulate_alone() {
    let scratch = Scratch::new("replay-stages");
    let set = scratch.path("set.toml");
    let text = "[capture]\nsource = \"rendered\"\n[capture.rendered]\nsize_px = [320, 240]\n\
                steps = 40\ngripper_poses = true\nfold_plan = true\n";
    fs::write(&set, text).unwrap();
    let file = scratch.path("fold.mcap");
    let arguments = ["--record", &file, "--record-stages"];
    let mut recorded = RunningSet::start_with("replay-record", Some(&set), &arguments);
    let ended = recorded.wait();
    assert_eq!(ended.code, 0, "{}{}", ended.stdout, ended.stderr);
    let tape = scratch.path("fold.stages.mcap");
    let replay = |tape: &str, stage: &str, set: &str| {
        let out = scratch.path("replay");
        run("orime", &["replay", tape, stage, "--set", set, "--out", &out, "--json"])
    };
    let taped = TapeContent::load(Path::new(&tape)).unwrap();
    assert_eq!(taped.of("orime/gripper").len(), 40, "one message of the grippers a step");
    assert!(!taped.of("orime/plan").is_empty());
    for stage in ["register", "simulate"] {
        let output = replay(&tape, stage, &set);
        assert_eq!(output.status.code(), Some(0), "{stage}: {}", said(&output));
        let compared: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!((&compared["steps"], &compared["equal"]), (&40.into(), &40.into()));
    }

    // The comparison can fail: other parameters give other targets.
    let other = scratch.path("other.toml");
    fs::write(&other, format!("[register]\nflatness = 0.0\n{text}")).unwrap();
    let output = replay(&tape, "register", &other);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let compared: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(compared["first_different"].is_u64(), "{compared}");

    let output = replay(&tape, "segment", &set);
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    let bytes = fs::read(&tape).unwrap();
    fs::write(&tape, &bytes[..bytes.len() / 2]).unwrap();
    let output = replay(&tape, "register", &set);
    assert_eq!(output.status.code(), Some(3), "a cut tape is refused: {}", said(&output));
}
