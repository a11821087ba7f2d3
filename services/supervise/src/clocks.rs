//! Suspends of the machine and steps of its wall clock, told from how clocks move apart.
//!
//! `CLOCK_BOOTTIME` goes on while the machine sleeps, `CLOCK_MONOTONIC` does not; the wall clock
//! can be set. No latency is ever taken from the wall clock, so a step of it is only reported.

use std::time::{SystemTime, UNIX_EPOCH};

use rustix::time::{ClockId, clock_gettime};

/// A difference that is no slewing and no pause between two readings, nanoseconds.
const STEP_MIN_NS: i64 = 250_000_000;

/// What happened to the clocks between two looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClockEvent {
    /// The machine slept so long, nanoseconds.
    Suspend(i64),
    /// The wall clock was set by so much, nanoseconds.
    Step(i64),
}

/// How far the clocks were apart at the last look.
#[derive(Debug, Clone, Copy)]
pub struct Clocks {
    boot_minus_monotonic_ns: i64,
    wall_minus_boot_ns: i64,
}

/// One reading of all three, nanoseconds.
#[derive(Debug, Clone, Copy)]
pub struct Reading {
    monotonic_ns: i64,
    boot_ns: i64,
    wall_ns: i64,
}

impl Reading {
    /// Now.
    pub fn now() -> Self {
        let ns = |clock| {
            let time = clock_gettime(clock);
            time.tv_sec * 1_000_000_000 + time.tv_nsec
        };
        let wall = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self {
            monotonic_ns: ns(ClockId::Monotonic),
            boot_ns: ns(ClockId::Boottime),
            wall_ns: wall.as_nanos() as i64,
        }
    }
}

impl Clocks {
    /// Begins with this reading.
    pub fn new(reading: Reading) -> Self {
        Self {
            boot_minus_monotonic_ns: reading.boot_ns - reading.monotonic_ns,
            wall_minus_boot_ns: reading.wall_ns - reading.boot_ns,
        }
    }

    /// What happened since the last look.
    pub fn look(&mut self, reading: Reading) -> Option<ClockEvent> {
        let next = Self::new(reading);
        let slept_ns = next.boot_minus_monotonic_ns - self.boot_minus_monotonic_ns;
        let set_ns = next.wall_minus_boot_ns - self.wall_minus_boot_ns;
        if slept_ns.abs() >= STEP_MIN_NS {
            *self = next;
            return Some(ClockEvent::Suspend(slept_ns));
        }
        if set_ns.abs() >= STEP_MIN_NS {
            *self = next;
            return Some(ClockEvent::Step(set_ns));
        }
        // Slewing by NTP must not add up to a step.
        *self = next;
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    fn at(monotonic_s: i64, slept_s: i64, set_s: i64) -> Reading {
        let boot_ns = (monotonic_s + slept_s) * S;
        Reading { monotonic_ns: monotonic_s * S, boot_ns, wall_ns: boot_ns + (1000 + set_s) * S }
    }

    #[test]
    fn sleep_and_setting_are_told_apart_and_passing_time_is_neither() {
        let mut clocks = Clocks::new(at(10, 0, 0));
        assert_eq!(clocks.look(at(20, 0, 0)), None);
        assert_eq!(clocks.look(at(21, 600, 0)), Some(ClockEvent::Suspend(600 * S)));
        assert_eq!(clocks.look(at(22, 600, -3600)), Some(ClockEvent::Step(-3600 * S)));
        assert_eq!(clocks.look(at(23, 600, -3600)), None);
    }
}
