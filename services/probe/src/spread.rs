//! How a time spreads: counts and percentiles.

use hdrhistogram::Histogram;
use serde::Serialize;

/// Longest time that is told apart, nanoseconds: ten minutes.
const NS_MAX: u64 = 600_000_000_000;

/// Collects times, nanoseconds, to three significant digits.
#[derive(Debug, Clone)]
pub struct Spread {
    histogram: Histogram<u64>,
}

/// Percentiles of a [`Spread`], microseconds; `None` where there is nothing to tell.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Percentiles {
    /// Number of samples.
    pub count: u64,
    /// Half are below.
    pub p50: Option<f64>,
    /// 99 of 100 are below.
    pub p99: Option<f64>,
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

    /// The percentiles that are shown everywhere.
    pub fn percentiles(&self) -> Percentiles {
        let us = |quantile| self.quantile_ns(quantile).map(|ns| ns as f64 / 1e3);
        Percentiles { count: self.count(), p50: us(0.5), p99: us(0.99), max: us(1.0) }
    }
}

impl Default for Spread {
    fn default() -> Self {
        Self::new()
    }
}
