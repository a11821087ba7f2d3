//! The layout file's format.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::LayoutError;
use super::numbers::Numbers;

/// A layout file (TOML): where the images of each camera lie, and where its calibration.
///
/// ```toml
/// root = "paper_desk"     # folder of everything below, relative to the data folder
/// rate_hz = 30.0          # nominal rate, where there are no time stamps
/// frames = { first = 0, last = 15, step = 1 }     # or a list: [0, 2, 4]
///
/// [[camera]]
/// name = "xtion"
/// color = "color_{frame:04}.jpg"      # {frame:04} is the frame number, padded to 4 digits
/// depth = "depth_{frame:04}.png"
/// depth_m_per_unit = 0.001
///
/// [camera.color_lens]
/// size_px = [640, 480]
/// k = { file = "calib.json", pointer = "/rgb/K" }
/// distortion = { file = "calib.json", pointer = "/rgb/dist" }
/// ```
///
/// Wherever numbers stand, a `{ file, pointer }` may stand instead: a JSON file under `root` and
/// a JSON pointer into it. Nested arrays are flattened, row by row.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FolderLayout {
    /// Folder of all files, relative to the data folder (or absolute). Default: that folder.
    #[serde(default)]
    pub root: PathBuf,
    /// Nominal frame rate, Hz, where there are no time stamps. Default 30.
    #[serde(default = "nominal_rate_hz")]
    pub rate_hz: f64,
    /// Frame numbers, in order of time.
    pub frames: FrameNumbers,
    /// The cameras, at least one; their order is the order of camera indices.
    #[serde(default)]
    pub camera: Vec<CameraLayout>,
}

fn nominal_rate_hz() -> f64 {
    30.0
}

/// Frame numbers: a range or a list.
#[derive(Debug, Clone, Deserialize)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = "expected { first, last, step } or a list of frame numbers"
)]
pub enum FrameNumbers {
    /// `first`, `first + step`, … up to `last` at most.
    Range {
        /// First number.
        first: u64,
        /// Last number, inclusive.
        last: u64,
        /// Distance between two, at least 1. Default 1.
        step: Option<u64>,
    },
    /// These.
    List(Vec<u64>),
}

/// One camera of a layout.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraLayout {
    /// Name for people, unique.
    pub name: String,
    /// Pattern of the colour images' paths under `root`: JPEG, or PNG of 8 bits.
    pub color: Pattern,
    /// Pattern of the depth images' paths under `root`: grey PNG of 16 bits, 0 = no return.
    pub depth: Pattern,
    /// Metres per unit of depth.
    pub depth_m_per_unit: Numbers,
    /// The colour lens.
    pub color_lens: LensLayout,
    /// The depth lens; left out where depth is registered to colour.
    pub depth_lens: Option<LensLayout>,
    /// Maps depth-optical coordinates into colour-optical ones; needs `depth_lens`.
    pub color_from_depth: Option<PoseLayout>,
    /// Maps colour-optical coordinates into the world. Default: the camera is the world.
    pub world_from_color: Option<PoseLayout>,
    /// Time stamps of the frames; without, `rate_hz` counts.
    pub exposure: Option<ExposureLayout>,
}

/// One lens: either `k` or all of `fx_px`, `fy_px`, `cx_px`, `cy_px`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensLayout {
    /// Width and height of the images.
    pub size_px: [u32; 2],
    /// Camera matrix, nine numbers row by row.
    pub k: Option<Numbers>,
    /// Horizontal focal length.
    pub fx_px: Option<Numbers>,
    /// Vertical focal length.
    pub fy_px: Option<Numbers>,
    /// Column of the principal point; pixel centres are integers.
    pub cx_px: Option<Numbers>,
    /// Row of the principal point.
    pub cy_px: Option<Numbers>,
    /// Brown–Conrady `k1, k2, p1, p2, k3` (four or five numbers). Default none.
    pub distortion: Option<Numbers>,
}

/// A rigid motion: `matrix`, or `rotation` with `translation_m`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseLayout {
    /// 4 × 4, sixteen numbers row by row, translation in metres.
    pub matrix: Option<Numbers>,
    /// 3 × 3, nine numbers row by row.
    pub rotation: Option<Numbers>,
    /// Three numbers, metres.
    pub translation_m: Option<Numbers>,
}

