//! Opening a set's source before anything starts, and the key that a fault is to be mended at.

use std::error::Error;

use orime_capture::{CaptureParams, OpenError, SourceKind};
use orime_geometry::{RgbdCamera, SheetParams};
use orime_recording::ReadError;
use orime_runtime::{SetError, SetFile};

/// Why a set's source cannot be played.
#[derive(Debug)]
pub struct SourceFault {
    /// The key of the set that names it.
    pub key: &'static str,
    /// What is wrong and what would be right.
    pub message: String,
    /// Whether a recording is damaged, and nothing else is wrong.
    pub is_damage: bool,
}

/// Opens the source, so that a missing recording shows before anything starts: its cameras, and
/// its steps unless it is endless.
pub fn open(set: &SetFile) -> Result<(Vec<RgbdCamera>, Option<u64>), SourceFault> {
    let wrong = |error: SetError| fault("capture", error.to_string());
    let sheet = set.checked("sheet", SheetParams::check).map_err(wrong)?;
    let params: CaptureParams = set.section("capture").map_err(wrong)?;
    let config = set.checked("capture", CaptureParams::check).map_err(wrong)?;
    let source = orime_capture::open(&config, &sheet).map_err(|error| SourceFault {
        is_damage: is_damage(&error),
        ..fault(key_of(params.source), with_causes(&error))
    })?;
    let cameras = source.cameras();
    if cameras.is_empty() || cameras.len() > orime_messages::CAMERAS_MAX {
        let most = orime_messages::CAMERAS_MAX;
        let message = format!("the source has {} cameras: 1 to {most} are possible", cameras.len());
        return Err(fault(key_of(params.source), message));
    }
    Ok((cameras.to_vec(), source.steps()))
}

fn fault(key: &'static str, message: String) -> SourceFault {
    SourceFault { key, message, is_damage: false }
}

fn key_of(source: SourceKind) -> &'static str {
    match source {
        SourceKind::Rendered => "capture.rendered",
        SourceKind::Folder => "capture.folder.layout",
        SourceKind::Recording => "capture.recording.file",
        SourceKind::Realsense => "capture.realsense",
        SourceKind::Bag => "capture.bag.files",
        SourceKind::Db3 => "capture.db3.files",
    }
}

fn is_damage(error: &OpenError) -> bool {
    matches!(error, OpenError::Damaged { .. } | OpenError::File(ReadError::NothingLeft { .. }))
}

/// The error and its causes, each said once.
fn with_causes(error: &dyn Error) -> String {
    let mut message = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let text = error.to_string();
        if !message.contains(&text) {
            message.push_str(&format!(": {text}"));
        }
        cause = error.source();
    }
    message
}
