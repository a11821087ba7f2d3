//! The `folder` source: RGB-D images in folders, described by a layout file.

use std::path::{Path, PathBuf};

use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid};
use orime_params::{Checker, Problem};
use orime_recording::FolderRecording;
use serde::{Deserialize, Serialize};

use crate::playback::{After, Playback};
use crate::{FrameError, FrameReport, FrameSource, OpenError};

/// The `[capture.folder]` section of a set.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FolderParams {
    /// Path of the layout file; see [`orime_recording::FolderLayout`] for its format. No default.
    pub layout: String,
    /// Folder that the layout's `root` is relative to. Default: the layout file's own folder.
    pub data_dir: Option<String>,
}

/// A checked `[capture.folder]` section.
#[derive(Debug, Clone, PartialEq)]
pub struct FolderConfig {
    layout: PathBuf,
    data_dir: Option<PathBuf>,
}

impl FolderParams {
    /// Checks the section; every problem at once. Whether the files exist shows on opening.
    pub fn check(&self) -> Result<FolderConfig, Vec<Problem>> {
        let Self { layout, data_dir } = self;
        let mut checker = Checker::new();
        checker.require(!layout.is_empty(), "layout", layout, "must be the path of a layout file");
        let empty = data_dir.as_ref().is_some_and(String::is_empty);
        checker.require(!empty, "data_dir", data_dir, "must be a folder, or be left out");
        for (key, path) in [("layout", Some(layout)), ("data_dir", data_dir.as_ref())] {
            checker.require(
                !path.is_some_and(|path| path.contains("${")),
                key,
                path,
                "holds a variable that nobody has replaced",
            );
        }
        checker.finish(|| FolderConfig {
            layout: PathBuf::from(layout),
            data_dir: data_dir.as_ref().map(PathBuf::from),
        })
    }
}

/// The source; see the module.
pub(crate) struct FolderSource {
    recording: FolderRecording,
    playback: Playback,
}

impl FolderSource {
    pub(crate) fn open(config: &FolderConfig, repeat: bool) -> Result<Self, OpenError> {
        let data_dir = config.data_dir.as_deref().map(Path::new);
        let recording = FolderRecording::open(&config.layout, data_dir)?;
        let after = if repeat { After::StartOver } else { After::End };
        let playback = Playback { frames: recording.steps(), after };
        Ok(Self { recording, playback })
    }
}

impl FrameSource for FolderSource {
    fn cameras(&self) -> &[RgbdCamera] {
        self.recording.cameras()
    }

    fn steps(&self) -> Option<u64> {
        self.playback.steps()
    }

    fn exposure_ns(&self, step: u64, camera: usize) -> u64 {
        let in_round = self.recording.exposure_ns(self.playback.frame(step), camera);
        in_round + self.playback.round(step) * self.recording.round_ns()
    }

    fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<FrameReport, FrameError> {
        let copies = self
            .recording
            .read(self.playback.frame(step), camera, frame)
            .map_err(|error| FrameError::Unreadable(error.to_string()))?;
        Ok(FrameReport { copies })
    }

    fn truth_m(&self, _step: u64, _sheet: &SheetGrid, _nodes_m: &mut [[f32; 3]]) -> bool {
        false
    }
}
