//! Recordings of RealSense cameras, read without the SDK: `.bag` (rosbag v1, SDK up to 2.56) and
//! `.db3` (rosbag2 on SQLite, SDK 2.57 and later).
//!
//! A recording holds one device. Its depth and colour frames are paired by their own time stamps.
//! Extrinsics of a stream map points of the device's reference stream into it.

mod bag;
mod bytes;
mod db3;
mod extrinsics;
mod lens;
mod pair;
mod pixels;

use std::io;
use std::path::{Path, PathBuf};

use orime_geometry::{CameraModel, RgbdCamera, RgbdFrameMut};

pub use extrinsics::Extrinsics;
pub use lens::forward_distortion;

/// Why a recording of a RealSense camera cannot be played, or a frame of it not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RealsenseError {
    /// The file is absent or unreadable.
    #[error("reading recording `{path}`: {source}; give the path of a RealSense .bag or .db3 file")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file is damaged, or no RealSense recording.
    #[error("recording `{path}`: {message}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// The recording is whole, but lacks what is needed.
    #[error("recording `{path}` has no {what}: record depth and colour (`rs-record`, Viewer)")]
    Missing {
        /// The file.
        path: PathBuf,
        /// What is missing.
        what: String,
    },
}

/// One frame of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct FrameRef {
    /// Time stamp of the camera, nanoseconds.
    time_ns: u64,
    /// Number that the camera gave it.
    number: u64,
    /// Where its pixels lie.
    place: Place,
}

/// Where a message lies in its file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// Position of the chunk, and which record of it.
    Bag { chunk: u64, record: u32 },
    /// Row of the table `messages`.
    Db3 { row: i64 },
}

/// One stream of a device.
#[derive(Debug, Clone, PartialEq)]
struct Stream {
    lens: Option<CameraModel>,
    extrinsics: Option<Extrinsics>,
    frames: Vec<FrameRef>,
}

/// What a file says.
#[derive(Debug, Clone, PartialEq)]
struct Contents {
    /// `Name`, `Serial Number` and whatever else the camera says of itself.
    info: Vec<(String, String)>,
    depth_m_per_unit: Option<f32>,
    depth: Stream,
    color: Stream,
}

impl Stream {
    fn new() -> Self {
        Self { lens: None, extrinsics: None, frames: Vec::new() }
    }
}

impl Contents {
    fn new() -> Self {
        let (depth, color) = (Stream::new(), Stream::new());
        Self { info: Vec::new(), depth_m_per_unit: None, depth, color }
    }

    /// The stream that a topic is about, and the rest of the topic: the first depth and the first
    /// colour stream of the device count.
    fn stream<'t>(&mut self, topic: &'t str) -> Option<(&mut Stream, &'t str)> {
        let mut parts = topic.strip_prefix("/device_0/sensor_")?.splitn(3, '/');
        let (_, name, rest) = (parts.next()?, parts.next()?, parts.next()?);
        match name {
            "Depth_0" => Some((&mut self.depth, rest)),
            "Color_0" => Some((&mut self.color, rest)),
            _ => None,
        }
    }
}

enum File {
    Bag(bag::BagFile),
    Db3(db3::Db3File),
}

/// An opened recording.
pub struct RealsenseRecording {
    file: File,
    camera: RgbdCamera,
    info: Vec<(String, String)>,
    extrinsics: [Extrinsics; 2],
    /// Per step: depth and colour frame.
    pairs: Vec<[FrameRef; 2]>,
    unpaired: u64,
    period_ns: u64,
}

impl RealsenseRecording {
    /// Opens a recording; its camera is named after its serial number. Depth and colour frames
    /// that are at most `pair_ns` apart belong together; without, one nominal period.
    pub fn open(path: &Path, pair_ns: Option<u64>) -> Result<Self, RealsenseError> {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let (file, contents) = if ending == "db3" {
            let (file, contents) = db3::open(path)?;
            (File::Db3(file), contents)
        } else {
            let (file, contents) = bag::open(path)?;
            (File::Bag(file), contents)
        };
        let missing =
            |what: &str| RealsenseError::Missing { path: path.to_owned(), what: what.to_owned() };
        let Contents { info, depth_m_per_unit, depth, color } = contents;
        let depth_lens = depth.lens.ok_or_else(|| missing("depth stream"))?;
        let color_lens = color.lens.ok_or_else(|| missing("colour stream"))?;
        let paired = pair::pair(&depth.frames, &color.frames, pair_ns);
        if paired.pairs.is_empty() {
            return Err(missing("pair of a depth and a colour frame"));
        }
        let extrinsics =
            [depth.extrinsics, color.extrinsics].map(|e| e.unwrap_or(Extrinsics::IDENTITY));
        let depth_from_reference = extrinsics[0].isometry();
        let color_from_reference = extrinsics[1].isometry();
        let serial = info.iter().find(|(key, _)| key == "Serial Number");
        let camera = RgbdCamera {
            name: serial.map_or("realsense".to_owned(), |(_, serial)| serial.clone()),
            color: color_lens,
            depth: depth_lens,
            color_from_depth: color_from_reference * depth_from_reference.inverse(),
            world_from_color: Default::default(),
            depth_m_per_unit: f64::from(depth_m_per_unit.ok_or_else(|| missing("depth unit"))?),
        };
        let pair::Paired { pairs, unpaired, period_ns } = paired;
        Ok(Self { file, camera, info, extrinsics, pairs, unpaired, period_ns })
    }

    /// The camera; it is the world.
    pub fn camera(&self) -> &RgbdCamera {
        &self.camera
    }

    /// What the camera says of itself: `Name`, `Serial Number`, `Firmware Version`, …
    pub fn info(&self) -> &[(String, String)] {
        &self.info
    }

    /// Extrinsics of the depth and of the colour stream, as they stand in the file.
    pub fn extrinsics(&self) -> &[Extrinsics; 2] {
        &self.extrinsics
    }

    /// Number of pairs, at least 1.
    pub fn steps(&self) -> u64 {
        self.pairs.len() as u64
    }

    /// Frames that found no partner.
    pub fn unpaired(&self) -> u64 {
        self.unpaired
    }

    /// The depth frame's time stamp in the camera's clock, nanoseconds; strictly increasing.
    pub fn exposure_ns(&self, step: u64) -> u64 {
        self.pairs[step as usize][0].time_ns
    }

    /// Numbers that the camera gave the depth and the colour frame.
    pub fn frame_numbers(&self, step: u64) -> [u64; 2] {
        self.pairs[step as usize].map(|frame| frame.number)
    }

    /// How much later the recording starts over when it is repeated, nanoseconds.
    pub fn round_ns(&self) -> u64 {
        let [first, last] = [0, self.pairs.len() - 1].map(|k| self.pairs[k][0].time_ns);
        last - first + self.period_ns
    }

    /// Reads one pair in place; whole-image copies made on the way.
    pub fn read(&mut self, step: u64, frame: RgbdFrameMut<'_>) -> Result<u32, RealsenseError> {
        let [depth, color] = self.pairs[step as usize];
        let RgbdFrameMut { color_rgb, depth_units } = frame;
        let camera = &self.camera;
        let depth =
            pixels::Target::Depth(depth_units, &camera.depth).read(&mut self.file, depth)?;
        let color = pixels::Target::Color(color_rgb, &camera.color).read(&mut self.file, color)?;
        Ok(depth + color)
    }
}
