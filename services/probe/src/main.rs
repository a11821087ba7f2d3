//! `orime-probe`: attaches to a running set, shows its figures, leaves without a trace.

mod args;
mod bench;
mod budget;
mod csv;
mod hdr_log;
mod live;
mod prometheus;
mod sinks;
mod sockets;
mod trace;
mod view;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    match live::run(&args::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("orime-probe: {error:#}");
            ExitCode::from(if error.is::<live::OverBudget>() { 4 } else { 1 })
        }
    }
}
