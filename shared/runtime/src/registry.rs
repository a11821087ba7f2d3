//! Who is running: one small file per run, so that others find runs and clear dead ones.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use orime_messages::PROTOCOL;
use serde::{Deserialize, Serialize};

use crate::channel::Pace;
use crate::error::RuntimeError;
use crate::run::{RunId, make_private_dir};

/// One run of a set, as its supervisor registered it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunEntry {
    /// The run's id, eight hexadecimal digits.
    pub run: String,
    /// The supervisor's process id.
    pub pid: u32,
    /// When that process began, clock ticks since boot: a later process of the same id has
    /// another one.
    pub start_ticks: u64,
    /// The set's name.
    pub name: String,
    /// The set file.
    pub set: PathBuf,
    /// Where the run writes.
    pub out: PathBuf,
    /// The set's pace.
    pub pace: Pace,
    /// What its processes speak, see [`orime_messages::PROTOCOL`]; empty in entries of versions
    /// that did not say.
    #[serde(default)]
    pub protocol: String,
    /// Cameras of the set; 0 in entries of versions that did not say.
    #[serde(default)]
    pub cameras: usize,
    /// The stages' process ids, by name, once they run.
    pub stages: Vec<(String, u32)>,
}

/// Where runs are registered.
pub fn registry_dir() -> PathBuf {
    match std::env::var_os("XDG_RUNTIME_DIR") {
        Some(dir) if !dir.is_empty() => Path::new(&dir).join("orime"),
        _ => {
            let user = rustix::process::getuid().as_raw();
            PathBuf::from(format!("/tmp/orime-{user}/runs"))
        }
    }
}

/// When process `pid` began, clock ticks since boot; `None` where there is no such process.
pub fn start_ticks(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name is in parentheses and may hold anything; field 22 is the 20th after it.
    let after_name = &stat[stat.rfind(')')? + 1..];
    let mut fields = after_name.split_ascii_whitespace();
    // A zombie has ended.
    let state = fields.next()?;
    if state == "Z" || state == "X" {
        return None;
    }
    fields.nth(18)?.parse().ok()
}

impl RunEntry {
    /// The run's id; `None` where the file was written by something else.
    pub fn run_id(&self) -> Option<RunId> {
        self.run.parse().ok()
    }

    /// Whether its supervisor still runs.
    pub fn is_alive(&self) -> bool {
        start_ticks(self.pid) == Some(self.start_ticks)
    }

    /// Refuses `program`, which is this one, where it was not built with the run.
    pub fn agrees(&self, program: &str) -> Result<(), RuntimeError> {
        if self.protocol == PROTOCOL {
            return Ok(());
        }
        let other = match self.protocol.as_str() {
            "" => "an older version".to_owned(),
            protocol => protocol.to_owned(),
        };
        Err(RuntimeError::Protocol { program: program.to_owned(), own: PROTOCOL, other })
    }

    fn path(&self) -> PathBuf {
        registry_dir().join(format!("{}.json", self.run))
    }

    /// Writes, or overwrites, this entry.
    pub fn register(&self) -> io::Result<()> {
        make_private_dir(&registry_dir())?;
        let half = self.path().with_extension("part");
        fs::write(&half, serde_json::to_vec_pretty(self).map_err(io::Error::other)?)?;
        fs::rename(&half, self.path())
    }

    /// Removes this entry.
    pub fn unregister(&self) -> io::Result<()> {
        match fs::remove_file(self.path()) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            other => other,
        }
    }
}

/// All registered runs, dead ones too, oldest first.
pub fn registered() -> io::Result<Vec<RunEntry>> {
    let dir = match fs::read_dir(registry_dir()) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        other => other?,
    };
    let mut entries = Vec::new();
    for file in dir {
        let path = file?.path();
        if path.extension().is_none_or(|extension| extension != "json") {
            continue;
        }
        // Another run may just have removed its own.
        let Ok(text) = fs::read(&path) else { continue };
        if let Ok(entry) = serde_json::from_slice::<RunEntry>(&text) {
            entries.push(entry);
        }
    }
    entries.sort_by_key(|entry| entry.start_ticks);
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_is_alive_and_another_start_is_another_process() {
        let pid = std::process::id();
        let ticks = start_ticks(pid).unwrap();
        let mut entry = RunEntry {
            run: RunId::new().to_string(),
            pid,
            start_ticks: ticks,
            name: "test".to_owned(),
            set: PathBuf::new(),
            out: PathBuf::new(),
            pace: Pace::Lockstep,
            protocol: PROTOCOL.to_owned(),
            cameras: 1,
            stages: vec![("segment".to_owned(), 1)],
        };
        assert!(entry.is_alive());
        entry.start_ticks += 1;
        assert!(!entry.is_alive());
        assert_eq!(start_ticks(u32::MAX - 1), None);
    }
}
