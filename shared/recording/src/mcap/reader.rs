//! Reading a recording.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use orime_geometry::{ObservedPoint, RgbdCamera, RgbdFrameMut, SheetGrid};

use super::cameras::cameras;
use super::chunk::{ChunkReader, Damage, MessageHead, Next};
use super::message::{self, PixelKind};
use super::pixels::read_image;
use super::scan::{Channel, Place, Scan};
use super::steps::{FramePlace, Steps};
use super::topic::Role;
use super::wire::Malformed;
use super::{Loss, ReadError, SheetState};

/// An opened recording.
///
/// Opening reads the whole file once and compares every checksum. What is damaged is left out and
/// counted in [`Self::loss`]; what is left reads bit for bit, and is checked again when it is
/// read.
#[derive(Debug)]
pub struct McapRecording {
    path: PathBuf,
    file: File,
    set: Option<String>,
    cameras: Vec<RgbdCamera>,
    channels: BTreeMap<u16, Channel>,
    steps: Steps,
    loss: Loss,
    /// Room for one chunk as it lies in the file.
    body: Vec<u8>,
    /// Room for one message that is not an image.
    message: Vec<u8>,
}

impl McapRecording {
    /// Opens a recording; a damaged one too, as long as one frame is left.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let at_file = |source| ReadError::File { path: path.to_owned(), source };
        let mut file = File::open(path).map_err(at_file)?;
        check_magic(path, &mut file)?;
        let scan = Scan::of(&mut file).map_err(at_file)?;
        if let Some(format) = &scan.foreign_format {
            return Err(ReadError::NotOurs {
                path: path.to_owned(),
                message: format!(
                    "it was recorded in format {format} and this program reads format {}; read it \
                     with the Orime that recorded it",
                    super::topic::FORMAT
                ),
            });
        }
        if !scan.channels.values().any(|channel| channel.role == Role::ColorImage) {
            return Err(match scan.damage {
                Some(damage) => ReadError::NotOurs {
                    path: path.to_owned(),
                    message: format!("it holds no readable Orime channel: {damage}"),
                },
                None if !scan.loss.is_none() => {
                    ReadError::NothingLeft { path: path.to_owned(), loss: scan.loss }
                }
                None => ReadError::NotOurs {
                    path: path.to_owned(),
                    message: "it holds no channel that Orime recorded; record with \
                              `orime record`"
                        .into(),
                },
            });
        }
        Self::of_scan(path, file, scan)
    }

    fn of_scan(path: &Path, file: File, scan: Scan) -> Result<Self, ReadError> {
        let Scan { channels, entries, constants, changed, set, mut loss, .. } = scan;
        // Without one whole frame there is no calibration to miss either.
        if !entries.iter().any(|entry| is_image(&channels, entry.channel)) {
            return Err(ReadError::NothingLeft { path: path.to_owned(), loss });
        }
        let cameras = cameras(path, &channels, &constants)?;
        if let Some((channel, step)) = changed {
            let camera = channels.get(&channel).and_then(|channel| channel.camera.as_ref());
            return Err(ReadError::Calibration {
                path: path.to_owned(),
                camera: camera.map(|(_, name, _)| name.clone()).unwrap_or_default(),
                message: format!(
                    "its calibration changes at step {step}; record again with cameras that stay"
                ),
            });
        }
        let steps = Steps::of(&entries, &channels, cameras.len())
            .map_err(|message| ReadError::NotOurs { path: path.to_owned(), message })?;
        loss.frames = steps.frames_lost();
        let path = path.to_owned();
        let (body, message) = (Vec::new(), Vec::new());
        Ok(Self { path, file, set, cameras, channels, steps, loss, body, message })
    }

    /// The cameras, in the order in which they were recorded.
    pub fn cameras(&self) -> &[RgbdCamera] {
        &self.cameras
    }

    /// Name of the set that was recorded, where it is legible.
    pub fn set(&self) -> Option<&str> {
        self.set.as_deref()
    }

    /// What is damaged or missing.
    pub fn loss(&self) -> &Loss {
        &self.loss
    }

    /// Number of frame sets, at least 1.
    pub fn steps(&self) -> u64 {
        self.steps.numbers.len() as u64
    }

    /// The number that frame set `step` was recorded under; strictly increasing.
    pub fn step_number(&self, step: u64) -> u64 {
        u64::from(self.steps.numbers[step as usize])
    }

    /// Exposure time of a frame in the recorded clock, nanoseconds; strictly increasing over
    /// `step` for each camera.
    pub fn exposure_ns(&self, step: u64, camera: usize) -> u64 {
        self.steps.frames[step as usize][camera].exposure_ns
    }

    /// How much later the recording starts over when it is repeated, nanoseconds: its length and
    /// one mean period.
    pub fn round_ns(&self) -> u64 {
        self.steps.round_ns()
    }

    /// Decompresses one frame straight into the given buffers, without another copy. On an error
    /// their contents are unspecified, and the other frames live.
    pub fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<(), ReadError> {
        let RgbdFrameMut { color_rgb, depth_units } = frame;
        let FramePlace { color, depth, .. } = self.steps.frames[step as usize][camera];
        let mut parts = [
            (Role::ColorImage, Some(color_rgb)),
            (Role::DepthImage, Some(bytemuck::cast_slice_mut(depth_units))),
        ];
        let read = match (color, depth) {
            (Some(color), Some(depth)) => self.read_parts(step, camera, color, depth, &mut parts),
            _ => Err("the frame is not in the file: it was lost or never recorded".into()),
        };
        read.map_err(|message| {
            let what = format!("camera `{}`", self.cameras[camera].name);
            self.wrong(self.step_number(step), what, message)
        })
    }

    /// Reads an observed cloud by its step's *number*; `false` where none was recorded. `points`
    /// is cleared first.
    pub fn cloud(
        &mut self,
        number: u64,
        points: &mut Vec<ObservedPoint>,
    ) -> Result<bool, ReadError> {
        points.clear();
        let place = u32::try_from(number).ok().and_then(|n| self.steps.clouds.get(&n).copied());
        let Some(place) = place else {
            return Ok(false);
        };
        self.read_message(number, Role::Cloud, place)
            .and_then(|()| message::read_cloud(&self.message, points).map_err(said))
            .map_err(|message| self.wrong(number, "cloud".into(), message))?;
        Ok(true)
    }

    /// Reads where the sheet's nodes are, world frame, metres, by its step's *number*; the grid
    /// that they belong to, or `None` where none was recorded. `nodes_m` is cleared first.
    pub fn sheet(
        &mut self,
        number: u64,
        state: SheetState,
        nodes_m: &mut Vec<[f32; 3]>,
    ) -> Result<Option<SheetGrid>, ReadError> {
        nodes_m.clear();
        let places = &self.steps.sheets[state as usize];
        let place = u32::try_from(number).ok().and_then(|n| places.get(&n).copied());
        let Some(place) = place else {
            return Ok(None);
        };
        self.read_message(number, state.role(), place)
            .and_then(|()| message::read_sheet(&self.message, nodes_m).map_err(said))
            .map(Some)
            .map_err(|message| self.wrong(number, "sheet".into(), message))
    }

    fn wrong(&self, step: u64, what: String, message: Damage) -> ReadError {
        ReadError::Message {
            path: self.path.clone(),
            step,
            what,
            message: format!("{message}; the file changed or its disk fails"),
        }
    }

    fn read_parts(
        &mut self,
        step: u64,
        camera: usize,
        color: Place,
        depth: Place,
        parts: &mut [(Role, Option<&mut [u8]>); 2],
    ) -> Result<(), Damage> {
        let number = self.steps.numbers[step as usize];
        let RgbdCamera { color: color_lens, depth: depth_lens, .. } = &self.cameras[camera];
        let sizes = [color_lens, depth_lens].map(|lens| [lens.width, lens.height]);
        let places = [color, depth];
        for place in &places[..if color == depth { 1 } else { 2 }] {
            load(&mut self.file, *place, &mut self.body)?;
            let mut reader = ChunkReader::new(&self.body)?;
            while let Some(next) = reader.next()? {
                let head = match next {
                    Next::Other(_, bytes) => {
                        reader.skip(bytes)?;
                        continue;
                    }
                    Next::Message(head) => head,
                };
                let wanted = (0..2).find(|k| {
                    let (role, pixels) = &parts[*k];
                    pixels.is_some() && is_it(&self.channels, head, *role, Some(camera), number)
                });
                let Some(k) = wanted else {
                    reader.skip(head.bytes)?;
                    continue;
                };
                let kind = [PixelKind::Rgb8, PixelKind::Depth16][k];
                if let Some(pixels) = parts[k].1.take() {
                    read_image(&mut reader, head.bytes, sizes[k], kind, pixels)?;
                }
            }
            reader.finish()?;
        }
        if parts.iter().any(|(_, pixels)| pixels.is_some()) {
            return Err("an image is no longer where it was".into());
        }
        Ok(())
    }

    /// Brings the message of this role and step from a chunk to `self.message`.
    fn read_message(&mut self, number: u64, role: Role, place: Place) -> Result<(), Damage> {
        load(&mut self.file, place, &mut self.body)?;
        let mut reader = ChunkReader::new(&self.body)?;
        let mut found = false;
        while let Some(next) = reader.next()? {
            match next {
                Next::Message(head)
                    if !found && is_it(&self.channels, head, role, None, number as u32) =>
                {
                    reader.fill_vec(head.bytes, &mut self.message)?;
                    found = true;
                }
                Next::Message(MessageHead { bytes, .. }) | Next::Other(_, bytes) => {
                    reader.skip(bytes)?;
                }
            }
        }
        reader.finish()?;
        if found { Ok(()) } else { Err("the message is no longer where it was".into()) }
    }
}

