//! What systemd is told by a supervisor that it started: ready, alive, stopping.

use std::env;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::{Duration, Instant};

/// The way to systemd; silent where there is none.
#[derive(Debug)]
pub struct Notify {
    socket: Option<(UnixDatagram, SocketAddr)>,
    /// Half the watchdog's time.
    period: Option<Duration>,
    told: Instant,
}

impl Notify {
    /// Finds the way in the environment, as `systemd.service(5)` says.
    pub fn from_environment() -> Self {
        let socket = env::var("NOTIFY_SOCKET").ok().and_then(|path| {
            let address = match path.strip_prefix('@') {
                Some(name) => SocketAddr::from_abstract_name(name),
                None => SocketAddr::from_pathname(&path),
            };
            Some((UnixDatagram::unbound().ok()?, address.ok()?))
        });
        let own = env::var("WATCHDOG_PID").ok().and_then(|pid| pid.parse().ok());
        let is_meant = own.is_none_or(|pid: u32| pid == std::process::id());
        let watchdog_us = env::var("WATCHDOG_USEC").ok().and_then(|us| us.parse().ok());
        let period = watchdog_us.filter(|_| is_meant).map(|us: u64| Duration::from_micros(us / 2));
        Self { socket, period, told: Instant::now() }
    }

    /// Everything runs.
    pub fn ready(&self, status: &str) {
        self.send(&format!("READY=1\nSTATUS={status}"));
    }

    /// The set is ending.
    pub fn stopping(&self) {
        self.send("STOPPING=1");
    }

    /// Still here; said as often as systemd wants to hear it.
    pub fn alive(&mut self, status: impl FnOnce() -> String) {
        if self.period.is_some_and(|period| self.told.elapsed() >= period) {
            self.told = Instant::now();
            self.send(&format!("WATCHDOG=1\nSTATUS={}", status()));
        }
    }

    fn send(&self, message: &str) {
        if let Some((socket, address)) = &self.socket {
            // Whoever does not listen is not told.
            let _ = socket.send_to_addr(message.as_bytes(), address);
        }
    }
}
