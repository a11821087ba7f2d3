//! Messages from process to process: by iceoryx2 written in place, by UDP and by a Unix socket.
//!
//! All in one run and in turn, so that whatever else the machine does falls on all. Each way
//! is timed from the moment the sender has the frame (in shared memory, or in a buffer of its own)
//! to the moment the receiver has all of it: what happens between is the transport.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::UdpSocket;
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Context;
use orime_geometry::nalgebra::Isometry3;
use orime_geometry::{CameraModel, RgbdCamera};
use orime_messages::{FrameStatus, Header, Stage};
use orime_probe::{Percentiles, Spread};
use orime_runtime::{FrameWritten, Identity, Link, Pace, RunId, Stop, clean, now_ns};
use serde::{Deserialize, Serialize};

use crate::sockets::{self, Senders};

/// Time between two frames: each finds an idle receiver, as a camera's would.
const GAP: Duration = Duration::from_millis(4);
/// Frames of each kind that are left out: caches and pages are cold.
const WARM_UP: usize = 20;
/// Frames of each kind while a set runs.
const BACKGROUND_FRAMES: usize = 300;
/// Bytes of a cloud, as the paper's loop sends it.
const CLOUD_BYTES: usize = 7_500;

/// What a bench measured.
#[derive(Debug, Clone, Serialize)]
pub struct Bench {
    /// Frames first, then clouds.
    pub sizes: Vec<SizeBench>,
}

/// Messages of one size, one way, microseconds.
#[derive(Debug, Clone, Serialize)]
pub struct SizeBench {
    /// `frame` or `cloud`.
    pub what: &'static str,
    /// Bytes of a message.
    pub bytes: usize,
    /// By iceoryx2, written in place.
    pub iceoryx2_us: Percentiles,
    /// By UDP over the loopback.
    pub udp_us: Percentiles,
    /// By a Unix socket, a stream.
    pub unix_us: Percentiles,
    /// Messages that UDP lost in part.
    pub udp_lost: usize,
    /// iceoryx2's median over UDP's.
    pub p50_ratio: Option<f64>,
}

/// What the receiving process says at its end, nanoseconds.
#[derive(Debug, Serialize, Deserialize)]
struct Times {
    iceoryx2_ns: Vec<u64>,
    udp_ns: Vec<u64>,
    unix_ns: Vec<u64>,
}

/// A bench that runs beside what this thread does.
pub struct Background {
    thread: JoinHandle<anyhow::Result<Bench>>,
}

impl Background {
    /// Starts it.
    pub fn start(frame_bytes: usize) -> anyhow::Result<Self> {
        let thread = std::thread::Builder::new()
            .name("bench".to_owned())
            .spawn(move || run(frame_bytes, BACKGROUND_FRAMES))?;
        Ok(Self { thread })
    }

    /// Whether it still measures.
    pub fn runs(&self) -> bool {
        !self.thread.is_finished()
    }

    /// What it measured.
    pub fn finish(self) -> anyhow::Result<Bench> {
        self.thread.join().map_err(|_| anyhow::anyhow!("the bench panicked"))?
    }
}

/// A run of its own, cleaned whatever happens.
struct OwnRun(RunId);

impl Drop for OwnRun {
    fn drop(&mut self) {
        if let Err(error) = clean(self.0) {
            eprintln!("orime-probe: removing the bench's shared memory: {error}");
        }
    }
}

/// The receiving process, ended whatever happens.
struct Receiver(Child);

