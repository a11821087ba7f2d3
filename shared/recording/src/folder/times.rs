//! When each frame of a recording was exposed.

use orime_params::{Checker, Problem};

use super::layout::{ExposureLayout, FolderLayout};
use super::numbers::JsonFiles;

/// Exposure times per camera and frame, nanoseconds, strictly increasing; every problem at once.
pub(super) fn exposures_ns(
    layout: &FolderLayout,
    frames: &[u64],
    files: &mut JsonFiles,
) -> Result<Vec<Vec<u64>>, Vec<Problem>> {
    let mut checker = Checker::new();
    let rate_hz = layout.rate_hz;
    let holds = (0.001..=1000.0).contains(&rate_hz);
    checker.require(holds, "rate_hz", rate_hz, "must be 0.001 to 1000");
    let mut all = Vec::new();
    for (k, camera) in layout.camera.iter().enumerate() {
        let times = match &camera.exposure {
            None => (0..frames.len()).map(|n| ((n + 1) as f64 * 1e9 / rate_hz) as u64).collect(),
            Some(exposure) => {
                let found = stamps_ns(exposure, frames, files).and_then(|times| {
                    match times.windows(2).position(|pair| pair[1] <= pair[0]) {
                        None => Ok(times),
                        Some(n) => Err(format!(
                            "goes back in time from frame {} to frame {}",
                            frames[n],
                            frames[n + 1]
                        )),
                    }
                });
                found.unwrap_or_else(|message| {
                    checker.problem(&format!("camera[{k}].exposure"), message);
                    Vec::new()
                })
            }
        };
        all.push(times);
    }
    checker.finish(|| all)
}

/// See [`super::FolderRecording::round_ns`].
pub(super) fn round_ns(exposures_ns: &[Vec<u64>], rate_hz: f64) -> u64 {
    let first = exposures_ns.iter().filter_map(|times| times.first()).min();
    let last = exposures_ns.iter().filter_map(|times| times.last()).max();
    match (first, last) {
        (Some(first), Some(last)) => last - first + (1e9 / rate_hz) as u64,
        _ => 0,
    }
}

fn stamps_ns(
    exposure: &ExposureLayout,
    frames: &[u64],
    files: &mut JsonFiles,
) -> Result<Vec<u64>, String> {
    let ExposureLayout { file, list, frame, time, unit } = exposure;
    let entries = files.value(file, list)?.as_array();
    let Some(entries) = entries else {
        return Err(format!("finds no list at `{list}` in `{}`", file.display()));
    };
    frames
        .iter()
        .map(|number| {
            let is_it = |entry: &&serde_json::Value| {
                entry.pointer(frame).and_then(serde_json::Value::as_u64) == Some(*number)
            };
            let stamp = entries.iter().find(is_it).and_then(|entry| entry.pointer(time)?.as_f64());
            let missing =
                || format!("finds no `{time}` for `{frame}` = {number} in `{}`", file.display());
            let ns = stamp.ok_or_else(missing)? * unit.ns();
            if (0.0..9e18).contains(&ns) {
                Ok(ns as u64)
            } else {
                Err(format!("holds {ns} ns for frame {number}, out of range"))
            }
        })
        .collect()
}
