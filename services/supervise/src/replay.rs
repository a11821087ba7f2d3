//! `orime replay`: recorded messages into one stage alone, and what it makes of them compared with
//! what was recorded, bit for bit.

use std::path::PathBuf;
use std::sync::mpsc::channel as lines;
use std::time::{Duration, Instant};

use orime_messages::{
    FoldPlan, Grippers, Header, Message, ObservedCloud, SheetState, Stage, Targets,
};
use orime_record::TapeContent;
use orime_runtime::{
    Identity, Link, Pace, Publisher, READY, RunId, Stop, Subscription, channel, clean, now_ns,
};
use serde::Serialize;

use crate::args::Replay;
use crate::check::{CheckedSet, check};
use crate::exit::{Exit, Failure};
use crate::process::{Launch, Part, Process};
use crate::up::DEFAULT_SET;

/// Time that the stage may take for one message.
const PATIENCE: Duration = Duration::from_secs(60);
/// Time between two looks for its answer.
const LOOK: Duration = Duration::from_micros(200);
/// What is wrong with a tape whose messages are cut or padded.
const ODD_SIZE: &str = "a message on the tape has another size than its kind";

/// What a replay gave.
#[derive(Debug, Serialize)]
struct Compared {
    stage: &'static str,
    steps: usize,
    equal: usize,
    /// First step whose result is another one.
    first_different: Option<u64>,
}

/// A run that is removed with all it left.
struct OwnRun(RunId);

impl Drop for OwnRun {
    fn drop(&mut self) {
        if let Err(error) = clean(self.0) {
            eprintln!("orime: removing the replay's shared memory: {error}");
        }
    }
}

/// Plays the tape.
pub fn replay(args: &Replay, json: bool) -> Result<Exit, Failure> {
    let machine = |error: &dyn std::fmt::Display| Failure::machine(error.to_string());
    let set = load(args)?;
    let tape = TapeContent::load(&args.tape).map_err(|error| match &error {
        orime_record::TapeError::Format { source, .. } => machine(&format!("{error}: {source}")),
        orime_record::TapeError::File { source, .. } => machine(&format!("{error}: {source}")),
        _ => machine(&error),
    })?;
    std::fs::create_dir_all(args.out.join("logs"))
        .map_err(|error| machine(&format!("writing to `{}`: {error}", args.out.display())))?;
    let player = Player { run: RunId::new(), set: &set, out: args.out.clone() };
    let own = OwnRun(player.run);
    let compared = match args.stage.as_str() {
        "register" => player.register(&tape),
        "simulate" => player.simulate(&tape),
        other => {
            return Err(Failure::usage(format!(
                "`{other}` cannot be replayed into: register and simulate can; frames are replayed \
                 by a set with `source = \"recording\"`"
            )));
        }
    };
    drop(own);
    let compared = compared?;
    let Compared { stage, steps, equal, first_different } = &compared;
    if json {
        let text = serde_json::to_string_pretty(&compared).map_err(|error| machine(&error))?;
        println!("{text}");
    } else {
        println!("{stage}: {equal} of {steps} steps bit for bit what was recorded");
        if let Some(step) = first_different {
            println!("the first other one is step {step}");
        }
    }
    Ok(if equal == steps { Exit::Good } else { Exit::SetFailed })
}

fn load(args: &Replay) -> Result<CheckedSet, Failure> {
    let path = match &args.set {
        Some(path) => path.clone(),
        None => {
            std::fs::create_dir_all(&args.out)
                .and_then(|()| std::fs::write(args.out.join("half_fold.toml"), DEFAULT_SET))
                .map_err(|error| Failure::machine(format!("writing the set: {error}")))?;
            args.out.join("half_fold.toml")
        }
    };
    let text = std::fs::read_to_string(&path)
        .map_err(|error| Failure::usage(format!("reading set `{}`: {error}", path.display())))?;
    let set = check(&path, &text).map_err(|problems| {
        let list: Vec<String> = problems.iter().map(ToString::to_string).collect();
        Failure::usage(list.join("\n"))
    })?;
    if set.file.pace == Pace::Realtime {
        return Err(Failure::usage(format!(
            "set `{}` is in realtime, where the newest wins: only lockstep can be replayed",
            path.display()
        )));
    }
    Ok(set)
}

