//! `orime-evaluate`: scores, pictures and comparisons, in process or beside a set.

mod command;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    match command::run(command::Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("orime-evaluate: {error:#}");
            command::exit_code(&error)
        }
    }
}
