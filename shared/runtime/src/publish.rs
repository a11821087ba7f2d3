//! Publishing: messages are written in place, in shared memory.

use std::mem::MaybeUninit;
use std::time::{Duration, Instant};

use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher as Port;
use iceoryx2::port::update_connections::{ConnectionFailure, UpdateConnections};
use iceoryx2::port::{BackpressureAction, BackpressureInfo, LoanError};
use iceoryx2::prelude::IceoryxSend;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use orime_geometry::{RgbdCamera, RgbdFrameMut};
use orime_messages::{
    CameraMeta, FLAG_END, FLAG_PREDICTION, FrameExtent, FrameMeta, FrameStatus, Header, Message,
    Stage,
};

use crate::channel::{self, Channel, LOANS_MAX};
use crate::error::RuntimeError;
use crate::gauge;
use crate::link::{Ipc, Link, Mode};
use crate::now_ns;
use crate::stop::Stop;
use crate::wire::{Block, Wire};

/// How long a publisher sleeps before it looks again for a free message in its pool.
const POOL_POLL: Duration = Duration::from_micros(200);

/// How long capture goes on waiting for its consumers after it was asked to stop: for it, that
/// means to end the stream, and the end must arrive. The others end at once.
const CAPTURE_GRACE: Duration = Duration::from_secs(8);

fn grace(stage: Stage) -> Duration {
    if stage == Stage::Capture { CAPTURE_GRACE } else { Duration::ZERO }
}

/// What handing a message over gave.
#[derive(Debug, Clone, Copy)]
pub struct Sent<R> {
    /// The header it went out with.
    pub header: Header,
    /// What the writer returned.
    pub written: R,
}

/// Writes messages of one type into a channel.
#[derive(Debug)]
pub struct Publisher<M: Message> {
    port: Port<Ipc, Wire<M>, ()>,
    outlet: Outlet,
}

/// Writes frames into the frame channel.
#[derive(Debug)]
pub struct FramePublisher {
    port: Port<Ipc, [Block], Wire<FrameMeta>>,
    outlet: Outlet,
}

/// What both kinds of publishers share: waking, counting, waiting.
#[derive(Debug)]
struct Outlet {
    channel: &'static str,
    notifier: Option<Notifier<Ipc>>,
    identity: Header,
    sent: u64,
    stop: Stop,
    grace: Duration,
}

impl Outlet {
    fn new<M>(link: &Link, channel: &Channel<M>) -> Result<Self, RuntimeError> {
        Ok(Self {
            channel: channel.name,
            notifier: link.notifier(channel)?,
            identity: link.header(),
            sent: 0,
            stop: link.stop().clone(),
            grace: grace(link.identity().stage),
        })
    }

    /// Loans, waiting for a free message as long as nobody asks this process to end.
    fn loan<S>(
        &self,
        mut attempt: impl FnMut() -> Result<S, LoanError>,
        take_back: impl Fn() -> Result<(), ConnectionFailure>,
    ) -> Result<Option<S>, RuntimeError> {
        let (mut asked, mut has_waited) = (None::<Instant>, false);
        loop {
            match attempt() {
                Ok(sample) => return Ok(Some(sample)),
                // What a subscriber held that has left is given back only on request.
                Err(LoanError::OutOfMemory) => take_back().map_err(|error| {
                    RuntimeError::channel(self.channel, "looking who has left", error)
                })?,
                Err(error) => return Err(RuntimeError::channel(self.channel, "loaning", error)),
            }
            if !std::mem::replace(&mut has_waited, true) {
                gauge::loan_waited();
            }
            if self.stop.requested() {
                let asked = asked.get_or_insert_with(Instant::now);
                if asked.elapsed() >= self.grace {
                    return Ok(None);
                }
            }
            std::thread::sleep(POOL_POLL);
        }
    }

    /// The header of the next message: the lineage's times, this publisher's identity.
    fn header(&self, lineage: &Header, flags: u32) -> Header {
        Header {
            run_id: self.identity.run_id,
            incarnation: self.identity.incarnation,
            stage: self.identity.stage,
            sequence: self.sent,
            publish_ns: 0,
            flags,
            ..*lineage
        }
    }

    fn wake(&mut self, step: u64) {
        self.sent += 1;
        crate::log::note_step(step);
        let Some(notifier) = &self.notifier else { return };
        // A listener whose socket is full is awake anyway, and one that is gone needs no waking.
        if let Err(error) = notifier.notify() {
            tracing::debug!(channel = self.channel, ?error, "waking");
        }
    }
}

