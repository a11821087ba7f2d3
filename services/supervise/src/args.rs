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
  orime up --record fold.mcap         the same, and everything that is published is recorded
  orime check my_set.toml             every problem of a set file, nothing is started
  orime ps --json                     what runs
  orime down 1a2b3c4d                 stop that run

Exit status: 0 good, 1 the set failed, 2 wrong usage or set file, 3 the machine refuses,
5 the set's recording is damaged and `capture.recording.damaged = true` does not allow that (or
nothing of it is left), 130 ended at once by a second Ctrl-C.
A fault of --record never changes the exit status: the set goes on without its recorder, and the
summary says that the recording is incomplete, and why."
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
    /// Record a running set in realtime, from now on.
    Record(Record),
    /// Show every problem of a set file.
    Check {
        /// The set file.
        set: PathBuf,
    },
    /// Show what each effect of a simulated scene is made of and what it costs here.
    Effects {
        /// A set file; its [sheet] and [simulate] are what counts.
        scene: PathBuf,
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
    /// Record frames, clouds, states and truth into this MCAP file, which must not exist yet.
    ///
    /// In lockstep everything is recorded, and the set waits for the disk; in realtime the set
    /// does not wait, and what the recorder missed is counted and said. A full disk ends the
    /// recording, not the set: exit status 0, and the summary says that the recording is
    /// incomplete and why. Play it with `source = "recording"` in the `[capture]` of a set.
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
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

/// `orime record`.
#[derive(Debug, Args)]
#[command(after_help = "\
Attaches to a set in realtime: its stages never wait for a listener, so that recording does not
disturb it; messages that come faster than they are written are missed, counted and said, and the
exit status is 0 all the same. A set in lockstep waits for all who listen, and would slow down or
hang with a recorder that is slow or suspended. So it is refused (exit status 2): start it with
`orime up SET --record FILE`, it repeats bit for bit. A set has one recorder at a time.

Exit status: 0 recorded, 2 wrong usage, no such run or a run in lockstep, 3 the file cannot be
written or the run cannot be attached to.")]
pub struct Record {
    /// The run, as `orime ps` shows it; the only one if left out.
    pub run: Option<String>,
    /// The MCAP file to write; it must not exist yet.
    #[arg(long)]
    pub out: PathBuf,
    /// Seconds to record; until the set ends, or Ctrl-C, if left out.
    #[arg(long)]
    pub seconds: Option<f64>,
}
