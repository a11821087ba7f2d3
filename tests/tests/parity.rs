//! Agreement with public libraries, both run here and now.

use orime_tests::{program, recordings, root};
use std::process::Command;

/// The Python of `deploy/python-env`, or `None` after saying loudly that a test is skipped.
fn python(test: &str) -> Option<std::path::PathBuf> {
    let environment = root().join(".venv");
    if environment.join("orime-ready").exists() {
        return Some(environment.join("bin/python"));
    }
    eprintln!("SKIPPED {test}: no .venv with pycpd (deploy/python-env makes it)");
    None
}

#[test]
fn textbook_cpd_is_pycpd() {
    let name = "textbook_cpd_is_pycpd";
    let (Some(data), Some(python)) = (recordings(name), python(name)) else { return };
    let output = Command::new(python)
        .arg(root().join("tests/pycpd_parity.py"))
        .arg(program("orime-evaluate"))
        .arg(data.join("cpd_fixtures"))
        .env("OMP_NUM_THREADS", "1")
        .output()
        .unwrap();
    let (out, err) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{out}{err}");
    assert_eq!(out.lines().count(), 3, "three shapes are compared: {out}");
}
