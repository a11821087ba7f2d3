//! A camera's clock against the machine's.

/// How long an offset is remembered, nanoseconds: long enough to meet a fast frame, short enough
/// to follow clocks that drift by 50 parts in a million to within 0.3 ms.
const HALF_WINDOW_NS: u64 = 3_000_000_000;

/// Maps a camera's time stamps to CLOCK_MONOTONIC.
///
/// A frame arrives later than it was exposed, by at least the transport's least delay and often
/// more. So arrival − stamp is the clocks' offset plus that delay, and the least difference of
/// the last seconds is the best guess: delays of single frames do not move it. The least delay
/// itself (a few milliseconds, the same for equal cameras) stays in it.
#[derive(Debug, Clone, Default)]
pub(super) struct ClockMap {
    /// Least offset of the half window before and of the one at hand.
    least_ns: [Option<i64>; 2],
    begun_ns: u64,
    last_ns: u64,
}

impl ClockMap {
    /// The machine's time of a stamp that came at `arrival_ns`; strictly increasing, and never
    /// after the arrival unless stamps stand still.
    pub fn map(&mut self, stamp_ns: u64, arrival_ns: u64) -> u64 {
        if arrival_ns.saturating_sub(self.begun_ns) > HALF_WINDOW_NS {
            self.least_ns = [self.least_ns[1], None];
            self.begun_ns = arrival_ns;
        }
        let offset_ns = arrival_ns as i64 - stamp_ns as i64;
        let here = &mut self.least_ns[1];
        *here = Some(here.map_or(offset_ns, |least| least.min(offset_ns)));
        let least_ns = self.least_ns.iter().flatten().min().copied().unwrap_or(offset_ns);
        let time_ns = (stamp_ns as i64 + least_ns).max(0) as u64;
        self.last_ns = time_ns.max(self.last_ns + 1);
        self.last_ns
    }

    /// Forgets the offset, but not how far time has come: the camera's clock begins anew.
    pub fn restart(&mut self) {
        *self = Self { last_ns: self.last_ns, ..Self::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn late_frames_keep_their_time() {
        let mut clock = ClockMap::default();
        // Stamps of a clock that started 90 s later; delays of 4 ms, now and then of 30.
        for k in 0..600u64 {
            let exposed = 100_000 * MS + k * 33 * MS;
            let delay = if k % 7 == 3 { 30 * MS } else { 4 * MS };
            let mapped = clock.map(exposed - 90_000 * MS, exposed + delay);
            if k > 3 {
                assert_eq!(mapped, exposed + 4 * MS, "frame {k}");
            }
        }
    }

    #[test]
    fn a_drifting_clock_is_followed() {
        let mut clock = ClockMap::default();
        for k in 0..3000u64 {
            let exposed = 1_000_000 * MS + k * 33 * MS;
            let stamp = exposed + k * 33 * 50; // 50 parts in a million fast
            let mapped = clock.map(stamp, exposed + 4 * MS);
            let error = mapped.abs_diff(exposed + 4 * MS);
            assert!(error < 350_000, "frame {k}: {error} ns");
        }
    }

    #[test]
    fn time_never_stands_still() {
        let mut clock = ClockMap::default();
        let times = [5, 5, 4, 6].map(|stamp| clock.map(stamp, 100));
        assert!(times.windows(2).all(|w| w[0] < w[1]), "{times:?}");
    }
}
