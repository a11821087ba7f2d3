//! Sets that faults are done to: started, watched, signalled, looked at.

use std::cell::RefCell;
use std::fs::{self, File};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail, ensure};
use orime_runtime::{Guest, RunEntry, Stop, now_ns, shared_memory_of};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use super::Skipped;

/// Longest that anything is waited for.
const PATIENCE: Duration = Duration::from_secs(120);
/// Time between two looks.
const LOOK: Duration = Duration::from_millis(10);

/// Where one row works; removed with all it holds.
#[derive(Debug)]
pub struct Bench {
    folder: PathBuf,
    programs: PathBuf,
    /// Runs that were seen.
    runs: RefCell<Vec<String>>,
}

/// A set that was started for a row; ended, however the row ends.
#[derive(Debug)]
pub struct Set<'b> {
    bench: &'b Bench,
    child: Child,
    name: String,
}

impl Bench {
    /// A fresh folder.
    pub fn new(row: u32) -> anyhow::Result<Self> {
        let folder =
            std::env::temp_dir().join(format!("orime-faults-{}-{row}", std::process::id()));
        fs::create_dir_all(folder.join("runs"))
            .with_context(|| format!("making `{}`", folder.display()))?;
        let own = std::env::current_exe().context("finding this program")?;
        let programs = own.parent().context("this program lies in a folder")?.to_owned();
        Ok(Self { folder, programs, runs: RefCell::new(Vec::new()) })
    }

    /// A path in the row's folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes a file into the row's folder.
    pub fn write(&self, name: &str, text: &str) -> anyhow::Result<PathBuf> {
        let path = self.path(name);
        fs::write(&path, text).with_context(|| format!("writing `{}`", path.display()))?;
        Ok(path)
    }

    /// A rendered set, small enough for a busy machine.
    pub fn rendered(&self, pace: &str, more: &str) -> anyhow::Result<PathBuf> {
        let text = format!(
            "pace = \"{pace}\"\n[capture]\nsource = \"rendered\"\n{more}\n[capture.rendered]\n\
             size_px = [320, 240]\nsteps = 40\n"
        );
        self.write(&format!("{pace}.toml"), &text)
    }

    /// A program of Orime, with this row's registry.
    pub fn program(&self, name: &str) -> Command {
        self.program_in(&self.programs, name)
    }

    /// … from another folder.
    pub fn program_in(&self, folder: &Path, name: &str) -> Command {
        let mut command = Command::new(folder.join(name));
        command.env("XDG_RUNTIME_DIR", self.path("runs")).stdin(Stdio::null());
        command
    }

    /// Runs a program of Orime to its end.
    pub fn run(&self, name: &str, arguments: &[&str]) -> anyhow::Result<Output> {
        self.program(name).args(arguments).output().with_context(|| format!("running {name}"))
    }

    /// A folder with all programs, for one of them to be replaced.
    pub fn other_programs(&self) -> anyhow::Result<PathBuf> {
        let folder = self.path("bin");
        fs::create_dir_all(&folder)?;
        for name in ["orime", "orime-capture", "orime-segment", "orime-register", "orime-simulate"]
        {
            let (from, to) = (self.programs.join(name), folder.join(name));
            // Links stay where they lead; this program looks for the others beside itself.
            if fs::hard_link(&from, &to).is_err() {
                fs::copy(&from, &to).with_context(|| format!("copying `{}`", from.display()))?;
            }
        }
        Ok(folder)
    }

