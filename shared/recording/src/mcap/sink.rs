//! Where a recorder's bytes go: anything that can be written to from front to back.

use std::io::{self, Seek, SeekFrom, Write};

/// Counts positions for the MCAP library, and stays closed once a write has failed: what follows
/// a partial write could never be read.
pub(super) struct Sink {
    inner: Box<dyn Write + Send>,
    position: u64,
    failed: bool,
}

impl Sink {
    pub(super) fn new(inner: Box<dyn Write + Send>) -> Self {
        Self { inner, position: 0, failed: false }
    }

    pub(super) fn position(&self) -> u64 {
        self.position
    }

    fn guarded<T>(&mut self, call: impl FnOnce(&mut dyn Write) -> io::Result<T>) -> io::Result<T> {
        if self.failed {
            return Err(io::Error::other("an earlier write failed"));
        }
        let result = call(self.inner.as_mut());
        if let Err(error) = &result {
            self.failed = error.kind() != io::ErrorKind::Interrupted;
        }
        result
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.guarded(|inner| inner.write(bytes))?;
        self.position += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.guarded(|inner| inner.flush())
    }
}

impl Seek for Sink {
    /// Only ever asked where it is.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.position),
            _ => Err(io::ErrorKind::Unsupported.into()),
        }
    }
}
