//! `orime`: starts, watches and stops sets of services. What a run is made of is in `up.rs`.

mod args;
mod asked;
mod check;
mod effects;
mod exit;
mod open;
mod places;
mod problem;
mod process;
mod progress;
mod record;
mod recording;
mod runs;
mod summary;
mod up;
mod watch;
use args::{Cli, Command};
use clap::Parser;
use exit::Failure;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = match &cli.command {
        Command::Up(args) => up::up(args, cli.json),
        Command::Ps => runs::ps(cli.json),
        Command::Down { run } => runs::down(run.as_deref(), cli.json),
        Command::Record(args) => record::record(args, cli.json),
        Command::Check { set } => check::command(set, cli.json),
        Command::Effects { scene } => effects::effects(scene, cli.json),
    };
    let exit = result.unwrap_or_else(|Failure { exit, message }| {
        eprintln!("orime: {message}");
        exit
    });
    ExitCode::from(exit)
}
