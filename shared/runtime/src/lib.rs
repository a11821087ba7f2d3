//! Channels, set files, clock and lifecycle: all that knows of processes.
//!
//! The only crate that depends on iceoryx2. A process of a set is a [`Service`]: it reads its
//! section of the [`SetFile`], opens its channels, says that it is ready, and works until its
//! input ends or it is asked to stop. Everything a run leaves on the machine bears its
//! [`RunId`]'s prefix or lies in its directory, and [`clean`] removes exactly that.

pub mod channel;
mod clock;
mod error;
mod gauge;
mod guest;
mod inbox;
mod link;
mod log;
mod memory;
mod publish;
mod recorder;
mod registry;
mod resume;
mod run;
mod service;
mod set_file;
mod stop;
mod subscribe;
#[cfg(test)]
mod tests;
mod wire;

pub use channel::Pace;
pub use clock::now_ns;
pub use error::RuntimeError;
pub use guest::Guest;
pub use link::{Identity, Link};
pub use log::LOG_VARIABLE;
pub use memory::{free_bytes, needed_bytes};
pub use publish::{FramePublisher, FrameWritten, Publisher, Sent};
pub use recorder::{Recorder, Work};
pub use registry::{RunEntry, registered, registry_dir, start_ticks};
pub use resume::Resume;
pub use run::{
    RunId, SHARED_MEMORY_DIR, clean, foreign_owner, ipc_dirs, make_private_dir, shared_memory_of,
    user_name,
};
pub use service::{
    Beginning, CAMERAS_VARIABLE, PARENT_VARIABLE, PROTOCOL_VARIABLE, READY, RESUME_VARIABLE,
    RUN_VARIABLE, SPARE_VARIABLE, Service,
};
pub use set_file::{DATA_VARIABLE, SECTIONS, SetError, SetFile, data_dir, expand};
pub use stop::{Stop, die_with_parent};
pub use subscribe::{Aside, FrameSubscription, Received, ReceivedFrame, Subscription};
