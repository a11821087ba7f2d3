//! Subscribing: a thread of its own takes messages the moment they come, the stage works on them
//! when it can. So transport and queueing are told apart.

use std::ops::Deref;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use iceoryx2::port::ReceiveError;
use iceoryx2::port::listener::Listener;
use iceoryx2::sample::Sample;
use orime_geometry::RgbdFrame;
use orime_messages::{Drops, FrameMeta, FrameStatus, Header, Message};

use crate::channel::{self, Channel, Pace};
use crate::error::RuntimeError;
use crate::inbox::{Inbox, Resumed, STOP_POLL, Taken};
use crate::link::{Ipc, Link, Mode};
use crate::now_ns;
use crate::stop::Stop;
use crate::wire::{Block, Wire};

/// A message in shared memory, held until it is dropped.
#[derive(Debug)]
pub struct Received<M: Message> {
    sample: Sample<Ipc, Wire<M>, ()>,
    /// When it was taken, `CLOCK_MONOTONIC`, nanoseconds.
    pub take_ns: u64,
}

impl<M: Message> Deref for Received<M> {
    type Target = M;

    fn deref(&self) -> &M {
        &self.sample.payload().0
    }
}

impl<M: Message> Taken for Received<M> {
    fn header(&self) -> &Header {
        Message::header(&**self)
    }
}

/// A frame in shared memory, held until it is dropped.
#[derive(Debug)]
pub struct ReceivedFrame {
    sample: Sample<Ipc, [Block], Wire<FrameMeta>>,
    /// When it was taken, `CLOCK_MONOTONIC`, nanoseconds.
    pub take_ns: u64,
}

impl ReceivedFrame {
    /// Everything but the pixels.
    pub fn meta(&self) -> &FrameMeta {
        &self.sample.user_header().0
    }

    /// The pixels, where capture wrote them; `None` where there are none or the sender's numbers
    /// do not fit the payload.
    pub fn view(&self) -> Option<RgbdFrame<'_>> {
        let payload: &[u8] = bytemuck::cast_slice(self.sample.payload());
        let extent = self.meta().extent();
        if self.meta().status != FrameStatus::Ok as u32 {
            return None;
        }
        let color_rgb = payload.get(..extent.color_bytes)?;
        let depth_end = extent.depth_offset.checked_add(extent.depth_bytes)?;
        let depth = payload.get(extent.depth_offset..depth_end)?;
        Some(RgbdFrame { color_rgb, depth_units: bytemuck::try_cast_slice(depth).ok()? })
    }
}

impl Taken for ReceivedFrame {
    fn header(&self) -> &Header {
        &self.meta().header
    }

    fn place(&self) -> u64 {
        u64::from(self.meta().camera)
    }
}

/// Messages of one channel, as they come.
#[derive(Debug)]
pub struct Subscription<M: Message> {
    intake: Intake<Received<M>>,
}

/// Frames, as they come.
#[derive(Debug)]
pub struct FrameSubscription {
    intake: Intake<ReceivedFrame>,
}

/// How long the taking thread waits for the stage to give something back.
const BORROW_POLL: Duration = Duration::from_millis(1);

/// The inbox and the thread that fills it.
#[derive(Debug)]
struct Intake<T> {
    inbox: Arc<Inbox<T>>,
    stop: Stop,
    /// Ends this thread alone.
    gone: Stop,
    thread: Option<JoinHandle<()>>,
}

