//! The calibration file of a set.

use std::io;
use std::path::{Path, PathBuf};

use orime_geometry::nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use orime_geometry::{CameraModel, RgbdCamera};
use serde::{Deserialize, Serialize};

use crate::depth::DepthCorrection;
use crate::{kalibr, ros};

/// Why a calibration cannot be used. A deployment fault: stop.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// The file is absent or unreadable.
    #[error("reading calibration `{path}`: {source}; `orime calibrate` writes one")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file is of no known form, or says what cannot be.
    #[error("calibration `{path}`: {message}")]
    Wrong {
        /// The file.
        path: PathBuf,
        /// What is wrong, with the key.
        message: String,
    },
}

/// A calibration: what of some cameras is known better than their source knows.
///
/// ```toml
/// [[camera]]
/// name = "cam1"           # as the source calls it
/// world_from_color = { translation_m = [-0.3, 0.1, 0.4], rotation_ijkw = [0.0, 0.8, 0.0, 0.6] }
/// depth = { bias_m = -0.004, scale = 1.0 }        # measured = scale · true + bias
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// The cameras, in any order.
    #[serde(default)]
    pub camera: Vec<CameraEntry>,
}

/// What is known of one camera.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraEntry {
    /// Name of the camera in its source.
    pub name: String,
    /// Maps colour-optical coordinates into the world. Default: the source's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world_from_color: Option<PoseEntry>,
    /// The colour lens. Default: the source's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color_lens: Option<LensEntry>,
    /// How depth errs. Default: it does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthEntry>,
}

/// A rigid motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseEntry {
    /// Metres.
    pub translation_m: [f64; 3],
    /// Unit quaternion, `i, j, k, w`.
    pub rotation_ijkw: [f64; 4],
}

/// One lens.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensEntry {
    /// Width and height.
    pub size_px: [u32; 2],
    /// Focal lengths.
    pub focal_px: [f64; 2],
    /// Principal point; pixel centres are integers.
    pub principal_px: [f64; 2],
    /// `k1, k2, p1, p2, k3`.
    #[serde(default)]
    pub distortion: [f64; 5],
}

/// How a camera's depth errs: measured = scale · true + bias.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthEntry {
    /// Metres, -0.1 to 0.1; negative where the camera reads short.
    pub bias_m: f64,
    /// 0.8 to 1.25.
    #[serde(default = "one")]
    pub scale: f64,
}

fn one() -> f64 {
    1.0
}

impl From<&Isometry3<f64>> for PoseEntry {
    fn from(pose: &Isometry3<f64>) -> Self {
        Self {
            translation_m: pose.translation.vector.into(),
            rotation_ijkw: pose.rotation.coords.into(),
        }
    }
}

impl PoseEntry {
    /// The motion, with its quaternion made a unit again; `None` if that is too far from one.
    pub fn isometry(&self) -> Option<Isometry3<f64>> {
        let [i, j, k, w] = self.rotation_ijkw;
        let rotation = Quaternion::new(w, i, j, k);
        let is_unit = (rotation.norm() - 1.0).abs() < 1e-3;
        let is_finite = self.translation_m.iter().all(|x| x.is_finite());
        (is_unit && is_finite).then(|| {
            let translation = Translation3::from(self.translation_m);
            Isometry3::from_parts(translation, UnitQuaternion::from_quaternion(rotation))
        })
    }
}

impl From<&CameraModel> for LensEntry {
    fn from(lens: &CameraModel) -> Self {
        Self {
            size_px: [lens.width, lens.height],
            focal_px: [lens.fx_px, lens.fy_px],
            principal_px: [lens.cx_px, lens.cy_px],
            distortion: lens.distortion,
        }
    }
}

impl From<&LensEntry> for CameraModel {
    fn from(lens: &LensEntry) -> Self {
        let LensEntry { size_px, focal_px, principal_px, distortion } = *lens;
        Self {
            width: size_px[0],
            height: size_px[1],
            fx_px: focal_px[0],
            fy_px: focal_px[1],
            cx_px: principal_px[0],
            cy_px: principal_px[1],
            distortion,
        }
    }
}

