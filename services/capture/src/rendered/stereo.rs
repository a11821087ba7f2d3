//! What happens to a stereo camera's depth at the edges of nearer objects.
//!
//! The left imager's pixel x at depth z appears in the right one at x − d, d = f·b/z. Beside the
//! left edge of a nearer object the right imager sees the object instead: Δd pixels are lost.
//! The matching window loses a little more, on both sides; and some pixels mix near and far.

use std::ops::Range;

use super::noise::hash;

/// How far holes reach beyond what is hidden, pixels: the matching window.
const WINDOW_PX: f32 = 1.3;

/// A step in disparity that counts as an edge, pixels.
const EDGE_PX: f32 = 0.5;

/// A part of the image.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Window {
    pub rows: Range<usize>,
    pub columns: Range<usize>,
}

impl Window {
    /// Grows to hold these rows and columns, too.
    pub fn include(&mut self, rows: Range<usize>, columns: Range<usize>) {
        if rows.is_empty() || columns.is_empty() {
            return;
        }
        let join = |a: &Range<usize>, b: Range<usize>| {
            if a.is_empty() { b } else { a.start.min(b.start)..a.end.max(b.end) }
        };
        self.rows = join(&self.rows, rows);
        self.columns = join(&self.columns, columns);
    }
}

/// Strengths of the faults at edges.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edges {
    /// Focal length · baseline, pixels · units of depth.
    pub focal_baseline: f32,
    /// Share of the real holes' width; 0 is off.
    pub shadow: f32,
    /// Mixed pixels for each pixel of an edge; 0 is off.
    pub flying_rate: f32,
    /// How far behind an edge mixed pixels may lie, units.
    pub far_units: f32,
}

impl Edges {
    /// Adds holes and mixed pixels to `raw` where `exact` (units) has edges within `window`.
    pub fn apply(
        &self,
        exact: &[f32],
        width: usize,
        window: &Window,
        random: u64,
        raw: &mut [u16],
    ) {
        if self.shadow == 0.0 && self.flying_rate == 0.0 {
            return;
        }
        let height = exact.len() / width;
        // Holes begin one pixel outside the objects and end where the widest shadow may.
        let columns = window.columns.start.saturating_sub(64)..(window.columns.end + 4).min(width);
        let rows = window.rows.start.saturating_sub(1)..(window.rows.end + 1).min(height);
        if self.shadow > 0.0 {
            for y in rows.clone() {
                let row = y * width..(y + 1) * width;
                let dither = hash(random, y as u64);
                self.cast(&exact[row.clone()], &columns, dither, &mut raw[row]);
            }
        }
        if self.flying_rate > 0.0 {
            for y in rows {
                self.mix(exact, width, (y, &columns), random, raw);
            }
        }
    }

    /// Holes of one row.
    fn cast(&self, exact: &[f32], columns: &Range<usize>, dither: u64, raw: &mut [u16]) {
        let disparity = |z: f32| self.focal_baseline / z;
        let window_px = WINDOW_PX * self.shadow;
        // Right imager's column of the last left edge; nothing right of it is seen there.
        let mut limit = f32::INFINITY;
        let mut next = disparity(exact[columns.end - 1]);
        for x in columns.clone().rev() {
            let here = disparity(exact[x]);
            if next - here > EDGE_PX {
                let share = unit(hash(dither, x as u64));
                let hidden_px = (next - here) * self.shadow + window_px + share;
                limit = limit.min((x + 1) as f32 - here - hidden_px.floor());
            } else if here - next > EDGE_PX {
                let lost = (window_px + unit(hash(dither, x as u64))) as usize;
                let beside = x + 1..(x + 1 + lost).min(raw.len());
                raw[beside].fill(0);
            }
            if x as f32 - here >= limit - 1e-3 {
                raw[x] = 0;
            } else {
                limit = f32::INFINITY;
            }
            next = here;
        }
    }