/// A port with a pool of this size, whose sender waits for a full subscriber until it is asked to
/// stop.
fn port<'f, P, H>(
    factory: &'f PortFactory<Ipc, P, H>,
    pool: usize,
    link: &Link,
) -> iceoryx2::service::port_factory::publisher::PortFactoryPublisher<'f, Ipc, P, H>
where
    P: IceoryxSend + std::fmt::Debug + ?Sized,
    H: iceoryx2::prelude::ZeroCopySend + std::fmt::Debug,
{
    let (stop, grace) = (link.stop().clone(), grace(link.identity().stage));
    factory
        .publisher_builder()
        .max_loaned_samples(LOANS_MAX)
        .override_sample_preallocation(move |_| pool)
        .set_backpressure_handler(move |info: &BackpressureInfo| {
            if stop.requested() && info.elapsed_time >= grace {
                return BackpressureAction::DiscardData;
            }
            std::thread::sleep(POOL_POLL);
            BackpressureAction::Retry
        })
}

impl<M: Message> Publisher<M> {
    pub(crate) fn new(link: &Link, channel: &Channel<M>) -> Result<Self, RuntimeError> {
        let factory = link.typed(channel, Mode::OpenOrCreate)?;
        let identity = link.identity();
        let port = port(&factory, channel.pool(identity.pace, identity.cameras), link)
            .create()
            .map_err(|error| RuntimeError::channel(channel.name, "making a publisher", error))?;
        Ok(Self { port, outlet: Outlet::new(link, channel)? })
    }

    /// Hands over one message that `write` fills in place, or `None` if this process shall end.
    ///
    /// The message's step, exposure and arrival are those of `lineage`. What `write` does not
    /// write is what an earlier message left there: it must set every count that says how much
    /// of an array is meant.
    pub fn send_with<R>(
        &mut self,
        lineage: &Header,
        write: impl FnOnce(&mut M) -> R,
    ) -> Result<Option<Sent<R>>, RuntimeError> {
        self.send(lineage, 0, None, write)
    }

    /// Gives those who have subscribed since the last message the newest ones, as many as the
    /// channel keeps.
    pub fn greet(&self) {
        // Whoever cannot be connected now is when the next message is sent.
        if let Err(error) = self.port.update_connections() {
            tracing::debug!(channel = self.outlet.channel, ?error, "greeting");
        }
    }

    /// As [`Publisher::send_with`], marked as a prediction for the exposure of `lineage`.
    pub fn send_prediction<R>(
        &mut self,
        lineage: &Header,
        write: impl FnOnce(&mut M) -> R,
    ) -> Result<Option<Sent<R>>, RuntimeError> {
        self.send(lineage, FLAG_PREDICTION, None, write)
    }

    /// Hands over the end of the stream.
    pub fn send_end(&mut self, lineage: &Header) -> Result<(), RuntimeError> {
        self.send(lineage, FLAG_END, None, |_| ()).map(|_| ())
    }

    /// As [`Publisher::send_with`], but the message keeps `about`'s publish time.
    pub(crate) fn send_stamped(
        &mut self,
        about: &Header,
        write: impl FnOnce(&mut M),
    ) -> Result<(), RuntimeError> {
        self.send(about, 0, Some(about.publish_ns), write).map(|_| ())
    }

    fn send<R>(
        &mut self,
        lineage: &Header,
        flags: u32,
        publish_ns: Option<u64>,
        write: impl FnOnce(&mut M) -> R,
    ) -> Result<Option<Sent<R>>, RuntimeError> {
        let Some(mut sample) =
            self.outlet.loan(|| self.port.loan_uninit(), || self.port.update_connections())?
        else {
            return Ok(None);
        };
        // SAFETY: the payload lies in pages of shared memory that the kernel filled with zeros
        // and that only this publisher has written since, always as an `M`. `M` is `Pod`, so
        // both are values of it. No other process writes to a message that is on loan.
        let Wire(message) = unsafe { MaybeUninit::assume_init_mut(sample.payload_mut()) };
        let mut header = self.outlet.header(lineage, flags);
        *message.header_mut() = header;
        let written = write(message);
        header.publish_ns = publish_ns.unwrap_or_else(now_ns);
        *message.header_mut() = header;
        // SAFETY: as above, and the header was written.
        let sample = unsafe { sample.assume_init() };
        sample
            .send()
            .map_err(|error| RuntimeError::channel(self.outlet.channel, "sending", error))?;
        self.outlet.wake(header.step);
        Ok(Some(Sent { header, written }))
    }
}

