//! How a time spreads: counts and percentiles.

use hdrhistogram::Histogram;
use serde::Serialize;

/// Longest time that is told apart, nanoseconds: ten minutes.
const NS_MAX: u64 = 600_000_000_000;
/// Fewest samples that a 99.9th percentile is told of.
const SAMPLES_FOR_P99_9: u64 = 1_000;

/// Collects times, nanoseconds, to three significant digits.
#[derive(Debug, Clone)]
pub struct Spread {
    histogram: Histogram<u64>,
}

/// Percentiles of a [`Spread`], microseconds; `None` where there is nothing to tell.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// Number of samples.
    pub count: u64,
    /// Half are below.
    pub p50: Option<f64>,
    /// 90 of 100 are below.
    pub p90: Option<f64>,
    /// 99 of 100 are below.
    pub p99: Option<f64>,
    /// 999 of 1000 are below; `None` with fewer than 1000 samples.
    pub p99_9: Option<f64>,
    /// The largest.
    pub max: Option<f64>,
}

impl Spread {
    /// Nothing yet.
    pub fn new() -> Self {
        let histogram = Histogram::new_with_bounds(1, NS_MAX, 3);
        Self { histogram: histogram.expect("the bounds are constants that fit") }
    }

    /// Adds one time; longer ones than ten minutes count as that.
    pub fn add_ns(&mut self, ns: u64) {
        self.histogram.saturating_record(ns);
    }

    /// Number of samples.
    pub fn count(&self) -> u64 {
        self.histogram.len()
    }

    /// A quantile, nanoseconds; `None` without samples.
    pub fn quantile_ns(&self, quantile: f64) -> Option<u64> {
        (self.count() > 0).then(|| self.histogram.value_at_quantile(quantile))
    }

    /// Standard deviation, nanoseconds; `None` with fewer than two samples.
    pub fn deviation_ns(&self) -> Option<f64> {
        (self.count() > 1).then(|| self.histogram.stdev())
    }

    /// The same with the samples that would have been taken every `period_ns` while one longer
    /// than that kept the next from being taken (coordinated omission).
    pub fn corrected(&self, period_ns: u64) -> Self {
        Self { histogram: self.histogram.clone_correct(period_ns) }
    }

    /// The percentiles that are shown everywhere.
    pub fn percentiles(&self) -> Percentiles {
        let us = |quantile| self.quantile_ns(quantile).map(|ns| ns as f64 / 1e3);
        Percentiles {
            count: self.count(),
            p50: us(0.5),
            p90: us(0.9),
            p99: us(0.99),
            p99_9: us(0.999).filter(|_| self.count() >= SAMPLES_FOR_P99_9),
            max: us(1.0),
        }
    }

    /// The histogram itself, nanoseconds.
    pub fn histogram(&self) -> &Histogram<u64> {
        &self.histogram
    }
}

impl Default for Spread {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_percentile_is_blank_where_it_would_be_the_maximum() {
        let mut spread = Spread::new();
        (0..999).for_each(|k| spread.add_ns(1000 + k));
        assert_eq!(spread.percentiles().p99_9, None);
        spread.add_ns(2000);
        assert!(spread.percentiles().p99_9.is_some());
    }

    #[test]
    fn a_stall_counts_for_the_samples_that_it_prevented() {
        let mut spread = Spread::new();
        (0..99).for_each(|_| spread.add_ns(1_000));
        spread.add_ns(100_000);
        let corrected = spread.corrected(1_000);
        assert_eq!(spread.percentiles().p90, Some(1.0));
        // 100 µs in a period of 1 µs: 99 more samples of 1 to 99 µs.
        assert_eq!(corrected.count(), 199);
        assert!(corrected.percentiles().p90.is_some_and(|us| us > 50.0));
    }
}
