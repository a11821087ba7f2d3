//! What the tests of the whole share: where things are, and how a program is run.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// The repository's root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().expect("the repository exists")
}

/// A program of the workspace, built with the tests (`deploy/test` builds all of them first).
pub fn program(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("a test knows its own path");
    let folder = test.parent().and_then(Path::parent).expect("tests lie in target/PROFILE/deps");
    let path = folder.join(name);
    assert!(path.exists(), "{} is not built: run deploy/test", path.display());
    path
}

/// Runs a program to its end.
pub fn run(name: &str, arguments: &[&str]) -> Output {
    Command::new(program(name))
        .args(arguments)
        .current_dir(root())
        .output()
        .expect("the program starts")
}

/// The folder of the recordings, or `None` after saying loudly that a test is skipped.
pub fn recordings(test: &str) -> Option<PathBuf> {
    let folder =
        std::env::var_os("ORIME_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED {test}: no recordings at {} (set ORIME_DATA)", folder.display());
    None
}

/// A fresh folder for one test, removed when dropped.
#[derive(Debug)]
pub struct Scratch(PathBuf);

impl Scratch {
    /// Makes the folder.
    pub fn new(test: &str) -> Self {
        let path = std::env::temp_dir().join(format!("orime-test-{test}-{}", std::process::id()));
        std::fs::create_dir_all(&path).expect("the temporary folder can be written");
        Self(path)
    }

    /// A path inside it, as text.
    pub fn path(&self, name: &str) -> String {
        self.0.join(name).to_string_lossy().into_owned()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A service set that a test started; stopped, and its registry removed, when dropped.
#[derive(Debug)]
pub struct RunningSet {
    child: Child,
    scratch: Scratch,
}

/// How a set ended.
#[derive(Debug)]
pub struct Ended {
    /// Exit status.
    pub code: i32,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

/// Longest that any test waits for a set.
const WAIT_MAX: Duration = Duration::from_secs(180);

impl RunningSet {
    /// Starts `orime up SET` with a registry and an output folder of its own.
    pub fn start(test: &str, set: Option<&str>) -> Self {
        Self::start_with(test, set, &[])
    }

    /// As [`RunningSet::start`], with further arguments.
    pub fn start_with(test: &str, set: Option<&str>, arguments: &[&str]) -> Self {
        let scratch = Scratch::new(test);
        std::fs::create_dir_all(scratch.path("runs")).expect("the scratch folder can be written");
        let file = |name: &str| {
            std::fs::File::create(scratch.path(name)).expect("the scratch folder can be written")
        };
        let child = Command::new(program("orime"))
            .arg("up")
            .args(set)
            .args(["--out", &scratch.path("out")])
            .args(arguments)
            .env("XDG_RUNTIME_DIR", scratch.path("runs"))
            .current_dir(root())
            .stdin(Stdio::null())
            .stdout(file("stdout"))
            .stderr(file("stderr"))
            .spawn()
            .expect("orime starts");
        Self { child, scratch }
    }

    /// A path in the set's output folder.
    pub fn out(&self, name: &str) -> PathBuf {
        PathBuf::from(self.scratch.path("out")).join(name)
    }

    /// The supervisor's process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Runs another program of Orime that finds this set and no other.
    pub fn beside(&self, name: &str, arguments: &[&str]) -> Output {
        Command::new(program(name))
            .args(arguments)
            .env("XDG_RUNTIME_DIR", self.scratch.path("runs"))
            .current_dir(root())
            .output()
            .expect("the program starts")
    }

    /// What `orime ps --json` says of this set, once `ready` says of it that it is as wanted.
    pub fn wait_until(&mut self, ready: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        while start.elapsed() < WAIT_MAX {
            let output = self.beside("orime", &["ps", "--json"]);
            let runs: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
            if let Some(run) = runs.get(0).filter(|run| ready(run)) {
                return run.clone();
            }
            assert!(self.child.try_wait().expect("waiting works").is_none(), "{:?}", self.ended());
            std::thread::sleep(Duration::from_millis(50));
        }
        panic!("the set did not get ready: {:?}", self.ended());
    }

    /// Waits until the judge has drawn a step: the whole pipeline has run once.
    pub fn wait_for_pictures(&mut self) {
        let start = Instant::now();
        let pictures = self.out("pictures");
        let is_empty = || {
            let mut found = std::fs::read_dir(&pictures).into_iter().flatten();
            found.next().is_none()
        };
        while is_empty() {
            assert!(start.elapsed() < WAIT_MAX, "no picture: {:?}", self.ended());
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits until the live line tells of a few states: at either pace, the pipeline runs.
    pub fn wait_for_states(&mut self) {
        let start = Instant::now();
        let step = |line: &str| -> Option<u64> {
            line.strip_prefix("step ")?.split([' ', '/']).next()?.parse().ok()
        };
        loop {
            let text = std::fs::read_to_string(self.scratch.path("stdout")).unwrap_or_default();
            if text.lines().filter_map(step).any(|step| step > 4) {
                return;
            }
            assert!(start.elapsed() < WAIT_MAX, "no states: {:?}", self.ended());
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits for the end.
    pub fn wait(&mut self) -> Ended {
        let start = Instant::now();
        while self.child.try_wait().expect("waiting works").is_none() {
            assert!(start.elapsed() < WAIT_MAX, "the set hangs: {:?}", self.ended());
            std::thread::sleep(Duration::from_millis(50));
        }
        self.ended()
    }

    fn ended(&mut self) -> Ended {
        let status = self.child.try_wait().expect("waiting works");
        let read =
            |name: &str| std::fs::read_to_string(self.scratch.path(name)).unwrap_or_default();
        Ended {
            code: status.and_then(|status| status.code()).unwrap_or(-1),
            stdout: read("stdout"),
            stderr: read("stderr"),
        }
    }

    /// Objects in shared memory that bear this run's name.
    pub fn shared_memory(run: &str) -> Vec<String> {
        let prefix = format!("orime_{run}_");
        let entries = std::fs::read_dir("/dev/shm").expect("shared memory is there");
        entries
            .map(|entry| {
                entry.expect("it can be listed").file_name().to_string_lossy().into_owned()
            })
            .filter(|name| name.starts_with(&prefix))
            .collect()
    }
}

impl Drop for RunningSet {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            // In order first, so that nothing of it stays; at once if it does not listen.
            if let Some(pid) = rustix::process::Pid::from_raw(self.child.id() as i32) {
                let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
            }
            let start = Instant::now();
            while matches!(self.child.try_wait(), Ok(None)) {
                if start.elapsed() > Duration::from_secs(20) {
                    let _ = self.child.kill();
                }
                std::thread::sleep(Duration::from_millis(50));
            }
        }
    }
}

/// Waits until `seen`, and fails the test where it takes too long.
pub fn wait_for(what: &str, mut seen: impl FnMut() -> bool) {
    let start = Instant::now();
    while !seen() {
        assert!(start.elapsed() < Duration::from_secs(90), "not seen: {what}");
        std::thread::sleep(Duration::from_millis(20)); // Between looks.
    }
}
