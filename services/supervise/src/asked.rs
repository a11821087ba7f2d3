//! Signals that were sent to the supervisor.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

/// Whether somebody asked the supervisor to stop.
#[derive(Debug)]
pub struct Asked {
    stop: Arc<AtomicBool>,
}

impl Asked {
    /// Listens from now on; whatever is started later is ended in order.
    pub fn listen() -> std::io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            signal_hook::flag::register(signal, Arc::clone(&stop))?;
        }
        Ok(Self { stop })
    }

    /// Whether somebody asked since the last look.
    pub fn again(&self) -> bool {
        self.stop.swap(false, Ordering::Relaxed)
    }
}
