//! The channels of a set, each with its quality of service in both paces.

use std::marker::PhantomData;

use orime_messages::{
    FoldPlan, FrameMeta, Grippers, ObservedCloud, SheetState, StageRecord, Targets, Truth,
};
use serde::{Deserialize, Serialize};

/// How a set treats time; the `pace` of a set file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pace {
    /// Every frame set is processed exactly once and nothing is dropped; results repeat bit for
    /// bit. For recordings and tests.
    Lockstep,
    /// The newest wins, every drop is counted by its cause. For cameras.
    Realtime,
}

/// How a channel behaves at one pace. Counts are messages, or frame sets on the frame channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// Whether a full buffer gives up its oldest message. If not, the publisher waits.
    pub overflow: bool,
    /// Messages that wait in shared memory for one subscriber.
    pub buffer: usize,
    /// Messages that one subscriber may hold: those in work and those taken and waiting.
    pub borrowed: usize,
    /// Messages in the publisher's pool, where fewer than the worst case are wanted: the
    /// publisher waits for a free one. With `buffer` and `borrowed` at least this, a subscriber
    /// can always take at once, and what it measures as transport is no waiting for its own work.
    pub pool: Option<usize>,
}

/// One channel: a name, a message, its quality of service.
#[derive(Debug, Clone, Copy)]
pub struct Channel<M> {
    /// Name inside the run.
    pub name: &'static str,
    /// At pace `lockstep`.
    pub lockstep: Qos,
    /// At pace `realtime`.
    pub realtime: Qos,
    /// Most publishers.
    pub publishers_max: usize,
    /// Most subscribers, those that come and go included.
    pub subscribers_max: usize,
    /// Whether the counts of [`Qos`] are per camera.
    pub per_camera: bool,
    /// Newest messages that one who subscribes late is given.
    pub history: usize,
    /// Whether a sent message wakes the subscribers; they look for themselves otherwise.
    pub wakes: bool,
    pub(crate) message: PhantomData<M>,
}

/// Most processes on one channel.
pub const NODES_MAX: usize = 24;

const fn lossless(pool: usize) -> Qos {
    Qos { overflow: false, buffer: pool, borrowed: pool, pool: Some(pool) }
}

const fn newest_wins(buffer: usize, borrowed: usize) -> Qos {
    Qos { overflow: true, buffer, borrowed, pool: None }
}

const fn channel<M>(name: &'static str, lockstep: Qos, realtime: Qos) -> Channel<M> {
    Channel {
        name,
        lockstep,
        realtime,
        publishers_max: 1,
        subscribers_max: 3,
        per_camera: false,
        wakes: true,
        history: 0,
        message: PhantomData,
    }
}

/// capture → segment, judge, one recorder. In lockstep one set is in work while the next is
/// written.
pub const FRAME: Channel<FrameMeta> =
    Channel { per_camera: true, ..channel("orime/frame", lossless(2), newest_wins(1, 3)) };
/// segment → register, judge, recorder.
pub const CLOUD: Channel<ObservedCloud> = channel("orime/cloud", lossless(2), newest_wins(2, 3));
/// register → simulate.
pub const TARGETS: Channel<Targets> = channel("orime/targets", lossless(2), newest_wins(2, 3));
/// simulate → register, judge, recorder, robot, viewer. A register that is restarted, or a viewer,
/// begins with the newest state.
pub const STATE: Channel<SheetState> = Channel {
    subscribers_max: 8,
    history: 1,
    ..channel("orime/state", lossless(4), newest_wins(2, 4))
};
/// capture → judge, recorder. Capture runs ahead of the states by all that is on its way, so this
/// holds more than the other channels together.
pub const TRUTH: Channel<Truth> = channel("orime/truth", lossless(16), newest_wins(16, 16));
/// capture → simulate, recorder. Capture opens it only for sources that tell their grippers, and
/// then sends one message a step, before the step's frames, so that a robot can publish here beside
/// live cameras. Simulate listens if `grippers` is among its effects.
pub const GRIPPER: Channel<Grippers> = channel("orime/gripper", lossless(16), newest_wins(4, 4));
/// capture → simulate. Capture opens it only for sources that tell what will be folded, so that a
/// robot can publish here beside live cameras. Each message is a whole plan; a simulate that comes
/// later begins with the newest.
pub const PLAN: Channel<FoldPlan> =
    Channel { history: 1, ..channel("orime/plan", lossless(4), newest_wins(4, 4)) };
/// simulate → robot, viewer: states between frames, in realtime and where
/// `simulate.predict.per_frame` asks for them; each is marked as a prediction.
pub const PREDICTION: Channel<SheetState> =
    channel("orime/prediction", newest_wins(2, 4), newest_wins(2, 4));
/// Every stage → supervisor, probes. Never holds a stage up, at any pace.
pub const RECORD: Channel<StageRecord> = Channel {
    publishers_max: 8,
    subscribers_max: 6,
    wakes: false,
    ..channel("orime/record", newest_wins(512, 128), newest_wins(512, 128))
};

impl<M> Channel<M> {
    /// The quality of service at a pace, with all counts in messages.
    pub fn qos(&self, pace: Pace, cameras: usize) -> Qos {
        let qos = match pace {
            Pace::Lockstep => self.lockstep,
            Pace::Realtime => self.realtime,
        };
        let per = if self.per_camera { cameras } else { 1 };
        Qos {
            overflow: qos.overflow,
            // One more of each for the end of the stream, and what the channel keeps for others.
            buffer: per * qos.buffer + 1 + self.history,
            borrowed: per * qos.borrowed + 1 + self.history,
            pool: qos.pool.map(|pool| per * pool + 1 + self.history),
        }
    }

    /// Messages in one publisher's pool, as iceoryx2 reserves them.
    pub fn pool(&self, pace: Pace, cameras: usize) -> usize {
        let qos = self.qos(pace, cameras);
        let worst_case =
            self.subscribers_max * (qos.buffer + qos.borrowed) + self.history + LOANS_MAX;
        qos.pool.map_or(worst_case, |pool| pool.min(worst_case))
    }
}

/// Messages that a publisher writes at the same time.
pub const LOANS_MAX: usize = 1;
