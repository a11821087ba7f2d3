//! The `bag` and `db3` sources: RealSense recordings, read without the SDK. One file a camera.

use std::path::PathBuf;

use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid};
use orime_params::{Checker, Problem};
use orime_recording::RealsenseRecording;
use serde::{Deserialize, Serialize};

use crate::matching::{MatchedSet, SetMatcher};
use crate::playback::{After, Playback};
use crate::source::Losses;
use crate::{FrameError, FrameReport, FrameSource, OpenError};

/// The `[capture.bag]` or `[capture.db3]` section of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RealsenseFileParams {
    /// Paths of the recordings, one a camera. No default.
    pub files: Vec<String>,
    /// How far a depth and a colour frame of one camera may be apart, seconds, 0.0001 to 1.
    /// Default: one period of the slower stream.
    pub pair_s: Option<f64>,
    /// How far frames of one set may be apart between cameras, seconds, 0.0001 to 1. Default
    /// 0.017: half a period at 30 Hz.
    pub set_s: f64,
    /// `"clock"` (default): the cameras' stamps are of one clock (the SDK's global time).
    /// `"start"`: each camera has a clock of its own, and all recordings began at once.
    pub align: Align,
}

/// How clocks of several recordings go together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Align {
    /// They are one clock.
    #[default]
    Clock,
    /// All recordings began at once.
    Start,
}

impl Default for RealsenseFileParams {
    fn default() -> Self {
        Self { files: Vec::new(), pair_s: None, set_s: 0.017, align: Align::Clock }
    }
}

/// A checked section.
#[derive(Debug, Clone, PartialEq)]
pub struct RealsenseFileConfig {
    files: Vec<PathBuf>,
    pair_ns: Option<u64>,
    set_ns: u64,
    align: Align,
}

impl RealsenseFileParams {
    /// Checks the section; every problem at once. Whether the files exist shows on opening.
    pub fn check(&self) -> Result<RealsenseFileConfig, Vec<Problem>> {
        let Self { files, pair_s, set_s, align } = self;
        let mut checker = Checker::new();
        let named = !files.is_empty() && files.iter().all(|file| !file.is_empty());
        checker.require(named, "files", files, "must be the paths of recordings, one a camera");
        let unresolved = files.iter().any(|file| file.contains("${"));
        checker.require(!unresolved, "files", files, "holds a variable that nobody has replaced");
        let range = 0.0001..=1.0;
        let requirement = "must be 0.0001 to 1 seconds";
        let holds = pair_s.is_none_or(|s| range.contains(&s));
        checker.require(holds, "pair_s", pair_s, requirement);
        checker.require(range.contains(set_s), "set_s", set_s, requirement);
        let ns = |seconds: f64| (seconds * 1e9) as u64;
        checker.finish(|| RealsenseFileConfig {
            files: files.iter().map(PathBuf::from).collect(),
            pair_ns: pair_s.map(ns),
            set_ns: ns(*set_s),
            align: *align,
        })
    }
}

/// The source; see the module.
pub(crate) struct RealsenseFileSource {
    recordings: Vec<RealsenseRecording>,
    cameras: Vec<RgbdCamera>,
    /// Per set and camera: time and the recording's step.
    sets: Vec<MatchedSet<u64>>,
    /// Times of cameras that have no frame in a set: those of the set's first frame.
    opened_ns: Vec<u64>,
    playback: Playback,
    round_ns: u64,
    losses: Losses,
}

impl RealsenseFileSource {
    pub(crate) fn open(config: &RealsenseFileConfig, repeat: bool) -> Result<Self, OpenError> {
        let mut recordings = Vec::new();
        for file in &config.files {
            recordings.push(RealsenseRecording::open(file, config.pair_ns)?);
        }
        let mut matcher = SetMatcher::new(recordings.len(), config.set_ns, u64::MAX);
        let mut unmatched = 0;
        for (camera, recording) in recordings.iter().enumerate() {
            let begin_ns = match config.align {
                Align::Clock => 0,
                Align::Start => recording.exposure_ns(0),
            };
            for step in 0..recording.steps() {
                // From one period on, so that no stamp is zero.
                let time_ns = recording.exposure_ns(step) - begin_ns;
                matcher.push(camera, time_ns.max(1), step);
            }
            unmatched += recording.unpaired();
        }
        (0..recordings.len()).for_each(|camera| matcher.set_ended(camera, true));
        let sets: Vec<MatchedSet<u64>> = std::iter::from_fn(|| matcher.pop(0)).collect();
        let opened_ns: Vec<u64> = sets.iter().map(first_ns).collect();
        let span_ns = opened_ns.last().zip(opened_ns.first()).map_or(0, |(l, f)| l - f);
        let period_ns = span_ns / (sets.len() as u64 - 1).max(1);
        let after = if repeat { After::StartOver } else { After::End };
        Ok(Self {
            cameras: recordings.iter().map(|recording| recording.camera().clone()).collect(),
            recordings,
            playback: Playback { frames: sets.len() as u64, after },
            round_ns: span_ns + period_ns.max(config.set_ns),
            opened_ns,
            sets,
            losses: Losses { unmatched: unmatched + matcher.unmatched(), ..Losses::default() },
        })
    }
}

fn first_ns(set: &MatchedSet<u64>) -> u64 {
    set.iter().flatten().map(|(time_ns, _)| *time_ns).min().unwrap_or(0)
}

impl FrameSource for RealsenseFileSource {
    fn cameras(&self) -> &[RgbdCamera] {
        &self.cameras
    }

    fn steps(&self) -> Option<u64> {
        self.playback.steps()
    }

    fn losses(&self) -> Losses {
        self.losses
    }

    fn exposure_ns(&self, step: u64, camera: usize) -> u64 {
        let set = self.playback.frame(step) as usize;
        let own = self.sets[set][camera].map(|(time_ns, _)| time_ns);
        own.unwrap_or(self.opened_ns[set]) + self.playback.round(step) * self.round_ns
    }

    fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<FrameReport, FrameError> {
        let set = self.playback.frame(step) as usize;
        let Some((_, recorded)) = self.sets[set][camera] else {
            return Err(FrameError::Missing);
        };
        let copies = self.recordings[camera]
            .read(recorded, frame)
            .map_err(|error| FrameError::Unreadable(error.to_string()))?;
        Ok(FrameReport { copies })
    }

    fn truth_m(&self, _step: u64, _sheet: &SheetGrid, _nodes_m: &mut [[f32; 3]]) -> bool {
        false
    }
}