/// What plays the others' parts.
struct Player<'a> {
    run: RunId,
    set: &'a CheckedSet,
    out: PathBuf,
}

impl Player<'_> {
    fn link(&self, stage: Stage) -> Result<Link, Failure> {
        let identity = Identity {
            run: self.run,
            pace: Pace::Lockstep,
            cameras: self.set.cameras.len(),
            stage,
            incarnation: now_ns(),
            resume: None,
        };
        Link::join(identity, Stop::new()).map_err(failed)
    }

    /// Starts the stage and waits until it is ready.
    fn start(&self, stage: Stage) -> Result<Process, Failure> {
        let set = self.set.file.path.canonicalize().map_err(failed)?;
        let launch = Launch {
            run: self.run,
            set: &set,
            out: &self.out,
            cameras: self.set.cameras.len(),
            record: None,
            record_stages: false,
            log_json: false,
            source: None,
        };
        let (said_by, said) = lines();
        let mut process = launch.start(stage, Part::First, &said_by)?;
        let start = Instant::now();
        while start.elapsed() < PATIENCE && process.runs() {
            match said.recv_timeout(Duration::from_millis(50)) {
                Ok(said) if said.line.starts_with(READY) => return Ok(process),
                _ => {}
            }
        }
        Err(Failure::set(format!("the stage did not get ready: {}", process.log_tail())))
    }

    /// Clouds and states in, targets out.
    fn register(&self, tape: &TapeContent) -> Result<Compared, Failure> {
        let (segment, simulate) = (self.link(Stage::Segment)?, self.link(Stage::Simulate)?);
        let judge = self.link(Stage::Judge)?;
        let mut targets = judge.subscribe::<Targets>(&channel::TARGETS).map_err(failed)?;
        let mut clouds = segment.publish::<ObservedCloud>(&channel::CLOUD).map_err(failed)?;
        let mut states = simulate.publish::<SheetState>(&channel::STATE).map_err(failed)?;
        let mut process = self.start(Stage::Register)?;
        segment.reserve_memory().map_err(failed)?;
        let recorded =
            parts(tape, &[channel::CLOUD.name, channel::TARGETS.name, channel::STATE.name])?;
        let mut compared = Compared::new(Stage::Register, recorded.len());
        for parts in &recorded {
            send(&mut clouds, parts[0])?;
            let made = answer(&mut targets, &mut process)?;
            let wanted: Targets = bytemuck::pod_read_unaligned(parts[1]);
            let same = made.figures == wanted.figures
                && bits(made.targets_m().as_flattened()) == bits(wanted.targets_m().as_flattened())
                && bits(made.confidence()) == bits(wanted.confidence());
            compared.add(wanted.header.step, same);
            send(&mut states, parts[2])?;
        }
        clouds.send_end(&segment.header()).map_err(failed)?;
        finish(process)?;
        Ok(compared)
    }

    /// Targets in, states out.
    fn simulate(&self, tape: &TapeContent) -> Result<Compared, Failure> {
        let (register, judge) = (self.link(Stage::Register)?, self.link(Stage::Judge)?);
        let mut states = judge.subscribe::<SheetState>(&channel::STATE).map_err(failed)?;
        let mut targets = register.publish::<Targets>(&channel::TARGETS).map_err(failed)?;
        let capture = self.link(Stage::Capture)?;
        let mut grippers = Beside::<Grippers>::new(&capture, &channel::GRIPPER, tape)?;
        let mut plans = Beside::<FoldPlan>::new(&capture, &channel::PLAN, tape)?;
        let mut process = self.start(Stage::Simulate)?;
        register.reserve_memory().map_err(failed)?;
        let recorded = parts(tape, &[channel::TARGETS.name, channel::STATE.name])?;
        let mut compared = Compared::new(Stage::Simulate, recorded.len());
        for parts in &recorded {
            let step = header(parts[0])?.step;
            grippers.send_until(step)?;
            plans.send_until(step)?;
            send(&mut targets, parts[0])?;
            let made = answer(&mut states, &mut process)?;
            let wanted: SheetState = bytemuck::pod_read_unaligned(parts[1]);
            let same = made.has_pose == wanted.has_pose
                && made.targets_rejected == wanted.targets_rejected
                && bits(made.positions_m().as_flattened())
                    == bits(wanted.positions_m().as_flattened());
            compared.add(wanted.header.step, same);
        }
        targets.send_end(&register.header()).map_err(failed)?;
        finish(process)?;
        Ok(compared)
    }
}

