//! From the first process to the last: starting in order, watching, restarting, stopping.

use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::time::{Duration, Instant};

use orime_messages::Stage;
use orime_runtime::{Guest, Pace, RunEntry, RunId, now_ns};
use rustix::process::Signal;
use signal_hook::consts::SIGBUS;

use crate::asked::Asked;
use crate::check::CheckedSet;
use crate::clocks::{ClockEvent, Clocks, Reading};
use crate::control::{self, Wish};
use crate::ending::{Ending, Watched, failed};
use crate::events::{Events, Kind};
use crate::exit::Failure;
use crate::fleet::Fleet;
use crate::notify::Notify;
use crate::policy::Budget;
use crate::process::{Launch, Part, Process, Said};
use crate::progress::Progress;
use crate::recording::Recording;
use crate::recovery::Recovery;

/// Time between two looks at everything.
pub const TICK: Duration = Duration::from_millis(20);
/// Time that the end of the stream may take through the whole set after a stop.
const DRAIN: Duration = Duration::from_secs(10);
/// Time that the others may take once one process has ended in order, the judge's pictures
/// included.
const FINISH: Duration = Duration::from_secs(120);
/// Time that the last words of processes that have ended may take.
const LAST_WORDS: Duration = Duration::from_secs(1);
/// Time that a record is on its way to the supervisor: nobody is woken for it.
const RECORDS_WAY: Duration = Duration::from_millis(15);
/// Why a process ends that is to be restarted.
const ASKED: &str = "was asked to hand over";

/// How long what may take.
#[derive(Debug, Clone, Copy)]
pub struct Deadlines {
    /// Until a process is ready.
    pub ready: Duration,
    /// Without progress, until a stage counts as hung.
    pub stall: Duration,
    /// Restarts of each stage.
    pub budget: Budget,
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
    /// How long what may take.
    pub deadlines: Deadlines,
    /// Whether what the stages say to each other is recorded too.
    pub record_stages: bool,
    /// Whether stages log JSON.
    pub log_json: bool,
    /// Whether a spare process of each stage waits for one to die.
    pub spares: bool,
    /// No live line.
    pub quiet: bool,
    /// What happens besides the work.
    pub events: Events,
    /// Restarts so far.
    pub recoveries: Vec<Recovery>,
    /// The set's entry in the registry.
    pub entry: RunEntry,
    /// What systemd is told.
    pub notify: Notify,
    /// In lockstep: stages that wait while the one after them is away.
    pub frozen: Vec<(Stage, Stage)>,
    /// Since when the set is being stopped, and is ending.
    pub ending_since: [Option<Instant>; 2],
}

impl Watch {
    /// Leaves the run: from here on this process holds nothing of its shared memory.
    pub fn leave(self) -> Watched {
        let Self { progress, recoveries, events, recording, .. } = self;
        Watched { progress, recoveries, events, recording }
    }

    /// Starts everything, consumers first, and watches until nothing is left.
    pub fn run(
        &mut self,
        set: &CheckedSet,
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
        let (log_json, record_stages) = (self.log_json, self.record_stages);
        let (set, source) = (&set.file.path, None);
        let launch = Launch { run, set, out, cameras, record, record_stages, log_json, source };
        let mut fleet = Fleet::new(launch, self.deadlines.budget);
        let listeners = [judge.then_some(Stage::Judge), record.map(|_| Stage::Record)];
        let consumers = [Stage::Simulate, Stage::Register, Stage::Segment];
        for stage in listeners.into_iter().flatten().chain(consumers) {
            fleet.start(stage, Part::First)?;
        }
        let ending = match self.await_ready(&mut fleet, asked) {
            Some(ending) => ending,
            None => {
                fleet.start(Stage::Capture, Part::First)?;
                self.register(&fleet)?;
                self.progress.moved_ns = now_ns();
                self.notify.ready(&format!("run {run}"));
                self.follow(&mut fleet, asked)?
            }
        };
        self.notify.stopping();
        fleet.end();
        for said in fleet.last_words(LAST_WORDS) {
            self.hear(&said);
        }
        // The last records are in shared memory of processes that have ended: still readable.
        self.read();
        Ok(ending)
    }

    /// Tells others which processes there are.
    fn register(&mut self, fleet: &Fleet<'_>) -> Result<(), Failure> {
        self.entry.stages = fleet.stages();
        self.entry
            .register()
            .map_err(|error| Failure::machine(format!("registering the run: {error}")))
    }

