//! From a checked config to a source.

use std::path::PathBuf;

use orime_geometry::SheetGrid;

use crate::calibrated::CalibratedSource;
use crate::folder::FolderSource;
use crate::preloaded::PreloadedSource;
use crate::realsense::RealsenseSource;
use crate::realsense_file::RealsenseFileSource;
use crate::recording::RecordingSource;
use crate::rendered::RenderedSource;
use crate::{CaptureConfig, FrameSource, SourceConfig};

/// Why a source could not be opened: a fault of the set or of the recording. Stop.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// The rendered scene cannot be built as the set describes it.
    #[error("{0}")]
    Scene(String),
    /// The recording or its layout file is at fault; the message lists every problem.
    #[error(transparent)]
    Recording(#[from] orime_recording::LayoutError),
    /// The MCAP file cannot be played.
    #[error(transparent)]
    File(#[from] orime_recording::ReadError),
    /// The RealSense SDK or a camera is not there.
    #[error(transparent)]
    Sdk(#[from] crate::SdkError),
    /// A recording of a RealSense camera cannot be played.
    #[error(transparent)]
    Realsense(#[from] orime_recording::RealsenseError),
    /// The calibration beside the source cannot be used.
    #[error(transparent)]
    Calibration(#[from] orime_calibration::CalibrationError),
    /// The MCAP file is damaged, and the set does not say that this is accepted.
    #[error(
        "recording `{path}` is damaged: {loss}; set `recording.damaged = true` to play what is left"
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is damaged.
        loss: orime_recording::Loss,
    },
}

/// Opens the source that `config` describes, for a sheet of `sheet`'s size.
pub fn open(config: &CaptureConfig, sheet: &SheetGrid) -> Result<Box<dyn FrameSource>, OpenError> {
    let source: Box<dyn FrameSource> = match &config.source {
        SourceConfig::Rendered(rendered) => {
            Box::new(RenderedSource::open(rendered, config.repeat, sheet)?)
        }
        SourceConfig::Folder(folder) => Box::new(FolderSource::open(folder, config.repeat)?),
        SourceConfig::Recording(recording) => {
            Box::new(RecordingSource::open(recording, config.repeat)?)
        }
        SourceConfig::Realsense(realsense) => Box::new(RealsenseSource::open(realsense)?),
        SourceConfig::RealsenseFile(files) => {
            Box::new(RealsenseFileSource::open(files, config.repeat)?)
        }
    };
    let source = CalibratedSource::over(source, &config.calibration)?;
    Ok(match config.preload_bytes {
        0 => source,
        room_bytes => PreloadedSource::over(source, room_bytes),
    })
}
