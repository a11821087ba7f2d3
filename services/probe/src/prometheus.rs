//! A page for Prometheus, on the loopback only.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::{Context, ensure};
use orime_probe::{Percentiles, Report};

/// Time that a client may take for its request.
const PATIENCE: Duration = Duration::from_secs(2);
/// Most lines of a request that are read.
const LINES_MAX: usize = 100;

/// The page, and the thread that serves it.
#[derive(Debug, Clone)]
pub struct Page {
    text: Arc<Mutex<String>>,
    /// Where it is served.
    pub address: SocketAddr,
}

impl Page {
    /// Serves on `address`, which must be of the loopback; port 0 takes a free one.
    pub fn serve(address: SocketAddr) -> anyhow::Result<Self> {
        ensure!(
            address.ip().is_loopback(),
            "{address} can be reached from outside; name an address of the loopback, as 127.0.0.1"
        );
        let listener =
            TcpListener::bind(address).with_context(|| format!("listening on {address}"))?;
        let page = Self { text: Arc::default(), address: listener.local_addr()? };
        let text = Arc::clone(&page.text);
        // It ends with the process: whoever reads a page is not waited for.
        std::thread::Builder::new().name("prometheus".to_owned()).spawn(move || {
            for client in listener.incoming().flatten() {
                let text = text.lock().unwrap_or_else(PoisonError::into_inner).clone();
                // A client that has gone is no concern of ours.
                let _ = answer(client, &text);
            }
        })?;
        Ok(page)
    }

    /// Puts new figures on the page.
    pub fn update(&self, run: &str, report: &Report) {
        let text = page(run, report);
        *self.text.lock().unwrap_or_else(PoisonError::into_inner) = text;
    }
}

fn answer(client: TcpStream, text: &str) -> std::io::Result<()> {
    client.set_read_timeout(Some(PATIENCE))?;
    client.set_write_timeout(Some(PATIENCE))?;
    let mut lines = BufReader::new(&client).lines();
    let request = lines.next().transpose()?.unwrap_or_default();
    for line in lines.take(LINES_MAX) {
        if line?.is_empty() {
            break;
        }
    }
    let (status, body) = match request.split(' ').nth(1) {
        Some("/metrics" | "/") => ("200 OK", text),
        _ => ("404 Not Found", "the page is /metrics\n"),
    };
    write!(
        &client,
        "HTTP/1.1 {status}\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\n\
         Content-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    )
}

/// Writes metrics of one name, each once under one head.
struct Writer<'t> {
    text: &'t mut String,
    run: &'t str,
}

impl Writer<'_> {
    fn head(&mut self, name: &str, kind: &str, help: &str) {
        // Writing to a string cannot fail, here and below.
        let _ = writeln!(self.text, "# HELP {name} {help}\n# TYPE {name} {kind}");
    }

    fn value(&mut self, name: &str, labels: &str, value: f64) {
        let comma = if labels.is_empty() { "" } else { "," };
        let _ = writeln!(self.text, "{name}{{run=\"{}\"{comma}{labels}}} {value}", self.run);
    }

    fn single(&mut self, name: &str, kind: &str, help: &str, value: Option<f64>) {
        self.head(name, kind, help);
        if let Some(value) = value {
            self.value(name, "", value);
        }
    }

    /// Percentiles in microseconds, as a summary in seconds.
    fn summary(&mut self, name: &str, labels: &str, us: &Percentiles) {
        let comma = if labels.is_empty() { "" } else { "," };
        let quantiles = [("0.5", us.p50), ("0.9", us.p90), ("0.99", us.p99), ("0.999", us.p99_9)];
        for (quantile, us) in quantiles {
            if let Some(us) = us {
                self.value(name, &format!("{labels}{comma}quantile=\"{quantile}\""), us * 1e-6);
            }
        }
        self.value(&format!("{name}_count"), labels, us.count as f64);
    }
}

