//! Borders of dark regions, pixel by pixel.

use super::threshold::{Binary, TRACED};

/// Steps to the eight neighbours, clockwise in the image from the right.
const STEPS: [[i32; 2]; 8] = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]];
const LEFT: usize = 4;

/// Longest border that is kept whole, pixels; a longer one is no marker, and its points beyond
/// are dropped.
pub(super) const BORDER_PX_MAX: usize = 1 << 15;

/// Follows the border through `start`, a dark pixel with a bright one on its left, marks its
/// pixels as traced, and puts them into `border` in order.
///
/// Returns twice the area inside, pixels², positive for an outer border (which is followed
/// clockwise) and negative for that of a hole. Ends where it began with the same next step, so
/// its cost is bounded by the pixels. Source: Suzuki & Abe, CVGIP 30, 1985, Algorithm 1, step 3.
pub(super) fn trace(binary: &mut Binary, start: usize, border: &mut Vec<[i32; 2]>) -> i64 {
    let stride = binary.stride;
    let offsets = STEPS.map(|[x, y]| y as isize * stride as isize + x as isize);
    let pixels = &mut binary.pixels[..];
    border.clear();
    // Coordinates in the image; `start` counts the frame.
    let mut at = [(start % stride) as i32 - 1, (start / stride) as i32 - 1];
    let neighbour = |here: usize, step: usize| here.wrapping_add_signed(offsets[step % 8]);
    let last = (1..8).map(|k| LEFT + 8 - k).find(|step| pixels[neighbour(start, *step)] != 0);
    let Some(to_last) = last else {
        pixels[start] |= TRACED;
        border.push(at);
        return 0;
    };
    let last = neighbour(start, to_last);
    let (mut here, mut back, mut twice_area) = (start, to_last % 8, 0);
    loop {
        pixels[here] |= TRACED;
        if border.len() < BORDER_PX_MAX {
            border.push(at);
        }
        // The pixel behind is dark, so the search ends with it at the latest.
        let step = (back + 1..back + 9).find(|step| pixels[neighbour(here, *step)] != 0);
        let step = step.unwrap_or(back) % 8;
        let [x, y] = STEPS[step];
        twice_area += i64::from(at[0]) * i64::from(y) - i64::from(at[1]) * i64::from(x);
        let next = neighbour(here, step);
        if next == start && here == last {
            return twice_area;
        }
        at = [at[0] + x, at[1] + y];
        (here, back) = (next, (step + 4) % 8);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::threshold::DARK;

    /// Traces every border of a picture; `#` is dark.
    fn borders(picture: &str) -> Vec<(usize, i64)> {
        let rows: Vec<&str> = picture.split_whitespace().collect();
        let stride = rows[0].len() + 2;
        let mut pixels = vec![0; stride * (rows.len() + 2)];
        for (y, row) in rows.iter().enumerate() {
            for (x, c) in row.bytes().enumerate() {
                pixels[(y + 1) * stride + x + 1] = if c == b'#' { DARK } else { 0 };
            }
        }
        let mut binary = Binary { stride, pixels };
        let (mut found, mut from, mut border) = (Vec::new(), 0, Vec::new());
        while let Some(start) = binary.next_start(from) {
            let twice_area = trace(&mut binary, start, &mut border);
            found.push((border.len(), twice_area));
            from = start + 1;
        }
        found
    }

    #[test]
    fn outer_borders_are_clockwise_and_holes_are_not() {
        assert_eq!(borders("#"), [(1, 0)]);
        assert_eq!(borders("## ##"), [(4, 2)]);
        assert_eq!(borders("####"), [(6, 0)]);
        assert_eq!(borders("##### ##### ##### ##### #####"), [(16, 32)]);
        // A ring two pixels wide: its outside, and the hole's border inside.
        let ring = "###### ###### ##..## ##..## ###### ######";
        assert_eq!(borders(ring), [(20, 50), (8, -14)]);
        // Diagonal neighbours belong together.
        assert_eq!(borders("#.# .#. #.#").len(), 1);
        assert_eq!(borders("#.. ... ..#").len(), 2);
    }
}
