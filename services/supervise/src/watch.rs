//! From the first process to the last: starting in order, watching, stopping.

use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use orime_messages::Stage;
use orime_runtime::{Guest, READY, RunEntry, RunId, now_ns};
use rustix::process::Signal;
use signal_hook::consts::{SIGBUS, SIGHUP, SIGINT, SIGTERM};

use crate::check::CheckedSet;
use crate::exit::Failure;
use crate::process::{Launch, Process, Said};
use crate::progress::Progress;

/// Time between two looks at everything.
const TICK: Duration = Duration::from_millis(40);
/// Time that the end of the stream may take through the whole set after a stop.
const DRAIN: Duration = Duration::from_secs(10);
/// Time from SIGTERM to SIGKILL.
const TERMINATE: Duration = Duration::from_secs(2);
/// Time that the others may take once one process has ended in order, the judge's pictures
/// included.
const FINISH: Duration = Duration::from_secs(120);

/// How a set ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// Its source ended.
    Finished,
    /// Somebody asked it to stop, and it did.
    Stopped,
    /// Somebody asked twice: ended at once.
    Interrupted,
    /// Something went wrong; what, and the end of its log.
    Failed(String),
}

/// A set that is being watched.
#[derive(Debug)]
pub struct Watch {
    /// What it is doing.
    pub progress: Progress,
    /// Its records.
    pub guest: Guest,
    /// Time that a process may take to get ready.
    pub ready: Duration,
    /// Time without progress after which the set counts as hung.
    pub stall: Duration,
    /// No live line.
    pub quiet: bool,
}

/// Signals that were sent to the supervisor.
struct Asked {
    stop: Arc<AtomicBool>,
}

impl Asked {
    fn listen() -> std::io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            signal_hook::flag::register(signal, Arc::clone(&stop))?;
        }
        Ok(Self { stop })
    }

    /// Whether somebody asked since the last look.
    fn again(&self) -> bool {
        self.stop.swap(false, Ordering::Relaxed)
    }
}

impl Watch {
    /// Starts everything, consumers first, and watches until nothing is left.
    pub fn run(
        &mut self,
        set: &CheckedSet,
        entry: &RunEntry,
        run: RunId,
        out: &Path,
        judge: bool,
    ) -> Result<Ending, Failure> {
        let asked = Asked::listen()
            .map_err(|error| Failure::machine(format!("handling signals: {error}")))?;
        let launch = Launch { run, set: &set.file.path, out, cameras: set.cameras.len() };
        let (said_by, said) = channel();
        let mut processes = Vec::new();
        let judge = judge.then_some(Stage::Judge);
        let consumers = [Stage::Simulate, Stage::Register, Stage::Segment];
        for stage in judge.into_iter().chain(consumers) {
            processes.push(launch.start(stage, &said_by)?);
        }
        if let Some(ending) = self.await_ready(&mut processes, &said, &asked) {
            return Ok(ending);
        }
        processes.push(launch.start(Stage::Capture, &said_by)?);
        let stages = processes.iter().map(|p| (p.stage.name().to_owned(), p.pid())).collect();
        RunEntry { stages, ..entry.clone() }
            .register()
            .map_err(|error| Failure::machine(format!("registering the run: {error}")))?;
        self.progress.moved_ns = now_ns();
        let ending = self.follow(&mut processes, &said, &asked);
        end(&mut processes);
        // The last records are in shared memory of processes that have ended: still readable.
        self.read();
        Ok(ending)
    }

    /// Waits until all are ready; an ending if that does not happen.
    fn await_ready(
        &mut self,
        processes: &mut [Process],
        said: &Receiver<Said>,
        asked: &Asked,
    ) -> Option<Ending> {
        let deadline = Instant::now() + self.ready;
        let mut waiting: Vec<Stage> = processes.iter().map(|process| process.stage).collect();
        while !waiting.is_empty() {
            if let Ok(said) = said.recv_timeout(TICK)
                && said.line.starts_with(READY)
            {
                waiting.retain(|stage| *stage != said.stage);
            }
            if asked.again() {
                return Some(Ending::Stopped);
            }
            if let Some(k) = first_ended(processes, None) {
                return Some(failed(&mut processes[k], "ended before it was ready"));
            }
            if Instant::now() > deadline {
                let late = processes.iter_mut().find(|process| waiting.contains(&process.stage));
                return late.map(|late| failed(late, "did not get ready in time (--ready-s)"));
            }
        }
        None
    }

