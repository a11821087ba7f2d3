//! Growing and shrinking binary images by squares, by shifts of whole words.

use std::sync::LazyLock;

use orime_lanes::{Lanes, Pass, Width};

use crate::bits::BitImage;

/// The widest vectors of this machine.
static WIDEST: LazyLock<Width> = LazyLock::new(|| Width::available()[0]);

impl BitImage {
    /// Grows the set by a square of side `2 radius + 1`; `radius < 64`.
    pub fn dilate(&mut self, radius: usize, scratch: &mut Self) {
        self.combine::<false>(radius, scratch);
    }

    /// Shrinks the set by a square of side `2 radius + 1`, outside counting as set;
    /// `radius < 64`.
    pub fn erode(&mut self, radius: usize, scratch: &mut Self) {
        self.combine::<true>(radius, scratch);
    }

    /// Joins (`ERODE`: intersects) the set with itself shifted by up to `radius` either way.
    fn combine<const ERODE: bool>(&mut self, radius: usize, scratch: &mut Self) {
        let words = self.words;
        // Empty rows farther than `radius` from the set stay empty.
        let Some(first) = self.bits.iter().position(|w| *w != 0) else { return };
        let last = self.bits.iter().rposition(|w| *w != 0).unwrap_or(first);
        let low = (first / words).saturating_sub(radius);
        let high = (last / words + radius + 1).min(self.height);
        let bits = &mut self.bits[low * words..high * words];
        let other = &mut scratch.bits[low * words..high * words];
        let last = self.width % 64;
        let unused = if last == 0 { 0 } else { !0 << last };
        WIDEST.run(Combine::<ERODE> { bits, other, words, radius, unused });
    }
}

/// Joins (`ERODE`: intersects) rows of `words` words with themselves.
struct Combine<'a, const ERODE: bool> {
    bits: &'a mut [u64],
    other: &'a mut [u64],
    words: usize,
    radius: usize,
    /// Bits of a row's last word that are no pixels.
    unused: u64,
}

impl<const ERODE: bool> Pass for Combine<'_, ERODE> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { bits, other, words, radius, unused } = self;
        for (row, other) in bits.chunks_exact_mut(words).zip(other.chunks_exact_mut(words)) {
            if ERODE {
                row[words - 1] |= unused;
            }
            other.copy_from_slice(row);
            doubling(radius, |step| from_left::<ERODE>(row, step));
            doubling(radius, |step| from_right::<ERODE>(other, step));
            join::<ERODE>(row, other);
            row[words - 1] &= !unused;
        }
        other.copy_from_slice(bits);
        doubling(radius, |step| from_above::<ERODE>(bits, step * words));
        doubling(radius, |step| from_below::<ERODE>(other, step * words));
        join::<ERODE>(bits, other);
    }
}

#[inline(always)]
fn join<const ERODE: bool>(a: &mut [u64], b: &[u64]) {
    let lanes = a.iter_mut().zip(b);
    if ERODE { lanes.for_each(|(a, b)| *a &= b) } else { lanes.for_each(|(a, b)| *a |= b) }
}

/// Calls `grow` with steps that together reach `radius`, each at most one above the reach so far.
#[inline(always)]
fn doubling(radius: usize, mut grow: impl FnMut(usize)) {
    let mut reach = 0;
    while reach < radius {
        let step = (reach + 1).min(radius - reach);
        grow(step);
        reach += step;
    }
}

/// Joins to each pixel the pixel `step` to its left, as it was; `0 < step < 64`.
#[inline(always)]
fn from_left<const ERODE: bool>(row: &mut [u64], step: usize) {
    let mut carry = if ERODE { !0 >> (64 - step) } else { 0 };
    for word in row {
        let next = *word >> (64 - step);
        let moved = *word << step | carry;
        *word = if ERODE { *word & moved } else { *word | moved };
        carry = next;
    }
}

/// Joins to each pixel the pixel `step` to its right, as it was; `0 < step < 64`.
#[inline(always)]
fn from_right<const ERODE: bool>(row: &mut [u64], step: usize) {
    let mut carry = if ERODE { !0 << (64 - step) } else { 0 };
    for word in row.iter_mut().rev() {
        let next = *word << (64 - step);
        let moved = *word >> step | carry;
        *word = if ERODE { *word & moved } else { *word | moved };
        carry = next;
    }
}

