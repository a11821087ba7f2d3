//! The `recording` source: frames of an MCAP file that Orime recorded, bit for bit.

use std::path::PathBuf;
use std::sync::Mutex;

use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid};
use orime_params::{Checker, Problem};
use orime_recording::{McapRecording, SheetState};
use serde::{Deserialize, Serialize};

use crate::playback::{After, Playback};
use crate::{FrameError, FrameReport, FrameSource, OpenError};

/// The `[capture.recording]` section of a set.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RecordingParams {
    /// Path of the MCAP file. No default.
    pub file: String,
    /// Whether a damaged or unfinished file is played as far as it reads, its lost frames being
    /// reported as unreadable. Default false: it is refused, and the loss named. Frames that were
    /// never recorded are unreadable too, but no damage.
    pub damaged: bool,
}

/// A checked `[capture.recording]` section.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingConfig {
    file: PathBuf,
    damaged: bool,
}

impl RecordingParams {
    /// Checks the section; every problem at once. Whether the file exists shows on opening.
    pub fn check(&self) -> Result<RecordingConfig, Vec<Problem>> {
        let Self { file, damaged } = self;
        let mut checker = Checker::new();
        checker.require(!file.is_empty(), "file", file, "must be the path of an MCAP file");
        let unresolved = file.contains("${");
        checker.require(!unresolved, "file", file, "holds a variable that nobody has replaced");
        checker.finish(|| RecordingConfig { file: PathBuf::from(file), damaged: *damaged })
    }
}

/// The source; see the module.
pub(crate) struct RecordingSource {
    cameras: Vec<RgbdCamera>,
    playback: Playback,
    round_ns: u64,
    /// Truth is asked for through a shared reference, and the file has one reading position.
    reader: Mutex<Reader>,
}

struct Reader {
    recording: McapRecording,
    /// Room for a recorded sheet state.
    nodes_m: Vec<[f32; 3]>,
}

impl RecordingSource {
    pub(crate) fn open(config: &RecordingConfig, repeat: bool) -> Result<Self, OpenError> {
        let recording = McapRecording::open(&config.file)?;
        if !config.damaged && recording.loss().is_damage() {
            return Err(OpenError::Damaged { path: config.file.clone(), loss: *recording.loss() });
        }
        let after = if repeat { After::StartOver } else { After::End };
        Ok(Self {
            cameras: recording.cameras().to_vec(),
            playback: Playback { frames: recording.steps(), after },
            round_ns: recording.round_ns(),
            reader: Mutex::new(Reader { recording, nodes_m: Vec::new() }),
        })
    }

    /// Nobody panics while holding the reader, and nothing in it can be half done.
    fn reader(&self) -> std::sync::MutexGuard<'_, Reader> {
        self.reader.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl FrameSource for RecordingSource {
    fn cameras(&self) -> &[RgbdCamera] {
        &self.cameras
    }

    fn steps(&self) -> Option<u64> {
        self.playback.steps()
    }

    fn exposure_ns(&self, step: u64, camera: usize) -> u64 {
        let in_round = self.reader().recording.exposure_ns(self.playback.frame(step), camera);
        in_round + self.playback.round(step) * self.round_ns
    }

    fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<FrameReport, FrameError> {
        let step = self.playback.frame(step);
        let reader = self.reader.get_mut().unwrap_or_else(std::sync::PoisonError::into_inner);
        reader
            .recording
            .read(step, camera, frame)
            .map_err(|error| FrameError::Unreadable(error.to_string()))?;
        Ok(FrameReport { copies: 0 })
    }

    fn truth_m(&self, step: u64, sheet: &SheetGrid, nodes_m: &mut [[f32; 3]]) -> bool {
        let mut reader = self.reader();
        let Reader { recording, nodes_m: recorded_m } = &mut *reader;
        let number = recording.step_number(self.playback.frame(step));
        let grid = recording.sheet(number, SheetState::Truth, recorded_m);
        // Truth on another grid is not truth on this one.
        let same = matches!(grid, Ok(Some(grid)) if grid == *sheet);
        if same && nodes_m.len() == recorded_m.len() {
            nodes_m.copy_from_slice(recorded_m);
            return true;
        }
        false
    }
}
