//! From the messages of a file to frame sets.

use std::collections::BTreeMap;

use super::scan::{Channel, Entry, Place};
use super::topic::Role;

/// Where one frame's images lie.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct FramePlace {
    pub(super) color: Option<Place>,
    pub(super) depth: Option<Place>,
    /// Exposure of the colour image, ns; estimated where the frame is lost.
    pub(super) exposure_ns: u64,
}

/// The frame sets of a recording, and what else it holds by step.
#[derive(Debug, Default)]
pub(super) struct Steps {
    /// The steps' own numbers, increasing: those of which at least one image is left.
    pub(super) numbers: Vec<u32>,
    /// Per step, per camera.
    pub(super) frames: Vec<Vec<FramePlace>>,
    pub(super) clouds: BTreeMap<u32, Place>,
    /// Estimates, truths.
    pub(super) sheets: [BTreeMap<u32, Place>; 2],
}

impl Steps {
    /// Sorts messages by step. The error says which message has no place.
    pub(super) fn of(
        entries: &[Entry],
        channels: &BTreeMap<u16, Channel>,
        cameras: usize,
    ) -> Result<Self, String> {
        let mut steps = Self::default();
        let mut frames: BTreeMap<u32, Vec<FramePlace>> = BTreeMap::new();
        for Entry { channel, step, time_ns, place } in entries {
            let Some(Channel { role, camera }) = channels.get(channel) else {
                continue;
            };
            let before = match (role, camera) {
                (Role::ColorImage | Role::DepthImage, Some((index, ..))) => {
                    let set =
                        frames.entry(*step).or_insert_with(|| vec![FramePlace::default(); cameras]);
                    if *role == Role::ColorImage {
                        set[*index].exposure_ns = *time_ns;
                        set[*index].color.replace(*place)
                    } else {
                        set[*index].depth.replace(*place)
                    }
                }
                (Role::Cloud, _) => steps.clouds.insert(*step, *place),
                (Role::Estimate, _) => steps.sheets[0].insert(*step, *place),
                (Role::Truth, _) => steps.sheets[1].insert(*step, *place),
                _ => None,
            };
            if before.is_some() {
                return Err(format!("step {step} stands twice on one of its topics"));
            }
        }
        (steps.numbers, steps.frames) = frames.into_iter().unzip();
        steps.estimate_exposures();
        steps.check_order(cameras)?;
        Ok(steps)
    }

    /// Gives frames that are lost a time between their neighbours'.
    fn estimate_exposures(&mut self) {
        for camera in 0..self.frames.first().map_or(0, Vec::len) {
            let mut earliest_ns = 0;
            for set in &mut self.frames {
                if set[camera].color.is_none() {
                    let seen = set.iter().filter(|frame| frame.color.is_some());
                    let set_ns = seen.map(|frame| frame.exposure_ns).min().unwrap_or(0);
                    set[camera].exposure_ns = set_ns.max(earliest_ns);
                }
                earliest_ns = set[camera].exposure_ns + 1;
            }
            let mut latest_ns = u64::MAX;
            for set in self.frames.iter_mut().rev() {
                if set[camera].color.is_none() {
                    set[camera].exposure_ns = set[camera].exposure_ns.min(latest_ns);
                }
                latest_ns = set[camera].exposure_ns.saturating_sub(1);
            }
        }
    }

    fn check_order(&self, cameras: usize) -> Result<(), String> {
        for camera in 0..cameras {
            let late = |pair: &[Vec<FramePlace>]| {
                pair[1][camera].exposure_ns <= pair[0][camera].exposure_ns
            };
            if let Some(k) = self.frames.windows(2).position(late) {
                let (before, after) = (self.numbers[k], self.numbers[k + 1]);
                return Err(format!("goes back in time from step {before} to step {after}"));
            }
        }
        Ok(())
    }

    /// Frames that are not whole.
    pub(super) fn frames_lost(&self) -> u64 {
        let frames = self.frames.iter().flatten();
        frames.filter(|frame| frame.color.is_none() || frame.depth.is_none()).count() as u64
    }

    /// From the first exposure to the last and one mean period, nanoseconds.
    pub(super) fn round_ns(&self) -> u64 {
        let times = |set: &Vec<FramePlace>| set.iter().map(|f| f.exposure_ns).collect::<Vec<_>>();
        let first = self.frames.first().and_then(|set| times(set).into_iter().min()).unwrap_or(0);
        let last = self.frames.last().and_then(|set| times(set).into_iter().max()).unwrap_or(0);
        let length_ns = last.saturating_sub(first);
        match self.frames.len() as u64 {
            0 | 1 => length_ns + 33_333_333, // A single step says nothing of the rate.
            steps => length_ns + (length_ns / (steps - 1)).max(1),
        }
    }
}
