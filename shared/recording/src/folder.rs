//! RGB-D images in folders, described by a small layout file; see [`FolderLayout`].

mod calibration;
mod layout;
mod numbers;
mod times;

use std::fmt;
use std::path::{Path, PathBuf};

use orime_geometry::{RgbdCamera, RgbdFrameMut};
use orime_params::{Checker, Problem};

pub use layout::{
    CameraLayout, ExposureLayout, FolderLayout, FrameNumbers, LensLayout, Pattern, PoseLayout,
    TimeUnit,
};
pub use numbers::{JsonFiles, Numbers};

use crate::image::{ImageError, ImageReader};

/// Why a recording could not be opened: its layout file or its structure is at fault. Stop.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LayoutError {
    /// The layout file is absent or unreadable.
    #[error("reading layout file `{path}`: {source}; give the path of a layout file (TOML)")]
    File {
        /// The layout file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The layout file is not TOML, or has unknown, missing or mistyped keys.
    #[error("layout file `{path}`: {message}")]
    Syntax {
        /// The layout file.
        path: PathBuf,
        /// Line, column and cause.
        message: String,
    },
    /// What the layout file says does not fit what is on disk.
    #[error("layout file `{path}`:{}", Listed(.problems))]
    Wrong {
        /// The layout file.
        path: PathBuf,
        /// Every problem that was found.
        problems: Vec<Problem>,
    },
}

/// One problem per line.
struct Listed<'a>(&'a [Problem]);

impl fmt::Display for Listed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|problem| write!(f, "\n  {problem}"))
    }
}

/// An opened recording: cameras, times, and where each image lies.
#[derive(Debug)]
pub struct FolderRecording {
    cameras: Vec<RgbdCamera>,
    /// Per camera, per step: colour file and depth file.
    images: Vec<Vec<[PathBuf; 2]>>,
    /// Per camera, per step.
    exposures_ns: Vec<Vec<u64>>,
    round_ns: u64,
    reader: ImageReader,
}

impl FolderRecording {
    /// Opens the recording that the layout file describes. The layout's `root` is relative to
    /// `data_dir`, or to the layout file's own folder without it.
    pub fn open(layout: &Path, data_dir: Option<&Path>) -> Result<Self, LayoutError> {
        let described = FolderLayout::load(layout)?;
        let base = data_dir.or(layout.parent()).unwrap_or(Path::new(""));
        Self::build(&described, base)
            .map_err(|problems| LayoutError::Wrong { path: layout.to_owned(), problems })
    }

    /// Builds the recording of a layout whose `root` is relative to `base`.
    pub fn build(layout: &FolderLayout, base: &Path) -> Result<Self, Vec<Problem>> {
        let mut checker = Checker::new();
        let root = base.join(&layout.root);
        if !root.is_dir() {
            checker.problem(
                "root",
                format!("is `{}`, which is no folder: put the recording there", root.display()),
            );
            return Err(checker.finish(|| ()).err().unwrap_or_default());
        }
        let frames = layout.frames.list();
        let frames = frames.unwrap_or_else(|message| {
            checker.problem("frames", message);
            Vec::new()
        });
        let mut files = JsonFiles::new(root.clone());
        let mut reader = ImageReader::new();
        let mut cameras = Vec::new();
        let mut images = Vec::new();
        for (k, camera) in layout.camera.iter().enumerate() {
            let key = format!("camera[{k}]");
            if layout.camera[..k].iter().any(|other| other.name == camera.name) {
                checker.problem(&format!("{key}.name"), "must be unique");
            }
            let paths: Vec<[PathBuf; 2]> = frames
                .iter()
                .map(|frame| [&camera.color, &camera.depth].map(|p| root.join(p.path(*frame))))
                .collect();
            let rgbd = calibration::camera(camera, &mut files)
                .map_err(|problems| checker.nested(&key, problems))
                .ok();
            if let Some(rgbd) = &rgbd {
                let problems = check_sizes(rgbd, &paths, &mut reader);
                checker.nested(&key, problems);
            }
            cameras.extend(rgbd);
            images.push(paths);
        }
        checker.require(!layout.camera.is_empty(), "camera", 0, "at least one [[camera]]");
        let exposures = times::exposures_ns(layout, &frames, &mut files);
        let exposures_ns = exposures.unwrap_or_else(|problems| {
            for problem in problems {
                checker.problem(&problem.key, problem.message);
            }
            Vec::new()
        });
        checker.finish(|| Self {
            round_ns: times::round_ns(&exposures_ns, layout.rate_hz),
            cameras,
            images,
            exposures_ns,
            reader,
        })
    }

    /// The cameras, in the layout's order.
    pub fn cameras(&self) -> &[RgbdCamera] {
        &self.cameras
    }

    /// Number of frames of each camera, at least 1.
    pub fn steps(&self) -> u64 {
        self.images[0].len() as u64
    }

    /// Exposure time of a frame in the recording's clock, nanoseconds; strictly increasing over
    /// `step` for each camera.
    pub fn exposure_ns(&self, step: u64, camera: usize) -> u64 {
        self.exposures_ns[camera][step as usize]
    }

    /// How much later the recording starts over when it is repeated, nanoseconds: its length and
    /// one nominal period.
    pub fn round_ns(&self) -> u64 {
        self.round_ns
    }

    /// Reads one frame in place; the number of whole-image copies that took. A file that is
    /// missing or damaged spoils this frame alone.
    pub fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<u32, ImageError> {
        let RgbdCamera { color, depth, .. } = &self.cameras[camera];
        let [color_path, depth_path] = &self.images[camera][step as usize];
        let copies = self.reader.color(color_path, [color.width, color.height], frame.color_rgb)?;
        let size_px = [depth.width, depth.height];
        Ok(copies + self.reader.depth(depth_path, size_px, frame.depth_units)?)
    }
}

/// Compares the first colour and the first depth image that exist with the lenses.
fn check_sizes(
    camera: &RgbdCamera,
    paths: &[[PathBuf; 2]],
    reader: &mut ImageReader,
) -> Vec<Problem> {
    let mut checker = Checker::new();
    for (which, key, lens_key, lens) in [
        (0, "color", "color_lens.size_px", &camera.color),
        (1, "depth", "depth_lens.size_px", &camera.depth),
    ] {
        let Some(first) = paths.iter().map(|pair| &pair[which]).find(|path| path.is_file()) else {
            let example = paths.first().map(|pair| pair[which].display().to_string());
            checker.problem(
                key,
                format!("matches no file, e.g. `{}` is missing", example.unwrap_or_default()),
            );
            continue;
        };
        match reader.size_px(first) {
            Ok(found) => checker.require(
                found == [lens.width, lens.height],
                lens_key,
                [lens.width, lens.height],
                &format!("`{}` has {} × {} pixels", first.display(), found[0], found[1]),
            ),
            // A damaged first file is that frame's problem, not the recording's.
            Err(_) => continue,
        }
    }
    checker.finish(|| ()).err().unwrap_or_default()
}
