//! What a sweep knows: one row per finished run, means over seeds, the Pareto front, and what a
//! millimetre costs along it.

mod growth;

pub use growth::{Exponents, Growth, growth};

use serde::{Deserialize, Serialize};

use crate::scores::percentile;
use crate::summary::{StageMs, StepScore, Summary};

/// Figures of one run. Lengths in millimetres, times in milliseconds per step.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RunFigures {
    /// Steps scored.
    pub steps: u64,
    /// Mean distance of the nodes from the truth.
    pub vertex_error_mm_mean: Option<f64>,
    /// Mean over the steps of the 95th percentile.
    pub vertex_error_mm_p95: Option<f64>,
    /// Eq. (5).
    pub e_mm_mean: Option<f64>,
    /// E of the true pose against the same clouds.
    pub e_at_truth_mm_mean: Option<f64>,
    /// Mean relative change of the edges' lengths, percent.
    pub strain_percent_mean: Option<f64>,
    /// Steps in which the sheet passes through itself.
    pub self_intersecting_steps: u64,
    /// Steps in which the sheet was not followed.
    pub lost_steps: u64,
    /// … of which the tracker knew nothing.
    pub lost_steps_unnoticed: u64,
    /// Median of segment + register + simulate.
    pub step_ms_p50: f64,
    /// … 99th percentile.
    pub step_ms_p99: f64,
    /// Medians per stage; capture is not part of a step.
    pub stage_ms_p50: StageMs,
    /// 99th percentiles per stage.
    pub stage_ms_p99: StageMs,
    /// Equal states, equal hashes.
    pub states_hash: String,
}

impl RunFigures {
    /// The figures of a run that was judged.
    pub fn of(steps: &[StepScore], summary: &Summary) -> Self {
        let times = |figure: fn(&StepScore) -> f64, share| {
            let mut values: Vec<f64> = steps.iter().map(figure).collect();
            values.sort_by(f64::total_cmp);
            percentile(&values, share).unwrap_or_default()
        };
        let stages = |share| StageMs {
            capture: times(|s| s.ms.capture, share),
            segment: times(|s| s.ms.segment, share),
            register: times(|s| s.ms.register, share),
            simulate: times(|s| s.ms.simulate, share),
        };
        Self {
            steps: summary.steps,
            vertex_error_mm_mean: summary.vertex_error_mm_mean,
            vertex_error_mm_p95: summary.vertex_error_mm_p95,
            e_mm_mean: summary.e_mm_mean,
            e_at_truth_mm_mean: summary.e_at_truth_mm_mean,
            strain_percent_mean: summary.strain_percent_mean,
            self_intersecting_steps: summary.self_intersecting_steps,
            lost_steps: summary.lost_steps,
            lost_steps_unnoticed: summary.lost_steps_unnoticed,
            step_ms_p50: times(|s| s.ms.step(), 0.5),
            step_ms_p99: times(|s| s.ms.step(), 0.99),
            stage_ms_p50: stages(0.5),
            stage_ms_p99: stages(0.99),
            states_hash: summary.states_hash.clone(),
        }
    }
}

/// One finished run, as it stands in the ledger.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Hash over the set with this point's keys and seed, the number of steps and the clock.
    pub key: String,
    /// Hash over the program: with the same key and program a run would give the same row again.
    pub program: String,
    /// What was varied.
    pub knob: String,
    /// … to what.
    pub value: String,
    /// Seed of everything random in the scene.
    pub seed: u64,
    /// What it gave.
    #[serde(flatten)]
    pub figures: RunFigures,
}

/// Mean, smallest and largest over the seeds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

/// One setting over all its seeds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Setting {
    /// What was varied.
    pub knob: String,
    /// … to what.
    pub value: String,
    /// Runs.
    pub seeds: usize,
    /// Mean true vertex error.
    pub vertex_error_mm: Spread,
    /// Mean over runs and steps of the 95th percentile.
    pub vertex_error_mm_p95: f64,
    /// Eq. (5).
    pub e_mm: f64,
    /// Strain, percent.
    pub strain_percent: f64,
    /// Medians of a step's time. The least one counts: a seed hardly changes the work, and other
    /// work on the machine only ever adds.
    pub step_ms: Spread,
    /// Largest 99th percentile.
    pub step_ms_p99: f64,
    /// Medians per stage of the run whose median was the least.
    pub stage_ms: StageMs,
    /// Steps of all runs in which the sheet passes through itself.
    pub self_intersecting_steps: u64,
    /// Steps of all runs in which the sheet was not followed.
    pub lost_steps: u64,
    /// Steps of all runs.
    pub steps: u64,
    /// Whether no other setting is both faster and more accurate.
    pub on_front: bool,
}

