//! How time grows with what a knob sets: `time ~ value^exponent`.

use serde::Serialize;

use super::Setting;
use crate::summary::StageMs;

/// Fewer values say nothing about growth.
const VALUES_MIN: usize = 3;

/// Growth of a step's time and of its stages with one knob.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Growth {
    /// What was varied.
    pub knob: String,
    /// Its smallest and largest value; of a resolution, pixels.
    pub range: [f64; 2],
    /// Slope of a line through all values, both axes logarithmic.
    pub overall: Exponents,
    /// Slope between the two largest values, where what does not grow matters least.
    pub upper: Exponents,
}

/// Exponents per stage, and of their sum.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Exponents {
    /// Segmentation of all cameras.
    pub segment: f64,
    /// Registration.
    pub register: f64,
    /// Simulation.
    pub simulate: f64,
    /// All three.
    pub step: f64,
}

impl Exponents {
    fn of(points: &[(f64, StageMs)]) -> Self {
        let through = |ms: &dyn Fn(&StageMs) -> f64| {
            slope(points.iter().map(|(value, stages)| [value.ln(), ms(stages).ln()]))
        };
        Self {
            segment: through(&|ms| ms.segment),
            register: through(&|ms| ms.register),
            simulate: through(&|ms| ms.simulate),
            step: through(&StageMs::step),
        }
    }
}

/// How time grows with a knob whose own value in the set is `own`; `None` if its values are no
/// numbers or too few of them are done.
pub fn growth(knob: &str, own: &str, settings: &[Setting]) -> Option<Growth> {
    let value = |setting: &Setting| match setting.knob.as_str() {
        "base" => number(own),
        name if name == knob => number(&setting.value),
        _ => None,
    };
    let mut points: Vec<(f64, StageMs)> =
        settings.iter().filter_map(|s| Some((value(s)?, s.stage_ms))).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let largest = points.len().checked_sub(VALUES_MIN)? + 1;
    Some(Growth {
        knob: knob.to_owned(),
        range: [points[0].0, points[points.len() - 1].0],
        overall: Exponents::of(&points),
        upper: Exponents::of(&points[largest..]),
    })
}

/// A positive number, or the pixels of a resolution.
fn number(text: &str) -> Option<f64> {
    let factors = text.split('x').map(|factor| factor.trim().parse::<f64>().ok());
    let product = factors.product::<Option<f64>>()?;
    (product > 0.0).then_some(product)
}

/// Slope of the line through points with the least sum of squared residuals.
fn slope(points: impl Iterator<Item = [f64; 2]> + Clone) -> f64 {
    let n = points.clone().count() as f64;
    let mean = |k: usize| points.clone().map(|p| p[k]).sum::<f64>() / n;
    let (x, y) = (mean(0), mean(1));
    let rise: f64 = points.clone().map(|p| (p[0] - x) * (p[1] - y)).sum();
    let run: f64 = points.map(|p| (p[0] - x) * (p[0] - x)).sum();
    rise / run
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::{Row, RunFigures, settings};

    #[test]
    fn exponents_are_those_of_the_powers_that_made_the_times() {
        let row = |knob: &str, value: &str, size: f64| {
            let stage_ms_p50 = StageMs {
                capture: 0.0,
                segment: 3.0,
                register: 2.0 * size,
                simulate: 0.5 * size * size,
            };
            let figures = RunFigures {
                vertex_error_mm_mean: Some(1.0),
                step_ms_p50: stage_ms_p50.step(),
                stage_ms_p50,
                ..RunFigures::default()
            };
            let [key, program] = [value.to_owned(), String::new()];
            Row { key, program, knob: knob.into(), value: value.into(), seed: 1, figures }
        };
        let rows = [row("size", "4x2", 8.0), row("base", "", 4.0), row("size", "1", 1.0)].to_vec();
        let settings = settings(&rows, &[]);
        let found = growth("size", "4", &settings).unwrap();
        assert_eq!(found.range, [1.0, 8.0]);
        for exponents in [found.overall, found.upper] {
            let stages = [exponents.segment, exponents.register, exponents.simulate];
            for (exponent, expected) in stages.iter().zip([0.0, 1.0, 2.0]) {
                assert!((exponent - expected).abs() < 1e-9, "{exponents:?}");
            }
        }
        assert!(found.upper.step > found.overall.step);
        assert_eq!(growth("size", "off", &settings), None);
    }
}
