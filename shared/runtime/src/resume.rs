//! What a process is told that takes the place of one that ended.

use serde::{Deserialize, Serialize};

/// Where a restarted stage goes on; the supervisor knows it from the stages' records.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Resume {
    /// First frame set that was not wholly published: capture goes on with it.
    pub next_set: u64,
    /// Frame set that capture's source began with: not 0 where it took another one's place.
    #[serde(default)]
    pub source_began: u64,
    /// Newest step that this stage has published.
    pub published: Option<u64>,
    /// Newest step that the stage before this one has published.
    pub asked: Option<u64>,
    /// Whether the stream into this stage has ended: nothing will come any more.
    pub input_ended: bool,
}

impl Resume {
    /// First step that this stage has not given a result for.
    pub fn wanted(&self) -> u64 {
        self.published.map_or(0, |step| step + 1)
    }
}
