//! A process' place in a run: its iceoryx2 node, under the run's own prefix and directory.

use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{
    FileName, LogLevel, NodeName, SemanticString, ServiceName, SignalHandlingMode, ipc_threadsafe,
    set_log_level,
};
use orime_geometry::RgbdCamera;
use orime_messages::{Header, Message, Stage};

use crate::channel::{Channel, NODES_MAX, Pace};
use crate::error::RuntimeError;
use crate::memory;
use crate::publish::{FramePublisher, Publisher};
use crate::resume::Resume;
use crate::run::{RunId, make_private_dir};
use crate::stop::Stop;
use crate::subscribe::{FrameSubscription, Subscription};
use crate::wire::{Block, Wire};

/// The flavour of iceoryx2 that we use: ports may be moved between threads.
pub(crate) type Ipc = ipc_threadsafe::Service;

/// What all channels of one process share.
#[derive(Debug, Clone, Copy)]
pub struct Identity {
    /// The run.
    pub run: RunId,
    /// The pace of its set.
    pub pace: Pace,
    /// Cameras of its set.
    pub cameras: usize,
    /// This process' part; what it publishes is marked with it.
    pub stage: Stage,
    /// Marks this process among those that had the part before it.
    pub incarnation: u64,
    /// Where it goes on, if it takes the place of one that ended.
    pub resume: Option<Resume>,
}

/// A process' connection to its run. Ports made from it may outlive it.
#[derive(Debug)]
pub struct Link {
    node: Node<Ipc>,
    identity: Identity,
    stop: Stop,
}

impl Link {
    /// Joins a run.
    pub fn join(identity: Identity, stop: Stop) -> Result<Self, RuntimeError> {
        set_log_level(LogLevel::Fatal);
        let dir = identity.run.ipc_dir();
        make_private_dir(&dir)
            .map_err(|source| RuntimeError::RunDir { path: dir.clone(), source })?;
        // A guest may follow one that was killed, of which nobody else knows.
        let is_guest = identity.stage == Stage::Judge || identity.stage == Stage::Record;
        let config = config(identity.run, &dir, is_guest)?;
        let name = NodeName::new(identity.stage.name())
            .map_err(|error| RuntimeError::channel("node", "naming", error))?;
        let node = NodeBuilder::new()
            .name(&name)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .config(&config)
            .create::<Ipc>()
            .map_err(|error| RuntimeError::channel("node", "joining the run", error))?;
        Ok(Self { node, identity, stop })
    }

    /// Who this process is.
    pub fn identity(&self) -> Identity {
        self.identity
    }

    /// The flag that ends all waiting.
    pub fn stop(&self) -> &Stop {
        &self.stop
    }

    /// Makes sure that the run's shared memory is really there; call it when all ports are made.
    pub fn reserve_memory(&self) -> Result<(), RuntimeError> {
        memory::reserve(self.identity.run).map_err(RuntimeError::Memory)
    }

    /// A header of this process for step `step`, times still 0.
    pub fn header(&self) -> Header {
        Header {
            run_id: self.identity.run.number(),
            incarnation: self.identity.incarnation,
            stage: self.identity.stage as u32,
            ..bytemuck::Zeroable::zeroed()
        }
    }

    /// Subscribes to a channel.
    pub fn subscribe<M: Message>(
        &self,
        channel: &Channel<M>,
    ) -> Result<Subscription<M>, RuntimeError> {
        Subscription::new(self, channel, Mode::OpenOrCreate)
    }

    /// Publishes on a channel.
    pub fn publish<M: Message>(&self, channel: &Channel<M>) -> Result<Publisher<M>, RuntimeError> {
        Publisher::new(self, channel)
    }

    /// Subscribes to the frames.
    pub fn subscribe_frames(&self) -> Result<FrameSubscription, RuntimeError> {
        FrameSubscription::new(self, Mode::OpenOrCreate)
    }

    /// Publishes the frames of these cameras.
    pub fn publish_frames(&self, cameras: &[RgbdCamera]) -> Result<FramePublisher, RuntimeError> {
        FramePublisher::new(self, cameras)
    }

    /// Gives back what dead members of this run held, so that nobody waits for them.
    pub(crate) fn clear_dead_members(&self) {
        self.node.try_cleanup_dead_nodes();
    }

    pub(crate) fn typed<M: Message>(
        &self,
        channel: &Channel<M>,
        mode: Mode,
    ) -> Result<TypedFactory<M>, RuntimeError> {
        let qos = channel.qos(self.identity.pace, self.identity.cameras);
        let builder = self
            .node
            .service_builder(&service_name(channel)?)
            .publish_subscribe::<Wire<M>>()
            .enable_safe_overflow(qos.overflow)
            .subscriber_max_buffer_size(qos.buffer)
            .subscriber_max_borrowed_samples(qos.borrowed)
            .history_size(channel.history)
            .max_publishers(channel.publishers_max)
            .max_subscribers(channel.subscribers_max)
            .max_nodes(NODES_MAX);
        match mode {
            Mode::OpenOrCreate => builder
                .open_or_create()
                .map_err(|error| RuntimeError::channel(channel.name, "opening", error)),
            Mode::Open => builder
                .open()
                .map_err(|error| RuntimeError::channel(channel.name, "attaching to", error)),
        }
    }

