//! Which edgels a piece of contour is, sixteen edgels at a time.

use super::cells::Cells;
use crate::projector::Coordinates;
use orime_lanes::{LANES, Lanes, Pass};

/// Widest match along the contour, pixels.
const TANGENT_PX: f32 = 4.0;
/// Edgels this close to the nearest one along the normal are averaged with it, pixels.
const SAME_EDGE_PX: f32 = 2.5;
/// Least cosine between the normals of sample and edgel.
const COSINE_MIN: f32 = 0.8;
/// A pixel along the contour counts as so many along the normal.
const ALONG: f32 = 0.25;
/// Samples may move so far in the image before edgels are gathered for them anew, pixels.
pub(super) const MARGIN_PX: f32 = 4.0;

/// A sample that a camera should see as contour.
#[derive(Debug, Clone, Copy)]
pub(super) struct Silhouette {
    pub sample: u32,
    /// As [`orime_geometry::Edgel::kind`].
    pub kind: u32,
    /// Unit normal out of the sheet, in the image.
    pub normal: [f32; 2],
    /// Where it was when it was classified.
    pub classified_px: [f32; 2],
    /// Where it was when edgels were gathered for it.
    pub gathered_px: [f32; 2],
    /// Their places among the candidates: whole vectors.
    pub candidates: [usize; 2],
}

impl Silhouette {
    /// A pixel along the normal and along the contour.
    #[inline(always)]
    fn turned(&self, pixel: [f32; 2]) -> [f32; 2] {
        let ([x, y], [n_x, n_y]) = (pixel, self.normal);
        [n_x * x + n_y * y, n_x * y - n_y * x]
    }
}

/// Edgels that silhouettes may match: along each one's normal and contour, pixels.
#[derive(Debug, Clone, Default)]
pub(super) struct Candidates {
    turned_px: [Vec<f32>; 2],
}

impl Candidates {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.turned_px.iter_mut().for_each(Vec::clear);
    }
}

/// The distance of each lane from zero.
#[inline(always)]
fn magnitude<V: Lanes>(of: V) -> V {
    of.max(V::splat(0.0).sub(of))
}

/// Sixteen numbers from `at` on.
#[inline(always)]
fn load<V: Lanes>(of: &[f32], at: usize) -> V {
    let sixteen = &of[at..at + LANES];
    // SAFETY: the slice has sixteen numbers.
    unsafe { V::load(sixteen.as_ptr()) }
}

/// The lanes that a loop over whole vectors has at the end of a range.
#[inline(always)]
fn rest(count: usize) -> u16 {
    u16::MAX >> (LANES - count.min(LANES))
}

/// Gathers the edgels around a silhouette that it may match, wherever it moves within
/// [`MARGIN_PX`].
pub(super) struct Gather<'a> {
    /// Of the silhouette's kind.
    pub cells: &'a Cells,
    /// Where it is now, pixels.
    pub pixel: [f32; 2],
    /// Widest match along the normal, pixels.
    pub reach_px: f32,
    pub silhouette: &'a mut Silhouette,
    pub candidates: &'a mut Candidates,
}

