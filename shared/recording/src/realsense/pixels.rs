//! Pixels of a recorded frame into a frame's buffers.

use std::io::Cursor;

use orime_geometry::CameraModel;

use super::{File, FrameRef, RealsenseError};

/// An image as its message holds it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Image<'a> {
    /// `mono16`, `rgb8`, …, or `png`.
    pub encoding: &'a str,
    /// Width and height; of a PNG they stand in the file.
    pub size_px: Option<[u32; 2]>,
    /// Bytes a row.
    pub step: usize,
    pub data: &'a [u8],
}

/// Where pixels go, and the lens they must fit.
pub(super) enum Target<'a> {
    Depth(&'a mut [u16], &'a CameraModel),
    Color(&'a mut [u8], &'a CameraModel),
}

impl Target<'_> {
    /// Reads one image; whole-image copies made on the way.
    pub fn read(self, file: &mut File, frame: FrameRef) -> Result<u32, RealsenseError> {
        let mut target = self;
        let mut write = |image: Image<'_>| target.write(image);
        match file {
            File::Bag(bag) => bag.image(frame.place, &mut write),
            File::Db3(db3) => db3.image(frame.place, &mut write),
        }
    }

    fn write(&mut self, image: Image<'_>) -> Result<u32, String> {
        let lens = match self {
            Self::Depth(_, lens) | Self::Color(_, lens) => *lens,
        };
        let expected = [lens.width, lens.height];
        if let Some(found) = image.size_px.filter(|found| *found != expected) {
            return Err(format!("a frame is {found:?} pixels, its lens {expected:?}"));
        }
        if image.encoding == "png" {
            return self.write_png(image.data, expected);
        }
        let [width, height] = expected.map(|n| n as usize);
        match self {
            Self::Depth(units, _) => depth(image, width, height, units)?,
            Self::Color(rgb, _) => color(image, width, height, rgb)?,
        }
        Ok(0)
    }

    fn write_png(&mut self, data: &[u8], expected: [u32; 2]) -> Result<u32, String> {
        let wrong = |error: png::DecodingError| format!("a frame's PNG is damaged: {error}");
        let mut reader = png::Decoder::new(Cursor::new(data)).read_info().map_err(wrong)?;
        let info = reader.info();
        let found = [info.width, info.height];
        let kind = (info.color_type, info.bit_depth);
        if found != expected {
            return Err(format!("a frame is {found:?} pixels, its lens {expected:?}"));
        }
        match (self, kind) {
            (Self::Color(rgb, _), (png::ColorType::Rgb, png::BitDepth::Eight)) => {
                reader.next_frame(rgb).map_err(wrong)?;
            }
            (Self::Depth(units, _), (png::ColorType::Grayscale, png::BitDepth::Sixteen)) => {
                reader.next_frame(bytemuck::cast_slice_mut(units)).map_err(wrong)?;
                units.iter_mut().for_each(|raw| *raw = u16::from_be(*raw));
            }
            (_, kind) => return Err(format!("a frame's PNG is of kind {kind:?}")),
        }
        Ok(0)
    }
}

/// The rows of an image of `width · bytes` bytes each, or why there are not enough.
fn rows<'a>(
    image: &Image<'a>,
    width: usize,
    height: usize,
    bytes: usize,
) -> Result<impl Iterator<Item = &'a [u8]>, String> {
    let (used, step) = (width * bytes, image.step);
    let needed = step * height.saturating_sub(1) + used;
    if step < used || image.data.len() < needed {
        let found = image.data.len();
        return Err(format!("a frame has {found} bytes in rows of {step}, {needed} are needed"));
    }
    Ok(image.data.chunks(step).take(height).map(move |row| &row[..used]))
}

fn depth(image: Image<'_>, width: usize, height: usize, units: &mut [u16]) -> Result<(), String> {
    if !["mono16", "16UC1", "Z16"].contains(&image.encoding) {
        return Err(format!("depth is encoded as `{}`: record Z16", image.encoding));
    }
    for (to, row) in units.chunks_exact_mut(width).zip(rows(&image, width, height, 2)?) {
        for (to, from) in to.iter_mut().zip(row.as_chunks::<2>().0) {
            *to = u16::from_le_bytes(*from);
        }
    }
    Ok(())
}

fn color(image: Image<'_>, width: usize, height: usize, rgb: &mut [u8]) -> Result<(), String> {
    let encoding = image.encoding.to_lowercase();
    let bytes = match encoding.as_str() {
        "rgb8" | "bgr8" => 3,
        "rgba8" | "bgra8" => 4,
        "yuv422" | "yuyv" | "yuv422_yuy2" => 2,
        _ => return Err(format!("colour is encoded as `{encoding}`: record RGB8, BGR8 or YUYV")),
    };
    for (to, row) in rgb.chunks_exact_mut(3 * width).zip(rows(&image, width, height, bytes)?) {
        match encoding.as_str() {
            "rgb8" => to.copy_from_slice(row),
            "yuv422" | "yuyv" | "yuv422_yuy2" => yuyv_row(row, to),
            _ => {
                let is_bgr = encoding.starts_with("bgr");
                for (to, from) in to.as_chunks_mut::<3>().0.iter_mut().zip(row.chunks(bytes)) {
                    *to = [from[0], from[1], from[2]];
                    if is_bgr {
                        to.reverse();
                    }
                }
            }
        }
    }
    Ok(())
}

/// ITU-R BT.601, studio range, in whole numbers as the SDK converts.
fn yuyv_row(row: &[u8], rgb: &mut [u8]) {
    for (pair, to) in row.as_chunks::<4>().0.iter().zip(rgb.as_chunks_mut::<6>().0) {
        let [y0, u, y1, v] = pair.map(i32::from);
        for (k, y) in [y0, y1].into_iter().enumerate() {
            let (c, d, e) = (298 * (y - 16), u - 128, v - 128);
            let byte = |value: i32| ((value + 128) >> 8).clamp(0, 255) as u8;
            to[3 * k] = byte(c + 409 * e);
            to[3 * k + 1] = byte(c - 100 * d - 208 * e);
            to[3 * k + 2] = byte(c + 516 * d);
        }
    }
}
