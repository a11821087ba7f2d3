//! How a recording went, for the supervisor and for people.

use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// Messages by kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Frames, each one camera's at one step.
    pub frames: u64,
    /// Observed clouds.
    pub clouds: u64,
    /// Tracked sheets; steps before the first pose have none.
    pub states: u64,
    /// True sheets; sources that do not know have none.
    pub truths: u64,
}

impl Counts {
    /// All of them.
    pub fn total(&self) -> u64 {
        let Self { frames, clouds, states, truths } = *self;
        frames + clouds + states + truths
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frames, clouds, states, truths } = self;
        write!(f, "{frames} frames, {clouds} clouds, {states} states, {truths} truths")
    }
}

/// How a recording went.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// The MCAP file.
    pub file: PathBuf,
    /// Its size, bytes.
    pub bytes: u64,
    /// What is in it.
    pub recorded: Counts,
    /// What was published meanwhile and is not in it, because newer messages came first. Always
    /// 0 in lockstep.
    pub missed: Counts,
    /// Frames that capture could not read; they have no pixels, so they are not in the file.
    pub frames_unreadable: u64,
    /// What ended the recording before its set, if anything did.
    pub failure: Option<String>,
}

impl Report {
    /// Why the file does not hold all that was published while it was recorded; `None` if it does.
    pub fn incomplete(&self) -> Option<String> {
        match &self.failure {
            Some(failure) => Some(failure.clone()),
            None if self.missed.total() > 0 => {
                Some(format!("{} came too fast and were missed", self.missed))
            }
            None => None,
        }
    }
}

/// One line of a recorder's standard output, as JSON.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Said {
    /// The frames of this step are in the file.
    Step(u64),
    /// The recording has ended.
    Report(Report),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_is_complete_if_nothing_failed_and_nothing_was_missed() {
        let mut report = Report {
            file: PathBuf::from("a.mcap"),
            bytes: 1,
            recorded: Counts { frames: 3, ..Counts::default() },
            missed: Counts::default(),
            frames_unreadable: 2,
            failure: None,
        };
        assert_eq!(report.incomplete(), None);
        report.missed.clouds = 4;
        assert!(report.incomplete().unwrap().contains("4 clouds"));
        report.failure = Some("disk full".to_owned());
        assert_eq!(report.incomplete().unwrap(), "disk full");
        let line = serde_json::to_string(&Said::Report(report.clone())).unwrap();
        assert_eq!(serde_json::from_str::<Said>(&line).unwrap(), Said::Report(report));
    }
}
