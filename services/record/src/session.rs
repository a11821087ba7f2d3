//! A recording from its first message to its last: one thread per channel, one file.

use std::error::Error;
use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use orime_geometry::SheetGrid;
use orime_messages::{
    Drops, FoldPlan, Grippers, Message, ObservedCloud, SheetState, Targets, Truth,
};
use orime_recording::{RecordError, Recorder, SheetState as Sheet};
use orime_runtime::{
    Aside, FrameSubscription, Received, ReceivedFrame, RuntimeError, Stop, Subscription, channel,
};
use signal_hook::consts::SIGXFSZ;

use crate::gather::{Gathered, gather};
use crate::report::{Counts, Report};
use crate::tape::Tape;

/// Bytes that gather before the system is asked to write.
const BUFFER_BYTES: usize = 1 << 20;

/// What is recorded.
#[derive(Debug)]
pub struct Inputs {
    /// From capture.
    pub frames: FrameSubscription,
    /// From segment.
    pub clouds: Subscription<ObservedCloud>,
    /// From simulate.
    pub states: Subscription<SheetState>,
    /// From capture.
    pub truths: Subscription<Truth>,
    /// Where the stages are recorded too.
    pub simulated: Option<Simulated>,
}

/// What simulate hears.
#[derive(Debug)]
pub struct Simulated {
    /// From register.
    pub targets: Subscription<Targets>,
    /// From capture or a robot, or from nobody.
    pub grippers: Aside<Grippers>,
    /// As the grippers.
    pub plans: Aside<FoldPlan>,
}

/// A recording that is about to begin: its file is there and is ours.
#[derive(Debug)]
pub struct Session {
    path: PathBuf,
    file: File,
    set: String,
    sheet: SheetGrid,
    stop: Stop,
    tape: Option<Tape>,
}

/// What the threads of a session share.
struct Shared {
    recorder: Mutex<Recorder>,
    tape: Mutex<Option<Tape>>,
    failure: Mutex<Option<String>>,
    stop: Stop,
}

/// Makes writing past a limit on file sizes an error, as on a full disk, instead of the process'
/// death.
pub fn survive_size_limits() -> io::Result<()> {
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false))).map(|_| ())
}

impl Session {
    /// Creates the file, which must not exist, for a recording of `set`, whose truth lies on
    /// `sheet`. `stop` ends the recording at once; it is raised when the recording fails.
    pub fn create(path: &Path, set: &str, sheet: &SheetGrid, stop: Stop) -> io::Result<Self> {
        let file = File::create_new(path)?;
        let (path, set, sheet) = (path.to_owned(), set.to_owned(), sheet.clone());
        Ok(Self { path, file, set, sheet, stop, tape: None })
    }

    /// Records what the stages say to each other too.
    pub fn with_tape(mut self, tape: Tape) -> Self {
        self.tape = Some(tape);
        self
    }

    /// Removes the file again, where there will be nothing to record.
    pub fn abandon(self) {
        // Whoever made it impossible to remove it will find it empty.
        let _ = fs::remove_file(&self.path);
    }

    /// Records until every stream has ended, or `stop` is raised, or the file cannot be written.
    /// `on_step` hears of each step whose frames are in the file.
    pub fn run(self, mut inputs: Inputs, on_step: impl FnMut(u64)) -> Report {
        let path = self.path.clone();
        let gathered = gather(&mut inputs.frames);
        let nothing = |failure: String| Report {
            file: path.clone(),
            bytes: 0,
            recorded: Counts::default(),
            missed: Counts::default(),
            frames_unreadable: 0,
            failure: Some(failure),
        };
        match gathered {
            Ok(Some(gathered)) => self.write(inputs, gathered, on_step),
            Ok(None) => {
                self.abandon();
                nothing("no frame came, so that there is nothing to record".to_owned())
            }
            Err(error) => {
                self.abandon();
                nothing(with_causes(&error))
            }
        }
    }

