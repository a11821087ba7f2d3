//! What can go wrong between processes, phrased for the person who started them.

use std::fmt;
use std::io;
use std::path::PathBuf;

/// Why a process of a set cannot do its part.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RuntimeError {
    /// Started by hand.
    #[error("{program} is started by the supervisor: use `orime up SET` ({missing} is missing)")]
    NotSupervised {
        /// The program.
        program: String,
        /// The argument or variable that a supervisor passes.
        missing: &'static str,
    },
    /// Programs that were not built together.
    #[error(
        "{program} speaks `{own}`, its supervisor `{other}`: build all of Orime from one source \
         (`cargo build --release --workspace`) and start the set again"
    )]
    Protocol {
        /// The program that refuses.
        program: String,
        /// What it speaks.
        own: &'static str,
        /// What the run speaks.
        other: String,
    },
    /// The run belongs to somebody else.
    #[error("run {run} belongs to user {owner}: only they can attach to it")]
    Foreign {
        /// The run.
        run: crate::RunId,
        /// Name or number of its owner.
        owner: String,
    },
    /// The set file.
    #[error(transparent)]
    Set(#[from] crate::SetError),
    /// iceoryx2 refused.
    #[error("channel `{channel}`: {action}: {reason}")]
    Channel {
        /// The channel's name.
        channel: &'static str,
        /// What was being done.
        action: &'static str,
        /// iceoryx2's reason.
        reason: String,
    },
    /// The directory of the run.
    #[error("directory `{path}` of the run; it must belong to you and be writable")]
    RunDir {
        /// The directory.
        path: PathBuf,
        /// Why.
        #[source]
        source: io::Error,
    },
    /// The run has ended, or is another user's.
    #[error("run {run} is not there: `orime ps` shows your runs")]
    NoRun {
        /// The run.
        run: crate::RunId,
    },
    /// The run's stages wait for all who listen.
    #[error(
        "run {run} is in lockstep: its stages wait for all who listen, so that a guest could slow \
         it down or hang it; start it again with `orime up SET --record FILE`"
    )]
    Waits {
        /// The run.
        run: crate::RunId,
    },
    /// Not enough shared memory.
    #[error("reserving shared memory in /dev/shm: free some, or give the machine more of it")]
    Memory(#[source] io::Error),
    /// Signals, threads and the like.
    #[error("{action}")]
    System {
        /// What was being done.
        action: &'static str,
        /// Why not.
        #[source]
        source: io::Error,
    },
}

impl RuntimeError {
    pub(crate) fn channel(
        channel: &'static str,
        action: &'static str,
        reason: impl fmt::Debug,
    ) -> Self {
        Self::Channel { channel, action, reason: format!("{reason:?}") }
    }
}
