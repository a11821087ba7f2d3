//! What `orime check` warns of: cameras that can be started but cannot be right.

use orime_calibration::{doubts, doubts_of_depth};
use orime_capture::{CaptureParams, SourceKind};
use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetParams};

use crate::check::CheckedSet;

/// Doubts about the cameras of a set, by their calibration and by what they see first.
pub fn of(set: &CheckedSet) -> Vec<String> {
    let mut found = doubts(&set.cameras);
    if found.is_empty() {
        found.extend(first_depth(set).and_then(|depth| doubts_of_depth(&set.cameras, &depth)));
    }
    found
}

/// Depth images of the first frame set, empty where there is none. Live cameras are not waited
/// for.
fn first_depth(set: &CheckedSet) -> Option<Vec<Vec<u16>>> {
    let params: CaptureParams = set.file.section("capture").ok()?;
    if set.cameras.len() < 2 || params.source == SourceKind::Realsense {
        return None;
    }
    let sheet = set.file.checked("sheet", SheetParams::check).ok()?;
    let mut source = orime_capture::open(&params.check().ok()?, &sheet).ok()?;
    let read = |(index, camera): (usize, &RgbdCamera)| {
        let mut color_rgb = vec![0; 3 * camera.color.pixels()];
        let mut depth_units = vec![0; camera.depth.pixels()];
        let frame = RgbdFrameMut { color_rgb: &mut color_rgb, depth_units: &mut depth_units };
        source.read(0, index, frame).map_or(Vec::new(), |_| depth_units)
    };
    Some(set.cameras.iter().enumerate().map(read).collect())
}