    fn write(self, inputs: Inputs, gathered: Gathered, on_step: impl FnMut(u64)) -> Report {
        let Self { path, file, set, sheet, stop, tape } = self;
        let mut report = Report {
            file: path.clone(),
            bytes: 0,
            recorded: Counts::default(),
            missed: Counts { frames: gathered.given_up, ..Counts::default() },
            frames_unreadable: 0,
            failure: None,
        };
        let sink = Box::new(BufWriter::with_capacity(BUFFER_BYTES, file));
        match Recorder::to_writer(&path, sink, &set, &gathered.cameras) {
            Ok(recorder) => {
                let (recorder, failure) = (Mutex::new(recorder), Mutex::new(None));
                let shared = Shared { recorder, tape: Mutex::new(tape), failure, stop };
                shared.take_all(inputs, gathered.frames, &sheet, on_step, &mut report);
                report.failure = shared.finish();
            }
            Err(error) => report.failure = Some(with_causes(&error)),
        }
        report.bytes = fs::metadata(&path).map_or(0, |file| file.len());
        report
    }
}

impl Shared {
    /// Takes every channel to its end.
    fn take_all(
        &self,
        inputs: Inputs,
        first: Vec<ReceivedFrame>,
        sheet: &SheetGrid,
        on_step: impl FnMut(u64),
        report: &mut Report,
    ) {
        let Inputs { mut frames, clouds, states, truths, simulated } = inputs;
        let (mut recorded, mut missed) = (report.recorded, report.missed);
        std::thread::scope(|scope| {
            let clouds = scope.spawn(|| {
                self.take(clouds, |recorder, cloud| {
                    self.tape(channel::CLOUD.name, cloud);
                    let ObservedCloud { header, .. } = cloud;
                    recorder.cloud(header.step, header.exposure_ns, cloud.points()).map(|()| true)
                })
            });
            let states = scope.spawn(|| {
                self.take(states, |recorder, state| {
                    self.tape(channel::STATE.name, state);
                    record_state(recorder, state)
                })
            });
            let simulated = simulated.map(|heard| scope.spawn(|| self.take_simulated(heard)));
            let truths = scope.spawn(|| {
                self.take(truths, |recorder, truth| {
                    let Truth { header, .. } = truth;
                    let nodes_m = truth.positions_m();
                    if nodes_m.len() != sheet.len() {
                        return Ok(false);
                    }
                    let (step, time_ns) = (header.step, header.exposure_ns);
                    recorder.sheet(step, time_ns, Sheet::Truth, sheet, nodes_m).map(|()| true)
                })
            });
            let [taken, unreadable] = self.take_frames(&mut frames, first, on_step);
            (recorded.frames, report.frames_unreadable) = (taken, unreadable);
            missed.frames += lost(frames.drops());
            if simulated.is_some_and(|thread| thread.join().is_err()) {
                self.fail("a thread of the recorder panicked");
            }
            for (thread, recorded, missed) in [
                (clouds, &mut recorded.clouds, &mut missed.clouds),
                (states, &mut recorded.states, &mut missed.states),
                (truths, &mut recorded.truths, &mut missed.truths),
            ] {
                match thread.join() {
                    Ok(counts) => [*recorded, *missed] = counts,
                    // It said why when it happened.
                    Err(_) => self.fail("a thread of the recorder panicked"),
                }
            }
        });
        (report.recorded, report.missed) = (recorded, missed);
    }

    /// Puts what simulate hears on the tape; the recording itself has no place for it. Grippers and
    /// plans are sent before the frames that targets are made of, so they lie before these.
    fn take_simulated(&self, heard: Simulated) {
        let Simulated { targets, grippers, plans } = heard;
        self.take(targets, |_, targets| {
            self.tape_aside(channel::GRIPPER.name, &grippers);
            self.tape_aside(channel::PLAN.name, &plans);
            self.tape(channel::TARGETS.name, targets);
            Ok(true)
        });
    }

    /// Puts all that has come on a channel on the tape.
    fn tape_aside<M: Message>(&self, topic: &str, messages: &Aside<M>) {
        loop {
            match messages.try_next() {
                Ok(Some(message)) if Message::header(&*message).is_end() => {}
                Ok(Some(message)) => self.tape(topic, &*message),
                Ok(None) => return,
                Err(error) => return self.fail(&with_causes(&error)),
            }
        }
    }

    /// Puts a message on the tape, if there is one; a tape that cannot be written ends both.
    fn tape<M: Message>(&self, topic: &str, message: &M) {
        let mut tape = lock(&self.tape);
        if let Some(Err(error)) = tape.as_mut().map(|tape| tape.add(topic, message)) {
            *tape = None;
            self.fail(&with_causes(&error));
        }
    }

