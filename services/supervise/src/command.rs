//! Which command does what.

use std::process::ExitCode;

use crate::args::{Cli, Command};
use crate::exit::Failure;
use crate::{check, control, doctor, effects, layouts, logs, record, replay, runs, up};

/// Runs the command; its failure is said on the standard error.
pub fn run(cli: &Cli) -> ExitCode {
    let json = cli.json;
    let result = match &cli.command {
        Command::Up(args) => up::up(args, json),
        Command::Ps => runs::ps(json),
        Command::Down { run } => runs::down(run.as_deref(), json),
        Command::Restart { stage, run, source } => {
            control::restart(stage, run.as_deref(), source.as_deref(), json)
        }
        Command::Logs(args) => logs::logs(args),
        Command::Doctor => doctor::doctor(json),
        Command::Clean { dry_run } => doctor::clean(*dry_run, json),
        Command::Layouts => layouts::layouts(),
        Command::Record(args) => record::record(args, json),
        Command::Calibrate { words } => return orime_calibrate::command::command(words, json),
        Command::Replay(args) => replay::replay(args, json),
        Command::Effects { scene } => effects::effects(scene, json),
        Command::Check { set } => check::command(set, json),
    };
    let exit = result.unwrap_or_else(|Failure { exit, message }| {
        eprintln!("orime: {message}");
        exit
    });
    ExitCode::from(exit)
}
