//! How old states are when they come, against a set's budget, and what was given up for it.

use serde::Serialize;

/// One state of a running set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// From the last pixel of the frame set to the state, milliseconds.
    pub latency_ms: f64,
    /// Share of the full registration that was planned, 0 to 1.
    pub effort: f32,
    /// Whether the deadline ended the registration.
    pub cut_short: bool,
}

/// Figures over the states of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LatencyFigures {
    /// The set's `budget_ms`.
    pub budget_ms: Option<f64>,
    /// States that were seen.
    pub states: usize,
    /// Median latency, milliseconds.
    pub latency_ms_p50: f64,
    /// 99th percentile.
    pub latency_ms_p99: f64,
    /// Longest.
    pub latency_ms_max: f64,
    /// States that came later than the budget.
    pub late: usize,
    /// Mean share of the full registration that there was time for.
    pub effort_mean: f64,
    /// Registrations that the deadline ended.
    pub cut_short: usize,
}

impl LatencyFigures {
    /// `None` without states.
    pub fn of(timings: &[Timing], budget_ms: Option<f64>) -> Option<Self> {
        let mut ms: Vec<f64> = timings.iter().map(|timing| timing.latency_ms).collect();
        ms.sort_by(f64::total_cmp);
        let last = ms.len().checked_sub(1)?;
        let at = |share: f64| ms[(share * last as f64).round() as usize];
        let efforts = timings.iter().map(|timing| f64::from(timing.effort));
        Some(Self {
            budget_ms,
            states: ms.len(),
            latency_ms_p50: at(0.5),
            latency_ms_p99: at(0.99),
            latency_ms_max: ms[last],
            late: budget_ms.map_or(0, |budget| ms.iter().filter(|ms| **ms > budget).count()),
            effort_mean: efforts.sum::<f64>() / ms.len() as f64,
            cut_short: timings.iter().filter(|timing| timing.cut_short).count(),
        })
    }
}

impl std::fmt::Display for LatencyFigures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { latency_ms_p50: p50, latency_ms_p99: p99, latency_ms_max: max, .. } = self;
        write!(f, "last pixel to state        p50 {p50:.1} ms, p99 {p99:.1} ms, max {max:.1} ms")?;
        if let Some(budget_ms) = self.budget_ms {
            let Self { late, states, cut_short, .. } = self;
            let effort = 100.0 * self.effort_mean;
            write!(
                f,
                "\nbudget of {budget_ms} ms          {late} of {states} late, {effort:.0} % of the \
                 full work, {cut_short} cut short"
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_late_is_counted() {
        assert_eq!(LatencyFigures::of(&[], Some(1.0)), None);
        let timing = |latency_ms, effort, cut_short| Timing { latency_ms, effort, cut_short };
        let timings = [timing(9.0, 0.5, false), timing(12.0, 1.0, true), timing(3.0, 0.6, false)];
        let figures = LatencyFigures::of(&timings, Some(10.0)).unwrap();
        assert_eq!((figures.states, figures.late, figures.cut_short), (3, 1, 1));
        assert_eq!((figures.latency_ms_p50, figures.latency_ms_max), (9.0, 12.0));
        assert!((figures.effort_mean - 0.7).abs() < 1e-6);
        assert!(figures.to_string().contains("1 of 3 late"));
        assert_eq!(LatencyFigures::of(&timings, None).unwrap().late, 0);
    }
}
