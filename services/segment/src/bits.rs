//! Binary images, 64 pixels to a word, with square morphology.

/// A binary image. Bits beyond the width are always zero.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct BitImage {
    pub width: usize,
    pub height: usize,
    /// Words per row.
    pub words: usize,
    bits: Vec<u64>,
}

impl BitImage {
    /// An empty image.
    pub fn new(width: usize, height: usize) -> Self {
        let words = width.div_ceil(64);
        Self { width, height, words, bits: vec![0; words * height] }
    }

    pub fn get(&self, x: usize, y: usize) -> bool {
        self.bits[y * self.words + x / 64] >> (x % 64) & 1 == 1
    }

    /// [`Self::get`], with nothing set outside the image.
    pub fn get_or_unset(&self, x: i32, y: i32) -> bool {
        (0..self.width as i32).contains(&x)
            && (0..self.height as i32).contains(&y)
            && self.get(x as usize, y as usize)
    }

    pub fn set(&mut self, x: usize, y: usize) {
        self.bits[y * self.words + x / 64] |= 1 << (x % 64);
    }

    pub fn row(&self, y: usize) -> &[u64] {
        &self.bits[y * self.words..(y + 1) * self.words]
    }

    pub fn row_mut(&mut self, y: usize) -> &mut [u64] {
        &mut self.bits[y * self.words..(y + 1) * self.words]
    }

    /// Which bits of word `k` of a row are pixels.
    pub fn used(&self, k: usize) -> u64 {
        match self.width - 64 * k {
            rest if rest >= 64 => !0,
            rest => (1 << rest) - 1,
        }
    }

    pub fn clear(&mut self) {
        self.bits.fill(0);
    }

    pub fn count(&self) -> usize {
        self.bits.iter().map(|w| w.count_ones() as usize).sum()
    }

    pub fn copy_from(&mut self, other: &Self) {
        self.bits.copy_from_slice(&other.bits);
    }

    pub fn or(&mut self, other: &Self) {
        self.bits.iter_mut().zip(&other.bits).for_each(|(a, b)| *a |= b);
    }

    pub fn and(&mut self, other: &Self) {
        self.bits.iter_mut().zip(&other.bits).for_each(|(a, b)| *a &= b);
    }

    pub fn and_not(&mut self, other: &Self) {
        self.bits.iter_mut().zip(&other.bits).for_each(|(a, b)| *a &= !b);
    }

    pub fn invert(&mut self) {
        let last = self.used(self.words.saturating_sub(1));
        for row in self.bits.chunks_exact_mut(self.words.max(1)) {
            row.iter_mut().for_each(|w| *w = !*w);
            if let Some(w) = row.last_mut() {
                *w &= last;
            }
        }
    }

    /// Sets pixels `start..end` of row `y`.
    pub fn set_run(&mut self, y: usize, start: usize, end: usize) {
        for_words(start, end, |k, mask| self.bits[y * self.words + k] |= mask);
    }

    /// Number of set pixels in `start..end` of row `y`.
    pub fn count_run(&self, y: usize, start: usize, end: usize) -> u32 {
        let mut count = 0;
        for_words(start, end, |k, mask| {
            count += (self.bits[y * self.words + k] & mask).count_ones();
        });
        count
    }

