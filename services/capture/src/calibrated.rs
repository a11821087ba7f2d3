//! A source seen through a calibration: poses and lenses replaced, depth corrected in place.

use std::path::PathBuf;

use orime_calibration::{Calibration, DepthCorrection};
use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid};
use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

use crate::source::{Advance, Losses};
use crate::{FrameError, FrameReport, FrameSource, Gripper, OpenError, PlannedFold};

/// What the target of `orime calibrate` is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TargetKind {
    /// All markers are fixed to one body (a board, a cube); how is found out.
    #[default]
    Rigid,
    /// Every marker lies where it lies in each frame set; only markers that several cameras see
    /// at once tell where the cameras stand.
    Free,
}

/// The `[capture.calibration]` section of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CalibrationParams {
    /// Path of a calibration: what `orime calibrate` wrote (TOML), Kalibr's camchain or ROS's
    /// camera_info (YAML). It replaces what the source says. Default: none.
    pub file: Option<String>,
    /// Whether depth is corrected for the bias and scale that the file states; costs a look-up a
    /// pixel. Corrected depth has units of 0.1 mm and ends at 6.55 m. Default true.
    pub correct_depth: bool,
    /// What `orime calibrate` looks for: `"rigid"` (default), markers on one body, or `"free"`.
    pub target: TargetKind,
    /// Dictionary of the markers, e.g. `"DICT_4X4_50"`. Default: none, and nothing to calibrate by.
    pub dictionary: String,
    /// Side of the markers' black squares, metres, 0.002 to 1. It sets the scale of everything:
    /// measure the print. Default 0.03.
    pub marker_m: f64,
    /// Most frame sets that `orime calibrate` looks at, evenly over the source, 2 to 5000.
    /// Default 500.
    pub frames_max: u64,
}

impl Default for CalibrationParams {
    fn default() -> Self {
        Self {
            file: None,
            correct_depth: true,
            target: TargetKind::Rigid,
            dictionary: String::new(),
            marker_m: 0.03,
            frames_max: 500,
        }
    }
}

/// A checked `[capture.calibration]` section.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationConfig {
    /// The calibration, if there is one.
    pub file: Option<PathBuf>,
    /// Whether depth is corrected.
    pub correct_depth: bool,
    /// The target of `orime calibrate`.
    pub target: TargetKind,
    /// Its dictionary; empty if it is not said.
    pub dictionary: String,
    /// Side of its markers, metres.
    pub marker_m: f64,
    /// Most frame sets looked at.
    pub frames_max: u64,
}

impl CalibrationParams {
    /// Checks the section; every problem at once. Whether the file exists shows on opening.
    pub fn check(&self) -> Result<CalibrationConfig, Vec<Problem>> {
        let Self { file, correct_depth, target, dictionary, marker_m, frames_max } = self;
        let mut checker = Checker::new();
        let empty = file.as_ref().is_some_and(String::is_empty);
        checker.require(!empty, "file", file, "must be the path of a calibration, or be left out");
        let unresolved = file.as_ref().is_some_and(|path| path.contains("${"));
        checker.require(!unresolved, "file", file, "holds a variable that nobody has replaced");
        let holds = (0.002..=1.0).contains(marker_m);
        checker.require(holds, "marker_m", marker_m, "must be 0.002 to 1 metres");
        let holds = (2..=5000).contains(frames_max);
        checker.require(holds, "frames_max", frames_max, "must be 2 to 5000");
        checker.finish(|| CalibrationConfig {
            file: file.as_ref().map(PathBuf::from),
            correct_depth: *correct_depth,
            target: *target,
            dictionary: dictionary.clone(),
            marker_m: *marker_m,
            frames_max: *frames_max,
        })
    }
}

/// The source; see the module.
pub(crate) struct CalibratedSource {
    inner: Box<dyn FrameSource>,
    cameras: Vec<RgbdCamera>,
    corrections: Vec<Option<DepthCorrection>>,
}

impl CalibratedSource {
    /// Puts the calibration of `config` over `inner`, where there is one.
    pub(crate) fn over(
        inner: Box<dyn FrameSource>,
        config: &CalibrationConfig,
    ) -> Result<Box<dyn FrameSource>, OpenError> {
        let Some(path) = &config.file else { return Ok(inner) };
        let mut cameras = inner.cameras().to_vec();
        let mut calibration = Calibration::load(path, &cameras)?;
        if !config.correct_depth {
            calibration.camera.iter_mut().for_each(|camera| camera.depth = None);
        }
        let corrections = calibration.apply(path, &mut cameras)?;
        Ok(Box::new(Self { inner, cameras, corrections }))
    }
}

impl FrameSource for CalibratedSource {
    fn cameras(&self) -> &[RgbdCamera] {
        &self.cameras
    }

    fn steps(&self) -> Option<u64> {
        self.inner.steps()
    }

    fn advance(&mut self, step: u64) -> Advance {
        self.inner.advance(step)
    }

    fn losses(&self) -> Losses {
        self.inner.losses()
    }

    fn exposure_ns(&self, step: u64, camera: usize) -> u64 {
        self.inner.exposure_ns(step, camera)
    }

    fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<FrameReport, FrameError> {
        let RgbdFrameMut { color_rgb, depth_units } = frame;
        let inside = RgbdFrameMut { color_rgb: &mut *color_rgb, depth_units: &mut *depth_units };
        let report = self.inner.read(step, camera, inside)?;
        if let Some(correction) = &self.corrections[camera] {
            correction.apply(depth_units);
        }
        Ok(report)
    }

    fn truth_m(&self, step: u64, sheet: &SheetGrid, nodes_m: &mut [[f32; 3]]) -> bool {
        self.inner.truth_m(step, sheet, nodes_m)
    }

    fn fold_plan(&self) -> Vec<PlannedFold> {
        self.inner.fold_plan()
    }

    fn tells_grippers(&self) -> bool {
        self.inner.tells_grippers()
    }

    fn grippers(&self, step: u64, out: &mut Vec<Gripper>) {
        self.inner.grippers(step, out);
    }
}
