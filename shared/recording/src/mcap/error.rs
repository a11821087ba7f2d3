//! What can go wrong with recordings.

use std::io;
use std::path::PathBuf;

use super::Loss;

/// Why something could not be recorded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The file cannot be created; recordings are never overwritten.
    #[error("creating recording `{path}`: {source}; name a file that does not exist yet")]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A write failed, for example because the disk is full. Stop recording.
    #[error(
        "writing recording `{path}`: {source}; what was written before it reads back, free some \
         space and record again"
    )]
    Write {
        /// The file.
        path: PathBuf,
        /// What failed.
        source: mcap::McapError,
    },
    /// A frame's buffers have not the size of the camera's images. Nothing was written.
    #[error("recording `{path}`: a frame does not fit camera `{camera}`")]
    Size {
        /// The file.
        path: PathBuf,
        /// The camera's name.
        camera: String,
    },
    /// A sheet state has not one position per node. Nothing was written.
    #[error("recording `{path}`: {found} node positions for a sheet of {expected} nodes")]
    Nodes {
        /// The file.
        path: PathBuf,
        /// Positions given.
        found: usize,
        /// Nodes of the grid.
        expected: usize,
    },
    /// Steps and exposure times must increase on each channel, steps to 2³²−1. Nothing was
    /// written.
    #[error(
        "recording `{path}`: step {step} at {exposure_ns} ns does not follow step {} at {} ns",
        last[0], last[1]
    )]
    Order {
        /// The file.
        path: PathBuf,
        /// The step that was refused.
        step: u64,
        /// Its exposure time, ns.
        exposure_ns: u64,
        /// Step and exposure time, ns, before it.
        last: [u64; 2],
    },
}

/// Why a recording, or one message of it, could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The system refused.
    #[error("reading recording `{path}`: {source}; give the path of an MCAP file")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file is of another kind.
    #[error("`{path}` is no MCAP file but {found}; give a file that Orime recorded")]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// What it looks like.
        found: &'static str,
    },
    /// The file is whole, but Orime did not record it, or another version did.
    #[error("`{path}` is an MCAP file, but {message}")]
    NotOurs {
        /// The file.
        path: PathBuf,
        /// What is missing or different, and what to do.
        message: String,
    },
    /// What a camera's frames need to be understood is missing or wrong.
    #[error("recording `{path}`, camera `{camera}`: {message}")]
    Calibration {
        /// The file.
        path: PathBuf,
        /// The camera's name.
        camera: String,
        /// What is wrong, and what to do.
        message: String,
    },
    /// The damage leaves nothing to play.
    #[error("recording `{path}` holds no readable frame: {loss}; record it again")]
    NothingLeft {
        /// The file.
        path: PathBuf,
        /// What is damaged.
        loss: Loss,
    },
    /// One message cannot be read; others can.
    #[error("recording `{path}`, step {step}, {what}: {message}")]
    Message {
        /// The file.
        path: PathBuf,
        /// The step's number.
        step: u64,
        /// The camera, or the kind of message.
        what: String,
        /// Why.
        message: String,
    },
}
