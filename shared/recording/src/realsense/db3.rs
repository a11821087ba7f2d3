//! `.db3`: rosbag2 on SQLite, as the SDK from 2.57 on writes it.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use rusqlite::{Connection, OpenFlags};

use super::bytes::{Bytes, camera_info};
use super::extrinsics::Extrinsics;
use super::pixels::Image;
use super::{Contents, FrameRef, Place, RealsenseError};

/// An opened database.
pub(super) struct Db3File {
    path: PathBuf,
    database: Connection,
}

/// Opens a database and lists what it holds.
pub(super) fn open(path: &Path) -> Result<(Db3File, Contents), RealsenseError> {
    // SQLite's own message for a missing file does not say that it is missing.
    std::fs::metadata(path)
        .map_err(|source| RealsenseError::File { path: path.to_owned(), source })?;
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let listed = Connection::open_with_flags(path, flags).and_then(|database| {
        let contents = list(&database)?;
        Ok((database, contents))
    });
    let (database, contents) = listed.map_err(|error| RealsenseError::Damaged {
        path: path.to_owned(),
        message: format!("is no rosbag2 database, or damaged: {error}"),
    })?;
    Ok((Db3File { path: path.to_owned(), database }, contents))
}

fn list(database: &Connection) -> rusqlite::Result<Contents> {
    let mut topics: HashMap<i64, String> = HashMap::new();
    let mut rows = database.prepare("SELECT id, name FROM topics")?;
    for row in rows.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))? {
        let (id, name) = row?;
        topics.insert(id, name);
    }
    let mut contents = Contents::new();
    // Images are left where they are; a frame's own words come right behind it.
    let mut rows = database.prepare(
        "SELECT m.id, m.topic_id, CASE WHEN t.type LIKE '%CompressedImage' OR t.type LIKE '%/Image'
         THEN NULL ELSE m.data END
         FROM messages m JOIN topics t ON t.id = m.topic_id ORDER BY m.id",
    )?;
    let mut rows = rows.query([])?;
    while let Some(row) = rows.next()? {
        let place = Place::Db3 { row: row.get(0)? };
        let Some(topic) = topics.get(&row.get(1)?) else { continue };
        let data: Option<Vec<u8>> = row.get(2)?;
        take(&mut contents, topic, data.as_deref(), place);
    }
    Ok(contents)
}

/// Takes what one message says; messages that cannot be read say nothing.
fn take(contents: &mut Contents, topic: &str, data: Option<&[u8]>, place: Place) -> Option<()> {
    if topic == "/device_0/info" {
        let words = words(data?)?;
        contents.info.extend(words.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())));
        return None;
    }
    if topic.starts_with("/device_0/sensor_") && topic.ends_with("/option/Depth_Units/value") {
        contents.depth_m_per_unit = text(data?)?.parse().ok();
        return None;
    }
    let (stream, what) = contents.stream(topic)?;
    match what {
        _ if what.starts_with("image/data") => {
            // Its number and its time are in the message that follows.
            stream.frames.push(FrameRef { time_ns: 0, number: 0, place });
        }
        "image/metadata" => {
            let words = words(data?)?;
            let word = |key: &str| words.iter().find(|(k, _)| *k == key).map(|(_, v)| *v);
            let time_ms: f64 = word("timestamp")?.parse().ok()?;
            let frame = stream.frames.last_mut()?;
            frame.time_ns = (time_ms * 1e6).round() as u64;
            frame.number = word("Frame number").and_then(|n| n.parse().ok()).unwrap_or(0);
        }
        // The lens in full precision; `camera_info` has six digits.
        "image/camera_info" if stream.lens.is_none() => {
            let mut bytes = Bytes::cdr(data?)?;
            header(&mut bytes)?;
            stream.lens = Some(camera_info(&mut bytes)?);
        }
        _ if what.starts_with("tf/ref_") => {
            let words = words(data?)?;
            let numbers = |key: &str| -> Option<Vec<f32>> {
                let (_, list) = words.iter().find(|(k, _)| *k == key)?;
                list.split(',').map(|n| n.trim().parse().ok()).collect()
            };
            stream.extrinsics = Some(Extrinsics {
                rotation: numbers("rotation")?.try_into().ok()?,
                translation_m: numbers("translation")?.try_into().ok()?,
            });
        }
        _ => {}
    }
    Some(())
}

/// The text of a `std_msgs/String`.
fn text(data: &[u8]) -> Option<&str> {
    Bytes::cdr(data)?.text()
}

/// `key=value;key=value` of a `std_msgs/String`.
fn words(data: &[u8]) -> Option<Vec<(&str, &str)>> {
    Some(text(data)?.split(';').filter_map(|pair| pair.split_once('=')).collect())
}

/// A header, of which nothing is needed.
fn header(bytes: &mut Bytes<'_>) -> Option<()> {
    let (_secs, _nanos) = (bytes.u32()?, bytes.u32()?);
    bytes.text().map(drop)
}

impl Db3File {
    /// Gives the image at `place` to `write`.
    pub fn image(
        &mut self,
        place: Place,
        write: &mut dyn FnMut(Image<'_>) -> Result<u32, String>,
    ) -> Result<u32, RealsenseError> {
        let Place::Db3 { row } = place else { return Ok(0) };
        let mut read = || -> Result<u32, String> {
            let sql = "SELECT data FROM messages WHERE id = ?1";
            let mut statement = self.database.prepare(sql).map_err(|error| error.to_string())?;
            let mut rows = statement.query([row]).map_err(|error| error.to_string())?;
            let found = rows.next().map_err(|error| error.to_string())?;
            let found = found.ok_or("a frame's message is not where it was")?;
            let data = found.get_ref(0).map_err(|error| error.to_string())?;
            let data = data.as_blob().map_err(|error| error.to_string())?;
            write(image(data).ok_or("a frame's message is cut off, or of an unknown form")?)
        };
        read().map_err(|message| RealsenseError::Damaged { path: self.path.clone(), message })
    }
}

/// First bytes of a PNG file.
const PNG: [u8; 8] = [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n'];
/// Bytes that compressed depth has before its PNG.
const DEPTH_HEAD: usize = 12;

/// A `sensor_msgs/CompressedImage`.
fn image(data: &[u8]) -> Option<Image<'_>> {
    let mut bytes = Bytes::cdr(data)?;
    header(&mut bytes)?;
    let _format = bytes.text()?;
    let all = bytes.sequence()?;
    let file = [Some(all), all.get(DEPTH_HEAD..)].into_iter().flatten();
    let file = file.into_iter().find(|data| data.starts_with(&PNG))?;
    Some(Image { encoding: "png", size_px: None, step: 0, data: file })
}
