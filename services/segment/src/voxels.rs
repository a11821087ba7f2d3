//! Averages surface points over the cells of a regular grid in the world.

use orime_geometry::ObservedPoint;
use orime_lanes::{Lanes, Pass, Width};

use crate::bits::{BitImage, pack};
use crate::depth::{DepthMap, WorldRow};

/// Nobody has taken this slot of the hash table.
const FREE: u32 = u32::MAX;

/// How far on either side a normal is measured from, pixels.
const REACH_PX: [usize; 2] = [2, 4];

/// Every other pixel of nine.
const EVEN: u32 = 0b1_0101_0101;

/// Points per cell of one camera's image.
#[derive(Debug)]
pub(crate) struct Voxels {
    size_m: f32,
    per_m: f32,
    camera: u32,
    cells: Vec<Cell>,
    cells_max: usize,
    /// Open addressing; a power of two, at least twice `cells_max`.
    slots: Vec<u32>,
    /// Cell of the last run that ended in each column.
    above: Vec<u32>,
    left_out: u32,
    pub lanes: Width,
}

/// Cells of the 64 pixels of a word, and where in their cells they lie, metres; by coordinate.
/// Nothing of use where there is no depth.
struct Points {
    /// Of pixel `n` at `n + 1`, so that each has one before it.
    key: [[i32; 65]; 3],
    offset_m: [[f32; 64]; 3],
    /// Pixels whose cell is not that of the pixel before.
    changes: u64,
}

impl Points {
    const EMPTY: Self = Self { key: [[0; 65]; 3], offset_m: [[0.0; 64]; 3], changes: 0 };

    fn key(&self, bit: usize) -> [i32; 3] {
        [self.key[0][bit + 1], self.key[1][bit + 1], self.key[2][bit + 1]]
    }
}

/// Finds the cells of a word's pixels.
struct Place<'a> {
    row: &'a WorldRow<'a>,
    /// First pixel.
    start: usize,
    /// Side of a cell, and its inverse.
    size_m: [f32; 2],
    points: &'a mut Points,
}

impl Pass for Place<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { row, start, size_m: [size_m, per_m], points } = self;
        for axis in 0..3 {
            let origin_m = row.origin_m[axis];
            let (z_m, rays) = (&row.z_m[start..], &row.rays[axis][start..]);
            let keys = &mut points.key[axis][1..];
            let pixels = keys.iter_mut().zip(&mut points.offset_m[axis]);
            let place = |((key, offset), (z, ray)): ((&mut i32, &mut f32), (&f32, &f32))| {
                let position_m = origin_m + z * ray;
                *key = floor(position_m * per_m);
                *offset = position_m - *key as f32 * size_m;
            };
            // A loop of known length has no remainder.
            match (z_m.first_chunk::<64>(), rays.first_chunk::<64>()) {
                (Some(z_m), Some(rays)) => pixels.zip(z_m.iter().zip(rays)).for_each(place),
                _ => pixels.zip(z_m.iter().zip(rays)).for_each(place),
            }
        }
        let mut changes = [0; 64];
        let [x, y, z] = &points.key;
        for (n, change) in changes.iter_mut().enumerate() {
            let other = (x[n] != x[n + 1]) | (y[n] != y[n + 1]) | (z[n] != z[n + 1]);
            *change = u8::from(other);
        }
        points.changes = pack(&changes);
    }
}

#[derive(Debug, Clone, Copy)]
struct Cell {
    key: [i32; 3],
    /// Slot that holds this cell, to free it.
    slot: u32,
    pixels: f32,
    /// Sums over the pixels: position relative to the cell's corner, and pixel coordinates.
    offset_m: [f32; 3],
    pixel: [f32; 2],
}

impl Cell {
    const EMPTY: Self =
        Self { key: [i32::MIN; 3], slot: FREE, pixels: 0.0, offset_m: [0.0; 3], pixel: [0.0; 2] };
}

