//! The tree's own rules. ARCHITECTURE.md says why they are there.

use orime_tests::root;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Every file below the root with one of these endings, without what git ignores.
fn files(endings: &[&str]) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    let mut folders = vec![root()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap().map(Result::unwrap) {
            let path = entry.path();
            let name = entry.file_name().to_string_lossy().into_owned();
            if path.is_dir() {
                if !["target", ".git", "out", ".venv"].contains(&name.as_str()) {
                    folders.push(path);
                }
            } else if endings.iter().any(|ending| name.ends_with(ending)) {
                found.push((path.clone(), fs::read_to_string(&path).unwrap()));
            }
        }
    }
    assert!(!found.is_empty(), "no {endings:?} found: this test would test nothing");
    found
}

/// Fails with every complaint at once.
fn check(rule: &str, complaints: Vec<String>) {
    assert!(complaints.is_empty(), "{rule}:\n  {}", complaints.join("\n  "));
}

fn short(path: &Path) -> String {
    path.strip_prefix(root()).unwrap_or(path).display().to_string()
}

#[test]
fn stages_know_no_process() {
    let forbidden = ["iceoryx2", "orime-runtime", "orime-messages"];
    let stages = ["capture", "segment", "register", "simulate"];
    let mut complaints = Vec::new();
    for stage in stages {
        let package = format!("orime-{stage}");
        let tree = Command::new(env!("CARGO"))
            .args(["tree", "--offline", "--locked", "--no-default-features", "--edges", "normal"])
            .args(["--prefix", "none", "--package", &package])
            .current_dir(root())
            .output()
            .unwrap();
        let text = String::from_utf8(tree.stdout).unwrap();
        assert!(text.contains("orime-geometry"), "{}", String::from_utf8_lossy(&tree.stderr));
        for name in text.lines().filter_map(|line| line.split(' ').next()) {
            let is_other_stage =
                name != package && stages.iter().any(|s| name == format!("orime-{s}"));
            if forbidden.iter().any(|f| name.starts_with(f)) || is_other_stage {
                complaints.push(format!("the library of {package} depends on {name}"));
            }
        }
    }
    check("a stage's library knows geometry and data, no process and no other stage", complaints);
}

#[test]
fn only_the_runtime_knows_iceoryx2() {
    let mentions = |text: &str| text.lines().any(|line| line.starts_with("iceoryx2"));
    let complaints = files(&["Cargo.toml"])
        .into_iter()
        .filter(|(path, text)| {
            let name = short(path);
            name != "Cargo.toml" && name != "shared/runtime/Cargo.toml" && mentions(text)
        })
        .map(|(path, _)| short(&path))
        .collect();
    check("iceoryx2 stays behind one crate", complaints);
}

#[test]
fn truth_knows_no_tracker() {
    let manifest = fs::read_to_string(root().join("shared/origami/Cargo.toml")).unwrap();
    let complaints = manifest
        .lines()
        .filter(|line| line.starts_with("orime-"))
        .map(|line| format!("shared/origami depends on {line}"))
        .collect();
    check("the kinematics that errors are measured against are independent", complaints);
}

#[test]
fn files_and_lines_are_short() {
    let mut complaints = Vec::new();
    for (path, text) in files(&[".rs"]) {
        let limit = if path.ends_with("main.rs") { 40 } else { 500 };
        let count = text.lines().count();
        if count > limit {
            complaints.push(format!("{}: {count} lines, at most {limit}", short(&path)));
        }
        for (number, line) in text.lines().enumerate() {
            if line.chars().count() > 100 {
                complaints.push(format!("{}:{}: over 100 columns", short(&path), number + 1));
            }
        }
    }
    check("modules of at most 500 lines (mains 40) of at most 100 columns", complaints);
}

