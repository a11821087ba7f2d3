//! `orime-probe`: attaches to a running set, shows its figures, leaves without a trace.

mod args;
mod bench;
mod live;
mod view;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    match live::run(&args::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("orime-probe: {error:#}");
            ExitCode::FAILURE
        }
    }
}