impl Voxels {
    /// Memory for `cells_max` cells of side `size_m` from images `width` pixels wide.
    pub fn new(size_m: f32, camera: u32, cells_max: usize, width: usize) -> Self {
        Self {
            size_m,
            per_m: 1.0 / size_m,
            camera,
            cells: Vec::with_capacity(cells_max),
            cells_max,
            slots: vec![FREE; (2 * cells_max).next_power_of_two()],
            above: vec![FREE; width],
            left_out: 0,
            lanes: Width::available()[0],
        }
    }

    /// Forgets all points.
    pub fn clear(&mut self) {
        for cell in self.cells.drain(..) {
            self.slots[cell.slot as usize] = FREE;
        }
        self.left_out = 0;
    }

    /// Takes the points of `pixels` of the loaded image, in raster order.
    pub fn add(&mut self, map: &DepthMap, pixels: &BitImage) {
        let (mut sum, mut last) = (Cell::EMPTY, 0);
        let mut points = Points::EMPTY;
        for y in 0..map.height {
            let row = map.world_row(y);
            for (k, word) in pixels.row(y).iter().enumerate() {
                if *word == 0 {
                    continue;
                }
                self.lanes.run(Place {
                    row: &row,
                    start: 64 * k,
                    size_m: [self.size_m, self.per_m],
                    points: &mut points,
                });
                let mut rest = *word;
                while rest != 0 {
                    let bit = rest.trailing_zeros() as usize;
                    // Neighbours are often in the same cell: so many pixels from `bit` on.
                    let ends = !(rest >> bit) | points.changes >> bit & !1;
                    let n = ends.trailing_zeros() as usize;
                    rest &= !1 << (bit + n - 1);
                    let key = points.key(bit);
                    if key != sum.key {
                        self.merge(&sum, last);
                        sum = Cell { key, ..Cell::EMPTY };
                    }
                    last = 64 * k + bit + n - 1;
                    sum.pixels += n as f32;
                    for (sum, offset_m) in sum.offset_m.iter_mut().zip(&points.offset_m) {
                        offset_m[bit..bit + n].iter().for_each(|offset_m| *sum += offset_m);
                    }
                    // Whole numbers, in any order.
                    sum.pixel[0] += ((2 * last + 1 - n) * n / 2) as f32;
                    sum.pixel[1] += (y * n) as f32;
                }
            }
        }
        self.merge(&sum, last);
    }

    /// Adds the sums of a few pixels of a row, the last of them at column `x`, to their cell.
    fn merge(&mut self, sum: &Cell, x: usize) {
        if sum.pixels == 0.0 {
            return;
        }
        // The row above was often in the same cell.
        let above = self.cells.get(self.above[x] as usize).filter(|cell| cell.key == sum.key);
        let found = match above {
            Some(_) => Some(self.above[x] as usize),
            None => self.find(sum.key),
        };
        let Some(index) = found else {
            self.left_out += sum.pixels as u32;
            return;
        };
        self.above[x] = index as u32;
        let cell = &mut self.cells[index];
        cell.pixels += sum.pixels;
        (0..3).for_each(|axis| cell.offset_m[axis] += sum.offset_m[axis]);
        (0..2).for_each(|axis| cell.pixel[axis] += sum.pixel[axis]);
    }

    /// The cell of a key, a new one if need be; `None` when there is no room.
    fn find(&mut self, key: [i32; 3]) -> Option<usize> {
        let mask = self.slots.len() - 1;
        let mut slot = hash(key) as usize & mask;
        while self.slots[slot] != FREE {
            let index = self.slots[slot] as usize;
            if self.cells[index].key == key {
                return Some(index);
            }
            slot = (slot + 1) & mask;
        }
        if self.cells.len() == self.cells_max {
            return None;
        }
        self.slots[slot] = self.cells.len() as u32;
        self.cells.push(Cell { key, slot: slot as u32, ..Cell::EMPTY });
        Some(self.cells.len() - 1)
    }

