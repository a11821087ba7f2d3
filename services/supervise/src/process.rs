//! One process of a set: started, listened to, ended, reaped.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use orime_messages::{PROTOCOL, Stage};
use orime_runtime::{
    CAMERAS_VARIABLE, LOG_VARIABLE, PARENT_VARIABLE, PROTOCOL_VARIABLE, RESUME_VARIABLE,
    RUN_VARIABLE, Resume, RunId, SPARE_VARIABLE,
};
use rustix::process::{Pid, Signal, kill_process_group};

use crate::exit::Failure;

/// Time that the last record of a process may take to be read.
const LAST_RECORD: Duration = Duration::from_millis(200);

/// A line that a process printed on its standard output.
#[derive(Debug)]
pub struct Said {
    /// Who.
    pub stage: Stage,
    /// Which process of that stage.
    pub pid: u32,
    /// What.
    pub line: String,
}

/// A process of the set; killed with its group if it is dropped while it runs.
#[derive(Debug)]
pub struct Process {
    /// Its part.
    pub stage: Stage,
    /// Its standard error.
    pub log: PathBuf,
    /// When it was started.
    pub started: Instant,
    /// Whether it has said that it is ready.
    pub is_ready: bool,
    /// Why it was ended from here, if it was.
    pub ended_because: Option<&'static str>,
    /// Of a spare: where it is told that its turn has come.
    turn: Option<ChildStdin>,
    child: Child,
    status: Option<ExitStatus>,
    ended: Option<Instant>,
}

/// What every process of a run is started with.
#[derive(Debug)]
pub struct Launch<'a> {
    /// The run.
    pub run: RunId,
    /// The set file.
    pub set: &'a Path,
    /// Where the run writes.
    pub out: &'a Path,
    /// Cameras of the set.
    pub cameras: usize,
    /// What the recorder writes, if there is one.
    pub record: Option<&'a Path>,
    /// Whether what the stages say to each other is recorded too.
    pub record_stages: bool,
    /// Whether stages log JSON.
    pub log_json: bool,
    /// The set file whose source has taken the set's own one's place, and since which step.
    pub source: Option<(PathBuf, u64)>,
}

/// How a process comes to its part.
#[derive(Debug, Clone, Copy)]
pub enum Part {
    /// It is the first of its stage.
    First,
    /// It takes the place of one that has ended.
    Successor(Resume),
    /// It waits for one to end, see [`Process::take_turn`].
    Spare,
}

impl Launch<'_> {
    /// Starts a stage; what it prints goes to `said`, what it logs to `OUT/logs/STAGE.log`, after
    /// what its predecessor logged if it goes on where that one ended.
    pub fn start(&self, stage: Stage, part: Part, said: &Sender<Said>) -> Result<Process, Failure> {
        let program = program(stage)?;
        let set = self.source_of(stage).map_or(self.set, |(set, _)| set.as_path());
        let log = self.out.join("logs").join(format!("{}.log", stage.name()));
        let log_file = open_log(&log, !matches!(part, Part::First))?;
        let mut command = Command::new(&program);
        if stage == Stage::Judge {
            command.arg("watch").arg(set).arg("--out").arg(self.out);
        } else {
            command.arg(set);
        }
        if let (Stage::Record, Some(file)) = (stage, self.record) {
            command.arg("--file").arg(file);
            if self.record_stages {
                command.arg("--stages");
            }
        }
        if self.log_json {
            command.env(LOG_VARIABLE, "json");
        }
        match part {
            Part::First => {}
            Part::Successor(resume) => {
                let text = serde_json::to_string(&self.resume(stage, resume))
                    .map_err(|error| Failure::machine(error.to_string()))?;
                command.env(RESUME_VARIABLE, text);
            }
            Part::Spare => _ = command.env(SPARE_VARIABLE, "1"),
        }
        let is_spare = matches!(part, Part::Spare);
        let mut child = command
            // A log ends in what went wrong, not in where this program noticed.
            .env("RUST_LIB_BACKTRACE", "0")
            .env(RUN_VARIABLE, self.run.to_string())
            .env(CAMERAS_VARIABLE, self.cameras.to_string())
            .env(PROTOCOL_VARIABLE, PROTOCOL)
            .env(PARENT_VARIABLE, std::process::id().to_string())
            .stdin(if is_spare { Stdio::piped() } else { Stdio::null() })
            .stdout(Stdio::piped())
            .stderr(log_file)
            // Out of the terminal's group: what a Ctrl-C means is decided here.
            .process_group(0)
            .spawn()
            .map_err(|error| {
                Failure::machine(format!("starting `{}`: {error}", program.display()))
            })?;
        if let Some(stdout) = child.stdout.take() {
            let (said, pid) = (said.clone(), child.id());
            std::thread::spawn(move || {
                for line in BufReader::new(stdout).lines().map_while(Result::ok) {
                    if said.send(Said { stage, pid, line }).is_err() {
                        return;
                    }
                }
                // Its output ends with it: whoever waits for a word looks at once how it is.
                let _ = said.send(Said { stage, pid, line: String::new() });
            });
        }
        Ok(Process {
            stage,
            log,
            started: Instant::now(),
            is_ready: false,
            ended_because: None,
            turn: child.stdin.take(),
            child,
            status: None,
            ended: None,
        })
    }

    /// What a successor is told.
    pub fn resume(&self, stage: Stage, resume: Resume) -> Resume {
        let source_began = self.source_of(stage).map_or(0, |(_, step)| *step);
        Resume { source_began, ..resume }
    }

    /// The source that has taken the place of capture's own.
    fn source_of(&self, stage: Stage) -> Option<&(PathBuf, u64)> {
        self.source.as_ref().filter(|_| stage == Stage::Capture)
    }
}

