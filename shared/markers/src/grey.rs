//! Grey images and what is read from them.

/// The pixels and the size of an image do not fit together. A programming fault: stop.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{found} bytes are no {width} × {height} image of {channels} byte(s) a pixel: pass all rows, \
     without padding"
)]
pub struct ImageSizeError {
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Bytes of a pixel.
    pub channels: usize,
    /// Bytes that were passed.
    pub found: usize,
}

/// A borrowed grey image, row-major, one byte a pixel, no padding.
#[derive(Debug, Clone, Copy)]
pub struct GreyImage<'a> {
    width: usize,
    height: usize,
    pixels: &'a [u8],
}

impl<'a> GreyImage<'a> {
    /// No pixels.
    pub(crate) const EMPTY: Self = Self { width: 0, height: 0, pixels: &[] };

    /// An image of `width × height` pixels; either may be 0.
    pub fn new(width: usize, height: usize, pixels: &'a [u8]) -> Result<Self, ImageSizeError> {
        check_size(width, height, 1, pixels.len())?;
        Ok(Self { width, height, pixels })
    }

    /// Pixels of a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// One row.
    pub(crate) fn row(&self, y: usize) -> &'a [u8] {
        &self.pixels[y * self.width..(y + 1) * self.width]
    }

    /// Brightness between pixels, bilinear; the border is repeated outwards. Needs 2 × 2 pixels.
    #[inline]
    pub(crate) fn sample(&self, x: f32, y: f32) -> f32 {
        let x = x.clamp(0.0, self.width as f32 - 1.001);
        let y = y.clamp(0.0, self.height as f32 - 1.001);
        // The clamp may still round up to the last pixel in images wider than 2¹³.
        let column = (x as usize).min(self.width - 2);
        let row = (y as usize).min(self.height - 2);
        let (s, t) = (x - column as f32, y - row as f32);
        let first = row * self.width + column;
        let upper = &self.pixels[first..first + 2];
        let lower = &self.pixels[first + self.width..first + self.width + 2];
        let mix = |pair: &[u8]| {
            let (a, b) = (f32::from(pair[0]), f32::from(pair[1]));
            a + (b - a) * s
        };
        let (above, below) = (mix(upper), mix(lower));
        above + (below - above) * t
    }
}

/// Brightness of row-major `r, g, b` bytes into `grey` (resized to fit): ITU-R BT.601, rounded,
/// as OpenCV's `COLOR_RGB2GRAY`.
pub fn grey_from_rgb(
    width: usize,
    height: usize,
    rgb: &[u8],
    grey: &mut Vec<u8>,
) -> Result<(), ImageSizeError> {
    check_size(width, height, 3, rgb.len())?;
    grey.resize(width * height, 0);
    for (grey, rgb) in grey.iter_mut().zip(rgb.as_chunks::<3>().0) {
        let [r, g, b] = rgb.map(u32::from);
        // 0.299, 0.587 and 0.114 in steps of 2⁻¹⁵; they sum to 2¹⁵.
        *grey = ((9798 * r + 19235 * g + 3735 * b + (1 << 14)) >> 15) as u8;
    }
    Ok(())
}

fn check_size(
    width: usize,
    height: usize,
    channels: usize,
    found: usize,
) -> Result<(), ImageSizeError> {
    let needed = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(channels));
    if needed == Some(found) {
        Ok(())
    } else {
        Err(ImageSizeError { width, height, channels, found })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_bilinear_and_the_border_repeats() {
        let image = GreyImage::new(3, 2, &[0, 100, 200, 40, 140, 240]).unwrap();
        assert_eq!(image.sample(0.0, 0.0), 0.0);
        assert_eq!(image.sample(0.5, 0.5), 70.0);
        assert!((image.sample(9.0, 9.0) - 240.0).abs() < 0.2);
        assert_eq!(image.sample(-5.0, -5.0), 0.0);
    }

    #[test]
    fn greys_stay_greys_and_wrong_sizes_are_refused() {
        let mut grey = Vec::new();
        grey_from_rgb(2, 1, &[7, 7, 7, 255, 255, 255], &mut grey).unwrap();
        assert_eq!(grey, [7, 255]);
        grey_from_rgb(3, 1, &[255, 0, 0, 0, 255, 0, 0, 0, 255], &mut grey).unwrap();
        assert_eq!(grey, [76, 150, 29]);
        assert!(grey_from_rgb(2, 2, &[0; 11], &mut grey).is_err());
        let error = GreyImage::new(usize::MAX, 2, &[]).unwrap_err();
        assert!(error.to_string().contains("0 bytes"), "{error}");
    }
}
