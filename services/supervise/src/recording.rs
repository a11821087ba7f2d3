//! The recorder beside a set. Whatever happens to it, the set goes on.

use std::fs;
use std::path::PathBuf;

use orime_messages::Stage;
use orime_record::{Counts, Report, Said};
use orime_runtime::Guest;
use rustix::process::Signal;

use crate::process::Process;

/// What is known of a recording.
#[derive(Debug)]
pub struct Recording {
    /// The file.
    pub file: PathBuf,
    /// Newest step whose frames are in it.
    pub step: Option<u64>,
    /// What the recorder said at its end.
    report: Option<Report>,
    /// Why it ended without saying anything.
    died: Option<String>,
    /// Whether its end was seen.
    has_ended: bool,
}

impl Recording {
    /// A recording that has not begun.
    pub fn new(file: PathBuf) -> Self {
        Self { file, step: None, report: None, died: None, has_ended: false }
    }

    /// Takes in a line of the recorder.
    pub fn said(&mut self, line: &str) {
        match serde_json::from_str(line) {
            Ok(Said::Step(step)) => self.step = Some(step),
            Ok(Said::Report(report)) => {
                if let Some(failure) = &report.failure {
                    eprintln!("orime: the recording has stopped, the set goes on: {failure}");
                }
                self.report = Some(report);
            }
            // The line that says that it is ready.
            Err(_) => {}
        }
    }

    /// Looks whether the recorder lives, and gives the stages back what a dead one held.
    pub fn look(&mut self, processes: &mut [Process], guest: &Guest) {
        let recorder = processes.iter_mut().find(|process| process.stage == Stage::Record);
        let Some(recorder) = recorder.filter(|_| !self.has_ended) else { return };
        let Some(status) = recorder.poll() else { return };
        self.has_ended = true;
        if !status.success() {
            guest.clear_dead_members();
            let (log, tail) = (recorder.log.display(), recorder.log_tail());
            self.died.get_or_insert(format!("its recorder: {status}; its log `{log}`:\n{tail}"));
        }
    }

    /// Ends a recorder that holds the others up.
    pub fn give_up(&mut self, processes: &mut [Process], guest: &Guest, why: &str) {
        for process in processes.iter_mut().filter(|process| process.stage == Stage::Record) {
            process.signal(Signal::KILL);
            while process.poll().is_none() {
                std::thread::sleep(crate::watch::TICK);
            }
        }
        self.died.get_or_insert(format!("its recorder {why} and was ended"));
        self.look(processes, guest);
    }

    /// How it went, once no process is left.
    pub fn close(self) -> Report {
        let Self { file, report, died, .. } = self;
        report.unwrap_or_else(|| {
            let failure = died.unwrap_or_else(|| "its recorder was ended with the set".to_owned());
            eprintln!("orime: the recording has stopped: {failure}");
            Report {
                bytes: fs::metadata(&file).map_or(0, |file| file.len()),
                file,
                recorded: Counts::default(),
                missed: Counts::default(),
                frames_unreadable: 0,
                failure: Some(failure),
            }
        })
    }
}
