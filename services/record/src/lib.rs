//! `record`: what a running set publishes, into an MCAP file that capture can play.
//!
//! A recorder listens like the judge: losslessly beside a set in lockstep, to the newest beside one
//! in realtime, where it counts what it missed. It never ends a set: after a fault it says what
//! happened and leaves, and the stages go on without it.

mod gather;
mod report;
mod session;
mod tape;

pub use report::{Counts, Report, Said};
pub use session::{Inputs, Session, Simulated, survive_size_limits};
pub use tape::{Tape, TapeContent, TapeError, tape_path};
