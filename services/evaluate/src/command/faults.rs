//! `orime-evaluate faults`: does to real processes what goes wrong, and looks what is seen.
//!
//! The numbers are those of the fault table in docs/faults.md. Each row starts sets of its own,
//! with a registry and an output folder of its own.

pub(crate) mod driver;
mod rows_data;
mod rows_memory;
mod rows_stage;

use anyhow::Context;
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use driver::Bench;

/// Do to real processes what goes wrong, and check what users must see.
///
/// Rows that need more rights than this user has (mounting, another user) say that they were
/// skipped. Exit codes: 0 all as expected, 1 not.
#[derive(Debug, clap::Args)]
pub struct FaultsArguments {
    /// Write the table as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Only these rows, by number.
    #[arg(long, value_delimiter = ',')]
    rows: Vec<u32>,
}

/// What was seen of one fault.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    /// From the fault to the set's being whole again, or to the clear refusal, milliseconds.
    pub recovery_ms: f64,
    /// Frames that never became part of a state, where that can be said.
    pub frames_lost: Option<u64>,
    /// What users see, in a line.
    pub what: String,
}

/// Why a row has no result.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Skipped(pub String);

type RowFunction = fn(&Bench) -> anyhow::Result<Seen>;

/// Number, fault, what is expected, what does it.
const ROWS: [(u32, &str, &str, RowFunction); 14] = [
    (
        1,
        "camera unplugged or stalled",
        "DEGRADED, process lives, states say that they coast, comes back",
        rows_stage::camera_unplugged,
    ),
    (
        2,
        "slow subscriber",
        "realtime keeps the newest and counts, lockstep loses nothing",
        rows_stage::slow_subscriber,
    ),
    (
        3,
        "stage killed while holding a loan",
        "reaped, cleaned, restarted; memory given back",
        rows_stage::killed_mid_loan,
    ),
    (
        4,
        "one stage restarted",
        "new incarnation, neighbours keep their processes, tracking goes on",
        rows_stage::single_restarts,
    ),
    (5, "a stage hangs at start", "readiness deadline, stage named", rows_stage::hangs_at_start),
    (6, "supervisor killed -9", "children end, next start clears", rows_stage::supervisor_killed),
    (
        7,
        "stale shared memory",
        "doctor reports, clean removes only what is dead",
        rows_memory::stale_memory,
    ),
    (8, "/dev/shm too small", "refused at start, size needed", rows_memory::small_memory),
    (9, "wrong config", "every problem, line and column, nothing starts", rows_data::wrong_config),
    (10, "clock step", "event raised, latencies unharmed", rows_data::clock_step),
    (
        11,
        "damaged recording",
        "refused with its own status; valid prefix plays when asked",
        rows_data::damaged_recording,
    ),
    (
        12,
        "disk full while recording",
        "recorder stops and says so, the set goes on",
        rows_data::disk_full,
    ),
    (13, "another user attaches", "refused, owner named", rows_memory::other_user),
    (14, "mismatched versions", "refused before opening, both named", rows_memory::mismatch),
];

/// One row of the table.
#[derive(Debug, Serialize)]
struct Row {
    row: u32,
    fault: &'static str,
    expected: &'static str,
    /// `passed`, `failed` or `skipped`.
    result: &'static str,
    recovery_ms: Option<f64>,
    frames_lost: Option<u64>,
    /// Objects in shared memory of the row's runs after it.
    left_behind: usize,
    seen: String,
    seconds: f64,
}

/// The whole table.
#[derive(Debug, Serialize)]
struct Table {
    passed: usize,
    failed: usize,
    skipped: usize,
    rows: Vec<Row>,
}

/// Runs the command.
pub fn run(arguments: &FaultsArguments) -> anyhow::Result<()> {
    let mut rows = Vec::new();
    for (row, fault, expected, function) in ROWS {
        if !arguments.rows.is_empty() && !arguments.rows.contains(&row) {
            continue;
        }
        let row = measure(row, fault, expected, function)?;
        print(&row);
        rows.push(row);
    }
    let count = |result: &str| rows.iter().filter(|row| row.result == result).count();
    let (passed, failed, skipped) = (count("passed"), count("failed"), count("skipped"));
    println!("{passed} passed, {failed} failed, {skipped} skipped");
    let table = Table { passed, failed, skipped, rows };
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&table)?;
        std::fs::write(path, text).with_context(|| format!("writing `{}`", path.display()))?;
    }
    anyhow::ensure!(failed == 0, "{failed} faults are not handled as expected");
    Ok(())
}

fn measure(
    row: u32,
    fault: &'static str,
    expected: &'static str,
    function: RowFunction,
) -> anyhow::Result<Row> {
    let start = Instant::now();
    let bench = Bench::new(row)?;
    let outcome = function(&bench);
    let left_behind = bench.left_behind();
    let (result, seen) = match outcome {
        Ok(seen) if left_behind == 0 => ("passed", seen),
        Ok(seen) => (
            "failed",
            Seen { what: format!("{left_behind} objects are left: {}", seen.what), ..seen },
        ),
        Err(error) => {
            let is_skip = error.downcast_ref::<Skipped>().is_some();
            let what = format!("{error:#}");
            (if is_skip { "skipped" } else { "failed" }, Seen { what, ..Seen::default() })
        }
    };
    Ok(Row {
        row,
        fault,
        expected,
        result,
        recovery_ms: (result == "passed").then_some(seen.recovery_ms),
        frames_lost: seen.frames_lost,
        left_behind,
        seen: seen.what,
        seconds: start.elapsed().as_secs_f64(),
    })
}

fn print(row: &Row) {
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |ms| format!("{ms:.0} ms"));
    let lost = row.frames_lost.map_or("-".to_owned(), |lost| lost.to_string());
    println!(
        "{:>2}  {:34} {:8} recovery {:>9}  frames lost {:>3}  left {}  {}",
        row.row,
        row.fault,
        row.result,
        number(row.recovery_ms),
        lost,
        row.left_behind,
        row.seen,
    );
    // What is seen so far is worth seeing, even if a later row hangs.
    let _ = std::io::stdout().flush();
}
