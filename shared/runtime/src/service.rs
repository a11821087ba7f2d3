//! The life of one process of a set.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use orime_geometry::RgbdCamera;
use orime_messages::{Header, Message, PROTOCOL, Stage};
use orime_params::Problem;
use serde::de::DeserializeOwned;

use crate::channel::{self, Channel};
use crate::error::RuntimeError;
use crate::link::{Identity, Link};
use crate::log;
use crate::now_ns;
use crate::publish::{FramePublisher, Publisher};
use crate::recorder::Recorder;
use crate::resume::Resume;
use crate::run::RunId;
use crate::set_file::SetFile;
use crate::stop::{Stop, die_with_parent};
use crate::subscribe::{Aside, FrameSubscription, Subscription};

/// Environment variable: the run's id, by the supervisor.
pub const RUN_VARIABLE: &str = "ORIME_RUN";
/// Environment variable: number of cameras of the set, by the supervisor.
pub const CAMERAS_VARIABLE: &str = "ORIME_CAMERAS";
/// Environment variable: the supervisor's process id.
pub const PARENT_VARIABLE: &str = "ORIME_PARENT";
/// Environment variable: what the supervisor speaks, see [`PROTOCOL`].
pub const PROTOCOL_VARIABLE: &str = "ORIME_PROTOCOL";
/// Environment variable: a [`Resume`] as JSON, for a process that takes another one's place.
pub const RESUME_VARIABLE: &str = "ORIME_RESUME";
/// Environment variable: set for a spare, a process that waits for one of its stage to die. It is
/// told its [`Resume`] as a line of JSON on standard input.
pub const SPARE_VARIABLE: &str = "ORIME_SPARE";
/// First word of the line on standard output that says that a process is ready.
pub const READY: &str = "ready";

/// One process of a running set: its set file, its channels, its end.
#[derive(Debug)]
pub struct Service {
    stage: Stage,
    set: SetFile,
    link: Link,
}

/// A process of a set that has not joined it yet: what can be prepared before that is no delay for
/// the others.
#[derive(Debug)]
pub struct Beginning {
    stage: Stage,
    set: SetFile,
    run: RunId,
    cameras: usize,
    stop: Stop,
    /// `None` inside: a spare, which is told on standard input.
    resume: Option<Option<Resume>>,
}

impl Beginning {
    /// Begins a stage: `PROGRAM SET`, with what the supervisor says in the environment.
    pub fn of(stage: Stage) -> Result<Self, RuntimeError> {
        let set = std::env::args_os().nth(1).map(PathBuf::from);
        let set = set.ok_or_else(|| not_supervised(stage, "SET"))?;
        Self::with(stage, &set)
    }

    fn with(stage: Stage, set: &Path) -> Result<Self, RuntimeError> {
        let variable =
            |name: &'static str| std::env::var(name).map_err(|_| not_supervised(stage, name));
        let run: RunId =
            variable(RUN_VARIABLE)?.parse().map_err(|_| not_supervised(stage, RUN_VARIABLE))?;
        log::begin(&run.to_string(), stage);
        let other = variable(PROTOCOL_VARIABLE)?;
        // Not folded into the program's code: what its data says is what it speaks.
        if other != std::hint::black_box(PROTOCOL) {
            let program = format!("orime-{}", stage.name());
            return Err(RuntimeError::Protocol { program, own: PROTOCOL, other });
        }
        let cameras = variable(CAMERAS_VARIABLE)?
            .parse()
            .map_err(|_| not_supervised(stage, CAMERAS_VARIABLE))?;
        if let Ok(parent) = variable(PARENT_VARIABLE)?.parse() {
            die_with_parent(parent).map_err(|source| RuntimeError::System {
                action: "following the parent",
                source,
            })?;
        }
        let stop = Stop::on_terminate()
            .map_err(|source| RuntimeError::System { action: "handling signals", source })?;
        let set = SetFile::load(set)?;
        let resume = match (std::env::var(RESUME_VARIABLE), std::env::var(SPARE_VARIABLE)) {
            (Ok(text), _) => Some(Some(resume(stage, &text)?)),
            (Err(_), Ok(_)) => Some(None),
            (Err(_), Err(_)) => None,
        };
        Ok(Self { stage, set, run, cameras, stop, resume })
    }

    /// A section of the set, checked; every problem of it in one error.
    pub fn config<P: DeserializeOwned, C>(
        &self,
        section: &str,
        check: impl FnOnce(&P) -> Result<C, Vec<Problem>>,
    ) -> Result<C, RuntimeError> {
        Ok(self.set.checked(section, check)?)
    }

