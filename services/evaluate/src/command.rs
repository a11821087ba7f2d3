//! The commands of `orime-evaluate`.

mod attach;
mod compare;
mod cpd;
mod creases;
mod faults;
mod judged;
mod output;
mod points;
mod register;
mod set;
mod soak;
mod stability;
mod sweep;
mod track;
mod variant;
mod watch;

use clap::{Parser, Subcommand};
use orime_runtime::SetError;
use std::process::ExitCode;

/// Scores, pictures and comparisons of a tracked sheet.
///
/// Exit codes: 0 done, 1 failed, 2 wrong usage or set file, 3 a sweep was interrupted.
#[derive(Debug, Parser)]
#[command(name = "orime-evaluate", version, after_help = EXAMPLES)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  orime-evaluate track deploy/sets/half_fold.toml --json out.json --pictures out/
  orime-evaluate track deploy/sets/square_base.toml --pictures out/ --pictures-at 100,225,345
  orime-evaluate compare deploy/sets/square_base.toml --out out/compare
  orime-evaluate sweep deploy/sets/half_fold.toml --out out/sweep --seeds 3
  orime-evaluate creases --seeds 5 --json creases.json
  orime-evaluate faults --json faults.json
  orime-evaluate soak --seconds 1200 --kill-every-s 30 --json soak.json
  orime-evaluate attach --turns 12 --seconds 10
  orime-evaluate cpd --source model.csv --target cloud.csv --out moved.csv --beta 2 --lambda 2

What each figure means stands beside its name in services/evaluate/src/summary.rs, and how it is
computed in services/evaluate/src/scores.rs, with hand-computed tests.";

#[derive(Debug, Subcommand)]
enum Command {
    /// Run the stages of a set in this process, in lockstep, and score every step.
    Track(track::TrackArguments),
    /// Score a running service set from outside (started by `orime up`).
    Watch(watch::WatchArguments),
    /// Track one set in several settings and compare them; the paper's three series by default.
    Compare(compare::CompareArguments),
    /// What accuracy costs in time: vary every knob of a set, and draw error over time.
    Sweep(sweep::SweepArguments),
    /// Run the hard cases, each against its criterion.
    Stability(stability::StabilityArguments),
    /// Do to real processes what goes wrong, and check what users must see.
    Faults(faults::FaultsArguments),
    /// Kill stages of a running set again and again, and look whether it comes back each time.
    Soak(soak::SoakArguments),
    /// What an attached probe changes of the times that it measures.
    Attach(attach::AttachArguments),
    /// Register two point files by textbook Coherent Point Drift.
    Cpd(cpd::CpdArguments),
    /// Register a sheet to a cloud, once, from files.
    Register(register::RegisterArguments),
    /// Find creases in exact folds with noise, by both methods, against their goals.
    Creases(creases::CreasesArguments),
}

/// Runs one command.
pub fn run(arguments: Arguments) -> anyhow::Result<()> {
    match arguments.command {
        Command::Track(arguments) => track::run(&arguments),
        Command::Watch(arguments) => watch::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Sweep(arguments) => sweep::run(&arguments),
        Command::Faults(arguments) => faults::run(&arguments),
        Command::Soak(arguments) => soak::run(&arguments),
        Command::Attach(arguments) => attach::run(&arguments),
        Command::Cpd(arguments) => cpd::run(&arguments),
        Command::Stability(arguments) => stability::run(&arguments),
        Command::Register(arguments) => register::run(&arguments),
        Command::Creases(arguments) => creases::run(&arguments),
    }
}

/// 2 for a set file that is wrong, 3 for a sweep that was interrupted, 1 for everything else.
pub fn exit_code(error: &anyhow::Error) -> ExitCode {
    if error.downcast_ref::<sweep::Interrupted>().is_some() {
        return ExitCode::from(3);
    }
    let is_set = error.chain().any(|cause| cause.downcast_ref::<SetError>().is_some());
    ExitCode::from(if is_set { 2 } else { 1 })
}