/// Opens a stage's log; a successor goes on where its predecessor ended.
fn open_log(log: &Path, goes_on: bool) -> Result<File, Failure> {
    let cannot =
        |error: io::Error| Failure::machine(format!("writing `{}`: {error}", log.display()));
    // Always at the end: a stage and its spare write to one file.
    let file = OpenOptions::new().create(true).append(true).open(log).map_err(cannot)?;
    if !goes_on {
        file.set_len(0).map_err(cannot)?;
    }
    Ok(file)
}

/// The program of a stage, beside this one.
pub fn program(stage: Stage) -> Result<PathBuf, Failure> {
    let name = match stage {
        Stage::Judge => "orime-evaluate".to_owned(),
        stage => format!("orime-{}", stage.name()),
    };
    let own = std::env::current_exe()
        .map_err(|error| Failure::machine(format!("finding this program: {error}")))?;
    let path = own.with_file_name(name);
    if path.is_file() {
        return Ok(path);
    }
    Err(Failure::machine(format!(
        "`{}` is not there: build all of it with `cargo build --release --workspace`",
        path.display()
    )))
}

impl Process {
    /// Tells a spare that it is to take the place of one that has ended; `false` if it cannot.
    pub fn take_turn(&mut self, resume: Resume) -> bool {
        let Some(mut turn) = self.turn.take() else { return false };
        self.started = Instant::now();
        let Ok(text) = serde_json::to_string(&resume) else { return false };
        writeln!(turn, "{text}").is_ok() && self.runs()
    }

    /// Its process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Whether it still runs.
    pub fn runs(&mut self) -> bool {
        self.poll().is_none()
    }

    /// Whether a record of its end may still be on its way.
    pub fn may_have_said_more(&self) -> bool {
        let is_fresh = self.ended.is_some_and(|ended| ended.elapsed() < LAST_RECORD);
        is_fresh && self.ended_because.is_none()
    }

    /// How it ended, if it has.
    pub fn poll(&mut self) -> Option<ExitStatus> {
        if self.status.is_none() {
            self.status = self.child.try_wait().ok().flatten();
            self.ended = self.status.map(|_| Instant::now());
        }
        self.status
    }

    /// Sends a signal to it and whatever it started, unless it has ended.
    pub fn signal(&mut self, signal: Signal) {
        if self.poll().is_none()
            && let Some(group) = Pid::from_raw(self.child.id() as i32)
        {
            // It may end in this very moment; then there is nothing to do.
            let _ = kill_process_group(group, signal);
        }
    }

    /// The last lines of its log.
    pub fn log_tail(&self) -> String {
        log_tail(&self.log).unwrap_or_default()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if self.poll().is_none() {
            self.signal(Signal::KILL);
            let _ = self.child.wait();
        }
    }
}

/// Lines of a log that are shown when its process failed.
const TAIL_LINES: usize = 12;
/// Bytes from the end in which these are looked for.
const TAIL_BYTES: u64 = 8192;

fn log_tail(path: &Path) -> io::Result<String> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL_BYTES)))?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    let text = String::from_utf8_lossy(&bytes);
    let lines: Vec<&str> = text.lines().collect();
    let tail = &lines[lines.len().saturating_sub(TAIL_LINES)..];
    Ok(tail.iter().map(|line| format!("    {line}\n")).collect())
}
