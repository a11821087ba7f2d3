//! record as a process of a set, started by the supervisor.

use std::io::{self, Write};
use std::path::PathBuf;

use anyhow::Context;
use orime_geometry::SheetParams;
use orime_messages::Stage;
use orime_record::{
    Inputs, Report, Said, Session, Simulated, Tape, survive_size_limits, tape_path,
};
use orime_runtime::{RuntimeError, Service, channel};

/// Records a service set from its first message to its last (started by `orime up --record`).
#[derive(Debug, clap::Parser)]
#[command(name = "orime-record", version)]
pub struct Arguments {
    /// The set file.
    set: PathBuf,
    /// The MCAP file to write; it must not exist.
    #[arg(long)]
    file: PathBuf,
    /// Write what the stages say to each other too, beside it.
    #[arg(long)]
    stages: bool,
}

/// Records to the end; how it went is the last line of the standard output.
pub fn run(arguments: &Arguments) -> anyhow::Result<Report> {
    let service = Service::start_with(Stage::Record, &arguments.set)?;
    survive_size_limits().context("handling signals")?;
    let sheet = service.config("sheet", SheetParams::check)?;
    let inputs = Inputs {
        frames: service.subscribe_frames()?,
        clouds: service.subscribe(&channel::CLOUD)?,
        states: service.subscribe(&channel::STATE)?,
        truths: service.subscribe(&channel::TRUTH)?,
        simulated: arguments.stages.then(|| simulated(&service)).transpose()?,
    };
    let (file, set) = (&arguments.file, &service.set().name);
    let session = Session::create(file, set, &sheet, service.stop().clone())
        .with_context(|| format!("creating recording `{}`", file.display()))?;
    let session = match arguments.stages {
        true => session.with_tape(Tape::create(&tape_path(file))?),
        false => session,
    };
    if let Err(error) = service.ready() {
        session.abandon();
        return Err(error.into());
    }
    let report = session.run(inputs, |step| say(&Said::Step(step)));
    say(&Said::Report(report.clone()));
    Ok(report)
}

/// What simulate hears.
fn simulated(service: &Service) -> Result<Simulated, RuntimeError> {
    Ok(Simulated {
        targets: service.subscribe(&channel::TARGETS)?,
        grippers: service.aside(&channel::GRIPPER)?,
        plans: service.aside(&channel::PLAN)?,
    })
}

/// The recording does not depend on whether the supervisor listens.
fn say(said: &Said) {
    let Ok(line) = serde_json::to_string(said) else { return };
    let mut out = io::stdout().lock();
    let _ = writeln!(out, "{line}").and_then(|()| out.flush());
}
