//! How a process learns that it should end.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::process::{Pid, Signal, getppid, set_parent_process_death_signal};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};

/// A flag that asks a process to end, shared by all that wait in it.
#[derive(Debug, Clone, Default)]
pub struct Stop {
    requested: Arc<AtomicBool>,
    leaving: Arc<AtomicBool>,
    release: Arc<AtomicBool>,
}

impl Stop {
    /// A flag that nothing has raised yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Raised by SIGTERM, and by SIGHUP for a process that another one will follow. SIGINT, which
    /// a terminal sends to everyone, is ignored: the supervisor decides what a Ctrl-C means.
    pub fn on_terminate() -> io::Result<Self> {
        let stop = Self::new();
        signal_hook::flag::register(SIGTERM, Arc::clone(&stop.requested))?;
        // In this order: whoever sees the request also sees what it is for.
        signal_hook::flag::register(SIGHUP, Arc::clone(&stop.leaving))?;
        signal_hook::flag::register(SIGHUP, Arc::clone(&stop.requested))?;
        signal_hook::flag::register(SIGUSR1, Arc::clone(&stop.release))?;
        signal_hook::flag::register(SIGINT, Arc::new(AtomicBool::new(false)))?;
        Ok(stop)
    }

    /// The flag itself, for signal handlers.
    pub fn flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.requested)
    }

    /// Asks to end.
    pub fn request(&self) {
        self.requested.store(true, Ordering::Relaxed);
    }

    /// Whether another process of the same stage will go on: the stream does not end.
    pub fn is_handover(&self) -> bool {
        self.leaving.load(Ordering::Relaxed)
    }

    /// Whether the supervisor asks (SIGUSR1) to give back messages that are held for ones to come:
    /// they were lost with a stage that died, and its successor may need the memory. Told once.
    pub fn take_release(&self) -> bool {
        self.release.swap(false, Ordering::Relaxed)
    }

    /// Whether somebody asked to end.
    pub fn requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }
}

/// Has the kernel kill this process when `parent` ends, however that ends.
pub fn die_with_parent(parent: u32) -> io::Result<()> {
    set_parent_process_death_signal(Some(Signal::KILL))?;
    // The parent may have ended before the line above took effect.
    if getppid().map(Pid::as_raw_pid) != Some(parent as i32) {
        return Err(io::Error::other("the supervisor is gone already"));
    }
    Ok(())
}
