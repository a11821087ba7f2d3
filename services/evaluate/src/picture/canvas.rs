//! An RGB image to draw on.

use font8x8::{BASIC_FONTS, UnicodeFonts};
use std::io;
use std::path::Path;

/// Red, green, blue.
pub type Color = [u8; 3];

/// An RGB image, row-major.
#[derive(Debug, Clone)]
pub struct Canvas {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    rgb: Vec<u8>,
}

impl Canvas {
    /// An image of one colour.
    pub fn new(width: usize, height: usize, color: Color) -> Self {
        Self { width, height, rgb: color.repeat(width * height) }
    }

    /// An image from `r, g, b` bytes; black where there are too few.
    pub fn from_rgb(width: usize, height: usize, rgb: &[u8]) -> Self {
        let mut canvas = Self::new(width, height, [0; 3]);
        let n = rgb.len().min(canvas.rgb.len());
        canvas.rgb[..n].copy_from_slice(&rgb[..n]);
        canvas
    }

    /// Sets a pixel; outside the image nothing happens.
    pub fn set(&mut self, x: i64, y: i64, color: Color) {
        if (0..self.width as i64).contains(&x) && (0..self.height as i64).contains(&y) {
            let at = 3 * (y as usize * self.width + x as usize);
            self.rgb[at..at + 3].copy_from_slice(&color);
        }
    }

    /// The colour of a pixel inside the image.
    pub fn get(&self, x: usize, y: usize) -> Color {
        let at = 3 * (y * self.width + x);
        [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
    }

    /// A filled square of `2·radius + 1` pixels.
    pub fn dot(&mut self, x: f64, y: f64, radius: i64, color: Color) {
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                self.set(x.round() as i64 + dx, y.round() as i64 + dy, color);
            }
        }
    }

    /// A straight line, blended over what is there with `alpha` in 0 … 1.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], color: Color, alpha: f64) {
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        if !length.is_finite() || length > 1e5 {
            return;
        }
        let steps = length.ceil().max(1.0) as usize;
        for k in 0..=steps {
            let t = k as f64 / steps as f64;
            let (x, y) = (from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1]));
            let (x, y) = (x.round(), y.round());
            if x < 0.0 || y < 0.0 || x >= self.width as f64 || y >= self.height as f64 {
                continue;
            }
            let old = self.get(x as usize, y as usize);
            let mixed = [0, 1, 2]
                .map(|c| (f64::from(old[c]) * (1.0 - alpha) + f64::from(color[c]) * alpha) as u8);
            self.set(x as i64, y as i64, mixed);
        }
    }

    /// Text in an 8 × 8 font, `scale` times enlarged; characters it lacks become `?`.
    pub fn text(&mut self, x: usize, y: usize, text: &str, scale: usize, color: Color) {
        for (k, character) in text.chars().enumerate() {
            let glyph = BASIC_FONTS.get(character).or_else(|| BASIC_FONTS.get('?'));
            for (row, bits) in glyph.unwrap_or_default().iter().enumerate() {
                for column in (0..8).filter(|column| bits >> column & 1 == 1) {
                    for dy in 0..scale {
                        for dx in 0..scale {
                            let px = x + (8 * k + column) * scale + dx;
                            self.set(px as i64, (y + row * scale + dy) as i64, color);
                        }
                    }
                }
            }
        }
    }

    /// Copies `other` with its top left corner at `(x, y)`.
    pub fn place(&mut self, other: &Canvas, x: usize, y: usize) {
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            for column in 0..other.width.min(self.width.saturating_sub(x)) {
                self.set((x + column) as i64, (y + row) as i64, other.get(column, row));
            }
        }
    }

    /// Half the size, each pixel the mean of four.
    pub fn halved(&self) -> Canvas {
        let mut small = Canvas::new(self.width / 2, self.height / 2, [0; 3]);
        for y in 0..small.height {
            for x in 0..small.width {
                let four = [(0, 0), (1, 0), (0, 1), (1, 1)]
                    .map(|(dx, dy)| self.get(2 * x + dx, 2 * y + dy));
                let mean = [0, 1, 2]
                    .map(|c| (four.iter().map(|p| u32::from(p[c])).sum::<u32>() / 4) as u8);
                small.set(x as i64, y as i64, mean);
            }
        }
        small
    }

    /// Scaled to `width` by nearest pixels, keeping the aspect.
    pub fn scaled_to(&self, width: usize) -> Canvas {
        let height = (self.height * width / self.width.max(1)).max(1);
        let mut scaled = Canvas::new(width, height, [0; 3]);
        for y in 0..height {
            for x in 0..width {
                let color = self.get(x * self.width / width, y * self.height / height);
                scaled.set(x as i64, y as i64, color);
            }
        }
        scaled
    }

    /// Writes a PNG.
    pub fn save(&self, path: &Path) -> io::Result<()> {
        let file = io::BufWriter::new(std::fs::File::create(path)?);
        let mut encoder = png::Encoder::new(file, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(io::Error::other)?;
        writer.write_image_data(&self.rgb).map_err(io::Error::other)?;
        writer.finish().map_err(io::Error::other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawing_outside_is_ignored_and_inside_is_seen() {
        let mut canvas = Canvas::new(4, 4, [0; 3]);
        canvas.set(-1, 2, [9; 3]);
        canvas.set(4, 4, [9; 3]);
        canvas.line([-10.0, 1.0], [10.0, 1.0], [200, 0, 0], 0.5);
        canvas.line([f64::NAN, 0.0], [1.0, 1.0], [9; 3], 1.0);
        for x in 0..4 {
            assert_eq!(canvas.get(x, 1), [100, 0, 0]);
            assert_eq!(canvas.get(x, 2), [0, 0, 0]);
        }
        assert_eq!(canvas.halved().get(0, 0), [50, 0, 0]);
    }
}