/// Where a camera's time stamps stand: a JSON list with one entry per frame.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExposureLayout {
    /// JSON file under `root`.
    pub file: PathBuf,
    /// Pointer to the list.
    pub list: String,
    /// Pointer, inside an entry, to its frame number.
    pub frame: String,
    /// Pointer, inside an entry, to its time.
    pub time: String,
    /// Unit of the times.
    pub unit: TimeUnit,
}

/// Units of time stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TimeUnit {
    /// Seconds.
    S,
    /// Milliseconds.
    Ms,
    /// Microseconds.
    Us,
    /// Nanoseconds.
    Ns,
}

impl TimeUnit {
    /// Nanoseconds per unit.
    pub fn ns(self) -> f64 {
        match self {
            Self::S => 1e9,
            Self::Ms => 1e6,
            Self::Us => 1e3,
            Self::Ns => 1.0,
        }
    }
}

/// A path with one frame number in it: `color_{frame:04}.jpg`, or `{frame}` without padding.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct Pattern {
    before: String,
    digits: usize,
    after: String,
}

impl TryFrom<String> for Pattern {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let wrong = || {
            format!("`{text}` must hold `{{frame}}` or, padded with zeros, `{{frame:04}}`, once")
        };
        let (before, rest) = text.split_once("{frame").ok_or_else(wrong)?;
        let (format, after) = rest.split_once('}').ok_or_else(wrong)?;
        let digits = match format.strip_prefix(":0") {
            Some(digits) => digits.parse().ok().filter(|n| (1..=12).contains(n)),
            None => format.is_empty().then_some(1),
        };
        let digits = digits.filter(|_| !after.contains('{') && !before.contains('{'));
        let digits = digits.ok_or_else(wrong)?;
        Ok(Self { before: before.to_owned(), digits, after: after.to_owned() })
    }
}

impl Pattern {
    /// The path of this frame number.
    pub fn path(&self, frame: u64) -> PathBuf {
        let Self { before, digits, after } = self;
        PathBuf::from(format!("{before}{frame:0digits$}{after}"))
    }
}

/// Most frames a layout may list.
const FRAMES_MAX: usize = 1_000_000;

impl FrameNumbers {
    /// The numbers, or what is wrong with them.
    pub fn list(&self) -> Result<Vec<u64>, String> {
        let numbers: Vec<u64> = match self {
            Self::Range { first, last, step } => {
                let step = step.unwrap_or(1);
                if step == 0 || last < first {
                    return Err(format!("{first} to {last} by {step} holds no frame"));
                }
                (*first..=*last).step_by(step as usize).take(FRAMES_MAX + 1).collect()
            }
            Self::List(numbers) => numbers.clone(),
        };
        match numbers.len() {
            0 => Err("is empty: list at least one frame".into()),
            n if n > FRAMES_MAX => Err(format!("holds more than {FRAMES_MAX} frames")),
            _ => Ok(numbers),
        }
    }
}

impl FolderLayout {
    /// Reads a layout file.
    pub fn load(path: &Path) -> Result<Self, LayoutError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| LayoutError::File { path: path.to_owned(), source })?;
        toml::from_str(&text).map_err(|error| LayoutError::Syntax {
            path: path.to_owned(),
            message: error.to_string(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_pad_and_are_checked() {
        let pattern = |text: &str| Pattern::try_from(text.to_owned());
        let padded = pattern("cam0/rgb_{frame:05}.jpg").unwrap();
        assert_eq!(padded.path(42), Path::new("cam0/rgb_00042.jpg"));
        assert_eq!(pattern("{frame}.png").unwrap().path(7), Path::new("7.png"));
        for wrong in ["plain.png", "{frame", "{frame:4}", "{frame:0x}", "{frame}{frame}"] {
            assert!(pattern(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn frame_numbers_are_listed_or_refused() {
        let range = |first, last, step| FrameNumbers::Range { first, last, step };
        assert_eq!(range(0, 5, Some(2)).list(), Ok(vec![0, 2, 4]));
        assert_eq!(FrameNumbers::List(vec![3, 1]).list(), Ok(vec![3, 1]));
        assert!(range(0, 5, Some(0)).list().is_err());
        assert!(range(5, 0, None).list().is_err());
        assert!(range(0, u64::MAX, None).list().is_err());
        assert!(FrameNumbers::List(vec![]).list().is_err());
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line() {
        let error = toml::from_str::<FolderLayout>("root = 'x'\nframes = [0]\nfps = 3\n");
        let message = error.unwrap_err().to_string();
        assert!(message.contains("fps") && message.contains("line 3"), "{message}");
    }
}
