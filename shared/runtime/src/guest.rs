//! Looking at a running set from outside: attaches, makes nothing but what a robot publishes,
//! leaves no trace.

use orime_messages::{Header, Message, Stage, StageRecord};

use crate::channel::{self, Channel, Pace};
use crate::error::RuntimeError;
use crate::link::{Identity, Link, Mode};
use crate::now_ns;
use crate::publish::Publisher;
use crate::registry::RunEntry;
use crate::run::{RunId, foreign_owner};
use crate::stop::Stop;
use crate::subscribe::{FrameSubscription, Subscription};

/// A process that reads a run's records, and more of it where the pace allows.
#[derive(Debug)]
pub struct Guest {
    /// The records of all stages, from now on.
    pub records: Subscription<StageRecord>,
    link: Link,
}

impl Guest {
    /// Attaches to a run, as the supervisor before anyone else (`first`) or at any time later.
    pub fn attach(run: RunId, pace: Pace, first: bool, stop: Stop) -> Result<Self, RuntimeError> {
        Self::join(run, pace, 1, first, stop)
    }

    fn join(
        run: RunId,
        pace: Pace,
        cameras: usize,
        first: bool,
        stop: Stop,
    ) -> Result<Self, RuntimeError> {
        // Joining would make the run's directory: a run that is not there must stay so.
        if !first && !run.ipc_dir().exists() {
            return Err(match foreign_owner(run) {
                Some(owner) => RuntimeError::Foreign { run, owner },
                None => RuntimeError::NoRun { run },
            });
        }
        let identity = Identity {
            run,
            pace,
            cameras: cameras.max(1),
            stage: Stage::Judge,
            incarnation: now_ns(),
            resume: None,
        };
        let link = Link::join(identity, stop)?;
        let mode = if first { Mode::OpenOrCreate } else { Mode::Open };
        let records = Subscription::new(&link, &channel::RECORD, mode)?;
        Ok(Self { records, link })
    }

    /// Attaches to a running set whose messages are wanted too, not only its records.
    ///
    /// Only a set in realtime takes such guests: in lockstep its stages would wait for one that
    /// is slow or suspended.
    pub fn attach_to(entry: &RunEntry, stop: Stop) -> Result<Self, RuntimeError> {
        let gone = || RuntimeError::NoRun { run: entry.run_id().unwrap_or_default() };
        let run = entry.run_id().ok_or_else(gone)?;
        entry.agrees("this program")?;
        if entry.pace == Pace::Lockstep {
            return Err(RuntimeError::Waits { run });
        }
        Self::join(run, entry.pace, entry.cameras, false, stop)
    }

    /// Subscribes to a channel from now on.
    pub fn subscribe<M: Message>(
        &self,
        channel: &Channel<M>,
    ) -> Result<Subscription<M>, RuntimeError> {
        Subscription::new(&self.link, channel, Mode::Open)
    }

    /// Publishes on a channel that a robot may have, where capture does not:
    /// [`channel::GRIPPER`] or [`channel::PLAN`].
    pub fn publish<M: Message>(&self, channel: &Channel<M>) -> Result<Publisher<M>, RuntimeError> {
        self.link.publish(channel)
    }

    /// A header of this guest with no lineage yet.
    pub fn header(&self) -> Header {
        self.link.header()
    }

    /// Subscribes to the frames from now on.
    pub fn subscribe_frames(&self) -> Result<FrameSubscription, RuntimeError> {
        FrameSubscription::new(&self.link, Mode::Open)
    }

    /// Gives back what members of the run held that died, so that nobody waits for them.
    pub fn clear_dead_members(&self) {
        self.link.clear_dead_members();
    }

    /// The run it is attached to.
    pub fn run(&self) -> RunId {
        self.link.identity().run
    }
}
