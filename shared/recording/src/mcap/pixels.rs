//! The pixels of an image message, decompressed straight into a frame.

use super::chunk::{ChunkReader, Damage};
use super::message::PixelKind;
use super::wire::{Value, take_field, take_varint};

/// Longest image message beside its pixels, bytes.
const HEAD_BYTES_MAX: usize = 4096;
/// Key of `foxglove.RawImage.data`: field 6, bytes.
const DATA_KEY: u64 = 6 << 3 | 2;

/// Reads a `foxglove.RawImage` of `bytes` bytes, whose pixels stand last, into `pixels`.
pub(super) fn read_image(
    reader: &mut ChunkReader<'_>,
    bytes: u64,
    [width, height]: [u32; 2],
    kind: PixelKind,
    pixels: &mut [u8],
) -> Result<(), Damage> {
    let head_bytes = bytes.checked_sub(pixels.len() as u64).map(|head| head as usize);
    let Some(head_bytes) = head_bytes.filter(|head| *head <= HEAD_BYTES_MAX) else {
        return Err(format!("the image is not {width}×{height} {}", kind.encoding()).into());
    };
    let mut head = [0; HEAD_BYTES_MAX];
    let head = &mut head[..head_bytes];
    reader.fill(head)?;
    check_head(head, [width, height], kind, pixels.len()).map_err(|wrong| {
        format!("the image is not {width}×{height} {}: {wrong}", kind.encoding())
    })?;
    reader.fill(pixels)
}

fn check_head(
    mut head: &[u8],
    size_px: [u32; 2],
    kind: PixelKind,
    pixel_bytes: usize,
) -> Result<(), &'static str> {
    let (mut width, mut height, mut stride, mut encoding) = (0, 0, 0, "");
    loop {
        let mut after_key = head;
        if take_varint(&mut after_key).map_err(|wrong| wrong.0)? == DATA_KEY {
            let length = take_varint(&mut after_key).map_err(|wrong| wrong.0)?;
            if length != pixel_bytes as u64 || !after_key.is_empty() {
                return Err("its pixels do not end the message");
            }
            break;
        }
        let (tag, value) = take_field(&mut head).map_err(|wrong| wrong.0)?;
        let read = |value: Value<'_>| value.u32().map_err(|wrong| wrong.0);
        match tag {
            2 => width = read(value)?,
            3 => height = read(value)?,
            4 => encoding = value.string().map_err(|wrong| wrong.0)?,
            5 => stride = read(value)?,
            _ => {}
        }
    }
    if [width, height] != size_px || stride != size_px[0] * kind.bytes() {
        return Err("its size is another");
    }
    if encoding != kind.encoding() {
        return Err("its encoding is another");
    }
    Ok(())
}
