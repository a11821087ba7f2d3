//! From a checked config to a source.

use orime_geometry::SheetGrid;

use crate::folder::FolderSource;
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
}

/// Opens the source that `config` describes, for a sheet of `sheet`'s size.
pub fn open(config: &CaptureConfig, sheet: &SheetGrid) -> Result<Box<dyn FrameSource>, OpenError> {
    Ok(match &config.source {
        SourceConfig::Rendered(rendered) => {
            Box::new(RenderedSource::open(rendered, config.repeat, sheet)?)
        }
        SourceConfig::Folder(folder) => Box::new(FolderSource::open(folder, config.repeat)?),
    })
}
