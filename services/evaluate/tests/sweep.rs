//! `orime-evaluate sweep` as a user runs it: a tiny real one, interrupted and gone on with.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const SET: &str = "\
name = \"tiny\"
pace = \"lockstep\"
[sheet]
nodes = [13, 13]
[capture]
source = \"rendered\"
[capture.rendered]
steps = 60
size_px = [160, 120]
";

struct Scratch(PathBuf);

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn sweep(folder: &Path, more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_orime-evaluate"))
        .args(["sweep", "set.toml", "--out", "out", "--seeds", "2", "--knobs", "substeps"])
        .args(more)
        .current_dir(folder)
        .output()
        .expect("the program starts")
}

fn rows(folder: &Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(folder.join("out/runs.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn a_sweep_goes_on_where_it_ended_and_tells_the_same() {
    let name = format!("orime-sweep-{}", std::process::id());
    let scratch = Scratch(std::env::temp_dir().join(name));
    let folder = &scratch.0;
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("set.toml"), SET).unwrap();
    std::fs::write(folder.join("paper.json"), "{\"seconds_per_step\": 1.5}").unwrap();

    let first =
        sweep(folder, &["--steps", "6", "--json", "sweep.json", "--paper-loop", "paper.json"]);
    assert!(first.status.success(), "{}", String::from_utf8_lossy(&first.stderr));
    let all = rows(folder);
    // The set's own 20, and 5, 10, 40, 80, for two seeds.
    assert_eq!(all.len(), 10);
    let json = std::fs::read_to_string(folder.join("sweep.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["settings"].as_array().map(Vec::len), Some(5));
    assert_eq!(json["paper_loop_step_ms"].as_f64(), Some(1500.0));
    let error = json["settings"][0]["vertex_error_mm"]["mean"].as_f64().unwrap();
    assert!(error > 0.0 && error < 8.0, "the tiny fold is followed: {error} mm");
    for name in ["error_over_time.svg", "error_over_time.png", "knobs.svg", "runs.csv"] {
        assert!(folder.join("out").join(name).exists(), "{name}");
    }
    let svg = std::fs::read_to_string(folder.join("out/error_over_time.svg")).unwrap();
    assert!(svg.contains("paper_loop.py here: 1500 ms"));

    // Cut off in the middle of the ninth line: two runs are missing.
    let path = folder.join("out/runs.jsonl");
    let text = std::fs::read_to_string(&path).unwrap();
    let eight: usize = text.lines().take(8).map(|line| line.len() + 1).sum();
    std::fs::write(&path, &text[..eight + 20]).unwrap();
    let second = sweep(folder, &["--steps", "6"]);
    let said = String::from_utf8_lossy(&second.stderr);
    assert!(second.status.success() && said.contains("8 of 10 runs are done already"), "{said}");
    let hashes = |rows: &[serde_json::Value]| -> Vec<String> {
        rows.iter().map(|row| format!("{} {}", row["key"], row["states_hash"])).collect()
    };
    assert_eq!(hashes(&rows(folder)), hashes(&all));

    // Other steps are other runs; nothing is mixed up.
    let other = sweep(folder, &["--steps", "3", "--draw"]);
    assert!(!other.status.success());
    let said = String::from_utf8_lossy(&other.stderr);
    assert!(said.contains("nothing to draw"), "{said}");
}