    /// Joins the run; a spare does so once the process has died whose place it takes.
    pub fn join(self) -> Result<Service, RuntimeError> {
        let Self { stage, set, run, cameras, stop, resume } = self;
        let resume = match resume {
            Some(None) => Some(told(stage)?),
            resume => resume.flatten(),
        };
        let incarnation = now_ns() ^ (u64::from(std::process::id()) << 40);
        let identity = Identity { run, pace: set.pace, cameras, stage, incarnation, resume };
        let link = Link::join(identity, stop)?;
        Ok(Service { stage, set, link })
    }
}

fn resume(stage: Stage, text: &str) -> Result<Resume, RuntimeError> {
    serde_json::from_str(text).map_err(|_| not_supervised(stage, RESUME_VARIABLE))
}

/// What a spare is told when its turn has come.
fn told(stage: Stage) -> Result<Resume, RuntimeError> {
    let mut text = String::new();
    io::stdin()
        .read_line(&mut text)
        .map_err(|source| RuntimeError::System { action: "waiting for its turn", source })?;
    resume(stage, &text)
}

impl Service {
    /// Begins a stage and joins the run, see [`Beginning`].
    pub fn start(stage: Stage) -> Result<Self, RuntimeError> {
        Beginning::of(stage)?.join()
    }

    /// Begins a process of a set that finds the set file's path in its own way.
    pub fn start_with(stage: Stage, set: &Path) -> Result<Self, RuntimeError> {
        Beginning::with(stage, set)?.join()
    }

    /// The set file.
    pub fn set(&self) -> &SetFile {
        &self.set
    }

    /// This process' place in the run.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// Where this process goes on, if it takes the place of one that ended.
    pub fn resume(&self) -> Option<Resume> {
        self.link.identity().resume
    }

    /// The end of the stream that this stage would have to work on, if it came before this
    /// process did.
    pub fn ended_input(&self) -> Option<Header> {
        let resume = self.resume().filter(|resume| resume.input_ended)?;
        let step = resume.asked.map_or(0, |step| step + 1);
        Some(Header { step, ..self.header() })
    }

    /// Raised when this process shall end.
    pub fn stop(&self) -> &Stop {
        self.link.stop()
    }

    /// A section of the set, checked; every problem of it in one error.
    pub fn config<P: DeserializeOwned, C>(
        &self,
        section: &str,
        check: impl FnOnce(&P) -> Result<C, Vec<Problem>>,
    ) -> Result<C, RuntimeError> {
        Ok(self.set.checked(section, check)?)
    }

    /// A section of the set, as it is written.
    pub fn section<P: DeserializeOwned>(&self, section: &str) -> Result<P, RuntimeError> {
        Ok(self.set.section(section)?)
    }

    /// Subscribes to a channel.
    pub fn subscribe<M: Message>(
        &self,
        channel: &Channel<M>,
    ) -> Result<Subscription<M>, RuntimeError> {
        self.link.subscribe(channel)
    }

    /// Looks at a channel beside another one.
    pub fn aside<M: Message>(&self, channel: &Channel<M>) -> Result<Aside<M>, RuntimeError> {
        Aside::new(&self.link, channel)
    }

    /// Publishes on a channel.
    pub fn publish<M: Message>(&self, channel: &Channel<M>) -> Result<Publisher<M>, RuntimeError> {
        self.link.publish(channel)
    }

    /// Subscribes to the frames.
    pub fn subscribe_frames(&self) -> Result<FrameSubscription, RuntimeError> {
        self.link.subscribe_frames()
    }

    /// Publishes the frames of these cameras.
    pub fn publish_frames(&self, cameras: &[RgbdCamera]) -> Result<FramePublisher, RuntimeError> {
        self.link.publish_frames(cameras)
    }

    /// Publishes this stage's records.
    pub fn recorder(&self) -> Result<Recorder, RuntimeError> {
        Ok(Recorder::new(self.publish(&channel::RECORD)?))
    }

    /// A header of this process with no lineage yet.
    pub fn header(&self) -> Header {
        self.link.header()
    }

    /// Says that every channel of this process is there, so that the next one may start.
    pub fn ready(&self) -> Result<(), RuntimeError> {
        self.link.reserve_memory()?;
        let mut out = io::stdout().lock();
        writeln!(out, "{READY} {}", self.stage.name())
            .and_then(|()| out.flush())
            .map_err(|source| RuntimeError::System { action: "saying that it is ready", source })
    }
}

fn not_supervised(stage: Stage, missing: &'static str) -> RuntimeError {
    RuntimeError::NotSupervised { program: format!("orime-{}", stage.name()), missing }
}
