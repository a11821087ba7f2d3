//! Looking at a running set from outside: attaches, never makes anything, leaves no trace.

use orime_messages::{Stage, StageRecord};

use crate::channel::{self, Pace};
use crate::error::RuntimeError;
use crate::link::{Identity, Link, Mode};
use crate::now_ns;
use crate::run::RunId;
use crate::stop::Stop;
use crate::subscribe::Subscription;

/// A process that reads a run's records.
#[derive(Debug)]
pub struct Guest {
    /// The records of all stages, from now on.
    pub records: Subscription<StageRecord>,
    link: Link,
}

impl Guest {
    /// Attaches to a run, as the supervisor before anyone else (`first`) or at any time later.
    pub fn attach(run: RunId, pace: Pace, first: bool, stop: Stop) -> Result<Self, RuntimeError> {
        // Joining would make the run's directory: a run that is not there must stay so.
        if !first && !run.ipc_dir().exists() {
            return Err(RuntimeError::NoRun { run });
        }
        let identity =
            Identity { run, pace, cameras: 1, stage: Stage::Judge, incarnation: now_ns() };
        let link = Link::join(identity, stop)?;
        let mode = if first { Mode::OpenOrCreate } else { Mode::Open };
        let records = Subscription::new(&link, &channel::RECORD, mode)?;
        Ok(Self { records, link })
    }

    /// The run it is attached to.
    pub fn run(&self) -> RunId {
        self.link.identity().run
    }
}
