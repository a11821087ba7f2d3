//! Dark and bright by comparison with the mean of a window.

use crate::grey::GreyImage;

/// A bright pixel.
const BRIGHT: u8 = 0;
/// A dark pixel.
pub(super) const DARK: u8 = 1;
/// Added to a dark pixel whose border was traced.
pub(super) const TRACED: u8 = 2;

/// Dark and bright pixels, in a frame of bright ones.
#[derive(Debug, Default)]
pub(super) struct Binary {
    /// Width of a row with its frame.
    pub stride: usize,
    /// `DARK`, with `TRACED` where that is so; row-major.
    pub pixels: Vec<u8>,
}

impl Binary {
    /// First pixel at or after `from` that is dark, untraced, and has a bright pixel on its left.
    pub(super) fn next_start(&self, from: usize) -> Option<usize> {
        let mut at = from.max(1);
        let is_start = |at: usize| self.pixels[at] == DARK && self.pixels[at - 1] == BRIGHT;
        // Eight pixels at a time; every byte is at most `DARK | TRACED`.
        const ONES: u64 = u64::from_le_bytes([DARK; 8]);
        let word = |at: usize| -> Option<u64> {
            Some(u64::from_le_bytes(*self.pixels.get(at..)?.first_chunk()?))
        };
        while let (Some(here), Some(left)) = (word(at), word(at - 1)) {
            let starts = here & !(here >> 1) & !left & !(left >> 1) & ONES;
            if starts != 0 {
                return Some(at + starts.trailing_zeros() as usize / 8);
            }
            at += 8;
        }
        (at..self.pixels.len()).find(|at| is_start(*at))
    }
}

/// How far below the mean of its window a dark pixel is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cut {
    /// Side of the window, pixels; odd, at most 101.
    pub window_px: usize,
    /// Share of the mean that a dark pixel may have.
    pub ratio: f32,
    /// Grey levels that it is darker still.
    pub offset: f32,
}

/// Thresholds images; keeps the sums of a row.
#[derive(Debug, Default)]
pub(super) struct MeanThreshold {
    /// Per column, the sum over the window's rows: at most 101 · 255.
    columns: Vec<u16>,
    /// Per column, the sum of `columns` before it, modulo 2³².
    before: Vec<i32>,
}

impl MeanThreshold {
    /// Marks as dark what is dark enough beside the mean of the window around it; the window is
    /// cut at the image's border.
    pub(super) fn apply(&mut self, image: GreyImage<'_>, cut: Cut, binary: &mut Binary) {
        let (width, height) = (image.width(), image.height());
        let reach = cut.window_px / 2;
        binary.stride = width + 2;
        binary.pixels.clear();
        binary.pixels.resize(binary.stride * (height + 2), BRIGHT);
        self.columns.clear();
        self.columns.resize(width, 0);
        self.before.resize(width + 1, 0);
        for y in 0..reach.min(height) {
            add(&mut self.columns, image.row(y));
        }
        for y in 0..height {
            if y + reach < height {
                add(&mut self.columns, image.row(y + reach));
            }
            if y > reach {
                subtract(&mut self.columns, image.row(y - reach - 1));
            }
            let rows = (y + reach + 1).min(height) - y.saturating_sub(reach);
            let first = (y + 1) * binary.stride + 1;
            let target = &mut binary.pixels[first..first + width];
            self.row(image.row(y), rows, cut, target);
        }
    }

    /// One row, whose window has `rows` rows.
    fn row(&mut self, pixels: &[u8], rows: usize, cut: Cut, target: &mut [u8]) {
        let Cut { window_px: window, ratio, offset } = cut;
        let reach = window / 2;
        let mut sum = 0_i32;
        for (before, column) in self.before[1..].iter_mut().zip(&self.columns) {
            sum = sum.wrapping_add(i32::from(*column));
            *before = sum;
        }
        let width = pixels.len();
        let before = &self.before;
        let cut_short = |x: usize| -> u8 {
            let (start, end) = (x.saturating_sub(reach), (x + reach + 1).min(width));
            let sum = before[end].wrapping_sub(before[start]);
            dark(pixels[x], sum, ratio / (rows * (end - start)) as f32, offset)
        };
        let whole = reach..width.saturating_sub(reach);
        for x in (0..whole.start.min(width)).chain(whole.end.max(reach)..width) {
            target[x] = cut_short(x);
        }
        if whole.is_empty() {
            return;
        }
        let share = ratio / (rows * window) as f32;
        let (starts, ends) = (&before[..whole.len()], &before[window..window + whole.len()]);
        let pixels = &pixels[whole.clone()];
        let target = &mut target[whole];
        for (((target, pixel), start), end) in target.iter_mut().zip(pixels).zip(starts).zip(ends) {
            *target = dark(*pixel, end.wrapping_sub(*start), share, offset);
        }
    }
}

/// `DARK` if the pixel is at least `offset` below that share of the sum.
#[inline]
fn dark(pixel: u8, sum: i32, share: f32, offset: f32) -> u8 {
    u8::from(f32::from(pixel) + offset <= sum as f32 * share)
}

fn add(columns: &mut [u16], row: &[u8]) {
    for (column, pixel) in columns.iter_mut().zip(row) {
        *column += u16::from(*pixel);
    }
}

fn subtract(columns: &mut [u16], row: &[u8]) {
    for (column, pixel) in columns.iter_mut().zip(row) {
        *column -= u16::from(*pixel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, pixel by pixel.
    fn slowly(image: GreyImage<'_>, cut: Cut) -> Vec<u8> {
        let (width, height, reach) = (image.width(), image.height(), cut.window_px / 2);
        let mut pixels = vec![BRIGHT; (width + 2) * (height + 2)];
        for y in 0..height {
            for x in 0..width {
                let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
                let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
                let count = rows.len() * columns.len();
                let sum: i32 = rows
                    .map(|y| {
                        image.row(y)[columns.clone()].iter().map(|p| i32::from(*p)).sum::<i32>()
                    })
                    .sum();
                pixels[(y + 1) * (width + 2) + x + 1] =
                    dark(image.row(y)[x], sum, cut.ratio / count as f32, cut.offset);
            }
        }
        pixels
    }

    #[test]
    fn sums_that_roll_equal_sums_that_do_not() {
        let noise: Vec<u8> =
            (0..61_u32 * 43).map(|k| (k.wrapping_mul(2_654_435_769) >> 24) as u8).collect();
        let (mut threshold, mut binary) = (MeanThreshold::default(), Binary::default());
        for (width, height) in [(61, 43), (43, 61), (7, 300), (300, 7), (1, 9), (9, 1)] {
            let image = GreyImage::new(width, height, &noise[..width * height]).unwrap();
            for window_px in [3, 5, 23, 101] {
                let cut = Cut { window_px, ratio: 0.9, offset: 10.0 };
                threshold.apply(image, cut, &mut binary);
                assert_eq!(binary.stride, width + 2);
                assert!(binary.pixels == slowly(image, cut), "{width} × {height}");
            }
        }
    }

    #[test]
    fn starts_are_found_wherever_they_lie() {
        for start in 1..40 {
            let mut binary = Binary { stride: 41, pixels: vec![BRIGHT; 41] };
            assert_eq!(binary.next_start(0), None);
            binary.pixels[start] = DARK;
            assert_eq!(binary.next_start(0), Some(start));
            assert_eq!(binary.next_start(start), Some(start));
            assert_eq!(binary.next_start(start + 1), None);
            binary.pixels[start - 1] = DARK | TRACED;
            assert_eq!(binary.next_start(0), None);
        }
    }
}