    /// Runs a shell script in a mount namespace of its own, or says that this is not possible.
    pub fn in_own_mounts(&self, script: &str) -> anyhow::Result<Command> {
        let is_possible = Command::new("unshare")
            .args(["-m", "true"])
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|status| status.success());
        if !is_possible {
            bail!(Skipped("mount namespaces need rights that this user has not".to_owned()));
        }
        let mut command = Command::new("unshare");
        command.args(["-m", "sh", "-c", script]);
        command.env("XDG_RUNTIME_DIR", self.path("runs")).stdin(Stdio::null());
        command.env("PROGRAMS", &self.programs);
        Ok(command)
    }

    /// Starts `orime up`.
    pub fn up(&self, name: &str, set: &Path, arguments: &[&str]) -> anyhow::Result<Set<'_>> {
        self.up_by(self.program("orime"), name, set, arguments)
    }

    /// … by this command.
    pub fn up_by(
        &self,
        mut command: Command,
        name: &str,
        set: &Path,
        arguments: &[&str],
    ) -> anyhow::Result<Set<'_>> {
        let file = |ending: &str| File::create(self.path(&format!("{name}.{ending}")));
        let child = command
            .arg("up")
            .arg(set)
            .arg("--out")
            .arg(self.path(&format!("{name}.out")))
            .args(arguments)
            .stdout(file("stdout")?)
            .stderr(file("stderr")?)
            .process_group(0)
            .spawn()
            .context("starting orime")?;
        Ok(Set { bench: self, child, name: name.to_owned() })
    }

    /// Registered runs whose supervisors live.
    pub fn ps(&self) -> anyhow::Result<Vec<RunEntry>> {
        let output = self.run("orime", &["ps", "--json"])?;
        let entries: Vec<RunEntry> =
            serde_json::from_slice(&output.stdout).context("what `orime ps --json` says")?;
        let mut runs = self.runs.borrow_mut();
        for entry in &entries {
            if !runs.contains(&entry.run) {
                runs.push(entry.run.clone());
            }
        }
        Ok(entries)
    }

    /// Objects in shared memory of all runs that were seen.
    pub fn left_behind(&self) -> usize {
        let runs = self.runs.borrow();
        let ids = runs.iter().filter_map(|run| run.parse().ok());
        ids.filter_map(|run| shared_memory_of(run).ok()).map(|left| left.len()).sum()
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        // The system clears its folder for temporary files some day.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// All that a program said.
pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&[output.stdout.as_slice(), &output.stderr].concat()).into_owned()
}

/// Waits until `seen` gives something.
pub fn wait_for<T>(
    what: &str,
    mut seen: impl FnMut() -> anyhow::Result<Option<T>>,
) -> anyhow::Result<T> {
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        if let Some(found) = seen()? {
            return Ok(found);
        }
        std::thread::sleep(LOOK);
    }
    bail!("not seen in {PATIENCE:?}: {what}")
}

/// Milliseconds since a moment of `CLOCK_MONOTONIC`.
pub fn ms_since(from_ns: u64, to_ns: u64) -> f64 {
    to_ns.saturating_sub(from_ns) as f64 / 1e6
}

/// Sends a signal.
pub fn signal(pid: u32, signal: Signal) -> anyhow::Result<()> {
    let pid = Pid::from_raw(pid as i32).context("a process id")?;
    kill_process(pid, signal).context("signalling")
}

