//! When states between frames are due, and for which instants.

use orime_simulate::{FRAME_S_MAX, FRAME_S_MIN};

/// The instants between a frame and the one that is expected next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Between {
    /// How many there are.
    per_frame: u32,
    /// How many were taken.
    taken: u32,
    /// The frame's exposure, and when its state went out.
    exposure_ns: u64,
    published_ns: u64,
    /// Expected time to the next exposure.
    period_ns: u64,
}

/// One instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Due {
    /// When its state is to go out, `CLOCK_MONOTONIC`, nanoseconds.
    pub at_ns: u64,
    /// The instant, in the clock of the exposures, nanoseconds.
    pub exposure_ns: u64,
    /// The same after the frame's exposure, seconds.
    pub ahead_s: f64,
}

impl Between {
    /// Nothing is due before the first frame.
    pub fn new(per_frame: u32) -> Self {
        Self { per_frame, taken: per_frame, exposure_ns: 0, published_ns: 0, period_ns: 0 }
    }

    /// A frame's state went out; the frame took `dt_s`.
    pub fn begin(&mut self, exposure_ns: u64, published_ns: u64, dt_s: f64) {
        let period_ns = (dt_s.clamp(FRAME_S_MIN, FRAME_S_MAX) * 1e9) as u64;
        *self = Self { taken: 0, exposure_ns, published_ns, period_ns, ..*self };
    }

    /// The next instant, until all were taken.
    pub fn next(&self) -> Option<Due> {
        let left = self.taken < self.per_frame;
        let share = |ns: u64| ns * u64::from(self.taken + 1) / u64::from(self.per_frame + 1);
        left.then(|| {
            let ahead_ns = share(self.period_ns);
            Due {
                at_ns: self.published_ns + ahead_ns,
                exposure_ns: self.exposure_ns + ahead_ns,
                ahead_s: ahead_ns as f64 * 1e-9,
            }
        })
    }

    /// The next instant was taken, or missed.
    pub fn take(&mut self) {
        self.taken = (self.taken + 1).min(self.per_frame);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_part_the_frame_evenly_and_end() {
        let mut between = Between::new(3);
        assert_eq!(between.next(), None, "there was no frame yet");
        between.begin(1_000_000_000, 5_000_000_000, 0.04);
        let mut ahead_ms = Vec::new();
        while let Some(due) = between.next() {
            assert_eq!(due.at_ns - 5_000_000_000, due.exposure_ns - 1_000_000_000);
            ahead_ms.push((due.ahead_s * 1e3).round() as u32);
            between.take();
        }
        assert_eq!(ahead_ms, [10, 20, 30]);
        between.begin(2_000_000_000, 6_000_000_000, f64::INFINITY);
        assert_eq!(between.next().map(|due| due.exposure_ns), Some(2_025_000_000));
    }

    #[test]
    fn none_are_due_where_none_are_asked_for() {
        let mut between = Between::new(0);
        between.begin(1, 2, 0.04);
        assert_eq!(between.next(), None);
    }
}
