//! A whole set tracked and scored in this process.

use orime_evaluate::judge::Judge;
use orime_evaluate::pipeline::Pipeline;
use orime_runtime::SetFile;

/// Steps of a run: those of the set, and at most `limit`.
pub fn steps(limit: Option<u64>, pipeline: &Pipeline) -> anyhow::Result<u64> {
    match (limit, pipeline.steps()) {
        (Some(limit), Some(steps)) => Ok(limit.min(steps)),
        (Some(steps), None) | (None, Some(steps)) => Ok(steps),
        (None, None) => anyhow::bail!("this set never ends: say how many steps with --steps N"),
    }
}

/// How a run is made.
pub struct Run<'a> {
    /// Most steps.
    pub limit: Option<u64>,
    /// What its stages are timed by, seconds; `None` for the time on the wall.
    pub clock: Option<fn() -> f64>,
    /// Is told steps done and to do after each, and says whether to go on.
    pub goes_on: &'a mut dyn FnMut(u64, u64) -> bool,
}

/// Tracks and scores a set; `None` if it was not to go on.
pub fn judged(set: &SetFile, run: Run<'_>) -> anyhow::Result<Option<Judge>> {
    let (source, config) = super::set::open(set)?;
    let mut pipeline = Pipeline::new(source, &config);
    if let Some(clock) = run.clock {
        pipeline = pipeline.timed_by(clock);
    }
    let mut judge = Judge::new(&config.sheet, config.template_m.as_deref());
    let steps = steps(run.limit, &pipeline)?;
    for step in 0..steps {
        let result = pipeline.step(step);
        judge.score(&super::track::step_input(&pipeline, step, &result));
        if !(run.goes_on)(step + 1, steps) {
            return Ok(None);
        }
    }
    Ok(Some(judge))
}
