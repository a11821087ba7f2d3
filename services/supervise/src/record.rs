//! `orime record`: a running set in realtime, from now on.

use std::time::{Duration, Instant};

use orime_geometry::SheetParams;
use orime_record::{Inputs, Session, survive_size_limits};
use orime_runtime::{Guest, RunEntry, RuntimeError, SetFile, Stop, channel};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::args::Record;
use crate::exit::{Exit, Failure};
use crate::runs::find;
use crate::summary::RecordingSummary;
use crate::up::new_file;

/// Time between two looks whether the recording shall end.
const TICK: Duration = Duration::from_millis(50);

/// Records until the time is up, the set ends, or somebody asks to stop.
pub fn record(args: &Record, json: bool) -> Result<Exit, Failure> {
    let entry = find(args.run.as_deref())?;
    let file = new_file(&args.out)?;
    let stop = Stop::new();
    let machine = |error: &dyn std::fmt::Display| Failure::machine(error.to_string());
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, stop.flag()).map_err(|error| machine(&error))?;
    }
    survive_size_limits().map_err(|error| machine(&error))?;
    let set = SetFile::load(&entry.set).map_err(|error| machine(&error))?;
    let sheet = set.checked("sheet", SheetParams::check).map_err(|error| machine(&error))?;
    let inputs = attach(&entry, stop.clone()).map_err(|error| match error {
        RuntimeError::Waits { .. } => Failure::usage(error.to_string()),
        error => machine(&error),
    })?;
    let session = Session::create(&file, &entry.name, &sheet, stop.clone())
        .map_err(|error| machine(&format!("creating recording `{}`: {error}", file.display())))?;
    if !json {
        println!("recording run {} into {}; Ctrl-C ends it", entry.run, file.display());
    }
    let deadline = args.seconds.map(|s| Instant::now() + seconds(s));
    let report = std::thread::scope(|scope| {
        let recording = scope.spawn(|| session.run(inputs, |_| ()));
        while !recording.is_finished() {
            if deadline.is_some_and(|deadline| Instant::now() > deadline) || !entry.is_alive() {
                stop.request();
            }
            std::thread::sleep(TICK);
        }
        recording.join()
    });
    let report = report.map_err(|_| machine(&"the recorder panicked"))?;
    let failed = report.failure.is_some();
    let summary = RecordingSummary::of(report);
    if json {
        let text = serde_json::to_string_pretty(&summary).map_err(|error| machine(&error))?;
        println!("{text}");
    } else {
        println!("{}", summary.text());
    }
    Ok(if failed { Exit::Machine } else { Exit::Good })
}

fn seconds(s: f64) -> Duration {
    Duration::from_secs_f64(s.clamp(0.1, 86_400.0 * 365.0))
}

fn attach(entry: &RunEntry, stop: Stop) -> Result<Inputs, RuntimeError> {
    let guest = Guest::attach_to(entry, stop)?;
    Ok(Inputs {
        frames: guest.subscribe_frames()?,
        clouds: guest.subscribe(&channel::CLOUD)?,
        states: guest.subscribe(&channel::STATE)?,
        truths: guest.subscribe(&channel::TRUTH)?,
        simulated: None,
    })
}