fn page(run: &str, report: &Report) -> String {
    let mut text = String::new();
    let mut out = Writer { text: &mut text, run };
    let counters = [
        ("orime_states_total", "States published.", report.steps),
        (
            "orime_lost_states_total",
            "States in which the sheet was not followed.",
            report.lost_steps,
        ),
        ("orime_frames_total", "Frames taken by segment.", report.frames),
        (
            "orime_frame_copies_total",
            "Whole-image copies on the way to segment.",
            report.frame_copies,
        ),
    ];
    for (name, help, count) in counters {
        out.single(name, "counter", help, Some(count as f64));
    }
    let age_s = report.age_ms.map(|ms| ms * 1e-3);
    out.single("orime_age_seconds", "gauge", "Age of the newest state.", age_s);
    stages(&mut out, report);
    out.head("orime_drops_total", "counter", "Messages lost, by cause.");
    for (stage, of) in &report.stages {
        for (cause, count) in &of.drops {
            let labels = format!("stage=\"{stage}\",cause=\"{cause}\"");
            out.value("orime_drops_total", &labels, *count as f64);
        }
    }
    out.head("orime_effect_asleep", "gauge", "Whether an effect slept in the newest step.");
    for (name, effect) in &report.effects {
        let value = f64::from(u8::from(effect.asleep));
        out.value("orime_effect_asleep", &format!("effect=\"{name}\""), value);
    }
    out.head("orime_effect_asleep_states_total", "counter", "Steps in which an effect slept.");
    for (name, effect) in &report.effects {
        let labels = format!("effect=\"{name}\"");
        out.value("orime_effect_asleep_states_total", &labels, effect.asleep_steps as f64);
    }
    let hops = [
        ("capture_to_segment", &report.hops.capture_to_segment),
        ("segment_to_register", &report.hops.segment_to_register),
        ("register_to_simulate", &report.hops.register_to_simulate),
    ];
    out.head("orime_hop_seconds", "summary", "Transport, queue and compute of each hop.");
    for (hop, of) in hops {
        for (part, us) in
            [("transport", of.transport_us), ("queue", of.queue_us), ("compute", of.compute_us)]
        {
            out.summary("orime_hop_seconds", &format!("hop=\"{hop}\",part=\"{part}\""), &us);
        }
    }
    let spreads = [
        ("orime_end_to_end_seconds", "State minus exposure or arrival.", &report.end_to_end_us),
        ("orime_age_sampled_seconds", "Age of information, sampled.", &report.age_us),
        ("orime_step_compute_seconds", "Computing one step.", &report.step_us),
        ("orime_camera_skew_seconds", "Exposures of one set.", &report.camera_skew_us),
    ];
    for (name, help, us) in spreads {
        out.head(name, "summary", help);
        out.summary(name, "", us);
    }
    text
}

fn stages(out: &mut Writer<'_>, report: &Report) {
    type Of = fn(&orime_probe::StageReport) -> Option<f64>;
    let all: [(&str, &str, &str, Of); 6] = [
        ("orime_results_total", "counter", "Results published.", |s| Some(s.published as f64)),
        ("orime_rate_hertz", "gauge", "Results per second.", |s| s.hz),
        ("orime_queue_depth", "gauge", "Messages that wait.", |s| Some(f64::from(s.queue_depth))),
        ("orime_queue_high", "gauge", "Most that ever waited.", |s| Some(f64::from(s.queue_high))),
        ("orime_loan_waits_total", "counter", "Loans that waited.", |s| Some(s.loan_waits as f64)),
        ("orime_restarts_total", "counter", "Processes replaced.", |s| Some(s.restarts as f64)),
    ];
    for (name, kind, help, of) in all {
        out.head(name, kind, help);
        for (stage, figures) in &report.stages {
            if let Some(value) = of(figures) {
                out.value(name, &format!("stage=\"{stage}\""), value);
            }
        }
    }
}
