//! A run of a set: its id, and the only places that its processes leave files in.

use std::fmt;
use std::fs;
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Where POSIX shared memory lies on Linux.
pub const SHARED_MEMORY_DIR: &str = "/dev/shm";

/// Names one run of a set on this machine; printed as eight hexadecimal digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct RunId(u32);

impl RunId {
    /// An id that no other living run has: time and process, mixed.
    pub fn new() -> Self {
        let seed = crate::now_ns() ^ (u64::from(std::process::id()) << 40);
        let mixed = (seed ^ (seed >> 31)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        Self((mixed >> 32) as u32)
    }

    /// The id in message headers.
    pub fn number(self) -> u64 {
        u64::from(self.0)
    }

    /// What the names of all shared memory of this run begin with.
    pub fn prefix(self) -> String {
        format!("orime_{self}_")
    }

    /// iceoryx2's files of this run. Short, for Unix sockets in it have paths of 107 bytes.
    pub fn ipc_dir(self) -> PathBuf {
        user_dir().join(self.to_string())
    }
}

impl Default for RunId {
    fn default() -> Self {
        Self::new()
    }
}

impl fmt::Display for RunId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:08x}", self.0)
    }
}

impl FromStr for RunId {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match (text.len(), u32::from_str_radix(text, 16)) {
            (8, Ok(number)) => Ok(Self(number)),
            _ => {
                Err(format!("`{text}` is not a run: eight hexadecimal digits, as `orime ps` shows"))
            }
        }
    }
}

/// This user's directory for what must be short-lived and short-named.
fn user_dir() -> PathBuf {
    PathBuf::from(format!("/tmp/orime-{}", rustix::process::getuid().as_raw()))
}

/// Makes a directory, and its parents, that only this user can enter.
pub fn make_private_dir(path: &Path) -> io::Result<()> {
    fs::DirBuilder::new().recursive(true).mode(0o700).create(path)
}

/// The shared-memory objects of a run that exist now.
pub fn shared_memory_of(run: RunId) -> io::Result<Vec<PathBuf>> {
    let prefix = run.prefix();
    let mut found = Vec::new();
    for entry in fs::read_dir(SHARED_MEMORY_DIR)? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().starts_with(&prefix) {
            found.push(entry.path());
        }
    }
    found.sort();
    Ok(found)
}

/// Removes everything that a run left: its shared memory and iceoryx2's files, nothing else.
///
/// Only for runs none of whose processes lives. Returns how many shared-memory objects there were.
pub fn clean(run: RunId) -> io::Result<usize> {
    let leftovers = shared_memory_of(run)?;
    for path in &leftovers {
        remove_if_there(fs::remove_file(path))?;
    }
    remove_if_there(fs::remove_dir_all(run.ipc_dir()))?;
    Ok(leftovers.len())
}

/// Runs of this user that have a directory of their own.
pub fn ipc_dirs() -> io::Result<Vec<String>> {
    let dir = match fs::read_dir(user_dir()) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        other => other?,
    };
    let names = dir.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
    let names: io::Result<Vec<String>> = names.collect();
    Ok(names?.into_iter().filter(|name| name.parse::<RunId>().is_ok()).collect())
}

/// Name, or number, of the user that a run's shared memory belongs to, if that is somebody else.
pub fn foreign_owner(run: RunId) -> Option<String> {
    let own = rustix::process::getuid().as_raw();
    let objects = shared_memory_of(run).ok()?;
    let owners = objects.iter().filter_map(|path| Some(fs::metadata(path).ok()?.uid()));
    owners.filter(|owner| *owner != own).map(user_name).next()
}

/// A user's name, or the number where the machine knows none.
pub fn user_name(uid: u32) -> String {
    let passwd = fs::read_to_string("/etc/passwd").unwrap_or_default();
    let named = passwd.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(uid)).then(|| name.to_owned())
    });
    named.unwrap_or_else(|| uid.to_string())
}

fn remove_if_there(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}
