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
  orime restart register              hand a stage over to a new process
  orime restart capture --source live.toml   … which takes another set's cameras
  orime logs register --follow        what a stage logs
  orime doctor                        what could keep sets from running, and what dead ones left
  orime clean                         remove what dead runs left

Exit status: 0 good, 1 the set failed, 2 wrong usage or set file, 3 the machine refuses,
5 the set's recording is damaged and `capture.recording.damaged = true` does not allow that (or
nothing of it is left), 6 the set was in lockstep and lost something with a stage that died and
was restarted, 130 ended at once by a second Ctrl-C.
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
    /// Hand a stage of a running set over to a new process; nothing ends, and it costs no restart.
    Restart {
        /// `capture`, `segment`, `register`, `simulate` or `judge`.
        stage: String,
        /// The run, as `orime ps` shows it; the only one if left out.
        run: Option<String>,
        /// Only with `capture`: the new process takes the `[capture]` of this set file instead,
        /// for example live cameras after a recording. It needs the same pace, sheet and number of
        /// cameras; the other stages run on.
        #[arg(long, value_name = "SET")]
        source: Option<PathBuf>,
    },
    /// Show what the stages of a running set log.
    Logs(Logs),
    /// Report what could keep sets from running, and what dead ones left; changes nothing.
    Doctor,
    /// Print what the messages look like in memory, as JSON, for programs in other languages.
    Layouts,
    /// Remove what dead runs of this user left in shared memory, and nothing else.
    Clean {
        /// Only say what would be removed.
        #[arg(long)]
        dry_run: bool,
    },
    /// Record a running set in realtime, from now on.
    Record(Record),
    /// Find where a set's cameras stand and how their depth errs (`orime calibrate --help`).
    #[command(disable_help_flag = true)]
    Calibrate {
        /// Its own arguments.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, num_args = 0..)]
        words: Vec<std::ffi::OsString>,
    },
    /// Play recorded messages into one later stage alone, and compare what it makes of them.
    Replay(Replay),
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
    /// With --record: write what the stages say to each other too, as it lies in memory, into
    /// FILE's neighbour `.stages.mcap`; `orime replay` plays it into a later stage alone.
    #[arg(long, requires = "record")]
    pub record_stages: bool,
    /// Do not start the judge: no error figures, no pictures.
    #[arg(long)]
    pub no_judge: bool,
    /// Seconds that a process may take to get ready.
    #[arg(long, default_value_t = 30.0)]
    pub ready_s: f64,
    /// Seconds that a stage may have input and give no result; it is killed and restarted then.
    #[arg(long, default_value_t = 20.0)]
    pub stall_s: f64,
    /// Restarts of each stage within --restart-window-s; the next death ends the set. The first
    /// comes at once, the second after 0.1 s, then each after twice the time, up to 5 s.
    #[arg(long, default_value_t = 5)]
    pub restarts: u32,
    /// The time that restarts are counted in, seconds.
    #[arg(long, default_value_t = 60.0)]
    pub restart_window_s: f64,
    /// Do not keep a spare process of each stage of a set in realtime, ready to take the place of
    /// one that dies: less memory, slower restarts.
    #[arg(long)]
    pub no_spares: bool,
    /// Write the stages' logs as one JSON object per line. RUST_LOG decides what is logged.
    #[arg(long)]
    pub log_json: bool,
}

/// `orime logs`.
#[derive(Debug, Args)]
pub struct Logs {
    /// Only this stage; all of them if left out.
    pub stage: Option<String>,
    /// The run, as `orime ps` shows it; the only one if left out.
    #[arg(long)]
    pub run: Option<String>,
    /// Lines of each stage to begin with.
    #[arg(short = 'n', long, default_value_t = 20)]
    pub lines: usize,
    /// Go on until the run ends, or Ctrl-C.
    #[arg(short, long)]
    pub follow: bool,
}

/// `orime replay`.
#[derive(Debug, Args)]
#[command(after_help = "\
Exit status: 0 bit for bit what was recorded, 1 something else, 2 wrong usage, 3 the tape cannot
be read.")]
pub struct Replay {
    /// The tape, `….stages.mcap`, of `orime up --record FILE --record-stages`.
    pub tape: PathBuf,
    /// The stage: `register` or `simulate`. (Frames are replayed into segment and all after it by
    /// a set whose source is the recording.)
    pub stage: String,
    /// The set file whose parameters the stage has; the embedded default if left out.
    #[arg(long)]
    pub set: Option<PathBuf>,
    /// Where the stage's log is written.
    #[arg(long, default_value = "out/replay")]
    pub out: PathBuf,
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