impl<T: Taken + Send + 'static> Intake<T> {
    fn start<M>(
        link: &Link,
        channel: &Channel<M>,
        mode: Mode,
        mut receive: impl FnMut() -> Result<Option<T>, ReceiveError> + Send + 'static,
    ) -> Result<Self, RuntimeError> {
        let identity = link.identity();
        let qos = channel.qos(identity.pace, identity.cameras);
        let listener = link.listener(channel, mode)?;
        // Records overflow at every pace, but those that were taken are never given up.
        let newest_wins = identity.pace == Pace::Realtime && !channel.lockstep.overflow;
        // What the stage works on is borrowed too: a set of frames, a cloud and its state.
        let in_work = if newest_wins { qos.borrowed.div_ceil(2) } else { 0 };
        let resumed = identity.resume.map(|resume| Resumed {
            wanted: resume.wanted(),
            per_step: if channel.per_camera { identity.cameras as u64 } else { 1 },
        });
        let from_start = mode == Mode::OpenOrCreate && resumed.is_none();
        let inbox = Arc::new(Inbox::new(qos.borrowed - in_work, newest_wins, from_start, resumed));
        let (stop, gone) = (link.stop().clone(), Stop::new());
        let name = channel.name;
        let thread = std::thread::Builder::new()
            .name(format!("take {name}"))
            .spawn({
                let (inbox, gone) = (Arc::clone(&inbox), gone.clone());
                move || {
                    let result = take(name, &inbox, &gone, listener, &mut receive);
                    inbox.close(result.err());
                }
            })
            .map_err(|source| RuntimeError::System { action: "starting a thread", source })?;
        Ok(Self { inbox, stop, gone, thread: Some(thread) })
    }

    fn next(&self, mut idle: impl FnMut()) -> Result<Option<T>, RuntimeError> {
        loop {
            if let Some(message) = self.inbox.get(STOP_POLL)? {
                return Ok(Some(message));
            }
            idle();
            if self.stop.requested() || self.inbox.is_closed() {
                return Ok(None);
            }
        }
    }
}

impl<T> Drop for Intake<T> {
    fn drop(&mut self) {
        self.gone.request();
        if let Some(thread) = self.thread.take() {
            // A panic in it was reported when it happened.
            let _ = thread.join();
        }
    }
}

/// Takes messages into `inbox` until `gone`.
fn take<T: Taken>(
    channel: &'static str,
    inbox: &Inbox<T>,
    gone: &Stop,
    listener: Option<Listener<Ipc>>,
    receive: &mut impl FnMut() -> Result<Option<T>, ReceiveError>,
) -> Result<(), RuntimeError> {
    while !gone.requested() {
        if !inbox.has_room() {
            inbox.wait_for_room();
            continue;
        }
        match receive() {
            Ok(Some(message)) => inbox.put(message),
            Ok(None) => match &listener {
                // An interrupted wait is as good as a short one.
                Some(listener) => drop(listener.timed_wait(|_| {}, STOP_POLL)),
                None => std::thread::sleep(STOP_POLL / 5),
            },
            // The stage holds all that it may: it will give some back.
            Err(ReceiveError::ExceedsMaxBorrows) => std::thread::sleep(BORROW_POLL),
            Err(error) => return Err(RuntimeError::channel(channel, "receiving", error)),
        }
    }
    Ok(())
}

impl<M: Message> Subscription<M> {
    pub(crate) fn new(link: &Link, channel: &Channel<M>, mode: Mode) -> Result<Self, RuntimeError> {
        let factory = link.typed(channel, mode)?;
        let port = factory
            .subscriber_builder()
            .create()
            .map_err(|error| RuntimeError::channel(channel.name, "making a subscriber", error))?;
        let intake = Intake::start(link, channel, mode, move || {
            Ok(port.receive()?.map(|sample| Received { sample, take_ns: now_ns() }))
        })?;
        Ok(Self { intake })
    }

    /// The oldest message that was not had before, waiting for it; `None` when this process
    /// shall end.
    #[expect(clippy::should_implement_trait, reason = "it can fail, and it waits")]
    pub fn next(&mut self) -> Result<Option<Received<M>>, RuntimeError> {
        self.intake.next(|| {})
    }

    /// As [`Subscription::next`], calling `idle` about 20 times a second while it waits.
    pub fn next_with(&mut self, idle: impl FnMut()) -> Result<Option<Received<M>>, RuntimeError> {
        self.intake.next(idle)
    }

    /// The oldest message that was not had before, if there is one now.
    pub fn try_next(&mut self) -> Result<Option<Received<M>>, RuntimeError> {
        self.intake.inbox.get(Duration::ZERO)
    }