impl Setting {
    /// Knob and value in one word.
    pub fn name(&self) -> String {
        if self.value.is_empty() {
            self.knob.clone()
        } else {
            format!("{} {}", self.knob, self.value)
        }
    }

    /// Means over the rows of one setting; `None` where no run has an error.
    fn of(rows: &[&Row]) -> Option<Self> {
        let first = rows.first()?;
        let over = |figure: &dyn Fn(&RunFigures) -> Option<f64>| {
            Spread::of(rows.iter().filter_map(|row| figure(&row.figures)))
        };
        let mean = |figure: &dyn Fn(&RunFigures) -> Option<f64>| {
            over(figure).map_or(f64::NAN, |spread| spread.mean)
        };
        let by_time =
            |a: &&&Row, b: &&&Row| a.figures.step_ms_p50.total_cmp(&b.figures.step_ms_p50);
        let fastest = rows.iter().min_by(by_time)?;
        let count = |figure: fn(&RunFigures) -> u64| rows.iter().map(|r| figure(&r.figures)).sum();
        Some(Self {
            knob: first.knob.clone(),
            value: first.value.clone(),
            seeds: rows.len(),
            vertex_error_mm: over(&|f| f.vertex_error_mm_mean)?,
            vertex_error_mm_p95: mean(&|f| f.vertex_error_mm_p95),
            e_mm: mean(&|f| f.e_mm_mean),
            strain_percent: mean(&|f| f.strain_percent_mean),
            step_ms: over(&|f| Some(f.step_ms_p50))?,
            step_ms_p99: over(&|f| Some(f.step_ms_p99))?.max,
            stage_ms: fastest.figures.stage_ms_p50,
            self_intersecting_steps: count(|f| f.self_intersecting_steps),
            lost_steps: count(|f| f.lost_steps),
            steps: count(|f| f.steps),
            on_front: false,
        })
    }
}

impl Spread {
    /// Over some values; `None` without any.
    pub fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let values: Vec<f64> = values.collect();
        Some(Self {
            mean: crate::scores::mean(values.iter().copied())?,
            min: values.iter().copied().fold(f64::INFINITY, f64::min),
            max: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        })
    }
}

/// The settings in the order of their first rows, with the front marked. Settings of the knobs in
/// `apart` saw other data: they are never on the front and push nobody off it.
pub fn settings(rows: &[Row], apart: &[&str]) -> Vec<Setting> {
    let mut names: Vec<(&str, &str)> = Vec::new();
    for row in rows {
        let name = (row.knob.as_str(), row.value.as_str());
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let of = |(knob, value): &(&str, &str)| {
        let mine: Vec<&Row> =
            rows.iter().filter(|row| row.knob == *knob && row.value == *value).collect();
        Setting::of(&mine)
    };
    let mut settings: Vec<Setting> = names.iter().filter_map(of).collect();
    let taking_part: Vec<usize> =
        (0..settings.len()).filter(|k| !apart.contains(&settings[*k].knob.as_str())).collect();
    let places: Vec<[f64; 2]> = taking_part.iter().map(|k| place(&settings[*k])).collect();
    for k in front(&places) {
        settings[taking_part[k]].on_front = true;
    }
    settings
}

/// Time and error of a setting.
pub fn place(setting: &Setting) -> [f64; 2] {
    [setting.step_ms.min, setting.vertex_error_mm.mean]
}

/// The Pareto front of `[time, error]`: indices of the points than which no other one is at least
/// as good in both and better in one, by time. Of equal points the first is taken.
pub fn front(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|k| points[*k].iter().all(|c| c.is_finite())).collect();
    let by = |a: &usize, b: &usize| {
        let (a, b) = (points[*a], points[*b]);
        a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
    };
    order.sort_by(by);
    let mut least = f64::INFINITY;
    order.retain(|k| {
        let better = points[*k][1] < least;
        least = least.min(points[*k][1]);
        better
    });
    order
}