impl Drop for Receiver {
    fn drop(&mut self) {
        // Both fail where it has ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Measures `frames` frames of `frame_bytes`, and as many clouds, by each transport.
pub fn run(frame_bytes: usize, frames: usize) -> anyhow::Result<Bench> {
    let frame_bytes = frame_bytes.clamp(64, 256 << 20);
    let sizes = vec![size("frame", frame_bytes, frames)?, size("cloud", CLOUD_BYTES, frames)?];
    Ok(Bench { sizes })
}

fn size(what: &'static str, bytes: usize, messages: usize) -> anyhow::Result<SizeBench> {
    let run = OwnRun(RunId::new());
    let camera = camera_of(bytes);
    let link = join(run.0, Stage::Capture)?;
    let mut publisher = link.publish_frames(std::slice::from_ref(&camera))?;
    link.reserve_memory()?;
    // Removed with all that the run leaves.
    let socket = run.0.ipc_dir().join("bench.socket");
    let mut child = Command::new(std::env::current_exe()?)
        .args(["receive", &run.0.to_string(), &bytes.to_string()])
        .arg(&socket)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .context("starting the receiving process")?;
    let stdout = child.stdout.take().context("the receiver's output")?;
    let _receiver = Receiver(child);
    let mut said = BufReader::new(stdout);
    let mut port = String::new();
    said.read_line(&mut port)?;
    let port: u16 = port.trim().parse().context("the receiving process did not start")?;
    let mut senders = Senders::connect(port, &socket)?;

    let source: Vec<u8> = (0..bytes).map(|k| (k * 7) as u8).collect();
    let messages = messages.max(1) + WARM_UP;
    for k in 0..messages as u64 {
        let lineage = Header { step: k, ..link.header() };
        publisher.send_with(&lineage, (0, &camera), 1, |frame| {
            frame.color_rgb.fill(k as u8);
            frame.depth_units.fill(k as u16);
            FrameWritten { status: FrameStatus::Ok, copies: 0 }
        })?;
        std::thread::sleep(GAP);
        senders.by_udp(k, &source)?;
        std::thread::sleep(GAP);
        senders.by_unix(k, &source)?;
        std::thread::sleep(GAP);
    }
    publisher.send_end(&link.header())?;
    // Again and again, for one may get lost, until the receiver is gone and refuses.
    while senders.end().is_ok() {
        std::thread::sleep(GAP);
    }
    let mut text = String::new();
    said.read_to_string(&mut text)?;
    let times: Times = serde_json::from_str(&text).context("the receiving process failed")?;
    Ok(result(what, bytes, messages, &times))
}

fn result(what: &'static str, bytes: usize, messages: usize, times: &Times) -> SizeBench {
    let spread = |times_ns: &[u64]| {
        let mut spread = Spread::new();
        times_ns.iter().skip(WARM_UP).for_each(|ns| spread.add_ns(*ns));
        spread.percentiles()
    };
    let [iceoryx2_us, udp_us, unix_us] =
        [&times.iceoryx2_ns, &times.udp_ns, &times.unix_ns].map(|times_ns| spread(times_ns));
    let p50_ratio = iceoryx2_us.p50.zip(udp_us.p50).map(|(ours, udp)| ours / udp);
    let udp_lost = messages.saturating_sub(times.udp_ns.len());
    SizeBench { what, bytes, iceoryx2_us, udp_us, unix_us, udp_lost, p50_ratio }
}

/// The receiving process: a thread per transport, all waiting in the kernel.
pub fn receive(run: &str, bytes: usize, path: &Path) -> anyhow::Result<()> {
    let run: RunId = run.parse().map_err(anyhow::Error::msg)?;
    let link = join(run, Stage::Segment)?;
    let mut frames = link.subscribe_frames()?;
    let socket = UdpSocket::bind("127.0.0.1:0")?;
    sockets::enlarge(&socket);
    socket.set_read_timeout(Some(Duration::from_secs(10)))?;
    let listener = UnixListener::bind(path)?;
    println!("{}", socket.local_addr()?.port());
    std::io::stdout().flush()?;
    let done = Arc::new(AtomicBool::new(false));
    let udp = std::thread::spawn({
        let done = Arc::clone(&done);
        move || sockets::receive_udp(&socket, bytes, &done)
    });
    let unix = std::thread::spawn(move || sockets::receive_unix(&listener, bytes));
    let mut iceoryx2_ns = Vec::new();
    while let Some(frame) = frames.next()? {
        let meta = frame.meta();
        if meta.header.is_end() {
            break;
        }
        iceoryx2_ns.push(frame.take_ns.saturating_sub(meta.header.publish_ns));
    }
    done.store(true, Ordering::Relaxed);
    let panicked = |_| anyhow::anyhow!("a receiving thread panicked");
    let unix_ns = unix.join().map_err(panicked)??;
    let udp_ns = udp.join().map_err(panicked)??;
    println!("{}", serde_json::to_string(&Times { iceoryx2_ns, udp_ns, unix_ns })?);
    Ok(())
}

fn join(run: RunId, stage: Stage) -> anyhow::Result<Link> {
    let identity = Identity {
        run,
        pace: Pace::Lockstep,
        cameras: 1,
        stage,
        incarnation: now_ns(),
        resume: None,
    };
    Ok(Link::join(identity, Stop::new())?)
}

/// A camera whose frames have this size, nearly.
fn camera_of(frame_bytes: usize) -> RgbdCamera {
    let lens = CameraModel {
        width: (frame_bytes / 5) as u32,
        height: 1,
        fx_px: 1.0,
        fy_px: 1.0,
        cx_px: 0.0,
        cy_px: 0.0,
        distortion: [0.0; 5],
    };
    RgbdCamera {
        name: "bench".to_owned(),
        color: lens.clone(),
        depth: lens,
        color_from_depth: Isometry3::identity(),
        world_from_color: Isometry3::identity(),
        depth_m_per_unit: 0.001,
    }
}