/// What a frame's writer says about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameWritten {
    /// Whether there are pixels now.
    pub status: FrameStatus,
    /// Whole-image copies made on the way.
    pub copies: u32,
}

impl FramePublisher {
    pub(crate) fn new(link: &Link, cameras: &[RgbdCamera]) -> Result<Self, RuntimeError> {
        let channel = &channel::FRAME;
        let frame_bytes =
            cameras.iter().map(|camera| FrameExtent::of(camera).total_bytes()).max().unwrap_or(1);
        let factory = link.frames(channel, Mode::OpenOrCreate)?;
        let identity = link.identity();
        let port = port(&factory, channel.pool(identity.pace, identity.cameras), link)
            .initial_max_slice_len(Block::count(frame_bytes))
            .create()
            .map_err(|error| RuntimeError::channel(channel.name, "making a publisher", error))?;
        Ok(Self { port, outlet: Outlet::new(link, channel)? })
    }

    /// Hands over one frame of `camera` whose pixels `write` puts in place, or `None` if this
    /// process shall end. The frame's arrival is when `write` is done.
    pub fn send_with(
        &mut self,
        lineage: &Header,
        (index, camera): (usize, &RgbdCamera),
        n_cameras: usize,
        write: impl FnOnce(RgbdFrameMut<'_>) -> FrameWritten,
    ) -> Result<Option<Sent<FrameWritten>>, RuntimeError> {
        let extent = FrameExtent::of(camera);
        let Some(mut sample) = self.outlet.loan(
            || self.port.loan_slice_uninit(Block::count(extent.total_bytes())),
            || self.port.update_connections(),
        )?
        else {
            return Ok(None);
        };
        // SAFETY: bytes in pages that the kernel zero-filled or this publisher wrote; any bytes
        // are a `Block`, and nobody else writes to a frame on loan.
        let blocks =
            unsafe { &mut *(sample.payload_mut() as *mut [MaybeUninit<Block>] as *mut [Block]) };
        let payload: &mut [u8] = bytemuck::cast_slice_mut(blocks);
        let (color_rgb, rest) = payload.split_at_mut(extent.depth_offset);
        let frame = RgbdFrameMut {
            color_rgb: &mut color_rgb[..extent.color_bytes],
            depth_units: bytemuck::cast_slice_mut(&mut rest[..extent.depth_bytes]),
        };
        let written = write(frame);
        let mut header = self.outlet.header(lineage, 0);
        header.arrival_ns = now_ns();
        header.publish_ns = header.arrival_ns;
        sample.user_header_mut().0 = FrameMeta {
            header,
            camera: index as u32,
            n_cameras: n_cameras as u32,
            status: written.status as u32,
            copies: written.copies,
            color_bytes: extent.color_bytes as u64,
            depth_offset: extent.depth_offset as u64,
            depth_bytes: extent.depth_bytes as u64,
            calibration: CameraMeta::from(camera),
        };
        // SAFETY: as above.
        let sample = unsafe { sample.assume_init() };
        sample
            .send()
            .map_err(|error| RuntimeError::channel(self.outlet.channel, "sending", error))?;
        self.outlet.wake(header.step);
        Ok(Some(Sent { header, written }))
    }

    /// Hands over the end of the stream: a frame without pixels.
    pub fn send_end(&mut self, lineage: &Header) -> Result<(), RuntimeError> {
        let Some(mut sample) = self
            .outlet
            .loan(|| self.port.loan_slice_uninit(1), || self.port.update_connections())?
        else {
            return Ok(());
        };
        let mut header = self.outlet.header(lineage, FLAG_END);
        header.publish_ns = now_ns();
        sample.user_header_mut().0 =
            FrameMeta { header, ..<FrameMeta as bytemuck::Zeroable>::zeroed() };
        sample
            .write_from_fn(|_| bytemuck::Zeroable::zeroed())
            .send()
            .map_err(|error| RuntimeError::channel(self.outlet.channel, "sending", error))?;
        self.outlet.wake(header.step);
        Ok(())
    }
}
