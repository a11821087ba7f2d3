//! The `[capture]` section of a set.

use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

use crate::calibrated::{CalibrationConfig, CalibrationParams};
use crate::folder::{FolderConfig, FolderParams};
use crate::realsense::{RealsenseConfig, RealsenseParams};
use crate::realsense_file::{RealsenseFileConfig, RealsenseFileParams};
use crate::recording::{RecordingConfig, RecordingParams};
use crate::rendered::{RenderedConfig, RenderedParams};

/// Where frames come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SourceKind {
    /// Virtual cameras that see a sheet being folded, with known truth.
    #[default]
    Rendered,
    /// Images in folders, described by a layout file.
    Folder,
    /// An MCAP file that Orime recorded.
    Recording,
    /// Live RealSense cameras.
    Realsense,
    /// Recordings of RealSense cameras by the SDK up to 2.56.
    Bag,
    /// Recordings of RealSense cameras by the SDK from 2.57 on.
    Db3,
}

/// The `[capture]` section of a set.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CaptureParams {
    /// `"rendered"` (default), `"folder"`, `"recording"`, `"realsense"`, `"bag"` or `"db3"`;
    /// only that source's section is checked.
    pub source: SourceKind,
    /// Frame sets per second to be published, 0 to 1000; 0 (default) means as fast as the set
    /// takes them. Exposure times stay the source's own.
    pub fps: f64,
    /// Whether the source goes on for ever: a rendered fold unfolds and folds again, a recording
    /// starts over. Default false.
    pub repeat: bool,
    /// Frame sets are read before the set begins, as many as fit into so many megabytes of memory,
    /// 0 (default) to 65 536: to measure the other stages without what decoding or rendering
    /// takes. Later ones are read when it is their turn. Not for live cameras.
    pub preload_mb: f64,
    /// The virtual scene.
    pub rendered: RenderedParams,
    /// Images in folders.
    pub folder: FolderParams,
    /// A recorded MCAP file.
    pub recording: RecordingParams,
    /// Live RealSense cameras.
    pub realsense: RealsenseParams,
    /// RealSense recordings of the SDK up to 2.56.
    pub bag: RealsenseFileParams,
    /// RealSense recordings of the SDK from 2.57 on.
    pub db3: RealsenseFileParams,
    /// Calibration of any source, and what `orime calibrate` looks for.
    pub calibration: CalibrationParams,
}

/// A checked `[capture]` section.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureConfig {
    /// Time between published frame sets, seconds; `None` means as fast as the set takes them.
    pub period_s: Option<f64>,
    /// Whether the source never ends.
    pub repeat: bool,
    /// Memory for frames that are read before the first is asked for, bytes.
    pub preload_bytes: usize,
    /// The source.
    pub source: SourceConfig,
    /// What is known of its cameras beside it.
    pub calibration: CalibrationConfig,
}

/// A checked source.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "there is one in a process")]
pub enum SourceConfig {
    /// See [`SourceKind::Rendered`].
    Rendered(RenderedConfig),
    /// See [`SourceKind::Folder`].
    Folder(FolderConfig),
    /// See [`SourceKind::Recording`].
    Recording(RecordingConfig),
    /// See [`SourceKind::Realsense`].
    Realsense(RealsenseConfig),
    /// See [`SourceKind::Bag`] and [`SourceKind::Db3`].
    RealsenseFile(RealsenseFileConfig),
}

impl CaptureConfig {
    /// Whether the source is a device, which one process alone can have open.
    pub fn is_device(&self) -> bool {
        matches!(self.source, SourceConfig::Realsense(_))
    }
}

impl CaptureParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<CaptureConfig, Vec<Problem>> {
        let Self {
            source,
            fps,
            repeat,
            preload_mb,
            rendered,
            folder,
            recording,
            realsense,
            bag,
            db3,
            calibration,
        } = self;
        let mut checker = Checker::new();
        checker.require(
            0.0 <= *fps && *fps <= 1000.0,
            "fps",
            fps,
            "must be 0 (as fast as the set takes frames) to 1000",
        );
        checker.require(
            0.0 <= *preload_mb && *preload_mb <= 65_536.0,
            "preload_mb",
            preload_mb,
            "must be 0 to 65536",
        );
        let is_live = *source == SourceKind::Realsense && *preload_mb > 0.0;
        checker.require(!is_live, "preload_mb", preload_mb, "must be 0 with live cameras");
        let (key, source) = match source {
            SourceKind::Rendered => ("rendered", rendered.check().map(SourceConfig::Rendered)),
            SourceKind::Folder => ("folder", folder.check().map(SourceConfig::Folder)),
            SourceKind::Recording => ("recording", recording.check().map(SourceConfig::Recording)),
            SourceKind::Realsense => ("realsense", realsense.check().map(SourceConfig::Realsense)),
            SourceKind::Bag => ("bag", bag.check().map(SourceConfig::RealsenseFile)),
            SourceKind::Db3 => ("db3", db3.check().map(SourceConfig::RealsenseFile)),
        };
        let source = source.map_err(|problems| checker.nested(key, problems)).ok();
        let calibration =
            calibration.check().map_err(|problems| checker.nested("calibration", problems)).ok();
        match (source, calibration) {
            (Some(source), Some(calibration)) => checker.finish(|| CaptureConfig {
                period_s: (*fps > 0.0).then(|| 1.0 / fps),
                repeat: *repeat,
                preload_bytes: (*preload_mb * 1e6) as usize,
                source,
                calibration,
            }),
            _ => Err(checker.finish(|| ()).err().unwrap_or_default()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documented_defaults_hold() {
        let config = CaptureParams::default().check().unwrap();
        assert_eq!(config.period_s, None);
        assert!(!config.repeat);
        assert!(matches!(config.source, SourceConfig::Rendered(_)));
    }

    #[test]
    fn only_the_chosen_source_is_checked_and_all_problems_come_at_once() {
        let mut params = CaptureParams { fps: f64::NAN, ..CaptureParams::default() };
        params.rendered.steps = Some(1);
        let keys = |params: &CaptureParams| -> Vec<String> {
            params.check().unwrap_err().into_iter().map(|p| p.key).collect()
        };
        assert_eq!(keys(&params), ["fps", "rendered.steps"]);
        params.source = SourceKind::Folder;
        assert_eq!(keys(&params), ["fps", "folder.layout"]);
        params.source = SourceKind::Recording;
        assert_eq!(keys(&params), ["fps", "recording.file"]);
        (params.source, params.preload_mb) = (SourceKind::Realsense, 1.0);
        assert!(keys(&params).contains(&"preload_mb".to_owned()));
    }
}