    /// Mixed pixels of one row.
    fn mix(
        &self,
        exact: &[f32],
        width: usize,
        (y, columns): (usize, &Range<usize>),
        random: u64,
        raw: &mut [u16],
    ) {
        let row = y * width;
        // In units of inverse depth an edge is a fixed step.
        let step = EDGE_PX / self.focal_baseline;
        for x in columns.start.max(1)..columns.end.min(width - 1) {
            let here = row + x;
            let far = 1.0 / (1.0 / exact[here] - step).max(1e-9);
            let neighbours = [
                here - 1,
                here + 1,
                if y > 0 { here - width } else { here },
                if here + width < exact.len() { here + width } else { here },
            ];
            // Quick way out for nearly all pixels.
            let [a, b, c, d] = neighbours.map(|k| exact[k]);
            if a.max(b).max(c).max(d) <= far {
                continue;
            }
            let number = hash(random ^ 0xf17, here as u64);
            if unit(number) >= self.flying_rate {
                continue;
            }
            let beyond = neighbours.into_iter().find(|k| exact[*k] > far);
            if let Some(beyond) = beyond {
                let depth = (exact[beyond] - exact[here]).min(self.far_units);
                let share = 0.15 + 0.7 * unit(number >> 32 ^ number << 32);
                raw[beyond] = (exact[here] + share * depth).min(65535.0) as u16;
            }
        }
    }
}

/// A number in [0, 1) from a random one.
fn unit(number: u64) -> f32 {
    (number >> 40) as f32 / (1u64 << 24) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// f·b of a D415 at 640 × 480, pixels · millimetres.
    const D415: f32 = 598.0 * 55.0;

    /// A 30 mm cube on a plane, as the one that the real cameras' figures were measured on:
    /// mean width of the holes on its left and right, mixed pixels per pixel of its side edges.
    fn cube(far: f32, edges: &Edges) -> [f64; 3] {
        let (width, height) = (640, 480);
        let mut exact = vec![far; width * height];
        for y in 200..280 {
            exact[y * width + 300..y * width + 340].fill(far - 30.0);
        }
        let mut window = Window::default();
        window.include(200..280, 300..340);
        let mut sums = [0.0; 3];
        let frames = 40;
        for frame in 0..frames {
            let mut raw: Vec<u16> = exact.iter().map(|z| *z as u16).collect();
            edges.apply(&exact, width, &window, hash(5, frame), &mut raw);
            for y in 200..280 {
                let row = &raw[y * width..(y + 1) * width];
                let lost = |columns: Range<usize>| {
                    row[columns].iter().filter(|z| **z != far as u16).count() as f64
                };
                sums[0] += lost(220..300);
                sums[1] += lost(340..360);
                let mixed = |z: &&u16| 0 < **z && **z != far as u16 && **z != far as u16 - 30;
                sums[2] += row[220..360].iter().filter(mixed).count() as f64 / 2.0;
            }
        }
        sums.map(|sum| sum / (80.0 * frames as f64))
    }

    #[test]
    fn holes_and_mixed_pixels_are_those_of_real_cameras() {
        let edges = Edges { focal_baseline: D415, shadow: 1.0, flying_rate: 0.0, far_units: 200.0 };
        // Real D415s, 30 mm cube about half a metre away: 5.5 to 6.8 px left, 1.2 to 1.4 right.
        for far in [450.0, 480.0, 500.0] {
            let [left, right, _] = cube(far, &edges);
            assert!((5.5 * 0.85..=6.8 * 1.15).contains(&left), "{left} px left at {far} mm");
            assert!((1.2..=1.4).contains(&right), "{right} px right at {far} mm");
            let geometry = f64::from(D415 / (far - 30.0) - D415 / far);
            assert!((left - geometry - f64::from(WINDOW_PX)).abs() < 0.05, "{left}");
        }
        let flying = Edges { shadow: 0.0, flying_rate: 0.45, ..edges };
        let [_, _, mixed] = cube(500.0, &flying);
        assert!((0.4..=0.5).contains(&mixed), "{mixed} mixed pixels per pixel of edge");
    }

    #[test]
    fn without_an_edge_nothing_changes() {
        let exact: Vec<f32> = (0..640 * 48).map(|k| 400.0 + (k % 640) as f32 * 0.3).collect();
        let mut raw = vec![7; exact.len()];
        let mut window = Window::default();
        window.include(0..48, 0..640);
        let edges = Edges { focal_baseline: D415, shadow: 1.0, flying_rate: 1.0, far_units: 200.0 };
        edges.apply(&exact, 640, &window, 1, &mut raw);
        assert!(raw.iter().all(|z| *z == 7));
    }
}