    /// Watches a running set until all its processes have ended, or something fails.
    fn follow(
        &mut self,
        processes: &mut [Process],
        said: &Receiver<Said>,
        asked: &Asked,
    ) -> Ending {
        let mut stopping: Option<Instant> = None;
        let mut finishing: Option<Instant> = None;
        loop {
            std::thread::sleep(TICK);
            self.read();
            for said in said.try_iter().filter(|said| said.stage == Stage::Judge) {
                self.progress.judge_said(&said.line);
            }
            if !self.quiet {
                self.progress.show();
            }
            if asked.again() {
                if stopping.is_some() {
                    return Ending::Interrupted;
                }
                stopping = Some(Instant::now());
                stop_capture(processes);
            }
            match look(processes) {
                Look::Failed(ending) => return ending,
                Look::AllEnded if stopping.is_some() => return Ending::Stopped,
                Look::AllEnded => return Ending::Finished,
                Look::SomeEnded => _ = finishing.get_or_insert_with(Instant::now),
                Look::AllRun => {}
            }
            if stopping.is_some_and(|since| since.elapsed() > DRAIN) {
                return self.hung(processes, "did not end when it was asked to");
            }
            if finishing.is_some_and(|since| since.elapsed() > FINISH) {
                return self.hung(processes, "did not end when its input had ended");
            }
            let still_ns = now_ns().saturating_sub(self.progress.moved_ns);
            if finishing.is_none() && u128::from(still_ns) > self.stall.as_nanos() {
                return self.hung(processes, "made no progress (--stall-s)");
            }
        }
    }

    fn read(&mut self) {
        // The set itself does not depend on what its supervisor reads.
        if let Err(error) = self.progress.read(&mut self.guest) {
            eprintln!("orime: {error}");
        }
    }

    /// Names the process that holds the others up.
    fn hung(&self, processes: &mut [Process], what: &str) -> Ending {
        let judge = processes.iter().any(|process| process.stage == Stage::Judge);
        let holdup = self.progress.holdup(judge);
        let runs = |process: &mut Process| process.poll().is_none();
        let culprit = processes.iter().position(|process| process.stage == holdup);
        let culprit = culprit.filter(|k| runs(&mut processes[*k]));
        let culprit = culprit.or_else(|| processes.iter_mut().position(runs));
        match culprit {
            Some(k) => failed(&mut processes[k], what),
            None => Ending::Failed(format!("the set {what}")),
        }
    }
}

/// How the processes stand.
enum Look {
    AllRun,
    SomeEnded,
    AllEnded,
    Failed(Ending),
}

fn look(processes: &mut [Process]) -> Look {
    let mut running = 0;
    for process in processes.iter_mut() {
        match process.poll() {
            None => running += 1,
            Some(status) if status.success() => {}
            Some(status) => {
                let hint = match status.signal() {
                    Some(SIGBUS) => " (is /dev/shm full? `df -h /dev/shm`)",
                    _ => "",
                };
                let what = format!("{status}{hint}");
                return Look::Failed(failed(process, &what));
            }
        }
    }
    // A stage ends in order only when the stream has: capture is the first to know.
    let capture = Some(Stage::Capture);
    let capture_runs = processes.iter_mut().any(|p| Some(p.stage) == capture && p.poll().is_none());
    if capture_runs && let Some(k) = first_ended(processes, capture) {
        let early = failed(&mut processes[k], "ended although its input goes on");
        return Look::Failed(early);
    }
    match running {
        0 => Look::AllEnded,
        n if n < processes.len() => Look::SomeEnded,
        _ => Look::AllRun,
    }
}

/// The first process that has ended, not looking at `but`.
fn first_ended(processes: &mut [Process], but: Option<Stage>) -> Option<usize> {
    (0..processes.len()).find(|k| {
        let process = &mut processes[*k];
        Some(process.stage) != but && process.poll().is_some()
    })
}

fn stop_capture(processes: &mut [Process]) {
    for process in processes.iter_mut().filter(|process| process.stage == Stage::Capture) {
        process.signal(Signal::TERM);
    }
}

/// Ends what still runs: SIGTERM, a moment, SIGKILL; everything is reaped.
fn end(processes: &mut Vec<Process>) {
    for process in processes.iter_mut() {
        process.signal(Signal::TERM);
    }
    let deadline = Instant::now() + TERMINATE;
    while processes.iter_mut().any(|process| process.poll().is_none()) && Instant::now() < deadline
    {
        std::thread::sleep(TICK / 4);
    }
    // Dropping a process that still runs kills and reaps it.
    processes.clear();
}

fn failed(process: &mut Process, what: &str) -> Ending {
    let tail = process.log_tail();
    let log = process.log.display();
    let name = process.stage.name();
    if tail.is_empty() {
        return Ending::Failed(format!("stage `{name}`: {what}; its log `{log}` is empty"));
    }
    Ending::Failed(format!("stage `{name}`: {what}; its log `{log}` ends:\n{tail}"))
}
