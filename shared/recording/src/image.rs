//! JPEG and PNG files, decoded straight into a frame's buffers.

use std::fs::File;
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Why an image could not be read; always names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The file is absent or unreadable.
    #[error("reading image `{path}`: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file is no whole image: truncated, damaged, or of another format.
    #[error("image `{path}` is damaged or truncated: {message}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        message: String,
    },
    /// The image is whole, but not what the camera promises.
    #[error("image `{path}` is {found}, expected {expected}")]
    Unexpected {
        /// The file.
        path: PathBuf,
        /// Size and kind found.
        found: String,
        /// Size and kind wanted.
        expected: String,
    },
}

/// Reads images one after the other; keeps the room for a file's bytes between them.
///
/// PNG checksums are checked. JPEG has none: a file that ends early is always reported, a flipped
/// byte inside only where it breaks the code.
#[derive(Debug, Default)]
pub struct ImageReader {
    file: Vec<u8>,
    scratch: Vec<u8>,
}

const PNG_MAGIC: [u8; 4] = [0x89, b'P', b'N', b'G'];
const JPEG_MAGIC: [u8; 2] = [0xff, 0xd8];
const JPEG_END: [u8; 2] = [0xff, 0xd9];

/// Bytes that cameras append after a JPEG's end, at most.
const JPEG_TAIL_MAX: usize = 1024;

impl ImageReader {
    /// A reader without room yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Width and height of an image, from its head alone.
    pub fn size_px(&mut self, path: &Path) -> Result<[u32; 2], ImageError> {
        self.load(path)?;
        if self.file.starts_with(&PNG_MAGIC) {
            let reader = png::Decoder::new(Cursor::new(&self.file))
                .read_info()
                .map_err(|error| damaged(path, error))?;
            return Ok([reader.info().width, reader.info().height]);
        }
        let mut decoder = jpeg(&self.file, path)?;
        decoder.decode_headers().map_err(|error| damaged(path, error))?;
        let info = decoder.info().ok_or_else(|| damaged(path, "no frame header"))?;
        Ok([u32::from(info.width), u32::from(info.height)])
    }

    /// Decodes a JPEG, or a PNG of 8 bits, into row-major `r, g, b` bytes.
    ///
    /// Returns the number of whole-image copies: 0 for JPEG and RGB PNG, which are decoded in
    /// place; 1 for a PNG that is grey or has an alpha channel (which is dropped).
    pub fn color(
        &mut self,
        path: &Path,
        size_px: [u32; 2],
        rgb: &mut [u8],
    ) -> Result<u32, ImageError> {
        self.load(path)?;
        if self.file.starts_with(&PNG_MAGIC) {
            return self.color_png(path, size_px, rgb);
        }
        let mut decoder = jpeg(&self.file, path)?;
        decoder.decode_headers().map_err(|error| damaged(path, error))?;
        let info = decoder.info().ok_or_else(|| damaged(path, "no frame header"))?;
        let found = [u32::from(info.width), u32::from(info.height)];
        if found != size_px || decoder.output_buffer_size() != Some(rgb.len()) {
            return Err(unexpected(path, found, "JPEG", size_px, "colour"));
        }
        // Decoders are lenient with a missing end and leave the rest grey.
        let tail = &self.file[self.file.len().saturating_sub(JPEG_TAIL_MAX)..];
        if !tail.windows(2).any(|bytes| bytes == JPEG_END) {
            return Err(damaged(path, "the file ends before the image does"));
        }
        decoder.decode_into(rgb).map_err(|error| damaged(path, error))?;
        Ok(0)
    }

