//! Where what is seen goes to, besides the terminal.

use std::time::{Duration, Instant};

use anyhow::Context;
use orime_messages::StageRecord;
use orime_probe::Figures;
use orime_runtime::now_ns;

use crate::args::Cli;
use crate::csv::Csv;
use crate::hdr_log::HdrLog;
use crate::prometheus::Page;
use crate::trace::Trace;

/// Time between two lines of the histogram log, and two states of the page.
const PERIOD: Duration = Duration::from_secs(1);

/// All that was asked for.
pub struct Sinks {
    csv: Option<Csv>,
    trace: Option<Trace>,
    log: Option<HdrLog>,
    page: Option<Page>,
    run: String,
    written: Instant,
}

impl Sinks {
    /// Opens what the command line asks for.
    pub fn open(cli: &Cli, run: &str) -> anyhow::Result<Self> {
        let writing = |path: &std::path::Path| format!("writing `{}`", path.display());
        let csv = cli.csv.as_deref().map(|path| Csv::create(path).with_context(|| writing(path)));
        let trace =
            cli.trace.as_deref().map(|path| Trace::create(path).with_context(|| writing(path)));
        let log =
            cli.hdr_log.as_deref().map(|path| HdrLog::create(path).with_context(|| writing(path)));
        let page = cli.prometheus.map(Page::serve).transpose()?;
        if let Some(page) = &page {
            eprintln!("orime-probe: http://{}/metrics", page.address);
        }
        Ok(Self {
            csv: csv.transpose()?,
            trace: trace.transpose()?,
            log: log.transpose()?,
            page,
            run: run.to_owned(),
            written: Instant::now(),
        })
    }

    /// Whether anything was asked for.
    pub fn is_any(&self) -> bool {
        let Self { csv, trace, log, page, .. } = self;
        csv.is_some() || trace.is_some() || log.is_some() || page.is_some()
    }

    /// Takes in one record.
    pub fn add(&mut self, record: &StageRecord) -> anyhow::Result<()> {
        if let Some(csv) = &mut self.csv {
            csv.add(record).context("writing the CSV file")?;
        }
        if let Some(trace) = &mut self.trace {
            trace.add(record).context("writing the trace")?;
        }
        Ok(())
    }

    /// Writes what is written once a second.
    pub fn tick(&mut self, figures: &Figures, at_once: bool) -> anyhow::Result<()> {
        let since = self.written.elapsed();
        if since < PERIOD && !at_once {
            return Ok(());
        }
        self.written = Instant::now();
        if let Some(log) = &mut self.log {
            log.add(figures, since).context("writing the histogram log")?;
        }
        if let Some(page) = &self.page {
            page.update(&self.run, &figures.report(now_ns()));
        }
        Ok(())
    }

    /// Ends all files.
    pub fn finish(mut self, figures: &Figures) -> anyhow::Result<()> {
        self.tick(figures, true)?;
        if let Some(csv) = self.csv {
            csv.finish().context("writing the CSV file")?;
        }
        if let Some(trace) = self.trace {
            trace.finish().context("writing the trace")?;
        }
        Ok(())
    }
}