impl Calibration {
    /// Reads a calibration for `cameras`: this project's own TOML, Kalibr's camchain or ROS's
    /// camera_info (YAML). Cameras of a camchain have numbers for names: where none is one of the
    /// source's, they are taken in order.
    pub fn load(path: &Path, cameras: &[RgbdCamera]) -> Result<Self, CalibrationError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| CalibrationError::File { path: path.to_owned(), source })?;
        let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
        Self::parse(path, &text, &names)
            .map_err(|message| CalibrationError::Wrong { path: path.to_owned(), message })
    }

    fn parse(path: &Path, text: &str, names: &[&str]) -> Result<Self, String> {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if ending == "yaml" || ending == "yml" {
            return if ros::is_camera_info(text) {
                ros::import(text, names)
            } else {
                kalibr::import(text, names)
            };
        }
        toml::from_str(text).map_err(|error| error.to_string())
    }

    /// The text of the file, under a comment.
    pub fn to_text(&self, comment: &str) -> String {
        let head: String = comment.lines().map(|line| format!("# {line}\n")).collect();
        // Numbers and texts always have a form in TOML.
        format!("{head}\n{}", toml::to_string(self).unwrap_or_default())
    }

    /// Puts what is known into the source's cameras; how depth is to be corrected, per camera.
    ///
    /// `path` is for messages alone. Every camera of the source needs an entry: half a calibration
    /// is worse than none.
    pub fn apply(
        &self,
        path: &Path,
        cameras: &mut [RgbdCamera],
    ) -> Result<Vec<Option<DepthCorrection>>, CalibrationError> {
        let each = cameras.iter_mut().map(|camera| self.apply_to(camera));
        each.collect::<Result<_, String>>()
            .map_err(|message| CalibrationError::Wrong { path: path.to_owned(), message })
    }

    fn apply_to(&self, camera: &mut RgbdCamera) -> Result<Option<DepthCorrection>, String> {
        let name = &camera.name;
        let mut entries = self.camera.iter().filter(|entry| entry.name == *name);
        let (entry, more) = (entries.next(), entries.next());
        let Some(entry) = entry.filter(|_| more.is_none()) else {
            let count = if more.is_some() { "more than one" } else { "no" };
            return Err(format!(
                "has {count} [[camera]] `{name}`, as the source calls one of its cameras"
            ));
        };
        let CameraEntry { name: _, world_from_color, color_lens, depth } = entry;
        let pose = match world_from_color {
            Some(pose) => pose.isometry().ok_or_else(|| {
                format!("`rotation_ijkw` of `{name}` is no unit quaternion, or a number no number")
            })?,
            None => camera.world_from_color,
        };
        if let Some(lens) = color_lens {
            check_lens(lens, camera)?;
            let is_registered = camera.depth_is_registered();
            camera.color = lens.into();
            if is_registered {
                camera.depth = camera.color.clone();
            }
        }
        camera.world_from_color = pose;
        let Some(DepthEntry { bias_m, scale }) = *depth else { return Ok(None) };
        let holds = bias_m.abs() <= 0.1 && (0.8..=1.25).contains(&scale);
        if !holds {
            return Err(format!(
                "`depth` of `{name}` is a bias of {bias_m} m and a scale of {scale}: -0.1 to 0.1 \
                 and 0.8 to 1.25 are possible"
            ));
        }
        Ok(Some(DepthCorrection::new(camera, bias_m, scale)))
    }
}

fn check_lens(lens: &LensEntry, camera: &RgbdCamera) -> Result<(), String> {
    let (name, size) = (&camera.name, [camera.color.width, camera.color.height]);
    if lens.size_px != size {
        return Err(format!(
            "the lens of `{name}` is for {:?} pixels, its images have {size:?}: calibrate at the \
             resolution that is tracked",
            lens.size_px
        ));
    }
    let numbers = lens.focal_px.iter().chain(&lens.principal_px).chain(&lens.distortion);
    if lens.focal_px.iter().any(|f| *f <= 0.0) || numbers.clone().any(|x| !x.is_finite()) {
        return Err(format!("the lens of `{name}` has a focal length or number that cannot be"));
    }
    Ok(())
}
