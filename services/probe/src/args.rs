//! The command line.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Parser;

/// Latencies, rates and drops of a running set.
///
/// Reads the stages' records only, never frames, so that it disturbs nothing; attaches to what is
/// there and makes nothing.
#[derive(Debug, Parser)]
#[command(
    name = "orime-probe",
    version,
    after_help = "\
Examples:
  orime-probe                         live view of the running set
  orime-probe --once --json           figures of five seconds, as JSON
  orime-probe --once --json --bench   … and iceoryx2 against UDP, frames of the set's size
  orime-probe --once --budget deploy/budgets.toml
  orime-probe --prometheus 127.0.0.1:9464 --trace fold.json --csv fold.csv --hdr-log fold.hlog
  orime-probe bench --frame-bytes 1536000

Exit status: 0 good, 1 nothing runs or something failed, 2 wrong usage, 4 over the budget."
)]
pub struct Cli {
    /// Only measure transports, without a running set.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// The run, as `orime ps` shows it; the only one if left out.
    #[arg(long)]
    pub run: Option<String>,
    /// Watch for a while, print once and end.
    #[arg(long)]
    pub once: bool,
    /// How long --once watches, seconds; it ends earlier with the set.
    #[arg(long, default_value_t = 5.0)]
    pub seconds: f64,
    /// Print JSON (with --once or bench).
    #[arg(long, global = true)]
    pub json: bool,
    /// Write one line per record, comma-separated, into this file.
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Write a trace that <https://ui.perfetto.dev> opens: each frame's way through all processes.
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Write an HdrHistogram interval log, a line per second and quantity, nanoseconds.
    #[arg(long, value_name = "FILE")]
    pub hdr_log: Option<PathBuf>,
    /// Serve the figures to Prometheus; only an address of the loopback. Port 0: any free one.
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub prometheus: Option<SocketAddr>,
    /// With --once: compare with a budget, as deploy/budgets.toml; exit status 4 if it is exceeded.
    #[arg(long, value_name = "FILE")]
    pub budget: Option<PathBuf>,
    /// With --once: measure frames of the set's size by iceoryx2 and by UDP too, meanwhile.
    #[arg(long)]
    pub bench: bool,
}

/// What else to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Frames, and clouds of 7.5 KB, from one process to another: by iceoryx2 written in place, by
    /// UDP over the loopback and by a Unix socket, in turn.
    Bench {
        /// Bytes of a frame. Default: 640 × 480 of colour and depth.
        #[arg(long, default_value_t = 1_536_000)]
        frame_bytes: usize,
        /// Frames of each kind.
        #[arg(long, default_value_t = 300)]
        frames: usize,
    },
    /// The receiving process of `bench`.
    #[command(hide = true)]
    Receive {
        /// The bench's run.
        run: String,
        /// Bytes of a message.
        frame_bytes: usize,
        /// The Unix socket to listen on.
        socket: PathBuf,
    },
}
