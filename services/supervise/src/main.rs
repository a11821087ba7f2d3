//! `orime`: starts, watches and stops sets of services. What a run is made of is in `up.rs`.

mod args;
mod asked;
mod check;
mod clocks;
mod command;
mod control;
mod doctor;
mod doubts;
mod effects;
mod ending;
mod events;
mod exit;
mod fleet;
mod layouts;
mod logs;
mod notify;
mod open;
mod places;
mod policy;
mod problem;
mod process;
mod progress;
mod record;
mod recording;
mod recovery;
mod replay;
mod runs;
mod summary;
mod up;
mod watch;
use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    command::run(&args::Cli::parse())
}