impl Set<'_> {
    /// The supervisor's process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// A path in its output folder.
    pub fn out(&self, name: &str) -> PathBuf {
        self.bench.path(&format!("{}.out", self.name)).join(name)
    }

    /// What it said so far.
    pub fn said(&self) -> String {
        let read = |ending: &str| {
            fs::read_to_string(self.bench.path(&format!("{}.{ending}", self.name)))
                .unwrap_or_default()
        };
        format!("{}{}", read("stdout"), read("stderr"))
    }

    /// Its entry in the registry, once it has `stages` processes.
    pub fn entry(&mut self, stages: usize) -> anyhow::Result<RunEntry> {
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            let pid = self.child.id();
            let entry = self.bench.ps()?.into_iter().find(|entry| entry.pid == pid);
            if let Some(entry) = entry.filter(|entry| entry.stages.len() >= stages) {
                return Ok(entry);
            }
            ensure!(self.child.try_wait()?.is_none(), "the set has ended: {}", self.said());
            std::thread::sleep(LOOK);
        }
        bail!("the set did not start: {}", self.said())
    }

    /// Its entry, once states have come for a while.
    pub fn running(&mut self) -> anyhow::Result<RunEntry> {
        let entry = self.entry(5)?;
        let run = entry.run_id().context("a run")?;
        let mut guest = Guest::attach(run, entry.pace, false, Stop::new())?;
        let mut figures = orime_probe::Figures::new();
        wait_for("states", || {
            while let Some(record) = guest.records.try_next()? {
                figures.add(&record);
            }
            ensure!(entry.is_alive(), "the set has ended: {}", self.said());
            Ok((figures.steps() >= 8).then_some(()))
        })?;
        Ok(entry)
    }

    /// The process of a stage.
    pub fn stage_pid(&mut self, stage: &str) -> anyhow::Result<u32> {
        self.stage_pid_of(stage, 5)
    }

    /// … of a set of so many processes.
    pub fn stage_pid_of(&mut self, stage: &str, stages: usize) -> anyhow::Result<u32> {
        let entry = self.entry(stages)?;
        let found = entry.stages.iter().find(|(name, _)| name == stage);
        Ok(found.with_context(|| format!("no {stage} in {entry:?}"))?.1)
    }

    /// Events so far of this kind and stage.
    pub fn events(&self, kind: &str, stage: &str) -> Vec<Value> {
        let text = fs::read_to_string(self.out("events.jsonl")).unwrap_or_default();
        let events = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
        let is_meant =
            |event: &Value| event["event"] == kind && (stage.is_empty() || event["stage"] == stage);
        events.filter(is_meant).collect()
    }

    /// When the `n`-th event of this kind and stage was raised, waiting for it.
    pub fn await_event(&mut self, kind: &str, stage: &str, n: usize) -> anyhow::Result<u64> {
        wait_for(&format!("event {kind} of {stage}; said: {}", self.said()), || {
            let at = self.events(kind, stage).get(n).and_then(|event| event["at_ns"].as_u64());
            if at.is_none() {
                ensure!(self.child.try_wait()?.is_none(), "the set has ended: {}", self.said());
            }
            Ok(at)
        })
    }

    /// Kills a stage and waits until the set has recovered: milliseconds from kill to the first
    /// state that came through the new process.
    pub fn kill_and_recover(&mut self, stage: &str) -> anyhow::Result<f64> {
        let before = self.events("recovered", stage).len();
        let killed_ns = now_ns();
        signal(self.stage_pid(stage)?, Signal::KILL)?;
        let recovered_ns = self.await_event("recovered", stage, before)?;
        Ok(ms_since(killed_ns, recovered_ns))
    }

    /// Waits for its end: its status, and what it wrote about itself.
    pub fn wait(&mut self) -> anyhow::Result<(i32, Value)> {
        wait_for("the end of the set", || Ok(self.child.try_wait()?))
            .with_context(|| self.said())?;
        let code = self.child.try_wait()?.and_then(|status| status.code()).unwrap_or(-1);
        let text = fs::read_to_string(self.out("run.json")).unwrap_or_default();
        Ok((code, serde_json::from_str(&text).unwrap_or_default()))
    }

    /// Stops it in order; it must end well.
    pub fn stop(&mut self) -> anyhow::Result<Value> {
        signal(self.pid(), Signal::TERM)?;
        let (code, summary) = self.wait()?;
        ensure!(code == 0, "ended with {code}: {}", self.said());
        Ok(summary)
    }
}

impl Drop for Set<'_> {
    fn drop(&mut self) {
        let start = Instant::now();
        while matches!(self.child.try_wait(), Ok(None)) {
            // In order first, so that nothing of it stays; at once if it does not listen.
            let _ = signal(self.pid(), Signal::TERM);
            if start.elapsed() > Duration::from_secs(20) {
                let _ = self.child.kill();
            }
            std::thread::sleep(Duration::from_millis(100)); // Between looks.
        }
    }
}