    /// Moves the set by `[dx, dy]`; what leaves the image is lost. `|dx| < 64`.
    pub fn shift(&mut self, [dx, dy]: [i32; 2]) {
        let (words, rows) = (self.words, dy.unsigned_abs() as usize);
        let kept = self.height.saturating_sub(rows) * words;
        let gone = self.bits.len() - kept;
        if dy >= 0 {
            self.bits.copy_within(..kept, gone);
            self.bits[..gone].fill(0);
        } else {
            self.bits.copy_within(gone.., 0);
            self.bits[kept..].fill(0);
        }
        if dx == 0 {
            return;
        }
        let (step, last) = (dx.unsigned_abs(), self.used(words - 1));
        for row in self.bits.chunks_exact_mut(words) {
            let mut carry = 0;
            if dx > 0 {
                for word in row.iter_mut() {
                    let next = *word >> (64 - step);
                    *word = *word << step | carry;
                    carry = next;
                }
                row[words - 1] &= last;
            } else {
                for word in row.iter_mut().rev() {
                    let next = *word << (64 - step);
                    *word = *word >> step | carry;
                    carry = next;
                }
            }
        }
    }

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
        let unused = !match self.width % 64 {
            0 => !0,
            rest => (1u64 << rest) - 1,
        };
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

fn join<const ERODE: bool>(a: &mut [u64], b: &[u64]) {
    let lanes = a.iter_mut().zip(b);
    if ERODE { lanes.for_each(|(a, b)| *a &= b) } else { lanes.for_each(|(a, b)| *a |= b) }
}

/// Calls `grow` with steps that together reach `radius`, each at most one above the reach so far.
fn doubling(radius: usize, mut grow: impl FnMut(usize)) {
    let mut reach = 0;
    while reach < radius {
        let step = (reach + 1).min(radius - reach);
        grow(step);
        reach += step;
    }
}

/// Joins to each pixel the pixel `step` to its left, as it was; `0 < step < 64`.
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
fn from_right<const ERODE: bool>(row: &mut [u64], step: usize) {
    let mut carry = if ERODE { !0 << (64 - step) } else { 0 };
    for word in row.iter_mut().rev() {
        let next = *word << (64 - step);
        let moved = *word >> step | carry;
        *word = if ERODE { *word & moved } else { *word | moved };
        carry = next;
    }
}

/// Joins to each word the word `step` before it, as it was.
fn from_above<const ERODE: bool>(bits: &mut [u64], step: usize) {
    for k in (step..bits.len()).rev() {
        bits[k] = if ERODE { bits[k] & bits[k - step] } else { bits[k] | bits[k - step] };
    }
}

/// Joins to each word the word `step` after it, as it was.
fn from_below<const ERODE: bool>(bits: &mut [u64], step: usize) {
    for k in 0..bits.len().saturating_sub(step) {
        bits[k] = if ERODE { bits[k] & bits[k + step] } else { bits[k] | bits[k + step] };
    }
}

/// Calls `visit` with each word of `start..end` and the mask of the pixels in it.
fn for_words(start: usize, end: usize, mut visit: impl FnMut(usize, u64)) {
    if start >= end {
        return;
    }
    for k in start / 64..=(end - 1) / 64 {
        let low = start.saturating_sub(64 * k);
        let high = (end - 64 * k).min(64);
        visit(k, !0 << low & !0 >> (64 - high));
    }
}

/// Packs bytes that are 0 or 1 into bits, first byte lowest.
pub(crate) fn pack(bytes: &[u8; 64]) -> u64 {
    let mut word = 0;
    for (j, eight) in bytes.chunks_exact(8).enumerate() {
        let mut group = [0; 8];
        group.copy_from_slice(eight);
        // Each factor bit moves one byte's lowest bit into the top byte, in order.
        let packed = u64::from_le_bytes(group).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        word |= packed << (8 * j);
    }
    word
}

#[cfg(test)]
pub(crate) mod picture {
    //! Bit images as ASCII: `#` is set.
    use super::BitImage;

    pub fn parse(picture: &str) -> BitImage {
        let rows: Vec<&str> = picture.split_whitespace().collect();
        let mut image = BitImage::new(rows[0].len(), rows.len());
        for (y, row) in rows.iter().enumerate() {
            for (x, c) in row.chars().enumerate() {
                if c == '#' {
                    image.set(x, y);
                }
            }
        }
        image
    }

    pub fn draw(image: &BitImage) -> String {
        (0..image.height)
            .map(|y| {
                let row = (0..image.width).map(|x| if image.get(x, y) { '#' } else { '.' });
                row.chain(['\n']).collect::<String>()
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::BitImage;
    use super::picture::{draw, parse};

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
            ".......
             .##.##.
             .##.##.
             .......",
            close,
            ".......
             .#####.
             .#####.
             .......",
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