impl Pass for Gather<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { cells, pixel, silhouette, candidates, .. } = self;
        let ([n_x, n_y], here) = (silhouette.normal, silhouette.turned(pixel));
        let (reach_px, tangent_px) = (self.reach_px + MARGIN_PX, TANGENT_PX + MARGIN_PX);
        let half_px = [
            reach_px * n_x.abs() + tangent_px * n_y.abs(),
            reach_px * n_y.abs() + tangent_px * n_x.abs(),
        ];
        let [across_px, along_px] = &mut candidates.turned_px;
        let first = across_px.len();
        let (v_x, v_y) = (V::splat(n_x), V::splat(n_y));
        for range in cells.near(pixel, half_px) {
            for at in range.clone().step_by(LANES) {
                let [x, y] =
                    [load::<V>(&cells.position_px[0], at), load::<V>(&cells.position_px[1], at)];
                let [e_x, e_y] = [load::<V>(&cells.normal[0], at), load::<V>(&cells.normal[1], at)];
                let across = v_x.mul(x).add(v_y.mul(y));
                let along = v_x.mul(y).sub(v_y.mul(x));
                let mut bits = rest(range.end - at);
                bits &= V::splat(reach_px).above(magnitude(across.sub(V::splat(here[0]))));
                bits &= V::splat(tangent_px).above(magnitude(along.sub(V::splat(here[1]))));
                bits &= v_x.mul(e_x).add(v_y.mul(e_y)).above(V::splat(COSINE_MIN));
                if bits == 0 {
                    continue;
                }
                let mut found = [[0.0; LANES]; 2];
                // SAFETY: both arrays have sixteen numbers.
                unsafe {
                    across.store(found[0].as_mut_ptr());
                    along.store(found[1].as_mut_ptr());
                }
                for lane in (0..LANES).filter(|lane| bits >> lane & 1 == 1) {
                    across_px.push(found[0][lane]);
                    along_px.push(found[1][lane]);
                }
            }
        }
        // What fills the last vector is too far off to match.
        let end = across_px.len().next_multiple_of(LANES);
        across_px.resize(end, f32::INFINITY);
        along_px.resize(end, f32::INFINITY);
        silhouette.gathered_px = pixel;
        silhouette.candidates = [first, end];
    }
}

/// Signed distance along each silhouette's normal to the nearest matching edge, pixels; NaN where
/// there is none.
pub(super) struct Nearest<'a> {
    pub silhouettes: &'a [Silhouette],
    pub candidates: &'a Candidates,
    /// Where they are now: columns and rows.
    pub pixels: &'a Coordinates,
    /// Widest match along the normal, pixels.
    pub reach_px: f32,
    pub offsets_px: &'a mut Vec<f32>,
}

impl Pass for Nearest<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { silhouettes, candidates, pixels, reach_px, offsets_px } = self;
        offsets_px.clear();
        for (k, silhouette) in silhouettes.iter().enumerate() {
            let here = silhouette.turned([pixels.axes[0][k], pixels.axes[1][k]]);
            let among = silhouette.candidates;
            offsets_px.push(Around { candidates, among, here, reach_px }.nearest::<V>());
        }
    }
}

/// The candidates of one silhouette, seen from where it is.
struct Around<'a> {
    candidates: &'a Candidates,
    among: [usize; 2],
    here: [f32; 2],
    reach_px: f32,
}

impl Around<'_> {
    #[inline(always)]
    fn nearest<V: Lanes>(&self) -> f32 {
        let vectors = || (self.among[0]..self.among[1]).step_by(LANES);
        let far = V::splat(f32::INFINITY);
        let mut least = far;
        for at in vectors() {
            let (across, along, bits) = self.load::<V>(at);
            least = cost(across, along).select(far, bits).min(least);
        }
        let least = lanes_of(least).into_iter().fold(f32::INFINITY, f32::min);
        if least == f32::INFINITY {
            return f32::NAN;
        }
        let mut first = 0.0;
        for at in vectors() {
            let (across, along, bits) = self.load::<V>(at);
            let bits = bits & !cost(across, along).above(V::splat(least));
            if bits != 0 {
                first = lanes_of(across)[bits.trailing_zeros() as usize];
                break;
            }
        }
        let (mut sum, mut weights) = (V::splat(0.0), V::splat(0.0));
        for at in vectors() {
            let (across, along, bits) = self.load::<V>(at);
            let apart = magnitude(across.sub(V::splat(first)));
            let bits = bits & V::splat(SAME_EDGE_PX).above(apart);
            let weight = V::splat(1.0).div(V::splat(1.0).add(along.mul(along)));
            sum = sum.add(weight.mul(across).keep(bits));
            weights = weights.add(weight.keep(bits));
        }
        lanes_of(sum).iter().sum::<f32>() / lanes_of(weights).iter().sum::<f32>()
    }

    /// Sixteen candidates: along the normal, along the contour, and which of them match.
    #[inline(always)]
    fn load<V: Lanes>(&self, at: usize) -> (V, V, u16) {
        let [across, along] = &self.candidates.turned_px;
        let across = load::<V>(across, at).sub(V::splat(self.here[0]));
        let along = load::<V>(along, at).sub(V::splat(self.here[1]));
        let bits = V::splat(self.reach_px).above(magnitude(across))
            & V::splat(TANGENT_PX).above(magnitude(along));
        (across, along, bits)
    }
}

