//! The processes of a set: started in order, restarted one by one, ended together.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use orime_messages::Stage;
use orime_runtime::{Guest, READY, Resume};
use rustix::process::Signal;

use crate::exit::Failure;
use crate::policy::{Budget, History};
use crate::process::{Launch, Part, Process, Said};

/// Time from one spare's start to the next one's: the set is not to feel it.
const SPARE_PAUSE: Duration = Duration::from_secs(1);
/// Time from SIGTERM to SIGKILL.
const TERMINATE: Duration = Duration::from_secs(2);

/// A stage that is down and will be started again.
#[derive(Debug)]
struct Pending {
    stage: Stage,
    due: Instant,
}

/// All processes of a set.
#[derive(Debug)]
pub struct Fleet<'a> {
    launch: Launch<'a>,
    /// Those that run, or have ended and were not replaced.
    pub processes: Vec<Process>,
    pending: Vec<Pending>,
    /// Processes that wait for one of their stage to die.
    spares: Vec<Process>,
    spare_started: Instant,
    /// Stages whose spare has ended by itself: another one would do the same.
    without_spare: BTreeSet<Stage>,
    histories: BTreeMap<Stage, History>,
    budget: Budget,
    said_by: Option<Sender<Said>>,
    said: Receiver<Said>,
    /// The set file whose source capture's successor takes.
    source: Option<PathBuf>,
}

impl<'a> Fleet<'a> {
    /// No process yet.
    pub fn new(launch: Launch<'a>, budget: Budget) -> Self {
        let (said_by, said) = channel();
        Self {
            launch,
            processes: Vec::new(),
            pending: Vec::new(),
            spares: Vec::new(),
            spare_started: Instant::now(),
            without_spare: BTreeSet::new(),
            histories: BTreeMap::new(),
            budget,
            said_by: Some(said_by),
            said,
            source: None,
        }
    }

    /// Starts a stage, or its successor.
    pub fn start(&mut self, stage: Stage, part: Part) -> Result<(), Failure> {
        let Some(said_by) = &self.said_by else { return Ok(()) };
        let process = self.launch.start(stage, part, said_by)?;
        self.place(process);
        Ok(())
    }

    fn place(&mut self, process: Process) {
        self.processes.retain(|other| other.stage != process.stage);
        self.processes.push(process);
    }

    /// Starts one of the spares that are missing, if it is time to.
    pub fn keep_spares(&mut self) -> Result<(), Failure> {
        let without = &mut self.without_spare;
        self.spares.retain_mut(|spare| {
            let runs = spare.runs();
            if !runs {
                without.insert(spare.stage);
            }
            runs
        });
        let Some(said_by) = &self.said_by else { return Ok(()) };
        let has_spare = |stage: &Stage| {
            self.without_spare.contains(stage) || self.spares.iter().any(|p| p.stage == *stage)
        };
        let missing = Stage::PIPELINE.into_iter().find(|stage| !has_spare(stage));
        let Some(stage) = missing.filter(|_| self.spare_started.elapsed() > SPARE_PAUSE) else {
            return Ok(());
        };
        self.spare_started = Instant::now();
        self.spares.push(self.launch.start(stage, Part::Spare, said_by)?);
        Ok(())
    }

    /// The process of a stage, if there is one.
    pub fn process(&mut self, stage: Stage) -> Option<&mut Process> {
        self.processes.iter_mut().find(|process| process.stage == stage)
    }

    /// Names and process ids of all stages.
    pub fn stages(&self) -> Vec<(String, u32)> {
        self.processes.iter().map(|p| (p.stage.name().to_owned(), p.pid())).collect()
    }

    /// Whether a stage's process runs.
    pub fn runs(&mut self, stage: Stage) -> bool {
        self.process(stage).is_some_and(|process| process.poll().is_none())
    }

    /// Whether a stage is down and will come back.
    pub fn is_pending(&self, stage: Stage) -> bool {
        self.pending.iter().any(|pending| pending.stage == stage)
    }