fn said(wrong: Malformed) -> Damage {
    wrong.0.into()
}

fn is_image(channels: &BTreeMap<u16, Channel>, channel: u16) -> bool {
    channels
        .get(&channel)
        .is_some_and(|channel| matches!(channel.role, Role::ColorImage | Role::DepthImage))
}

fn is_it(
    channels: &BTreeMap<u16, Channel>,
    head: MessageHead,
    role: Role,
    camera: Option<usize>,
    number: u32,
) -> bool {
    head.sequence == number
        && channels.get(&head.channel).is_some_and(|channel| {
            let index = channel.camera.as_ref().map(|(index, ..)| *index);
            channel.role == role && index == camera
        })
}

/// Brings a chunk's record to memory.
fn load(file: &mut File, place: Place, body: &mut Vec<u8>) -> Result<(), Damage> {
    body.resize(place.bytes as usize, 0);
    file.seek(SeekFrom::Start(place.offset))
        .and_then(|_| file.read_exact(body))
        .map_err(|error| error.to_string().into())
}

/// Refuses files of other kinds.
fn check_magic(path: &Path, file: &mut File) -> Result<(), ReadError> {
    let mut start = Vec::new();
    let at_file = |source: io::Error| ReadError::File { path: path.to_owned(), source };
    file.take(16).read_to_end(&mut start).map_err(at_file)?;
    let found = match &start[..] {
        [] => "an empty one",
        start if start.starts_with(::mcap::MAGIC) => return Ok(()),
        start if ::mcap::MAGIC.starts_with(start) => "the first few bytes of one",
        start if start.starts_with(b"#ROSBAG") => "a ROS 1 bag",
        start if start.starts_with(b"SQLite format 3") => "an SQLite database (a ROS 2 bag?)",
        start if start.starts_with(b"RRF") => "a rerun recording",
        [0x89, b'P', b'N', b'G', ..] => "a PNG image",
        _ => "something else",
    };
    Err(ReadError::NotMcap { path: path.to_owned(), found })
}