#[inline(always)]
fn cost<V: Lanes>(across: V, along: V) -> V {
    magnitude(across).add(V::splat(ALONG).mul(magnitude(along)))
}

#[inline(always)]
fn lanes_of<V: Lanes>(of: V) -> [f32; LANES] {
    let mut lanes = [0.0; LANES];
    // SAFETY: the array has sixteen numbers.
    unsafe { of.store(lanes.as_mut_ptr()) };
    lanes
}

/// Marks the edgels near straight pieces of projected contour.
pub(super) struct Mark<'a> {
    pub cells: &'a Cells,
    /// Columns and rows where the pieces meet in twos, `before` to `here` to `after`; NaN where
    /// there is no pixel.
    pub pieces: [&'a Coordinates; 3],
    pub count: usize,
    /// How near, pixels.
    pub within_px: f32,
    /// As many as edgels, and a vector of room: 1 where marked.
    pub marks: &'a mut [f32],
}

impl Pass for Mark<'_> {
    #[inline(always)]
    fn run<V: Lanes>(mut self) {
        for k in 0..self.count {
            let [before, here, after] = self.pieces;
            let pixel = |of: &Coordinates| [of.axes[0][k], of.axes[1][k]];
            // Both halves, so that the corners, which are no sample here, are passed.
            for end in [pixel(before), pixel(after)] {
                self.mark::<V>(pixel(here), end);
            }
        }
    }
}