    /// Waits until all are ready; an ending if that does not happen.
    fn await_ready(&mut self, fleet: &mut Fleet<'_>, asked: &Asked) -> Option<Ending> {
        let deadline = Instant::now() + self.deadlines.ready;
        while fleet.processes.iter().any(|process| !process.is_ready) {
            fleet.hear(TICK);
            if asked.again() {
                return Some(Ending::Stopped);
            }
            let ended = fleet.processes.iter_mut().position(|process| !process.runs());
            if let Some(ended) = ended {
                return Some(failed(&mut fleet.processes[ended], "ended before it was ready"));
            }
            if Instant::now() > deadline {
                let late = fleet.processes.iter_mut().find(|process| !process.is_ready);
                return late.map(|late| failed(late, "did not get ready in time (--ready-s)"));
            }
        }
        None
    }

    /// Watches a running set until all its processes have ended, or something fails for good.
    fn follow(&mut self, fleet: &mut Fleet<'_>, asked: &Asked) -> Result<Ending, Failure> {
        let mut clocks = Clocks::new(Reading::now());
        loop {
            let said = fleet.hear(TICK);
            // In this order: whoever has ended by now has said so in a record that is read below.
            fleet.processes.iter_mut().for_each(|process| _ = process.poll());
            self.read();
            said.iter().for_each(|said| self.hear(said));
            if let Some(recording) = &mut self.recording {
                recording.look(&mut fleet.processes, &self.guest);
            }
            if !self.quiet {
                self.progress.show();
            }
            self.look_at_clocks(&mut clocks);
            self.look_at_cameras(fleet);
            if asked.again() {
                if self.ending_since[0].is_some() {
                    return Ok(Ending::Interrupted);
                }
                self.ending_since[0] = Some(Instant::now());
                if !fleet.runs(Stage::Capture) && fleet.is_pending(Stage::Capture) {
                    return Ok(Ending::Stopped);
                }
                fleet.signal(Stage::Capture, Signal::TERM);
            }
            for wish in control::take_wishes(&self.entry.run) {
                self.hand_over(fleet, wish);
            }
            if let Some(ending) = self.look(fleet) {
                return Ok(ending);
            }
            self.restart_due(fleet)?;
            self.look_at_recoveries(fleet);
            self.keep_spares(fleet)?;
            if let Some(ending) = self.look_for_hung(fleet) {
                return Ok(ending);
            }
            let steps = self.progress.figures.steps();
            self.notify.alive(|| format!("{steps} states"));
        }
    }

    /// Has a stage end, so that another process takes its place.
    fn hand_over(&mut self, fleet: &mut Fleet<'_>, Wish { stage, source }: Wish) {
        let Some(process) = fleet.process(stage).filter(|process| process.is_ready) else { return };
        process.ended_because = Some(ASKED);
        process.signal(Signal::HUP);
        process.signal(Signal::CONT);
        let other = source.as_ref().map(|set| format!(", with the source of `{}`", set.display()));
        let text = format!("is restarted as asked{}", other.unwrap_or_default());
        fleet.change_source(source);
        self.note(Kind::Asked, Some(stage), text);
    }

    /// How the processes stand: an ending if all have ended or one cannot be replaced.
    fn look(&mut self, fleet: &mut Fleet<'_>) -> Option<Ending> {
        let (mut running, mut ended, mut died) = (0, 0, Vec::new());
        for process in &mut fleet.processes {
            match process.poll() {
                None => running += 1,
                // However a recorder ends, that is no concern of the set's.
                Some(_) if process.stage == Stage::Record => {}
                Some(_) if self.progress.ended_in_order(process) => ended += 1,
                // Its last word may still be on its way.
                Some(status) if status.success() && process.may_have_said_more() => running += 1,
                Some(_) => died.push(process.stage),
            }
        }
        if !died.is_empty() {
            // What they published last tells where their successors go on.
            std::thread::sleep(RECORDS_WAY);
            self.read();
        }
        for stage in died {
            if let Some(ending) = self.bury(fleet, stage) {
                return Some(ending);
            }
            running += 1;
        }
        if running > 0 || fleet.is_disturbed() {
            if ended > 0 {
                self.ending_since[1].get_or_insert_with(Instant::now);
            }
            return None;
        }
        let is_stopped = self.ending_since[0].is_some();
        Some(if is_stopped { Ending::Stopped } else { Ending::Finished })
    }

