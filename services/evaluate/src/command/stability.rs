//! `orime-evaluate stability`: the hard cases.

use anyhow::Context;
use orime_evaluate::stability::{numbers, run as run_cases};
use std::path::PathBuf;

/// Run the hard cases, each against its criterion.
#[derive(Debug, clap::Args)]
pub struct StabilityArguments {
    /// One case only, by its number.
    #[arg(long, value_name = "N")]
    case: Option<u32>,
    /// Seed of the random ones.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Where to write the verdict as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command. Fails where a criterion does not hold.
pub fn run(arguments: &StabilityArguments) -> anyhow::Result<()> {
    if let Some(case) = arguments.case {
        let last = numbers().max().unwrap_or(0);
        anyhow::ensure!(
            numbers().any(|number| number == case),
            "--case {case}: there are cases 1 to {last}"
        );
    }
    let verdict = run_cases(arguments.case, arguments.seed, |outcome| {
        let word = if outcome.passed { "passed" } else { "FAILED" };
        println!("{word}  {:2}  {}", outcome.case, outcome.name);
        println!("            {}", outcome.criterion);
        println!("            {}", outcome.measured);
    });
    println!("{} passed, {} failed", verdict.passed, verdict.failed);
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&verdict)? + "\n";
        std::fs::write(path, text).with_context(|| format!("writing `{}`", path.display()))?;
    }
    anyhow::ensure!(verdict.failed == 0, "{} criteria do not hold", verdict.failed);
    Ok(())
}
