//! What the command's exit status means; part of its interface.

use std::process::ExitCode;

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// All went as asked; a set that was asked to stop and did counts as that.
    Good = 0,
    /// The set failed: a stage died, hung, or could not do its part.
    SetFailed = 1,
    /// Wrong usage or a wrong set file; nothing was started. (clap uses the same number.)
    Usage = 2,
    /// The machine refuses: shared memory, directories, programs that are not there.
    Machine = 3,
    /// The set's recording is damaged, and the set does not say that this is accepted.
    Damaged = 5,
    /// A set in lockstep lost something with a stage that died and was restarted.
    Lossy = 6,
    /// Ended at once, as asked by a second Ctrl-C.
    Interrupted = 130,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        ExitCode::from(exit as u8)
    }
}

/// Why a command did not do what it was asked, and the status to end with.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Failure {
    /// The status.
    pub exit: Exit,
    /// For the person.
    pub message: String,
}

impl Failure {
    /// The machine refuses.
    pub fn machine(message: impl Into<String>) -> Self {
        Self { exit: Exit::Machine, message: message.into() }
    }

    /// Wrong usage.
    pub fn usage(message: impl Into<String>) -> Self {
        Self { exit: Exit::Usage, message: message.into() }
    }

    /// The set failed.
    pub fn set(message: impl Into<String>) -> Self {
        Self { exit: Exit::SetFailed, message: message.into() }
    }
}