    /// Plans the successor of a stage that has died; an ending if there will be none.
    fn bury(&mut self, fleet: &mut Fleet<'_>, stage: Stage) -> Option<Ending> {
        let is_stopping = self.ending_since[0].is_some();
        let process = fleet.process(stage)?;
        let status = process.poll()?;
        let hint = match status.signal() {
            Some(SIGBUS) => " (is /dev/shm full? `df -h /dev/shm`)",
            _ if status.success() => " although its input goes on",
            _ => "",
        };
        let cause = match process.ended_because {
            Some(because) => because.to_owned(),
            None => format!("ended: {status}{hint}"),
        };
        let is_asked = process.ended_because == Some(ASKED);
        // What never got ready at all has nothing to go on from.
        let is_first = stage == Stage::Capture && !process.is_ready && self.recoveries.is_empty();
        let ending = failed(process, &cause);
        let pause = if is_stopping || is_first { None } else { fleet.plan(stage, is_asked) };
        let Some(pause) = pause else {
            let budget = self.deadlines.budget;
            let spent =
                format!("{cause}; not restarted: {} in {:?}", budget.restarts, budget.window);
            self.note(Kind::GaveUp, Some(stage), spent);
            return Some(ending);
        };
        let (figures, pipeline) = (&self.progress.figures, Stage::PIPELINE);
        self.recoveries.push(Recovery::begin(stage, cause.clone(), now_ns(), figures));
        self.note(
            Kind::Died,
            Some(stage),
            format!("{cause}; restarting in {} ms", pause.as_millis()),
        );
        fleet.processes.retain(|process| process.stage != stage);
        let at = pipeline.iter().position(|other| *other == stage);
        if let Some(before) = at.and_then(|at| at.checked_sub(1)).map(|at| pipeline[at])
            && self.entry.pace == Pace::Lockstep
        {
            // Nobody takes its messages now: it would run on without a listener.
            fleet.signal(before, Signal::STOP);
            self.frozen.push((before, stage));
        }
        None
    }

    /// Starts the successors that are due.
    fn restart_due(&mut self, fleet: &mut Fleet<'_>) -> Result<(), Failure> {
        for stage in fleet.due() {
            let resume = self.progress.resume(stage);
            fleet.restart(stage, resume, &self.guest)?;
            self.progress.moved_ns = now_ns();
            let goes_on = format!("is started again, from step {}", resume.wanted());
            self.note(Kind::Started, Some(stage), goes_on);
        }
        Ok(())
    }

    /// Has spares wait where the set runs as it should. In lockstep, where a set that lost a stage
    /// has failed anyway, there are none.
    fn keep_spares(&self, fleet: &mut Fleet<'_>) -> Result<(), Failure> {
        let is_quiet = self.progress.figures.steps() > 0
            && self.ending_since.iter().all(Option::is_none)
            && !self.recoveries.iter().any(Recovery::is_open)
            && !fleet.is_disturbed();
        if is_quiet && self.spares && self.entry.pace == Pace::Realtime {
            fleet.keep_spares()?;
        }
        Ok(())
    }

    /// Follows those that were restarted until the set has recovered.
    fn look_at_recoveries(&mut self, fleet: &mut Fleet<'_>) {
        let now = now_ns();
        let mut notes = Vec::new();
        let mut has_changed = false;
        for recovery in self.recoveries.iter_mut().filter(|recovery| recovery.is_open()) {
            let stage = recovery.of();
            if recovery.ready_ms.is_none() && fleet.process(stage).is_some_and(|p| p.is_ready) {
                recovery.is_ready(now);
                has_changed = true;
                let ms = recovery.ready_ms.unwrap_or(0.0);
                notes.push((Kind::Ready, stage, format!("is ready again after {ms:.0} ms")));
                self.frozen.retain(|(before, missing)| {
                    if *missing == stage {
                        fleet.signal(*before, Signal::CONT);
                    }
                    *missing != stage
                });
                // One that is not ready would die of it, and holds nothing yet.
                if fleet.process(Stage::Judge).is_some_and(|judge| judge.is_ready) {
                    fleet.signal(Stage::Judge, Signal::USR1);
                }
                // The end of its input may have passed while there was nobody to hear it.
                if self.progress.resume(stage).input_ended {
                    fleet.signal(stage, Signal::HUP);
                }
            }
            if recovery.look(&self.progress.figures) {
                let (ms, lost) = (recovery.state_ms.unwrap_or(0.0), recovery.messages_lost);
                let lost = lost.unwrap_or(0);
                let text = format!("works again: a state after {ms:.0} ms, {lost} messages lost");
                notes.push((Kind::Recovered, stage, text));
            }
        }
        for (kind, stage, text) in notes {
            self.note(kind, Some(stage), text);
        }
        if has_changed {
            // Whoever looks for the new process id reads it after it is ready.
            let _ = self.register(fleet);
        }
    }