    /// The newest message, giving up those before it; waits if there is none. The end of the
    /// stream is never given up, nor given before what precedes it.
    pub fn newest(&mut self) -> Result<Option<Received<M>>, RuntimeError> {
        self.newest_with(|| {})
    }

    /// As [`Subscription::newest`], calling `idle` about 20 times a second while it waits.
    pub fn newest_with(&mut self, idle: impl FnMut()) -> Result<Option<Received<M>>, RuntimeError> {
        let Some(first) = self.next_with(idle)? else { return Ok(None) };
        self.newer_than(first).map(Some)
    }

    /// The newest message, giving up those before it; `None` if none comes for so long.
    pub fn newest_within(&mut self, wait: Duration) -> Result<Option<Received<M>>, RuntimeError> {
        match self.intake.inbox.get(wait)? {
            Some(first) => self.newer_than(first).map(Some),
            None => Ok(None),
        }
    }

    /// The newest message if there is one now, giving up those before it.
    pub fn try_newest(&mut self) -> Result<Option<Received<M>>, RuntimeError> {
        match self.try_next()? {
            Some(first) => self.newer_than(first).map(Some),
            None => Ok(None),
        }
    }

    fn newer_than(&mut self, first: Received<M>) -> Result<Received<M>, RuntimeError> {
        let mut newest = first;
        let mut superseded = 0;
        while !Message::header(&*newest).is_end()
            && let Some(message) = self.try_next()?
        {
            newest = message;
            superseded += 1;
        }
        self.intake.inbox.count_superseded(superseded);
        Ok(newest)
    }

    /// What this subscription lost so far.
    pub fn drops(&self) -> Drops {
        self.intake.inbox.drops()
    }
}

/// Messages that matter only beside others: looked at when those come, and never waited for.
///
/// Whoever sends here before it sends what leads to the other message has its word heard with it:
/// no thread takes messages in between. What overflows is not counted.
#[derive(Debug)]
pub struct Aside<M: Message> {
    port: iceoryx2::port::subscriber::Subscriber<Ipc, Wire<M>, ()>,
    channel: &'static str,
}

impl<M: Message> Aside<M> {
    pub(crate) fn new(link: &Link, channel: &Channel<M>) -> Result<Self, RuntimeError> {
        let port =
            link.typed(channel, Mode::OpenOrCreate)?.subscriber_builder().create().map_err(
                |error| RuntimeError::channel(channel.name, "making a subscriber", error),
            )?;
        Ok(Self { port, channel: channel.name })
    }

    /// The oldest message that was not had before, if there is one.
    pub fn try_next(&self) -> Result<Option<Received<M>>, RuntimeError> {
        let sample = self
            .port
            .receive()
            .map_err(|error| RuntimeError::channel(self.channel, "receiving", error))?;
        Ok(sample.map(|sample| Received { sample, take_ns: now_ns() }))
    }
}

impl FrameSubscription {
    pub(crate) fn new(link: &Link, mode: Mode) -> Result<Self, RuntimeError> {
        let channel = &channel::FRAME;
        let port =
            link.frames(channel, mode)?.subscriber_builder().create().map_err(|error| {
                RuntimeError::channel(channel.name, "making a subscriber", error)
            })?;
        let intake = Intake::start(link, channel, mode, move || {
            Ok(port.receive()?.map(|sample| ReceivedFrame { sample, take_ns: now_ns() }))
        })?;
        Ok(Self { intake })
    }

    /// The oldest frame that was not had before, waiting for it; `None` when this process shall
    /// end.
    #[expect(clippy::should_implement_trait, reason = "it can fail, and it waits")]
    pub fn next(&mut self) -> Result<Option<ReceivedFrame>, RuntimeError> {
        self.intake.next(|| {})
    }

    /// The oldest frame that was not had before, if there is one now.
    pub fn try_next(&mut self) -> Result<Option<ReceivedFrame>, RuntimeError> {
        self.intake.inbox.get(Duration::ZERO)
    }

    /// What this subscription lost so far.
    pub fn drops(&self) -> Drops {
        self.intake.inbox.drops()
    }
}
