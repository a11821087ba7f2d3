//! Whether a set keeps to a budget: which stage takes longer than it may.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, bail};
use orime_probe::{Percentiles, Report};
use serde::Deserialize;

/// The shape of a budget file; every key is optional.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Budget {
    /// Per stage: `capture` (per frame), `segment`, `register`, `simulate`.
    stage: BTreeMap<String, StageBudget>,
    /// From exposure (or arrival) to the state, milliseconds, 99th percentile.
    end_to_end_p99_ms: Option<f64>,
    /// Age of information, sampled, milliseconds, 99th percentile.
    age_p99_ms: Option<f64>,
    /// States per second, at least.
    hz_min: Option<f64>,
    /// Messages lost by all stages, at most.
    drops_max: Option<u64>,
    /// Whole-image copies, at most.
    frame_copies_max: Option<u64>,
}

/// What one stage may take.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct StageBudget {
    /// Work on one message, milliseconds, 99th percentile.
    compute_p99_ms: Option<f64>,
    /// The way of its input, milliseconds, 99th percentile.
    transport_p99_ms: Option<f64>,
    /// Its input's waiting for work, milliseconds, 99th percentile.
    queue_p99_ms: Option<f64>,
    /// Restarts, at most.
    restarts_max: Option<u64>,
}

impl Budget {
    /// Reads a file.
    pub fn load(path: &Path) -> anyhow::Result<Self> {
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("reading budget `{}`", path.display()))?;
        let budget: Self =
            toml::from_str(&text).with_context(|| format!("budget `{}`", path.display()))?;
        let known = ["capture", "segment", "register", "simulate"];
        if let Some(stage) = budget.stage.keys().find(|stage| !known.contains(&stage.as_str())) {
            bail!("budget `{}`: no stage is called `{stage}`: {known:?} are", path.display());
        }
        Ok(budget)
    }

    /// Everything that is over its budget, in words. What was not seen at all is over it.
    pub fn exceeded(&self, report: &Report) -> Vec<String> {
        let mut found = Vec::new();
        for (stage, budget) in &self.stage {
            let nothing = Percentiles::default();
            let [transport, queue, compute] = match stage.as_str() {
                "capture" => [nothing, nothing, report.capture_us],
                "segment" => hop(&report.hops.capture_to_segment),
                "register" => hop(&report.hops.segment_to_register),
                _ => hop(&report.hops.register_to_simulate),
            };
            let parts = [
                ("compute", budget.compute_p99_ms, compute),
                ("transport", budget.transport_p99_ms, transport),
                ("queue", budget.queue_p99_ms, queue),
            ];
            for (part, max_ms, us) in parts {
                over(&mut found, &format!("stage `{stage}`: {part} p99"), max_ms, us.p99);
            }
            let restarts = report.stages.get(stage).map_or(0, |stage| stage.restarts);
            if budget.restarts_max.is_some_and(|max| restarts > max) {
                found.push(format!("stage `{stage}`: {restarts} restarts"));
            }
        }
        let end_to_end = report.end_to_end_us.p99;
        over(&mut found, "end to end p99", self.end_to_end_p99_ms, end_to_end);
        over(&mut found, "age of information p99", self.age_p99_ms, report.age_us.p99);
        if let Some(min) = self.hz_min.filter(|min| report.hz.is_none_or(|hz| hz < *min)) {
            found.push(format!("{:.2} states/s, at least {min} wanted", report.hz.unwrap_or(0.0)));
        }
        for (what, max, count) in [
            ("messages lost", self.drops_max, report.drops_total),
            ("frame copies", self.frame_copies_max, report.frame_copies),
        ] {
            if let Some(max) = max.filter(|max| count > *max) {
                found.push(format!("{count} {what}, at most {max} allowed"));
            }
        }
        found
    }
}

fn hop(hop: &orime_probe::HopReport) -> [Percentiles; 3] {
    [hop.transport_us, hop.queue_us, hop.compute_us]
}

fn over(found: &mut Vec<String>, what: &str, max_ms: Option<f64>, us: Option<f64>) {
    let Some(max_ms) = max_ms else { return };
    match us.map(|us| us / 1e3) {
        Some(ms) if ms <= max_ms => {}
        Some(ms) => found.push(format!("{what} is {ms:.2} ms, {max_ms} ms allowed")),
        None => found.push(format!("{what} was not seen at all")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_probe::Figures;

    #[test]
    fn what_is_over_is_named_and_what_was_not_seen_is_over() {
        let text = "drops_max = 0\n[stage.register]\ncompute_p99_ms = 5\nrestarts_max = 0\n";
        let budget: Budget = toml::from_str(text).unwrap();
        let mut report = Figures::new().report(0);
        assert_eq!(budget.exceeded(&report), ["stage `register`: compute p99 was not seen at all"]);
        report.hops.segment_to_register.compute_us.p99 = Some(4_999.0);
        assert!(budget.exceeded(&report).is_empty());
        report.hops.segment_to_register.compute_us.p99 = Some(5_500.0);
        report.drops_total = 2;
        let found = budget.exceeded(&report);
        assert_eq!(found[0], "stage `register`: compute p99 is 5.50 ms, 5 ms allowed");
        assert_eq!(found[1], "2 messages lost, at most 0 allowed");
    }

    #[test]
    fn the_shipped_budget_is_one() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/budgets.toml");
        assert!(!Budget::load(&path).unwrap().stage.is_empty());
    }
}
