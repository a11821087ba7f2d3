//! When a fold moves: rest, one smooth turn, rest.

/// Rests and turn of one move, as shares of the whole sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Share of the sequence at rest before the move, 0 to 1. Default 0.15.
    pub rest_before: f64,
    /// Share of the sequence at rest after the move, 0 to 1. Default 0.10.
    pub rest_after: f64,
}

impl Default for Timing {
    fn default() -> Self {
        Self { rest_before: 0.15, rest_after: 0.10 }
    }
}

impl Timing {
    /// Share of the move that is done at `progress` (0 = first step, 1 = last), smooth:
    /// s²(3 − 2s), zero velocity at both ends.
    pub fn done(&self, progress: f64) -> f64 {
        let moving = 1.0 - self.rest_before - self.rest_after;
        let s = ((progress - self.rest_before) / moving).clamp(0.0, 1.0);
        s * s * (3.0 - 2.0 * s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rests_at_both_ends_and_passes_the_middle_half_done() {
        let timing = Timing { rest_before: 0.2, rest_after: 0.2 };
        for (progress, done) in [(0.0, 0.0), (0.2, 0.0), (0.5, 0.5), (0.8, 1.0), (1.0, 1.0)] {
            assert!((timing.done(progress) - done).abs() < 1e-12, "at {progress}");
        }
        // A quarter of the turn: s = 0.25, s²(3 − 2s) = 0.0625 · 2.5.
        assert!((timing.done(0.35) - 0.15625).abs() < 1e-12);
    }

    #[test]
    fn documented_defaults_hold() {
        assert_eq!(Timing::default(), Timing { rest_before: 0.15, rest_after: 0.10 });
    }
}
