//! When a stage that died is started again, and when that is given up.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Pause before the second restart within the window; it doubles with each further one. The first
/// comes at once.
const PAUSE_FIRST: Duration = Duration::from_millis(100);
/// Longest pause.
const PAUSE_MAX: Duration = Duration::from_secs(5);

/// How often a stage may be restarted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    /// Restarts within the window; 0 means that a stage that dies ends the set.
    pub restarts: u32,
    /// The window.
    pub window: Duration,
}

/// The restarts of one stage that still count.
#[derive(Debug, Clone, Default)]
pub struct History {
    restarts: VecDeque<Instant>,
}

impl History {
    /// A stage has died: the pause before it is started again, or `None` if its budget is spent.
    pub fn died(&mut self, budget: Budget, now: Instant) -> Option<Duration> {
        while self.restarts.front().is_some_and(|at| now.duration_since(*at) > budget.window) {
            self.restarts.pop_front();
        }
        let before = self.restarts.len() as u32;
        if before >= budget.restarts {
            return None;
        }
        self.restarts.push_back(now);
        Some(match before {
            0 => Duration::ZERO,
            n => PAUSE_FIRST.saturating_mul(1 << (n - 1).min(10)).min(PAUSE_MAX),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_comes_at_once_then_pauses_double_and_the_budget_ends() {
        let budget = Budget { restarts: 4, window: Duration::from_secs(60) };
        let (mut history, start) = (History::default(), Instant::now());
        let mut after = |s: u64| history.died(budget, start + Duration::from_secs(s));
        let ms = |ms| Some(Duration::from_millis(ms));
        assert_eq!([after(0), after(1), after(2), after(3)], [ms(0), ms(100), ms(200), ms(400)]);
        assert_eq!(after(4), None);
        // The first two have left the window.
        assert_eq!((after(62), after(62)), (ms(200), ms(400)));
    }

    #[test]
    fn pauses_have_an_end_and_no_budget_means_no_restart() {
        let budget = Budget { restarts: 100, window: Duration::from_secs(60) };
        let (mut history, now) = (History::default(), Instant::now());
        let longest = (0..100).filter_map(|_| history.died(budget, now)).max();
        assert_eq!(longest, Some(PAUSE_MAX));
        let none = Budget { restarts: 0, ..budget };
        assert_eq!(History::default().died(none, now), None);
    }
}