/// Joins to each word the word `step` before it, as it was; from the last on, `step` at a time, so
/// that what is read and what is written lie apart.
#[inline(always)]
fn from_above<const ERODE: bool>(bits: &mut [u64], step: usize) {
    let mut end = bits.len();
    while end > step {
        let start = end.saturating_sub(step).max(step);
        let (before, here) = bits.split_at_mut(start);
        join::<ERODE>(&mut here[..end - start], &before[start - step..]);
        end = start;
    }
}

/// Joins to each word the word `step` after it, as it was.
#[inline(always)]
fn from_below<const ERODE: bool>(bits: &mut [u64], step: usize) {
    let mut rest = bits;
    while rest.len() > step {
        let (here, after) = rest.split_at_mut(step);
        join::<ERODE>(here, after);
        rest = after;
    }
}

#[cfg(test)]
mod tests {
    use crate::bits::BitImage;
    use crate::bits::picture::{draw, parse};

    /// `change` as a picture, for the picture.
    fn check(picture: &str, change: impl Fn(&mut BitImage, &mut BitImage), expected: &str) {
        let mut image = parse(picture);
        let mut scratch = image.clone();
        change(&mut image, &mut scratch);
        let expected: Vec<&str> = expected.split_whitespace().collect();
        assert_eq!(draw(&image).split_whitespace().collect::<Vec<_>>(), expected);
    }

    #[test]
    fn opening_removes_bridges_and_closing_fills_gaps() {
        let open = |image: &mut BitImage, scratch: &mut BitImage| {
            image.erode(1, scratch);
            image.dilate(1, scratch);
        };
        check(
            "###....
             ###....
             ####.##
             ....###
             ....###",
            open,
            "###....
             ###....
             ###..##
             ....###
             ....###",
        );
        let close = |image: &mut BitImage, scratch: &mut BitImage| {
            image.dilate(1, scratch);
            image.erode(1, scratch);
        };
        check(
            ".........
             .........
             ..##.##..
             ..##.##..
             .........
             .........",
            close,
            ".........
             .........
             ..#####..
             ..#####..
             .........
             .........",
        );
        check("..#..", |image, _| image.shift([2, 0]), "....#");
        check(
            "##.
             #..",
            |image, _| image.shift([-1, 1]),
            "...
             #..",
        );
    }

    /// Morphology and shifts against their definitions, over word borders.
    #[test]
    fn words_do_what_pixels_would() {
        for (width, height) in [(1, 1), (63, 9), (64, 9), (65, 9), (130, 40)] {
            let mut image = BitImage::new(width, height);
            let mut state = 1u32;
            for k in 0..width * height {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                if state >> 29 == 0 {
                    image.set(k % width, k / width);
                }
            }
            for radius in [0, 1, 2, 5, 16] {
                let near = |x: usize, y: usize, outside: bool| {
                    let r = radius as i32;
                    let (x, y) = (x as i32, y as i32);
                    let mut pixels = (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| [dx, dy]));
                    let inside = |[dx, dy]: [i32; 2]| {
                        (0..width as i32).contains(&(x + dx))
                            && (0..height as i32).contains(&(y + dy))
                    };
                    pixels.any(|[dx, dy]| {
                        inside([dx, dy]) && image.get_or_unset(x + dx, y + dy) != outside
                    })
                };
                let (mut grown, mut shrunk) = (image.clone(), image.clone());
                let mut scratch = BitImage::new(width, height);
                grown.dilate(radius, &mut scratch);
                shrunk.erode(radius, &mut scratch);
                let mut moved = image.clone();
                let by = [radius as i32 - 3, 2 - radius as i32];
                moved.shift(by);
                for y in 0..height {
                    for x in 0..width {
                        assert_eq!(grown.get(x, y), near(x, y, false), "{width} {radius}");
                        assert_eq!(shrunk.get(x, y), !near(x, y, true), "{width} {radius}");
                        let from = image.get_or_unset(x as i32 - by[0], y as i32 - by[1]);
                        assert_eq!(moved.get(x, y), from, "{width} {by:?}");
                    }
                }
                let set = (0..height).map(|y| grown.count_run(y, 0, width)).sum::<u32>();
                assert_eq!(set as usize, grown.count(), "{width}: bits beyond the image");
            }
        }
    }
}