/// One step along the front.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cost {
    /// Setting at its end.
    pub setting: String,
    /// Median time of a step there.
    pub step_ms: f64,
    /// True vertex error there, mean, smallest and largest of the seeds.
    pub vertex_error_mm: Spread,
    /// Share of its steps in which the sheet was not followed, percent.
    pub lost_percent: f64,
    /// Milliseconds per millimetre won since the setting before; `None` at the first.
    pub ms_per_mm: Option<f64>,
}

/// What each millimetre costs: the front by time.
pub fn costs(settings: &[Setting]) -> Vec<Cost> {
    let mut on_front: Vec<&Setting> = settings.iter().filter(|s| s.on_front).collect();
    on_front.sort_by(|a, b| a.step_ms.min.total_cmp(&b.step_ms.min));
    let price = |k: usize| {
        let [before, after] = [place(on_front[k.checked_sub(1)?]), place(on_front[k])];
        Some((after[0] - before[0]) / (before[1] - after[1]))
    };
    let cost = |(k, setting): (usize, &&Setting)| Cost {
        setting: setting.name(),
        step_ms: setting.step_ms.min,
        vertex_error_mm: setting.vertex_error_mm,
        lost_percent: 100.0 * setting.lost_steps as f64 / setting.steps.max(1) as f64,
        ms_per_mm: price(k),
    };
    on_front.iter().enumerate().map(cost).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(knob: &str, value: &str, seed: u64, ms: f64, error_mm: Option<f64>) -> Row {
        let figures = RunFigures {
            steps: 10,
            vertex_error_mm_mean: error_mm,
            step_ms_p50: ms,
            lost_steps: seed,
            ..RunFigures::default()
        };
        let key = format!("{knob}{value}{seed}");
        Row { key, program: String::new(), knob: knob.into(), value: value.into(), seed, figures }
    }

    #[test]
    fn the_front_holds_what_nothing_beats() {
        let points = [
            [10.0, 1.0], // On it.
            [12.0, 1.0], // As accurate and slower.
            [10.0, 1.5], // As fast and less accurate.
            [5.0, 3.0],  // On it: the fastest.
            [20.0, 0.5], // On it: the most accurate.
            [15.0, 2.0], // Beaten in both.
            [20.0, 0.5], // Equal to one that is on it.
            [1.0, f64::NAN],
        ];
        assert_eq!(front(&points), [3, 0, 4]);
        assert_eq!(front(&[]), [0; 0]);
    }

    #[test]
    fn seeds_are_averaged_and_costs_follow_the_front() {
        let rows = [
            row("base", "", 1, 10.0, Some(1.0)),
            row("fewer", "3", 1, 4.0, Some(2.0)),
            row("rate", "60", 1, 1.0, Some(0.1)),
            row("base", "", 2, 14.0, Some(0.5)),
            row("fewer", "3", 2, 6.0, Some(3.0)),
            row("blind", "1", 1, 1.0, None),
        ];
        let settings = settings(&rows, &["rate"]);
        let names: Vec<String> = settings.iter().map(Setting::name).collect();
        assert_eq!(names, ["base", "fewer 3", "rate 60"]);
        assert_eq!(settings.iter().map(|s| s.on_front).collect::<Vec<_>>(), [true, true, false]);
        let base = &settings[0];
        assert_eq!((base.seeds, base.lost_steps, base.steps), (2, 3, 20));
        assert_eq!(base.vertex_error_mm, Spread { mean: 0.75, min: 0.5, max: 1.0 });
        let costs = costs(&settings);
        assert_eq!(
            costs.iter().map(|c| c.setting.as_str()).collect::<Vec<_>>(),
            ["fewer 3", "base"]
        );
        // From 4 to 10 ms, from 2.5 to 0.75 mm.
        assert_eq!(costs[0].ms_per_mm, None);
        assert_eq!(costs[1].ms_per_mm, Some(6.0 / 1.75));
    }

    #[test]
    fn a_row_comes_back_from_its_line() {
        let row = row("grid", "31", 7, 0.1 + 0.2, Some(1.0 / 3.0));
        let line = serde_json::to_string(&row).unwrap();
        assert_eq!(serde_json::from_str::<Row>(&line).unwrap(), row);
    }
}
