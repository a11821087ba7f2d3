//! From the first process to the last: starting in order, watching, stopping.

use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use orime_messages::Stage;
use orime_runtime::{Guest, READY, RunEntry, RunId, now_ns};
use rustix::process::Signal;
use signal_hook::consts::SIGBUS;

use crate::asked::Asked;
use crate::check::CheckedSet;
use crate::exit::Failure;
use crate::process::{Launch, Process, Said};
use crate::progress::Progress;
use crate::recording::Recording;

/// Time between two looks at everything.
pub const TICK: Duration = Duration::from_millis(40);
/// Time that the end of the stream may take through the whole set after a stop.
const DRAIN: Duration = Duration::from_secs(10);
/// Time from SIGTERM to SIGKILL.
const TERMINATE: Duration = Duration::from_secs(2);
/// Time that the others may take once one process has ended in order, the judge's pictures
/// included.
const FINISH: Duration = Duration::from_secs(120);
/// Time that the last words of processes that have ended may take.
const LAST_WORDS: Duration = Duration::from_secs(1);

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
    /// What is recorded of it.
    pub recording: Option<Recording>,
    /// Time that a process may take to get ready.
    pub ready: Duration,
    /// Time without progress after which the set counts as hung.
    pub stall: Duration,
    /// No live line.
    pub quiet: bool,
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
        asked: &Asked,
    ) -> Result<Ending, Failure> {
        if asked.again() {
            return Ok(Ending::Stopped);
        }
        let record = self.recording.as_ref().map(|recording| recording.file.clone());
        let (cameras, record) = (set.cameras.len(), record.as_deref());
        let launch = Launch { run, set: &set.file.path, out, cameras, record };
        let (said_by, said) = channel();
        let mut processes = Vec::new();
        let listeners = [judge.then_some(Stage::Judge), record.map(|_| Stage::Record)];
        let consumers = [Stage::Simulate, Stage::Register, Stage::Segment];
        for stage in listeners.into_iter().flatten().chain(consumers) {
            processes.push(launch.start(stage, &said_by)?);
        }
        if let Some(ending) = self.await_ready(&mut processes, &said, asked) {
            drop(said_by);
            self.end(&mut processes, &said);
            return Ok(ending);
        }
        processes.push(launch.start(Stage::Capture, &said_by)?);
        let stages = processes.iter().map(|p| (p.stage.name().to_owned(), p.pid())).collect();
        RunEntry { stages, ..entry.clone() }
            .register()
            .map_err(|error| Failure::machine(format!("registering the run: {error}")))?;
        self.progress.moved_ns = now_ns();
        drop(said_by);
        let ending = self.follow(&mut processes, &said, asked);
        self.end(&mut processes, &said);
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
            if let Some(k) = first_ended(processes, &[]) {
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
            said.try_iter().for_each(|said| self.hear(&said));
            if let Some(recording) = &mut self.recording {
                recording.look(processes, &self.guest);
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
            let still_ns = now_ns().saturating_sub(self.progress.moved_ns);
            let hangs = if stopping.is_some_and(|since| since.elapsed() > DRAIN) {
                "did not end when it was asked to"
            } else if finishing.is_some_and(|since| since.elapsed() > FINISH) {
                "did not end when its input had ended"
            } else if finishing.is_none() && u128::from(still_ns) > self.stall.as_nanos() {
                "made no progress (--stall-s)"
            } else {
                continue;
            };
            if let Some(ending) = self.hung(processes, hangs) {
                return ending;
            }
            // It was the recorder: the others get the time that they had.
            self.progress.moved_ns = now_ns();
            stopping = stopping.map(|_| Instant::now());
            finishing = finishing.map(|_| Instant::now());
        }
    }

    /// Ends what still runs, and hears what it says last.
    fn end(&mut self, processes: &mut Vec<Process>, said: &Receiver<Said>) {
        end(processes);
        while let Ok(said) = said.recv_timeout(LAST_WORDS) {
            self.hear(&said);
        }
    }

    fn hear(&mut self, Said { stage, line }: &Said) {
        match (stage, &mut self.recording) {
            (Stage::Judge, _) => self.progress.judge_said(line),
            (Stage::Record, Some(recording)) => recording.said(line),
            _ => {}
        }
    }

    fn read(&mut self) {
        // The set itself does not depend on what its supervisor reads.
        if let Err(error) = self.progress.read(&mut self.guest) {
            eprintln!("orime: {error}");
        }
    }

    /// Names the process that holds the others up; `None` if it was the recorder, which is ended
    /// then.
    fn hung(&mut self, processes: &mut [Process], what: &str) -> Option<Ending> {
        let runs = |process: &mut Process| process.poll().is_none();
        let running: Vec<Stage> =
            processes.iter_mut().filter_map(|p| runs(p).then_some(p.stage)).collect();
        let judge = processes.iter().any(|process| process.stage == Stage::Judge);
        let recorded = self.recording.as_ref().filter(|_| running.contains(&Stage::Record));
        let holdup = self.progress.holdup(judge, recorded.map(|recording| recording.step));
        let culprit = if running.contains(&holdup) { Some(&holdup) } else { running.first() };
        let culprit = processes.iter().position(|process| Some(&process.stage) == culprit);
        match (culprit.map(|k| &mut processes[k]), &mut self.recording) {
            (None, _) => Some(Ending::Failed(format!("the set {what}"))),
            (Some(process), Some(recording)) if process.stage == Stage::Record => {
                recording.give_up(processes, &self.guest, what);
                None
            }
            (Some(process), _) => Some(failed(process, what)),
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
    let (mut running, mut ended) = (0, 0);
    for process in processes.iter_mut() {
        match process.poll() {
            None => running += 1,
            // However a recorder ends, that is no concern of the set's.
            Some(_) if process.stage == Stage::Record => {}
            Some(status) if status.success() => ended += 1,
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
    let capture_runs =
        processes.iter_mut().any(|p| p.stage == Stage::Capture && p.poll().is_none());
    if capture_runs && let Some(k) = first_ended(processes, &[Stage::Capture, Stage::Record]) {
        let early = failed(&mut processes[k], "ended although its input goes on");
        return Look::Failed(early);
    }
    match (running, ended) {
        (0, _) => Look::AllEnded,
        (_, 0) => Look::AllRun,
        _ => Look::SomeEnded,
    }
}

/// The first process that has ended, not looking at `but`.
fn first_ended(processes: &mut [Process], but: &[Stage]) -> Option<usize> {
    (0..processes.len()).find(|k| {
        let process = &mut processes[*k];
        !but.contains(&process.stage) && process.poll().is_some()
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