    pub(crate) fn frames(
        &self,
        channel: &Channel<orime_messages::FrameMeta>,
        mode: Mode,
    ) -> Result<FrameFactory, RuntimeError> {
        let qos = channel.qos(self.identity.pace, self.identity.cameras);
        let builder = self
            .node
            .service_builder(&service_name(channel)?)
            .publish_subscribe::<[Block]>()
            .user_header::<Wire<orime_messages::FrameMeta>>()
            .enable_safe_overflow(qos.overflow)
            .subscriber_max_buffer_size(qos.buffer)
            .subscriber_max_borrowed_samples(qos.borrowed)
            .history_size(0)
            .max_publishers(channel.publishers_max)
            .max_subscribers(channel.subscribers_max)
            .max_nodes(NODES_MAX);
        match mode {
            Mode::OpenOrCreate => builder
                .open_or_create()
                .map_err(|error| RuntimeError::channel(channel.name, "opening", error)),
            Mode::Open => builder
                .open()
                .map_err(|error| RuntimeError::channel(channel.name, "attaching to", error)),
        }
    }

    fn event<M>(&self, channel: &Channel<M>, mode: Mode) -> Result<EventFactory, RuntimeError> {
        let builder = self
            .node
            .service_builder(&service_name(channel)?)
            .event()
            .max_listeners(channel.subscribers_max)
            .max_notifiers(channel.publishers_max)
            .max_nodes(NODES_MAX)
            .event_id_max_value(0)
            .disable_notifier_created_event()
            .disable_notifier_dropped_event()
            .disable_notifier_dead_event()
            .disable_deadline();
        match mode {
            Mode::OpenOrCreate => builder.open_or_create().map_err(|error| {
                RuntimeError::channel(channel.name, "opening the event of", error)
            }),
            Mode::Open => builder.open().map_err(|error| {
                RuntimeError::channel(channel.name, "attaching to the event of", error)
            }),
        }
    }

    pub(crate) fn notifier<M>(
        &self,
        channel: &Channel<M>,
    ) -> Result<Option<Notifier<Ipc>>, RuntimeError> {
        if !channel.wakes {
            return Ok(None);
        }
        let notifier = self
            .event(channel, Mode::OpenOrCreate)?
            .notifier_builder()
            .create()
            .map_err(|error| RuntimeError::channel(channel.name, "making a notifier", error))?;
        Ok(Some(notifier))
    }

    pub(crate) fn listener<M>(
        &self,
        channel: &Channel<M>,
        mode: Mode,
    ) -> Result<Option<Listener<Ipc>>, RuntimeError> {
        if !channel.wakes {
            return Ok(None);
        }
        let listener = self
            .event(channel, mode)?
            .listener_builder()
            .create()
            .map_err(|error| RuntimeError::channel(channel.name, "making a listener", error))?;
        Ok(Some(listener))
    }
}

/// Whether a channel may be made by whoever comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Stages, which may come in any order.
    OpenOrCreate,
    /// Guests, which must leave no trace.
    Open,
}

pub(crate) type TypedFactory<M> =
    iceoryx2::service::port_factory::publish_subscribe::PortFactory<Ipc, Wire<M>, ()>;
pub(crate) type FrameFactory = iceoryx2::service::port_factory::publish_subscribe::PortFactory<
    Ipc,
    [Block],
    Wire<orime_messages::FrameMeta>,
>;
type EventFactory = iceoryx2::service::port_factory::event::PortFactory<Ipc>;

fn service_name<M>(channel: &Channel<M>) -> Result<ServiceName, RuntimeError> {
    ServiceName::new(channel.name)
        .map_err(|error| RuntimeError::channel(channel.name, "naming", error))
}

fn config(run: RunId, dir: &Path, clears_dead: bool) -> Result<Config, RuntimeError> {
    let naming = |error| RuntimeError::channel("node", "naming the run's files", error);
    let mut config = Config::default();
    // The supervisor clears what the dead left, before it starts a successor: whoever joins or
    // leaves in between would only look at every member of the run again, for each channel.
    config.global.service.cleanup_dead_nodes_on_open = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.node.cleanup_dead_nodes_on_creation = clears_dead;
    config.global.prefix = FileName::new(run.prefix().as_bytes()).map_err(naming)?;
    let root = iceoryx2::prelude::Path::new(dir.as_os_str().as_bytes()).map_err(naming)?;
    config.global.set_root_path(&root);
    Ok(config)
}
