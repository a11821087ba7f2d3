//! `orime-record`: what a running set publishes, into a file. The file's story is in `lib.rs`.

mod service;

use anyhow::bail;
use clap::Parser;

fn main() -> anyhow::Result<()> {
    let report = service::run(&service::Arguments::parse())?;
    match report.failure {
        Some(failure) => bail!(failure),
        None => {
            tracing::info!(recorded = %report.recorded, missed = %report.missed, "recorded");
            Ok(())
        }
    }
}