    /// Decodes a grey PNG of 16 bits into row-major depth values, in place.
    pub fn depth(
        &mut self,
        path: &Path,
        size_px: [u32; 2],
        units: &mut [u16],
    ) -> Result<u32, ImageError> {
        self.load(path)?;
        let mut reader = png::Decoder::new(Cursor::new(&self.file))
            .read_info()
            .map_err(|error| damaged(path, error))?;
        let found = [reader.info().width, reader.info().height];
        let kind = reader.output_color_type();
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(units);
        if found != size_px
            || kind != (ColorType::Grayscale, BitDepth::Sixteen)
            || reader.output_buffer_size() != Some(bytes.len())
        {
            return Err(unexpected(path, found, kind, size_px, "16-bit grey"));
        }
        reader.next_frame(bytes).map_err(|error| damaged(path, error))?;
        reader.finish().map_err(|error| damaged(path, error))?;
        // PNG is big-endian.
        units.iter_mut().for_each(|unit| *unit = u16::from_be(*unit));
        Ok(0)
    }

    fn color_png(
        &mut self,
        path: &Path,
        size_px: [u32; 2],
        rgb: &mut [u8],
    ) -> Result<u32, ImageError> {
        let mut decoder = png::Decoder::new(Cursor::new(&self.file));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().map_err(|error| damaged(path, error))?;
        let found = [reader.info().width, reader.info().height];
        let kind = reader.output_color_type();
        let channels = match kind {
            (ColorType::Rgb, BitDepth::Eight) => 3,
            (ColorType::Rgba, BitDepth::Eight) => 4,
            (ColorType::Grayscale, BitDepth::Eight) => 1,
            (ColorType::GrayscaleAlpha, BitDepth::Eight) => 2,
            _ => return Err(unexpected(path, found, kind, size_px, "8-bit colour")),
        };
        if found != size_px || reader.output_buffer_size() != Some(rgb.len() / 3 * channels) {
            return Err(unexpected(path, found, kind, size_px, "8-bit colour"));
        }
        if channels == 3 {
            reader.next_frame(rgb).map_err(|error| damaged(path, error))?;
            reader.finish().map_err(|error| damaged(path, error))?;
            return Ok(0);
        }
        self.scratch.resize(rgb.len() / 3 * channels, 0);
        reader.next_frame(&mut self.scratch).map_err(|error| damaged(path, error))?;
        reader.finish().map_err(|error| damaged(path, error))?;
        for (out, pixel) in rgb.chunks_exact_mut(3).zip(self.scratch.chunks_exact(channels)) {
            match pixel {
                [r, g, b, _] => out.copy_from_slice(&[*r, *g, *b]),
                [grey, ..] => out.fill(*grey),
                [] => {}
            }
        }
        Ok(1)
    }

    fn load(&mut self, path: &Path) -> Result<(), ImageError> {
        self.file.clear();
        File::open(path)
            .and_then(|mut file| file.read_to_end(&mut self.file))
            .map_err(|source| ImageError::File { path: path.to_owned(), source })?;
        Ok(())
    }
}

fn jpeg<'a>(file: &'a [u8], path: &Path) -> Result<JpegDecoder<Cursor<&'a [u8]>>, ImageError> {
    if !file.starts_with(&JPEG_MAGIC) {
        return Err(damaged(path, "it is neither JPEG nor PNG"));
    }
    let options =
        DecoderOptions::default().set_strict_mode(true).jpeg_set_out_colorspace(ColorSpace::RGB);
    Ok(JpegDecoder::new_with_options(Cursor::new(file), options))
}

fn damaged(path: &Path, message: impl ToString) -> ImageError {
    ImageError::Damaged { path: path.to_owned(), message: message.to_string() }
}

fn unexpected(
    path: &Path,
    [width, height]: [u32; 2],
    kind: impl std::fmt::Debug,
    [wanted_width, wanted_height]: [u32; 2],
    wanted_kind: &str,
) -> ImageError {
    ImageError::Unexpected {
        path: path.to_owned(),
        found: format!("{width}×{height} {kind:?}"),
        expected: format!("{wanted_width}×{wanted_height} {wanted_kind}"),
    }
}