    /// Records frames, those at hand first; how many, and how many had no pixels.
    fn take_frames(
        &self,
        frames: &mut FrameSubscription,
        first: Vec<ReceivedFrame>,
        mut on_step: impl FnMut(u64),
    ) -> [u64; 2] {
        let mut first = first.into_iter();
        let mut counts = [0, 0];
        let is_end = |frame: &ReceivedFrame| frame.meta().header.is_end();
        let next = || first.next().map_or_else(|| frames.next(), |frame| Ok(Some(frame)));
        self.each(next, is_end, |recorder, frame| {
            let meta = frame.meta();
            match frame.view() {
                // The pixels go from shared memory straight into the file's chunk.
                Some(view) => {
                    let (step, time_ns) = (meta.header.step, meta.header.exposure_ns);
                    recorder.frame(step, meta.camera as usize, time_ns, view)?;
                    counts[0] += 1;
                }
                None => counts[1] += 1,
            }
            if meta.camera + 1 == meta.n_cameras {
                on_step(meta.header.step);
            }
            Ok(())
        });
        counts
    }

    /// Records one channel with `write`, which says whether there was anything to record; how
    /// many messages, and how many were missed.
    fn take<M: Message>(
        &self,
        mut messages: Subscription<M>,
        mut write: impl FnMut(&mut Recorder, &M) -> Result<bool, RecordError>,
    ) -> [u64; 2] {
        let mut recorded = 0;
        let is_end = |message: &Received<M>| Message::header(&**message).is_end();
        self.each(
            || messages.next(),
            is_end,
            |recorder, message| {
                recorded += u64::from(write(recorder, message)?);
                Ok(())
            },
        );
        [recorded, lost(messages.drops())]
    }

    /// Hands every message to `write` until the end, a stop or a fault.
    fn each<T>(
        &self,
        mut next: impl FnMut() -> Result<Option<T>, RuntimeError>,
        is_end: impl Fn(&T) -> bool,
        mut write: impl FnMut(&mut Recorder, &T) -> Result<(), RecordError>,
    ) {
        while !self.stop.requested() {
            let message = match next() {
                Ok(Some(message)) if !is_end(&message) => message,
                Ok(_) => return,
                Err(error) => return self.fail(&with_causes(&error)),
            };
            if let Err(error) = write(&mut lock(&self.recorder), &message) {
                return self.fail(&with_causes(&error));
            }
        }
    }

    /// Ends all threads; the first fault is the one that is told.
    fn fail(&self, what: &str) {
        lock(&self.failure).get_or_insert_with(|| what.to_owned());
        self.stop.request();
    }

    /// Ends the file; what went wrong, if anything did.
    fn finish(self) -> Option<String> {
        let recorder = self.recorder.into_inner().unwrap_or_else(PoisonError::into_inner);
        let finished = recorder.finish().err().map(|error| with_causes(&error));
        let tape = self.tape.into_inner().unwrap_or_else(PoisonError::into_inner);
        let taped = tape.and_then(|tape| tape.finish().err()).map(|error| with_causes(&error));
        let finished = finished.or(taped);
        let failure = self.failure.into_inner().unwrap_or_else(PoisonError::into_inner);
        failure.or(finished)
    }
}

fn record_state(recorder: &mut Recorder, state: &SheetState) -> Result<bool, RecordError> {
    let SheetState { header, nodes, size_m, .. } = *state;
    let nodes = nodes.map(|n| n as usize);
    let positions_m = state.positions_m();
    let is_grid = nodes.iter().all(|n| *n >= 2) && nodes[0] * nodes[1] == positions_m.len();
    if state.has_pose == 0 || !is_grid {
        return Ok(false);
    }
    let grid = SheetGrid::new(size_m, nodes);
    recorder
        .sheet(header.step, header.exposure_ns, Sheet::Estimate, &grid, positions_m)
        .map(|()| true)
}

fn lost(Drops { overflow, superseded, .. }: Drops) -> u64 {
    overflow + superseded
}

/// The error and its causes, each said once: of a full disk, only the last of them speaks.
fn with_causes(error: &dyn Error) -> String {
    let mut message = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let text = error.to_string();
        if !message.contains(&text) {
            message.push_str(&format!(": {text}"));
        }
        cause = error.source();
    }
    message
}

/// The value, even if another thread panicked with it.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
