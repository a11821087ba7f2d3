//! `capture`: sources of RGB-D frames behind one trait, each writing its pixels in place.

mod calibrated;
mod folder;
mod matching;
mod open;
mod params;
mod playback;
mod preloaded;
mod realsense;
mod realsense_file;
mod recording;
mod rendered;
mod source;

pub use calibrated::{CalibrationConfig, CalibrationParams, TargetKind};
pub use folder::{FolderConfig, FolderParams};
pub use open::{OpenError, open};
pub use orime_origami::Gripper;
pub use params::{CaptureConfig, CaptureParams, SourceConfig, SourceKind};
pub use realsense::{LiveCameraParams, RealsenseConfig, RealsenseParams, SdkError};
pub use realsense_file::{Align, RealsenseFileConfig, RealsenseFileParams};
pub use recording::{RecordingConfig, RecordingParams};
pub use rendered::{
    FaultParams, FaultPreset, Model, Occluder, Printed, RenderedConfig, RenderedParams,
    SequenceKind, ViewParams, Viewpoints,
};
pub use source::{Advance, FrameError, FrameReport, FrameSource, Losses, PlannedFold};
