//! How a set ended, and what is known of it then.

use crate::events::Events;
use crate::process::Process;
use crate::progress::Progress;
use crate::recording::Recording;
use crate::recovery::Recovery;

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

/// What is known of a set once it is over.
#[derive(Debug)]
pub struct Watched {
    /// What it did.
    pub progress: Progress,
    /// Restarts.
    pub recoveries: Vec<Recovery>,
    /// What happened besides the work.
    pub events: Events,
    /// What was recorded of it.
    pub recording: Option<Recording>,
}

/// The end by a process that cannot be replaced: what it did, and the end of its log.
pub fn failed(process: &mut Process, what: &str) -> Ending {
    let tail = process.log_tail();
    let log = process.log.display();
    let name = process.stage.name();
    if tail.is_empty() {
        return Ending::Failed(format!("stage `{name}`: {what}; its log `{log}` is empty"));
    }
    Ending::Failed(format!("stage `{name}`: {what}; its log `{log}` ends:\n{tail}"))
}
