//! Recordings as MCAP files with Foxglove's schemas.
//!
//! | topic                                    | schema                                |
//! |------------------------------------------|---------------------------------------|
//! | `/camera/NAME/{color,depth}/image`       | `foxglove.RawImage`: `rgb8`, `16UC1`  |
//! | `/camera/NAME/{color,depth}/calibration` | `foxglove.CameraCalibration`          |
//! | `/camera/NAME/{color,depth}/transform`   | `foxglove.FrameTransform`             |
//! | `/cloud/observed`                        | `foxglove.PointCloud`                 |
//! | `/sheet/{estimate,truth}`                | `foxglove.SceneUpdate`, one entity    |
//!
//! Log and publish time of a message are its exposure, its sequence number is its step.
//! Images are stored without loss, chunks compressed by LZ4, so that a replay is bit for bit what
//! was recorded. [`Recorder`] writes, [`McapRecording`] reads.

mod camera_out;
mod cameras;
mod chunk;
mod error;
mod loss;
mod message;
mod pixels;
mod reader;
mod recorder;
mod scan;
mod schemas;
mod sink;
mod steps;
mod topic;
mod wire;

pub use error::{ReadError, RecordError};
pub use loss::Loss;
pub use reader::McapRecording;
pub use recorder::{Recorded, Recorder};

/// Whose idea of the sheet a recorded state is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SheetState {
    /// What the tracker thinks.
    Estimate,
    /// What the source knows.
    Truth,
}

impl SheetState {
    fn role(self) -> topic::Role {
        match self {
            SheetState::Estimate => topic::Role::Estimate,
            SheetState::Truth => topic::Role::Truth,
        }
    }
}