    /// Kills what stands still while it should not; an ending if the set cannot end in time.
    fn look_for_hung(&mut self, fleet: &mut Fleet<'_>) -> Option<Ending> {
        let ready = self.deadlines.ready;
        let is_late = |p: &mut Process| {
            let is_late = !p.is_ready && p.started.elapsed() > ready;
            is_late && p.ended_because.is_none() && p.runs()
        };
        let late = fleet.processes.iter_mut().find_map(|p| is_late(p).then_some(p.stage));
        if let Some(stage) = late {
            let what = "did not get ready in time (--ready-s)";
            fleet.kill(stage, what);
            self.note(Kind::Hung, Some(stage), format!("{what} and is killed"));
            return None;
        }
        let [stopping, finishing] = self.ending_since;
        let what = if stopping.is_some_and(|since| since.elapsed() > DRAIN) {
            "did not end when it was asked to"
        } else if finishing.is_some_and(|since| since.elapsed() > FINISH) {
            "did not end when its input had ended"
        } else {
            return self.look_for_stalled(fleet);
        };
        let culprit = self.culprit(fleet);
        if self.end_recorder(fleet, culprit, what) {
            let again = |since: Option<Instant>| since.map(|_| Instant::now());
            self.ending_since = self.ending_since.map(again);
            return None;
        }
        let ending = culprit.and_then(|culprit| fleet.process(culprit)).map(|p| failed(p, what));
        Some(ending.unwrap_or_else(|| Ending::Failed(format!("the set {what}"))))
    }

    /// Kills a stage that has input and gives no result for too long; it is restarted then.
    fn look_for_stalled(&mut self, fleet: &mut Fleet<'_>) -> Option<Ending> {
        if fleet.is_disturbed() || !self.frozen.is_empty() || self.ending_since[1].is_some() {
            self.progress.begin_anew();
            return None;
        }
        let stall = self.deadlines.stall;
        let still_ns = u128::from(now_ns().saturating_sub(self.progress.moved_ns));
        let behind = self.progress.stalled(stall);
        let culprit = if still_ns > stall.as_nanos() {
            self.culprit(fleet)
        } else {
            let mut is_old = |stage: Stage| {
                let is_old = |p: &mut Process| p.started.elapsed() > stall && p.runs();
                fleet.process(stage).is_some_and(is_old)
            };
            behind.into_iter().find(|stage| is_old(*stage))
        };
        let culprit = culprit?;
        self.progress.moved_ns = now_ns();
        let what = "made no progress (--stall-s)";
        if !self.end_recorder(fleet, Some(culprit), what) {
            fleet.kill(culprit, what);
            self.note(Kind::Hung, Some(culprit), format!("{what} and is killed"));
        }
        None
    }

    /// The process that holds the others up.
    fn culprit(&mut self, fleet: &mut Fleet<'_>) -> Option<Stage> {
        let running: Vec<Stage> =
            fleet.processes.iter_mut().filter_map(|p| p.runs().then_some(p.stage)).collect();
        let judge = fleet.process(Stage::Judge).is_some();
        let recorded = self.recording.as_ref().filter(|_| running.contains(&Stage::Record));
        let holdup = self.progress.holdup(judge, recorded.map(|recording| recording.step));
        if running.contains(&holdup) { Some(holdup) } else { running.first().copied() }
    }

    /// Ends the recorder if it is the one that holds the others up.
    fn end_recorder(&mut self, fleet: &mut Fleet<'_>, culprit: Option<Stage>, what: &str) -> bool {
        match &mut self.recording {
            Some(recording) if culprit == Some(Stage::Record) => {
                recording.give_up(&mut fleet.processes, &self.guest, what);
                true
            }
            _ => false,
        }
    }

    fn look_at_clocks(&mut self, clocks: &mut Clocks) {
        let seconds = |ns: i64| ns as f64 * 1e-9;
        let (kind, text) = match clocks.look(Reading::now()) {
            Some(ClockEvent::Step(ns)) => {
                (Kind::ClockStep, format!("the wall clock was set by {:+.3} s", seconds(ns)))
            }
            Some(ClockEvent::Suspend(ns)) => {
                (Kind::Suspend, format!("the machine slept for {:.3} s", seconds(ns)))
            }
            None => return,
        };
        let unharmed = "no latency is measured with it";
        self.note(kind, None, format!("{text}; {unharmed}"));
    }

    fn look_at_cameras(&mut self, fleet: &mut Fleet<'_>) {
        let ends = self.ending_since.iter().any(Option::is_some);
        if self.entry.pace == Pace::Lockstep || ends || fleet.is_disturbed() {
            return;
        }
        for (camera, is_degraded) in self.progress.cameras_changed(now_ns()) {
            let (kind, what) = match is_degraded {
                true => (Kind::Degraded, "gives no frames: DEGRADED"),
                false => (Kind::Restored, "gives frames again"),
            };
            self.note(kind, Some(Stage::Capture), format!("camera {camera} {what}"));
        }
    }

    fn note(&mut self, kind: Kind, stage: Option<Stage>, text: String) {
        let step = self.progress.figures.stage(Stage::Simulate).and_then(|simulate| simulate.step);
        self.events.add(kind, stage.map(Stage::name), step, text);
    }

    fn hear(&mut self, Said { stage, line, .. }: &Said) {
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
}
