//! How a config section becomes a config.
//!
//! A section of a set file is first *parsed* into plain parameters (`XParams`, serde), then
//! *checked* into the only form that a stage accepts (`XConfig`). The check reports every problem
//! at once, each with the key it is about, so that `orime check` can point at line and column.

use std::fmt;

/// One thing that is wrong with a parameter, phrased for the person who edits the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Dotted path of the key inside its section, for example `voxel_m` or `rendered.fps`.
    pub key: String,
    /// What is wrong and what would be right.
    pub message: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}` {}", self.key, self.message)
    }
}

/// Collects the problems of one section.
#[derive(Debug, Default)]
pub struct Checker {
    problems: Vec<Problem>,
}

impl Checker {
    /// A checker that has found nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Notes `requirement` against `key` unless `holds`; phrase `holds` so that NaN fails it.
    ///
    /// Prints as "`key` is `value`: `requirement`".
    pub fn require(&mut self, holds: bool, key: &str, value: impl fmt::Debug, requirement: &str) {
        if !holds {
            self.problem(key, format!("is {value:?}: {requirement}"));
        }
    }

    /// Notes a problem that is not about a single value.
    pub fn problem(&mut self, key: &str, message: impl Into<String>) {
        self.problems.push(Problem { key: key.to_owned(), message: message.into() });
    }

    /// Takes over the problems of a nested section, under `prefix`.
    pub fn nested(&mut self, prefix: &str, problems: Vec<Problem>) {
        self.problems.extend(problems.into_iter().map(|problem| Problem {
            key: format!("{prefix}.{}", problem.key),
            message: problem.message,
        }));
    }

    /// The config if nothing was wrong, else every problem.
    pub fn finish<T>(self, config: impl FnOnce() -> T) -> Result<T, Vec<Problem>> {
        if self.problems.is_empty() { Ok(config()) } else { Err(self.problems) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_problem_is_reported_and_nan_fails() {
        let dt_s = f64::NAN;
        let mut inner = Checker::new();
        inner.require(0.0 < dt_s && dt_s <= 0.1, "dt_s", dt_s, "must be in (0, 0.1] seconds");
        let mut checker = Checker::new();
        checker.nested("solver", inner.finish(|| ()).unwrap_err());
        checker.problem("links", "is missing");
        let problems = checker.finish(|| ()).unwrap_err();
        let text: Vec<String> = problems.iter().map(Problem::to_string).collect();
        assert_eq!(
            text,
            ["`solver.dt_s` is NaN: must be in (0, 0.1] seconds", "`links` is missing"]
        );
    }
}
