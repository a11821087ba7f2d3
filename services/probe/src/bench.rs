//! Frames of one size from process to process: by iceoryx2 written in place, and by UDP.
//!
//! Both in one run and in turn, so that whatever else the machine does falls on both. Each way
//! is timed from the moment the sender has the frame (in shared memory, or in a buffer of its own)
//! to the moment the receiver has all of it: what happens between is the transport.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::UdpSocket;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, bail};
use orime_geometry::nalgebra::Isometry3;
use orime_geometry::{CameraModel, RgbdCamera};
use orime_messages::{FrameStatus, Header, Stage};
use orime_probe::{Percentiles, Spread};
use orime_runtime::{FrameWritten, Identity, Link, Pace, RunId, Stop, clean, now_ns};
use serde::{Deserialize, Serialize};

/// Bytes of a frame in one datagram; the largest that IPv4 carries is 65 507.
const DATAGRAM_BYTES: usize = 60_000;
/// Frame number, send time, place in the frame.
const DATAGRAM_HEADER: usize = 24;
/// Frame number that ends the bench.
const LAST: u64 = u64::MAX;
/// Time between two frames: each finds an idle receiver, as a camera's would.
const GAP: Duration = Duration::from_millis(4);
/// Frames of each kind that are left out: caches and pages are cold.
const WARM_UP: usize = 20;
/// Frames of each kind while a set runs.
const BACKGROUND_FRAMES: usize = 300;
/// Receive buffer that is asked of the kernel, bytes.
const SOCKET_BYTES: usize = 16 << 20;

/// What a bench measured, one way, microseconds.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Bench {
    /// Bytes of a frame.
    pub frame_bytes: usize,
    /// By iceoryx2, written in place.
    pub iceoryx2_us: Percentiles,
    /// By UDP over the loopback.
    pub udp_us: Percentiles,
    /// Frames that UDP lost in part.
    pub udp_lost: usize,
    /// iceoryx2's median over UDP's.
    pub p50_ratio: Option<f64>,
}