    /// Writes the averaged points, in the order in which their cells were first met. `surface`
    /// are the pixels that were added, or more of the same surface.
    pub fn average(&self, map: &DepthMap, surface: &BitImage, out: &mut Vec<ObservedPoint>) {
        out.clear();
        out.extend((0..self.cells.len()).map(|k| self.point(k, map, surface)));
    }

    /// Pixels that found no cell because all were taken.
    pub fn left_out(&self) -> u32 {
        self.left_out
    }

    fn point(&self, index: usize, map: &DepthMap, surface: &BitImage) -> ObservedPoint {
        let cell = &self.cells[index];
        let position =
            |axis: usize| cell.key[axis] as f32 * self.size_m + cell.offset_m[axis] / cell.pixels;
        let mean = |sum: f32| (sum / cell.pixels + 0.5) as usize;
        let (x, y) = (mean(cell.pixel[0]), mean(cell.pixel[1]));
        ObservedPoint {
            position_m: [position(0), position(1), position(2)],
            normal: normal(map, surface, x, y).unwrap_or([0.0; 3]),
            camera: self.camera,
            pixels: cell.pixels,
        }
    }
}

/// Unit normal of the surface at a depth pixel, towards the camera, world axes.
///
/// With `P = z r` the surface has the tangents `P_u = z_u r + z r_u` and `P_v` alike; the slopes
/// `z_u`, `z_v` are least-squares over symmetric pairs of pixels [`REACH_PX`] away, in three
/// rows (columns). `None` with fewer than two pairs either way.
fn normal(map: &DepthMap, surface: &BitImage, x: usize, y: usize) -> Option<[f32; 3]> {
    let inside = |at: usize, size: usize| REACH_PX[1] <= at && at + REACH_PX[1] < size;
    if !inside(x, map.width) || !inside(y, map.height) || !surface.get(x, y) {
        return None;
    }
    // Bit `n` of row `m` is the pixel `n - 4` beside and `2 m - 4` below.
    let nine = |m: usize| surface.nine(x - 4, y + 2 * m - 4);
    let near = [nine(0), nine(1), nine(2), nine(3), nine(4)];
    let (depths, stride) = map.z_around(x, y);
    let z_m = |dx: usize, dy: usize| depths[dy * stride + dx];
    let set = |dx: usize, dy: usize| near[dy / 2] >> dx & 1 == 1;
    // Well inside, nothing has to be asked.
    let all = near[0] & near[1] & near[2] & near[3] & near[4] & EVEN == EVEN;
    let z_u = if all { slope(|_, _| true, z_m) } else { slope(set, z_m) }?;
    let z_m = |along: usize, side: usize| z_m(side, along);
    let z_v =
        if all { slope(|_, _| true, z_m) } else { slope(|along, side| set(side, along), z_m) }?;
    let z = map.z_m(x as i32, y as i32);
    let ray = map.world_ray(x, y);
    let (right, left) = (map.world_ray(x + 1, y), map.world_ray(x - 1, y));
    let (below, above) = (map.world_ray(x, y + 1), map.world_ray(x, y - 1));
    let (mut tangent_u, mut tangent_v) = ([0.0; 3], [0.0; 3]);
    for axis in 0..3 {
        tangent_u[axis] = z_u * ray[axis] + z * ((right[axis] - left[axis]) / 2.0);
        tangent_v[axis] = z_v * ray[axis] + z * ((below[axis] - above[axis]) / 2.0);
    }
    let n = cross(tangent_v, tangent_u);
    let length = dot(n, n).sqrt();
    let sign = if dot(n, ray) <= 0.0 { 1.0 } else { -1.0 };
    (length > 0.0).then(|| [sign * n[0] / length, sign * n[1] / length, sign * n[2] / length])
}

/// Slope of depth along one direction, metres a pixel, from pixels `(along, side)` of a window of
/// nine by nine: whether they are the surface's, and their depths.
#[inline(always)]
fn slope(set: impl Fn(usize, usize) -> bool, z_m: impl Fn(usize, usize) -> f32) -> Option<f32> {
    let (mut rise, mut run, mut pairs) = (0.0, 0.0, 0);
    for side in [2, 4, 6] {
        for n in REACH_PX {
            if set(4 - n, side) && set(4 + n, side) {
                rise += n as f32 * (z_m(4 + n, side) - z_m(4 - n, side));
                run += (2 * n * n) as f32;
                pairs += 1;
            }
        }
    }
    (pairs >= 2).then(|| rise / run)
}