    /// Whether any stage is down, not ready, or killed and not gone yet: the kernel takes tens of
    /// milliseconds to give back the memory of a process.
    pub fn is_disturbed(&mut self) -> bool {
        let is_on_its_way = |p: &Process| !p.is_ready || p.ended_because.is_some();
        !self.pending.is_empty()
            || self.processes.iter_mut().any(|p| is_on_its_way(p) && p.poll().is_none())
    }

    /// What the processes said since the last look, waiting for it for a while at most. That one
    /// is ready is noted.
    pub fn hear(&mut self, wait: Duration) -> Vec<Said> {
        let first = match wait.is_zero() {
            true => None,
            false => self.said.recv_timeout(wait).ok(),
        };
        let lines: Vec<Said> = first.into_iter().chain(self.said.try_iter()).collect();
        for said in lines.iter().filter(|said| said.line.starts_with(READY)) {
            let process = self.processes.iter_mut().find(|process| process.pid() == said.pid);
            if let Some(process) = process {
                process.is_ready = true;
            }
        }
        lines
    }

    /// Lines that are still on their way from processes that have ended.
    pub fn last_words(&mut self, patience: Duration) -> Vec<Said> {
        self.said_by = None;
        std::iter::from_fn(|| self.said.recv_timeout(patience).ok()).collect()
    }

    /// A stage has died: plans its successor. The pause before it, or `None` if the budget is
    /// spent.
    pub fn plan(&mut self, stage: Stage, is_free: bool) -> Option<Duration> {
        let now = Instant::now();
        let history = self.histories.entry(stage).or_default();
        let pause = if is_free { Some(Duration::ZERO) } else { history.died(self.budget, now) }?;
        self.pending.push(Pending { stage, due: now + pause });
        Some(pause)
    }

    /// The stages whose successors are due now; they are no longer pending.
    pub fn due(&mut self) -> Vec<Stage> {
        let now = Instant::now();
        let (due, later) =
            std::mem::take(&mut self.pending).into_iter().partition(|pending| pending.due <= now);
        self.pending = later;
        due.into_iter().map(|pending: Pending| pending.stage).collect()
    }

    /// Starts the successor of a stage, once the members of the run that died were cleared.
    pub fn restart(&mut self, stage: Stage, resume: Resume, guest: &Guest) -> Result<(), Failure> {
        guest.clear_dead_members();
        let other = self.source.take_if(|_| stage == Stage::Capture);
        let spare = self.spares.iter().position(|spare| spare.stage == stage);
        let spare = spare.map(|at| self.spares.remove(at));
        if let Some(set) = other {
            // Its spare has opened the source before.
            self.launch.source = Some((set, resume.next_set));
            return self.start(stage, Part::Successor(resume));
        }
        self.spare_started = Instant::now();
        let told = self.launch.resume(stage, resume);
        match spare.and_then(|mut spare| spare.take_turn(told).then_some(spare)) {
            Some(successor) => self.place(successor),
            None => self.start(stage, Part::Successor(resume))?,
        }
        Ok(())
    }

    /// Has capture's successor take the source of this set file; no change where there is none.
    pub fn change_source(&mut self, set: Option<PathBuf>) {
        self.source = set.or(self.source.take());
    }

    /// Signals a stage's process.
    pub fn signal(&mut self, stage: Stage, signal: Signal) {
        if let Some(process) = self.process(stage) {
            process.signal(signal);
        }
    }

    /// Kills a process that does not do its part; it counts as died.
    pub fn kill(&mut self, stage: Stage, because: &'static str) {
        if let Some(process) = self.process(stage) {
            process.ended_because = Some(because);
            process.signal(Signal::KILL);
        }
    }

    /// Ends what still runs: SIGTERM, a moment, SIGKILL; everything is reaped.
    pub fn end(&mut self) {
        self.pending.clear();
        self.spares.clear();
        for process in &mut self.processes {
            process.signal(Signal::TERM);
            // One that was stopped hears only after this.
            process.signal(Signal::CONT);
        }
        let deadline = Instant::now() + TERMINATE;
        while self.processes.iter_mut().any(|process| process.poll().is_none())
            && Instant::now() < deadline
        {
            std::thread::sleep(Duration::from_millis(10));
        }
        // Dropping a process that still runs kills and reaps it.
        self.processes.clear();
    }
}