/// What the receiving process says at its end, nanoseconds.
#[derive(Debug, Serialize, Deserialize)]
struct Times {
    iceoryx2_ns: Vec<u64>,
    udp_ns: Vec<u64>,
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

/// Measures `frames` frames of `frame_bytes` by each transport.
pub fn run(frame_bytes: usize, frames: usize) -> anyhow::Result<Bench> {
    let frame_bytes = frame_bytes.clamp(64, 256 << 20);
    let run = OwnRun(RunId::new());
    let camera = camera_of(frame_bytes);
    let link = join(run.0, Stage::Capture)?;
    let mut publisher = link.publish_frames(std::slice::from_ref(&camera))?;
    link.reserve_memory()?;
    let mut child = Command::new(std::env::current_exe()?)
        .args(["receive", &run.0.to_string(), &frame_bytes.to_string()])
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
    let socket = UdpSocket::bind("127.0.0.1:0")?;
    socket.connect(("127.0.0.1", port))?;

    let source: Vec<u8> = (0..frame_bytes).map(|k| (k * 7) as u8).collect();
    let mut datagram = vec![0; DATAGRAM_BYTES + DATAGRAM_HEADER];
    let frames = frames.max(1) + WARM_UP;
    for k in 0..frames as u64 {
        let lineage = Header { step: k, ..link.header() };
        publisher.send_with(&lineage, (0, &camera), 1, |frame| {
            frame.color_rgb.fill(k as u8);
            frame.depth_units.fill(k as u16);
            FrameWritten { status: FrameStatus::Ok, copies: 0 }
        })?;
        std::thread::sleep(GAP);
        send_datagrams(&socket, &mut datagram, k, &source)?;
        std::thread::sleep(GAP);
    }
    publisher.send_end(&link.header())?;
    datagram[..8].copy_from_slice(&LAST.to_le_bytes());
    // Again and again, for one may get lost, until the receiver is gone and refuses.
    while socket.send(&datagram[..DATAGRAM_HEADER]).is_ok() {
        std::thread::sleep(GAP);
    }
    let mut text = String::new();
    said.read_to_string(&mut text)?;
    let times: Times = serde_json::from_str(&text).context("the receiving process failed")?;
    Ok(result(frame_bytes, frames, &times))
}

fn result(frame_bytes: usize, frames: usize, times: &Times) -> Bench {
    let spread = |times_ns: &[u64]| {
        let mut spread = Spread::new();
        times_ns.iter().skip(WARM_UP).for_each(|ns| spread.add_ns(*ns));
        spread.percentiles()
    };
    let (iceoryx2_us, udp_us) = (spread(&times.iceoryx2_ns), spread(&times.udp_ns));
    let p50_ratio = iceoryx2_us.p50.zip(udp_us.p50).map(|(ours, udp)| ours / udp);
    let udp_lost = frames.saturating_sub(times.udp_ns.len());
    Bench { frame_bytes, iceoryx2_us, udp_us, udp_lost, p50_ratio }
}

fn send_datagrams(
    socket: &UdpSocket,
    datagram: &mut [u8],
    number: u64,
    source: &[u8],
) -> anyhow::Result<()> {
    let sent_ns = now_ns();
    for (k, part) in source.chunks(DATAGRAM_BYTES).enumerate() {
        datagram[..8].copy_from_slice(&number.to_le_bytes());
        datagram[8..16].copy_from_slice(&sent_ns.to_le_bytes());
        datagram[16..24].copy_from_slice(&((k * DATAGRAM_BYTES) as u64).to_le_bytes());
        datagram[DATAGRAM_HEADER..DATAGRAM_HEADER + part.len()].copy_from_slice(part);
        socket.send(&datagram[..DATAGRAM_HEADER + part.len()])?;
    }
    Ok(())
}

/// The receiving process: a thread per transport, both waiting in the kernel.
pub fn receive(run: &str, frame_bytes: usize) -> anyhow::Result<()> {
    let run: RunId = run.parse().map_err(anyhow::Error::msg)?;
    let link = join(run, Stage::Segment)?;
    let mut frames = link.subscribe_frames()?;
    let socket = UdpSocket::bind("127.0.0.1:0")?;
    enlarge(&socket);
    socket.set_read_timeout(Some(Duration::from_secs(10)))?;
    println!("{}", socket.local_addr()?.port());
    std::io::stdout().flush()?;
    let done = Arc::new(AtomicBool::new(false));
    let udp = std::thread::spawn({
        let done = Arc::clone(&done);
        move || receive_datagrams(&socket, frame_bytes, &done)
    });
    let mut iceoryx2_ns = Vec::new();
    while let Some(frame) = frames.next()? {
        let meta = frame.meta();
        if meta.header.is_end() {
            break;
        }
        iceoryx2_ns.push(frame.take_ns.saturating_sub(meta.header.publish_ns));
    }
    done.store(true, Ordering::Relaxed);
    let udp_ns = udp.join().map_err(|_| anyhow::anyhow!("the UDP thread panicked"))??;
    println!("{}", serde_json::to_string(&Times { iceoryx2_ns, udp_ns })?);
    Ok(())
}

fn receive_datagrams(
    socket: &UdpSocket,
    frame_bytes: usize,
    done: &AtomicBool,
) -> anyhow::Result<Vec<u64>> {
    let mut frame = vec![0; frame_bytes];
    let mut datagram = vec![0; DATAGRAM_BYTES + DATAGRAM_HEADER];
    let (mut number, mut got) = (LAST, 0);
    let mut times_ns = Vec::new();
    loop {
        let length = match socket.recv(&mut datagram) {
            Ok(length) if length >= DATAGRAM_HEADER => length,
            Ok(_) => continue,
            Err(_) if done.load(Ordering::Relaxed) => return Ok(times_ns),
            Err(error) => bail!("receiving by UDP: {error}"),
        };
        let word = |k: usize| {
            let mut bytes = [0; 8];
            bytes.copy_from_slice(&datagram[8 * k..8 * k + 8]);
            u64::from_le_bytes(bytes)
        };
        let (this, sent_ns, offset) = (word(0), word(1), word(2) as usize);
        if this == LAST {
            return Ok(times_ns);
        }
        if this != number {
            (number, got) = (this, 0);
        }
        let part = &datagram[DATAGRAM_HEADER..length];
        if let Some(place) = frame.get_mut(offset..offset + part.len()) {
            place.copy_from_slice(part);
            got += part.len();
        }
        if got == frame_bytes {
            times_ns.push(now_ns().saturating_sub(sent_ns));
        }
    }
}

/// Asks for a receive buffer that holds whole frames; only the superuser gets more than the
/// system's limit.
fn enlarge(socket: &UdpSocket) {
    use rustix::net::sockopt::{set_socket_recv_buffer_size, set_socket_recv_buffer_size_force};
    if set_socket_recv_buffer_size_force(socket, SOCKET_BYTES).is_err() {
        // What cannot be had is not had: frames that get lost are counted.
        let _ = set_socket_recv_buffer_size(socket, SOCKET_BYTES);
    }
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