/// The largest integer not above `x`, or 0 where that is none (no depth) or beyond any cell;
/// without a call into the mathematics library.
#[inline(always)]
fn floor(x: f32) -> i32 {
    let x = if x.abs() < (1 << 30) as f32 { x } else { 0.0 };
    // SAFETY: finite and in (-2^30, 2^30). The checked conversion has half again as many steps.
    let towards_zero = unsafe { x.to_int_unchecked::<i32>() };
    towards_zero - i32::from(towards_zero as f32 > x)
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn hash([x, y, z]: [i32; 3]) -> u64 {
    let mut h = (x as u32 as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    h = (h ^ y as u32 as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ h >> 29 ^ z as u32 as u64).wrapping_mul(0x94d0_49bb_1331_11eb);
    h ^ h >> 32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::SegmentParams;
    use orime_geometry::nalgebra::Isometry3;
    use orime_geometry::{CameraModel, RgbdCamera};

    /// A wall at 1 m: pixel `x` is at `0.005 + 0.01 x` metres, pixel `y` alike.
    fn wall() -> DepthMap {
        let lens = CameraModel {
            width: 4,
            height: 2,
            fx_px: 100.0,
            fy_px: 100.0,
            cx_px: -0.5,
            cy_px: -0.5,
            distortion: [0.0; 5],
        };
        let camera = RgbdCamera {
            name: String::new(),
            color: lens.clone(),
            depth: lens,
            color_from_depth: Isometry3::identity(),
            world_from_color: Isometry3::translation(0.0, -1.0, 0.01),
            depth_m_per_unit: 0.001,
        };
        let mut map = DepthMap::new(&camera, &SegmentParams::default());
        // The last column is 4 mm nearer; its two points stay in the cell of the column before.
        map.load(&[1000, 1000, 1000, 996, 1000, 1000, 1000, 996]);
        map
    }

    fn average(cells_max: usize) -> (Vec<[f32; 4]>, u32) {
        let map = wall();
        let mut pixels = map.valid.clone();
        // One pixel is not the sheet's.
        pixels.row_mut(0)[0] &= !0b0010;
        let mut voxels = Voxels::new(0.02, 7, cells_max, 4);
        let mut points = Vec::new();
        for _ in 0..2 {
            voxels.clear();
            voxels.add(&map, &pixels);
            voxels.average(&map, &pixels, &mut points);
        }
        assert!(points.iter().all(|p| p.camera == 7 && p.normal == [0.0; 3]));
        let flat =
            points.iter().map(|p| [p.position_m[0], p.position_m[1], p.position_m[2], p.pixels]);
        (flat.collect(), voxels.left_out())
    }

    #[test]
    fn cells_average_their_pixels_and_count_them() {
        let (points, left_out) = average(10);
        // Pixels 0, 4 and 5: x (5 + 5 + 15)/3 mm, y (5 + 15 + 15)/3 - 1000 mm.
        // Pixels 2, 6 and the nearer 3, 7: x (25 + 25 + 2 · 35 · 0.996)/4 mm, z 1010 - 2 mm.
        let expected =
            [[0.025 / 3.0, 0.035 / 3.0 - 1.0, 1.01, 3.0], [0.02993, 0.009_98 - 1.0, 1.008, 4.0]];
        assert_eq!((points.len(), left_out), (2, 0));
        for (point, expected) in points.iter().zip(expected) {
            for (a, b) in point.iter().zip(expected) {
                assert!((a - b).abs() < 1e-6, "{points:?}");
            }
        }
    }

    #[test]
    fn what_finds_no_cell_is_counted() {
        let (points, left_out) = average(1);
        assert_eq!((points.len(), left_out), (1, 4));
    }
}