/// Messages that were sent beside the targets, as far as the tape holds any.
struct Beside<'t, M: Message> {
    publisher: Option<Publisher<M>>,
    rest: &'t [Vec<u8>],
}

impl<'t, M: Message> Beside<'t, M> {
    fn new(
        link: &Link,
        channel: &channel::Channel<M>,
        tape: &'t TapeContent,
    ) -> Result<Self, Failure> {
        let rest = tape.of(channel.name);
        let publisher = (!rest.is_empty()).then(|| link.publish::<M>(channel));
        Ok(Self { publisher: publisher.transpose().map_err(failed)?, rest })
    }

    /// Sends what is of this step or an earlier one.
    fn send_until(&mut self, step: u64) -> Result<(), Failure> {
        let Some(publisher) = &mut self.publisher else { return Ok(()) };
        while let Some((next, rest)) = self.rest.split_first()
            && header(next)?.step <= step
        {
            send(publisher, next)?;
            self.rest = rest;
        }
        Ok(())
    }
}

impl Compared {
    fn new(stage: Stage, steps: usize) -> Self {
        Self { stage: stage.name(), steps, equal: 0, first_different: None }
    }

    fn add(&mut self, step: u64, same: bool) {
        self.equal += usize::from(same);
        if !same {
            self.first_different.get_or_insert(step);
        }
    }
}

fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::machine(error.to_string())
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Step by step, one message of each channel.
fn parts<'t>(tape: &'t TapeContent, topics: &[&str]) -> Result<Vec<Vec<&'t [u8]>>, Failure> {
    let counts: Vec<usize> = topics.iter().map(|topic| tape.of(topic).len()).collect();
    let steps = counts.iter().copied().min().unwrap_or(0);
    if steps == 0 || counts.iter().any(|count| *count != steps) {
        return Err(Failure::usage(format!(
            "the tape does not hold one message per step of each of {topics:?}: {counts:?}; record \
             a set in lockstep from its beginning with --record-stages"
        )));
    }
    Ok((0..steps)
        .map(|k| topics.iter().map(|topic| tape.of(topic)[k].as_slice()).collect())
        .collect())
}

/// The header that every message begins with.
fn header(bytes: &[u8]) -> Result<Header, Failure> {
    let header = bytes.get(..size_of::<Header>()).map(bytemuck::pod_read_unaligned);
    header.ok_or_else(|| failed(ODD_SIZE))
}

/// Sends a recorded message; its own header is the lineage of the new one.
fn send<M: Message>(publisher: &mut Publisher<M>, bytes: &[u8]) -> Result<(), Failure> {
    let lineage = header(bytes)?;
    if bytes.len() != size_of::<M>() {
        return Err(failed(ODD_SIZE));
    }
    let sent = publisher
        .send_with(&lineage, |message| bytemuck::bytes_of_mut(message).copy_from_slice(bytes));
    sent.map(drop).map_err(failed)
}

/// The stage's next message.
fn answer<M: Message>(
    messages: &mut Subscription<M>,
    process: &mut Process,
) -> Result<orime_runtime::Received<M>, Failure> {
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        if let Some(message) = messages.try_next().map_err(failed)? {
            return Ok(message);
        }
        if !process.runs() {
            return Err(Failure::set(format!("the stage has ended: {}", process.log_tail())));
        }
        std::thread::sleep(LOOK);
    }
    Err(Failure::set(format!("the stage gave nothing in {PATIENCE:?}: {}", process.log_tail())))
}

/// Waits for the stage's end, a while at most; dropping it kills what does not end.
fn finish(mut process: Process) -> Result<(), Failure> {
    let start = Instant::now();
    while process.runs() && start.elapsed() < Duration::from_secs(5) {
        std::thread::sleep(LOOK);
    }
    Ok(())
}
