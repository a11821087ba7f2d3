//! `.bag`: rosbag v1, as the SDK up to 2.56 writes it.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use rosbag::{ChunkRecord, IndexRecord, MessageRecord, RosBag};

use super::bytes::{Bytes, camera_info};
use super::extrinsics::Extrinsics;
use super::pixels::Image;
use super::{Contents, FrameRef, Place, RealsenseError};

/// An opened bag.
pub(super) struct BagFile {
    path: PathBuf,
    bag: RosBag,
}

/// Opens a bag and lists what it holds.
pub(super) fn open(path: &Path) -> Result<(BagFile, Contents), RealsenseError> {
    let file = |source| RealsenseError::File { path: path.to_owned(), source };
    let damaged = |message: String| RealsenseError::Damaged { path: path.to_owned(), message };
    check_head(path)?;
    let bag = RosBag::new(path).map_err(file)?;
    let mut topics: HashMap<u32, String> = HashMap::new();
    let mut chunks = Vec::new();
    for record in bag.index_records() {
        match record.map_err(|error| damaged(format!("its index is damaged: {error}")))? {
            IndexRecord::Connection(c) => drop(topics.insert(c.id, c.storage_topic.to_owned())),
            IndexRecord::ChunkInfo(info) => chunks.push(info.chunk_pos),
            IndexRecord::IndexData(_) => {}
        }
    }
    let mut contents = Contents::new();
    for chunk in chunks {
        each_record(&bag, chunk, &mut |number, message| {
            if let MessageRecord::MessageData(message) = message
                && let Some(topic) = topics.get(&message.conn_id)
            {
                let place = Place::Bag { chunk, record: number };
                take(&mut contents, topic, message.data, place);
            }
            true
        })
        .map_err(|message| damaged(format!("{message}; repair it with `rosbag reindex`")))?;
    }
    Ok((BagFile { path: path.to_owned(), bag }, contents))
}

/// Checks what the reader takes for granted: a head whose index lies inside the file.
fn check_head(path: &Path) -> Result<(), RealsenseError> {
    let file = |source| RealsenseError::File { path: path.to_owned(), source };
    let wrong = |message: &str| RealsenseError::Damaged {
        path: path.to_owned(),
        message: message.to_owned(),
    };
    let length = std::fs::metadata(path).map_err(file)?.len();
    let mut head = Vec::new();
    let opened = std::fs::File::open(path).map_err(file)?;
    std::io::Read::read_to_end(&mut std::io::Read::take(opened, 4096), &mut head).map_err(file)?;
    if !head.starts_with(b"#ROSBAG V2.0\n") {
        return Err(wrong("is no bag: it does not begin with `#ROSBAG V2.0`"));
    }
    let key = b"index_pos=";
    let at = head.windows(key.len()).position(|window| window == key).map(|at| at + key.len());
    let index = at.and_then(|at| head.get(at..at + 8)?.try_into().ok()).map(u64::from_le_bytes);
    // The head's own record is padded to 4096 bytes behind the magic line.
    match index {
        Some(index) if (4096..=length).contains(&index) => Ok(()),
        _ => Err(wrong("was not closed, or is cut off: repair it with `rosbag reindex`")),
    }
}

/// Gives the records of one chunk to `sink` until it says `false`.
fn each_record(
    bag: &RosBag,
    chunk: u64,
    sink: &mut dyn FnMut(u32, MessageRecord<'_>) -> bool,
) -> Result<(), String> {
    let mut records = bag.chunk_records();
    records.seek(chunk).map_err(|error| format!("a chunk lies outside: {error}"))?;
    let chunk = match records.next() {
        Some(Ok(ChunkRecord::Chunk(chunk))) => chunk,
        Some(Err(error)) => return Err(format!("a chunk is damaged: {error}")),
        _ => return Err("its index points beside a chunk".to_owned()),
    };
    for (number, message) in chunk.messages().enumerate() {
        let message = message.map_err(|error| format!("a message is damaged: {error}"))?;
        if !sink(number as u32, message) {
            break;
        }
    }
    Ok(())
}

/// Takes what one message says; messages that cannot be read say nothing.
fn take(contents: &mut Contents, topic: &str, data: &[u8], place: Place) -> Option<()> {
    let mut bytes = Bytes::packed(data);
    if topic == "/device_0/info" {
        let pair = (bytes.text()?.to_owned(), bytes.text()?.to_owned());
        contents.info.push(pair);
        return None;
    }
    if topic.starts_with("/device_0/sensor_")
        && (topic.ends_with("/option/Depth Units/value")
            || topic.ends_with("/option/Depth_Units/value"))
    {
        contents.depth_m_per_unit = Some(bytes.f32()?);
        return None;
    }
    let (stream, what) = contents.stream(topic)?;
    match what {
        "info/camera_info" => {
            header(&mut bytes)?;
            stream.lens = Some(camera_info(&mut bytes)?);
        }
        "image/data" => {
            let [number, secs, nanos] = header(&mut bytes)?;
            let time_ns = u64::from(secs) * 1_000_000_000 + u64::from(nanos);
            stream.frames.push(FrameRef { time_ns, number: u64::from(number), place });
        }
        _ if what.starts_with("tf/") => {
            let (translation_m, quaternion) = (bytes.f64s::<3>()?, bytes.f64s::<4>()?);
            stream.extrinsics = Some(Extrinsics::from_quaternion(quaternion, translation_m));
        }
        _ => {}
    }
    Some(())
}

/// A header: number, seconds and nanoseconds.
fn header(bytes: &mut Bytes<'_>) -> Option<[u32; 3]> {
    let found = [bytes.u32()?, bytes.u32()?, bytes.u32()?];
    bytes.text()?;
    Some(found)
}

impl BagFile {
    /// Gives the image at `place` to `write`.
    pub fn image(
        &mut self,
        place: Place,
        write: &mut dyn FnMut(Image<'_>) -> Result<u32, String>,
    ) -> Result<u32, RealsenseError> {
        let Place::Bag { chunk, record } = place else { return Ok(0) };
        let mut result = Err("a frame's message is not where it was".to_owned());
        let walked = each_record(&self.bag, chunk, &mut |number, message| {
            if number != record {
                return true;
            }
            if let MessageRecord::MessageData(message) = message {
                let image = image(message.data).ok_or("a frame's message is cut off".to_owned());
                result = image.and_then(&mut *write);
            }
            false
        });
        walked
            .and(result)
            .map_err(|message| RealsenseError::Damaged { path: self.path.clone(), message })
    }
}

/// A `sensor_msgs/Image`.
fn image(data: &[u8]) -> Option<Image<'_>> {
    let mut bytes = Bytes::packed(data);
    header(&mut bytes)?;
    let (height, width) = (bytes.u32()?, bytes.u32()?);
    let encoding = bytes.text()?;
    let _is_bigendian = bytes.u8()?;
    let step = bytes.u32()? as usize;
    Some(Image { encoding, size_px: Some([width, height]), step, data: bytes.sequence()? })
}
