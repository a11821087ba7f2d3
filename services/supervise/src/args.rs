//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

/// Starts, watches and stops sets of services that track a sheet.
#[derive(Debug, Parser)]
#[command(
    name = "orime",
    version,
    after_help = "\
Examples:
  orime up                            the embedded default: a rendered sheet is folded
  orime up tests/sets/paper_desk.toml --out out/desk
  orime check my_set.toml             every problem of a set file, nothing is started
  orime ps --json                     what runs
  orime down 1a2b3c4d                 stop that run

Exit status: 0 good, 1 the set failed, 2 wrong usage or set file, 3 the machine refuses,
130 ended at once by a second Ctrl-C."
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Print JSON instead of text.
    #[arg(long, global = true)]
    pub json: bool,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Start a set in the foreground; ends with its source, or on Ctrl-C (twice: at once).
    Up(Up),
    /// Show the runs of this user.
    Ps,
    /// Stop a run (or the only one) and wait until it is gone.
    Down {
        /// The run, as `orime ps` shows it.
        run: Option<String>,
    },
    /// Show every problem of a set file.
    Check {
        /// The set file.
        set: PathBuf,
    },
}

/// `orime up`.
#[derive(Debug, Args)]
pub struct Up {
    /// The set file; the embedded default if left out.
    pub set: Option<PathBuf>,
    /// Where logs, states' figures and pictures are written. Default: out/NAME.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Do not start the judge: no error figures, no pictures.
    #[arg(long)]
    pub no_judge: bool,
    /// Seconds that a process may take to get ready.
    #[arg(long, default_value_t = 30.0)]
    pub ready_s: f64,
    /// Seconds without progress after which the set counts as hung.
    #[arg(long, default_value_t = 60.0)]
    pub stall_s: f64,
}