/// Lengths of the functions of a formatted file: from `fn` to the brace at the same indent. What a
/// trait declares without a body has none.
fn functions(text: &str) -> Vec<(usize, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    let indent = |line: &str| line.len() - line.trim_start().len();
    let starts = lines.iter().enumerate().filter(|(_, line)| {
        let code = line.trim_start();
        let code = code.strip_prefix("pub(crate) ").unwrap_or(code);
        let code = code.strip_prefix("pub ").unwrap_or(code);
        ["fn ", "const fn ", "unsafe fn "].iter().any(|word| code.starts_with(word))
            && !code.ends_with(';')
    });
    starts
        .filter_map(|(start, line)| {
            let closing = format!("{}}}", " ".repeat(indent(line)));
            let length = lines[start..].iter().position(|line| **line == closing)?;
            Some((start + 1, length + 1))
        })
        .collect()
}

#[test]
fn functions_are_short() {
    assert_eq!(functions("fn a() {\n    1;\n}\n"), [(1, 3)]);
    assert_eq!(functions("    fn a() -> [u8; 2];\n    fn b() {\n        1;\n    }\n"), [(2, 3)]);
    let complaints = files(&[".rs"])
        .into_iter()
        .flat_map(|(path, text)| {
            let long = functions(&text).into_iter().filter(|(_, length)| *length > 70);
            long.map(|(line, length)| format!("{}:{line}: {length} lines", short(&path)))
                .collect::<Vec<_>>()
        })
        .collect();
    check("functions of at most 70 lines", complaints);
}

#[test]
fn no_drawers_for_odds_and_ends() {
    let complaints = files(&[".rs"])
        .into_iter()
        .map(|(path, _)| short(&path))
        .filter(|path| {
            ["utils.rs", "common.rs", "helpers.rs", "misc.rs"].iter().any(|n| path.ends_with(n))
        })
        .collect();
    check("a module is named after what is in it", complaints);
}

#[test]
fn exceptions_carry_reasons() {
    let mut complaints = Vec::new();
    for (path, text) in files(&[".rs"]) {
        if path.ends_with("tidy.rs") {
            continue;
        }
        for (number, line) in text.lines().enumerate() {
            let place = format!("{}:{}", short(&path), number + 1);
            if line.contains("#[ignore]") {
                complaints.push(format!("{place}: ignored without a reason"));
            }
            if line.trim_start().starts_with("#[allow(") {
                complaints.push(format!("{place}: use #[expect(…, reason = …)]"));
            }
            if ["TODO", "FIXME", "XXX"].iter().any(|mark| line.contains(mark)) {
                complaints.push(format!("{place}: unfinished work"));
            }
        }
    }
    check("exceptions carry reasons, and work is finished", complaints);
}

/// Words in back quotes that look like paths of this repository.
fn paths_named(text: &str) -> Vec<String> {
    let words = text.split('`').skip(1).step_by(2).flat_map(str::split_whitespace);
    let folders = ["shared/", "services/", "deploy/", "tests/", "docs/", ".ci/"];
    words
        .filter(|word| folders.iter().any(|folder| word.starts_with(folder)))
        .filter(|word| !word.contains(['*', '{', '<', '…']))
        .map(|word| word.trim_end_matches([',', '.', ':', ';', ')']).to_owned())
        .collect()
}

#[test]
fn what_the_docs_name_exists() {
    assert_eq!(paths_named("see `deploy/up X` and `cargo`"), ["deploy/up"]);
    let mut complaints = Vec::new();
    for (path, text) in files(&[".md"]) {
        for named in paths_named(&text) {
            if !root().join(&named).exists() {
                complaints.push(format!("{} names `{named}`, which is not there", short(&path)));
            }
        }
    }
    check("every path that the docs name exists", complaints);
}

#[test]
fn architecture_shows_every_room() {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let mut complaints = Vec::new();
    for parent in ["shared", "services"] {
        for entry in fs::read_dir(root().join(parent)).unwrap() {
            let name = format!("{parent}/{}", entry.unwrap().file_name().to_string_lossy());
            if !text.contains(&format!("`{name}`")) {
                complaints.push(format!("ARCHITECTURE.md does not mention `{name}`"));
            }
        }
    }
    check("a newcomer finds every room", complaints);
}
