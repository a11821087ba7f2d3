//! How much of its work registration can do in the time that a set gives a step.
//!
//! A set's `budget_ms` runs from the moment when capture has the last pixel to the publishing of
//! the state. What is left of it when a cloud comes, less what simulate usually takes, decides how
//! many points and iterations are asked for; if that was too much, what there is at the deadline is
//! handed over.

use orime_register::Effort;

/// Share of the full work that does not depend on points and iterations.
const FIXED: f64 = 0.3;
/// Share of an iteration that does not depend on the points.
const PER_ITERATION: f64 = 0.5;
/// Share of the time left that is planned with: the rest is for what nobody foresees.
const PLANNED: f64 = 0.85;
/// How fast what was learnt follows what is seen, per step.
const RATE: f64 = 0.1;
/// Points and iterations as shares of the full ones, from all to least.
const LADDER: [[f64; 2]; 7] =
    [[1.0, 1.0], [1.0, 0.8], [0.75, 0.8], [0.75, 0.65], [0.5, 0.65], [0.5, 0.5], [0.35, 0.4]];

/// Plans each step's registration by what the last ones took.
#[derive(Debug, Clone)]
pub(crate) struct Planner {
    budget_ns: f64,
    ladder: [Effort; LADDER.len()],
    /// What the full work takes; `None` before the first.
    full_ns: Option<f64>,
    /// From the targets to the state.
    simulate_ns: f64,
}

/// One step's plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plan {
    /// What is to be done.
    pub effort: Effort,
    /// Its share of the full work.
    pub share: f32,
    /// When it must be done, nanoseconds.
    pub until_ns: u64,
}

impl Planner {
    /// For a budget; `full` is what is done where there is time for it.
    pub fn new(budget_ms: f64, full: Effort) -> Self {
        let ladder = LADDER.map(|[points, iterations]| Effort {
            points_max: (points * full.points_max as f64) as usize,
            iterations_max: ((iterations * f64::from(full.iterations_max)).round() as u32).max(2),
        });
        Self { budget_ns: budget_ms * 1e6, ladder, full_ns: None, simulate_ns: 0.0 }
    }

    /// Work of an effort as a share of the full one.
    fn share(&self, effort: &Effort) -> f64 {
        let full = &self.ladder[0];
        let points = effort.points_max as f64 / full.points_max as f64;
        let iterations = f64::from(effort.iterations_max) / f64::from(full.iterations_max);
        FIXED + (1.0 - FIXED) * iterations * (PER_ITERATION + (1.0 - PER_ITERATION) * points)
    }

    /// Plans the registration of what arrived at `arrival_ns`; it is `now_ns`.
    pub fn plan(&self, arrival_ns: u64, now_ns: u64) -> Plan {
        let until_ns = arrival_ns as f64 + self.budget_ns - self.simulate_ns;
        let left_ns = (until_ns - now_ns as f64) * PLANNED;
        // Until something is known, little is tried.
        let fits = |effort: &&Effort| {
            self.full_ns.is_some_and(|full_ns| self.share(effort) * full_ns <= left_ns)
        };
        let least = self.ladder[LADDER.len() - 1];
        let effort = self.ladder.iter().find(fits).copied().unwrap_or(least);
        Plan { effort, share: self.share(&effort) as f32, until_ns: until_ns.max(0.0) as u64 }
    }

    /// Learns what a plan took that was not cut short.
    pub fn registered(&mut self, plan: &Plan, took_ns: u64) {
        let full_ns = took_ns as f64 / f64::from(plan.share);
        let known = self.full_ns.get_or_insert(full_ns);
        *known += RATE * (full_ns - *known);
    }

    /// Learns how long after the targets their state came.
    pub fn simulated(&mut self, took_ns: u64) {
        // What is rare and slow counts more: a deadline is missed by it.
        let took_ns = took_ns as f64;
        let rate = if took_ns > self.simulate_ns { 3.0 * RATE } else { RATE };
        self.simulate_ns += rate * (took_ns - self.simulate_ns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FULL: Effort = Effort { points_max: 2000, iterations_max: 10 };

    /// Runs steps on a machine on which the full work takes `full_ms`; the last plan, and what it
    /// took.
    fn settled(budget_ms: f64, full_ms: f64, simulate_ms: f64) -> (Plan, f64) {
        let mut planner = Planner::new(budget_ms, FULL);
        let mut last = (planner.plan(0, 0), 0.0);
        for step in 0..200 {
            let arrival_ns = step * 100_000_000;
            let now_ns = arrival_ns + 2_000_000;
            let plan = planner.plan(arrival_ns, now_ns);
            let took_ms = f64::from(plan.share) * full_ms;
            planner.registered(&plan, (took_ms * 1e6) as u64);
            planner.simulated((simulate_ms * 1e6) as u64);
            last = (plan, 2.0 + took_ms + simulate_ms);
        }
        last
    }

    #[test]
    fn enough_time_is_used_and_too_little_is_kept_to() {
        let (plan, took_ms) = settled(33.0, 10.0, 3.0);
        assert_eq!((plan.effort, plan.share), (FULL, 1.0));
        assert!(took_ms < 33.0);
        let mut shares = Vec::new();
        for budget_ms in [14.0, 12.0, 10.0] {
            let (plan, took_ms) = settled(budget_ms, 10.0, 3.0);
            assert!(took_ms <= budget_ms && plan.share < 1.0, "{budget_ms}: {took_ms}");
            shares.push(plan.share);
        }
        assert!(shares.windows(2).all(|pair| pair[0] > pair[1]), "{shares:?}");
        // What cannot be kept is at least tried with the least.
        let (plan, _) = settled(3.0, 10.0, 3.0);
        assert_eq!(plan.effort, Effort { points_max: 700, iterations_max: 4 });
    }

    #[test]
    fn a_slow_simulate_takes_from_what_register_has() {
        let (quick, _) = settled(14.0, 10.0, 1.0);
        let (slow, _) = settled(14.0, 10.0, 6.0);
        assert!(slow.share < quick.share && slow.until_ns + 4_000_000 < quick.until_ns);
    }
}