impl Mark<'_> {
    #[inline(always)]
    fn mark<V: Lanes>(&mut self, a: [f32; 2], b: [f32; 2]) {
        let way = [b[0] - a[0], b[1] - a[1]];
        if way[0].is_nan() {
            return;
        }
        let middle = [a[0] + 0.5 * way[0], a[1] + 0.5 * way[1]];
        let half_px = way.map(|c| self.within_px + 0.5 * c.abs());
        let per_length = 1.0 / (way[0] * way[0] + way[1] * way[1]).max(1e-12);
        let [w_x, w_y] = way.map(V::splat);
        for range in self.cells.near(middle, half_px) {
            for at in range.clone().step_by(LANES) {
                let [columns, rows] = &self.cells.position_px;
                let (x, y) = (load::<V>(columns, at), load::<V>(rows, at));
                let (x, y) = (x.sub(V::splat(a[0])), y.sub(V::splat(a[1])));
                let along = x.mul(w_x).add(y.mul(w_y)).mul(V::splat(per_length));
                let along = along.max(V::splat(0.0)).min(V::splat(1.0));
                let (x, y) = (x.sub(along.mul(w_x)), y.sub(along.mul(w_y)));
                let apart = x.mul(x).add(y.mul(y));
                let bits =
                    V::splat(self.within_px * self.within_px).above(apart) & rest(range.end - at);
                let marks: &mut [f32] = &mut self.marks[at..at + LANES];
                // SAFETY: the slice has sixteen numbers.
                unsafe {
                    let before = V::load(marks.as_ptr());
                    V::splat(1.0).select(before, bits).store(marks.as_mut_ptr());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::Edgel;
    use orime_lanes::Width;

    /// A wavy line of edgels every 1.7 pixels, and one of the other side.
    fn cells() -> Cells {
        let edgel = |k: u32| {
            let x = 1.7 * (k / 2) as f32;
            let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            let y = 60.0 + 5.0 * (0.05 * x).sin() + if k.is_multiple_of(2) { 0.0 } else { 3.0 };
            Edgel { position_px: [x, y], normal: [0.0, sign], camera: 0, kind: 0 }
        };
        let edgels: Vec<Edgel> = (0..200).map(edgel).collect();
        let mut cells = Cells::new(180, 120);
        edgels.iter().for_each(|edgel| cells.insert(edgel));
        cells.sort();
        cells
    }

    fn silhouettes() -> Vec<Silhouette> {
        let silhouette = |sample: u32| {
            let angle = 0.03 * sample as f32 - 0.3;
            Silhouette {
                sample,
                kind: 0,
                normal: [angle.sin(), angle.cos()],
                classified_px: [0.0; 2],
                gathered_px: [0.0; 2],
                candidates: [0; 2],
            }
        };
        (0..20).map(silhouette).collect()
    }

    fn offsets(width: Width, shift_px: f32) -> Vec<f32> {
        let (cells, mut silhouettes) = (cells(), silhouettes());
        let mut candidates = Candidates::default();
        let pixel = |sample: u32| [8.0 * sample as f32, 58.0];
        for silhouette in &mut silhouettes {
            let pixel = pixel(silhouette.sample);
            let reach_px = 12.0;
            let (cells, candidates) = (&cells, &mut candidates);
            width.run(Gather { cells, pixel, reach_px, silhouette, candidates });
        }
        let mut pixels = Coordinates::default();
        pixels.set((0..20).map(|k| [pixel(k)[0], pixel(k)[1] + shift_px, 1.0]));
        let mut offsets_px = Vec::new();
        width.run(Nearest {
            silhouettes: &silhouettes,
            candidates: &candidates,
            pixels: &pixels,
            reach_px: 12.0,
            offsets_px: &mut offsets_px,
        });
        offsets_px
    }

    #[test]
    fn the_nearest_edge_of_the_same_side_is_found() {
        for (k, offset) in offsets(Width::Portable, 0.0).iter().enumerate() {
            let (x, angle) = (8.0 * k as f32, 0.03 * k as f32 - 0.3);
            // The line where the silhouette's normal meets it, by halving.
            let apart = |t: f32| {
                let (x, y) = (x + t * angle.sin(), 58.0 + t * angle.cos());
                y - 60.0 - 5.0 * (0.05 * x).sin()
            };
            let (mut low, mut high) = (-12.0, 12.0);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                *(if apart(middle) < 0.0 { &mut low } else { &mut high }) = middle;
            }
            assert!((offset - low).abs() < 0.5, "{k}: {offset} instead of {low}");
        }
        // Within the margin the candidates are still the right ones, beyond the reach none is.
        let moved = offsets(Width::Portable, 2.0);
        let still = offsets(Width::Portable, 0.0);
        assert!(moved.iter().zip(still).all(|(a, b)| (a + 2.0 - b).abs() < 0.6), "{moved:?}");
        assert!(offsets(Width::Portable, 30.0).iter().all(|offset| offset.is_nan()));
    }

    #[test]
    fn every_width_matches_the_same() {
        let bits = |of: Vec<f32>| of.into_iter().map(f32::to_bits).collect::<Vec<_>>();
        let (cells, expected) = (cells(), bits(offsets(Width::Portable, 1.0)));
        let mut points = [(); 3].map(|()| Coordinates::default());
        for (k, points) in points.iter_mut().enumerate() {
            let x = |n: usize| 15.0 * n as f32 + 5.0 * (k as f32 - 1.0);
            points.set((0..6).map(|n| [x(n), if n == 4 { f32::NAN } else { 63.0 }, 1.0]));
        }
        let marks = |width: Width| {
            let mut marks = vec![0.0; cells.len() + LANES];
            let pieces = points.each_ref();
            width.run(Mark { cells: &cells, pieces, count: 6, within_px: 4.0, marks: &mut marks });
            marks
        };
        let portable = marks(Width::Portable);
        let marked = portable.iter().filter(|mark| **mark > 0.0).count();
        assert!((20..80).contains(&marked), "{marked}");
        for width in Width::available() {
            assert_eq!(bits(offsets(width, 1.0)), expected, "{width:?}");
            assert_eq!(marks(width), portable, "{width:?}");
        }
    }
}
