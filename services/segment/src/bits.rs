//! Binary images, 64 pixels to a word.

use crate::window::Window;

/// A binary image. Bits beyond the width are always zero.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct BitImage {
    pub width: usize,
    pub height: usize,
    /// Words per row.
    pub words: usize,
    /// Row-major.
    pub bits: Vec<u64>,
}

impl BitImage {
    /// An empty image.
    pub fn new(width: usize, height: usize) -> Self {
        let words = width.div_ceil(64);
        Self { width, height, words, bits: vec![0; words * height] }
    }

    /// Takes another size, at most the one that it was made for, without allocating. The content
    /// is kept if the size is; else the image is empty.
    pub fn reshape(&mut self, width: usize, height: usize) {
        if (self.width, self.height) != (width, height) {
            let words = width.div_ceil(64);
            (self.width, self.height, self.words) = (width, height, words);
            self.bits.clear();
            self.bits.resize(words * height, 0);
        }
    }

    /// Becomes the part `window` of an image of which `other` is the part `known`; nothing is
    /// set outside that. Both begin at whole words.
    pub fn copy_part(&mut self, window: &Window, other: &Self, known: &Window) {
        self.reshape(window.width, window.height);
        self.clear();
        let first = window.x.max(known.x);
        let last = (window.x + window.width).min(known.x + known.width);
        if first >= last {
            return;
        }
        let rows = window.y.max(known.y)..(window.y + window.height).min(known.y + known.height);
        let words = (last - first).div_ceil(64);
        let used = self.used(self.words - 1);
        for y in rows {
            let from = &other.row(y - known.y)[(first - known.x) / 64..][..words];
            let row = self.row_mut(y - window.y);
            row[(first - window.x) / 64..][..words].copy_from_slice(from);
            if let Some(last) = row.last_mut() {
                *last &= used;
            }
        }
    }

    /// The smallest window that holds every set pixel; `None` for an empty image.
    pub fn bounds(&self) -> Option<Window> {
        let (mut first, mut last) = (None, 0);
        let (mut left, mut right) = (usize::MAX, 0);
        for (y, row) in self.bits.chunks_exact(self.words).enumerate() {
            let Some(low) = row.iter().position(|word| *word != 0) else { continue };
            let high = row.iter().rposition(|word| *word != 0).unwrap_or(low);
            first = first.or(Some(y));
            last = y;
            left = left.min(64 * low + row[low].trailing_zeros() as usize);
            right = right.max(64 * (high + 1) - row[high].leading_zeros() as usize);
        }
        first.map(|y| Window { x: left, y, width: right - left, height: last + 1 - y })
    }

    pub fn get(&self, x: usize, y: usize) -> bool {
        self.bits[y * self.words + x / 64] >> (x % 64) & 1 == 1
    }

    /// Nine pixels of row `y` from `x` on, the first lowest; nothing is set beyond the row.
    #[inline(always)]
    pub fn nine(&self, x: usize, y: usize) -> u32 {
        let row = self.row(y);
        let (k, shift) = (x / 64, x % 64);
        let mut nine = row[k] >> shift;
        if shift > 64 - 9 {
            nine |= row.get(k + 1).copied().unwrap_or(0) << (64 - shift);
        }
        nine as u32 & 0x1ff
    }

    /// Whether the pixels at these bit addresses are set, the first lowest; none is beyond the
    /// image.
    pub fn bits_at(&self, addresses: &[u32; 64]) -> u64 {
        let mut found = 0;
        // Eight at a time, so that no pixel waits for the one before.
        for (k, eight) in addresses.chunks_exact(8).enumerate() {
            let mut group = 0;
            for (n, at) in eight.iter().enumerate() {
                let word = self.bits.get(*at as usize / 64).copied().unwrap_or(0);
                group |= (word >> (at % 64) & 1) << n;
            }
            found |= group << (8 * k);
        }
        found
    }

    /// Sets the pixel at a bit address, `64 words y + x`.
    pub fn set_at(&mut self, address: u32) {
        self.bits[address as usize / 64] |= 1 << (address % 64);
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

    pub fn unset(&mut self, x: usize, y: usize) {
        self.bits[y * self.words + x / 64] &= !(1 << (x % 64));
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

    /// Whether a pixel of the outermost rows or columns is set.
    pub fn touches_border(&self) -> bool {
        let (last_x, last_y) = (self.width - 1, self.height - 1);
        (0..=last_x).any(|x| self.get(x, 0) || self.get(x, last_y))
            || (0..=last_y).any(|y| self.get(0, y) || self.get(last_x, y))
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
    use super::*;

    #[test]
    fn parts_and_bounds_are_what_pixels_say() {
        let mut image = BitImage::new(200, 30);
        for [x, y] in [[70, 9], [127, 20], [128, 11], [140, 25], [5, 12], [199, 29]] {
            image.set(x, y);
        }
        let known = Window { x: 64, y: 8, width: 136, height: 20 };
        let mut part = BitImage::new(200, 30);
        part.copy_part(&known, &image, &Window::whole(200, 30));
        assert_eq!(part.bounds(), Some(Window { x: 6, y: 1, width: 71, height: 17 }));
        for at in [[0, 0, 200, 30], [128, 16, 72, 14], [64, 0, 64, 16], [0, 8, 64, 20]] {
            let [x, y, width, height] = at;
            let window = Window { x, y, width, height };
            let mut other = BitImage::new(200, 30);
            other.copy_part(&window, &part, &known);
            assert_eq!([other.width, other.height], [width, height]);
            for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
                let [left, top] = [window.x + x, window.y + y];
                let inside = left >= 64 && (8..28).contains(&top);
                assert_eq!(other.get(x, y), inside && image.get(left, top), "{window:?} {x} {y}");
            }
            assert_eq!(other.bounds().is_none(), other.count() == 0);
        }
    }
}
