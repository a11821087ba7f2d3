//! A short soak: every stage is killed once, and the set comes back each time.

use orime_tests::{Scratch, run};
use serde_json::Value;
use std::fs;

#[test]
fn a_set_whose_stages_are_killed_comes_back_each_time() {
    let scratch = Scratch::new("soak");
    let (set, json) = (scratch.path("set.toml"), scratch.path("soak.json"));
    let text = "pace = \"realtime\"\n[capture]\nsource = \"rendered\"\nrepeat = true\nfps = 15\n\
                [capture.rendered]\nsize_px = [320, 240]\n";
    fs::write(&set, text).unwrap();
    let seconds = ["--seconds", "22", "--kill-every-s", "5", "--json", &json];
    let output = run("orime-evaluate", &[&["soak", &set][..], &seconds].concat());
    let text = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    assert!(output.status.success(), "{text}");
    let figures: Value = serde_json::from_str(&fs::read_to_string(&json).unwrap()).unwrap();
    let killed: Vec<&str> =
        figures["each"].as_array().unwrap().iter().filter_map(|k| k["stage"].as_str()).collect();
    assert_eq!(killed, ["segment", "register", "simulate", "capture"], "{text}");
    assert!(figures["grew"].as_array().is_some_and(Vec::is_empty), "{text}");
    for stage in ["capture", "segment", "register", "simulate", "supervisor"] {
        let held = &figures["held"][stage];
        assert!(held["memory_kib"][1].as_u64() > Some(0), "{stage}: {text}");
        assert!(held["files"][1].as_u64() > Some(0), "{stage}: {text}");
    }

    // A recovery cannot take no time: what is not forgiven is a failure.
    let strict = ["--seconds", "20", "--kill-every-s", "6", "--slow-ms", "0", "--slow-max", "0"];
    let output = run("orime-evaluate", &[&["soak", &set][..], &strict].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1));
    assert!(said.contains("recoveries took more than 0 ms"), "{said}");

    // A set that ends by itself says so at once.
    fs::write(&set, fs::read_to_string(&set).unwrap().replace("true", "false")).unwrap();
    let output = run("orime-evaluate", &["soak", &set, "--seconds", "5"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("repeat = true"), "{said}");
}
