//! Averages surface points over the cells of a regular grid in the world.

use orime_geometry::ObservedPoint;

use crate::bits::BitImage;
use crate::depth::DepthMap;

/// Nobody has taken this slot of the hash table.
const FREE: u32 = u32::MAX;

/// Farthest pixels that a normal is measured from, and their spacing.
const REACH_PX: i32 = 4;

/// Points per cell of one camera's image.
#[derive(Debug)]
pub(crate) struct Voxels {
    size_m: f32,
    camera: u32,
    cells: Vec<Cell>,
    cells_max: usize,
    /// Open addressing; a power of two, at least twice `cells_max`.
    slots: Vec<u32>,
    /// Pixels that found no cell since `cells_max` were taken.
    pub left_out: u32,
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

impl Voxels {
    /// Memory for `cells_max` cells of side `size_m`.
    pub fn new(size_m: f32, camera: u32, cells_max: usize) -> Self {
        Self {
            size_m,
            camera,
            cells: Vec::with_capacity(cells_max),
            cells_max,
            slots: vec![FREE; (2 * cells_max).next_power_of_two()],
            left_out: 0,
        }
    }

    /// Cells that hold points.
    pub fn len(&self) -> usize {
        self.cells.len()
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
        let mut last: Option<usize> = None;
        for y in 0..map.height {
            for k in 0..pixels.words {
                let mut rest = pixels.row(y)[k];
                while rest != 0 {
                    let x = 64 * k + rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    last = self.add_point(map.world_m(x, y), [x as f32, y as f32], last);
                }
            }
        }
    }

    /// Adds one point; `last` is the cell of the point before, which is often the same.
    fn add_point(
        &mut self,
        position_m: [f32; 3],
        pixel: [f32; 2],
        last: Option<usize>,
    ) -> Option<usize> {
        let key = position_m.map(|x| (x / self.size_m).floor() as i32);
        let found = last.filter(|k| self.cells[*k].key == key).or_else(|| self.find(key));
        let Some(index) = found else {
            self.left_out += 1;
            return None;
        };
        let cell = &mut self.cells[index];
        cell.pixels += 1.0;
        for axis in 0..3 {
            cell.offset_m[axis] += position_m[axis] - key[axis] as f32 * self.size_m;
        }
        cell.pixel[0] += pixel[0];
        cell.pixel[1] += pixel[1];
        found
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
        self.cells.push(Cell {
            key,
            slot: slot as u32,
            pixels: 0.0,
            offset_m: [0.0; 3],
            pixel: [0.0; 2],
        });
        Some(self.cells.len() - 1)
    }

    /// The averaged point of cell `index`, in the order in which the cells were first met.
    pub fn point(&self, index: usize, map: &DepthMap, surface: &BitImage) -> ObservedPoint {
        let cell = &self.cells[index];
        let position =
            |axis: usize| cell.key[axis] as f32 * self.size_m + cell.offset_m[axis] / cell.pixels;
        let [x, y] = cell.pixel.map(|sum| (sum / cell.pixels).round() as i32);
        ObservedPoint {
            position_m: [0, 1, 2].map(position),
            normal: normal(map, surface, x, y).unwrap_or([0.0; 3]),
            camera: self.camera,
            pixels: cell.pixels,
        }
    }
}

/// Unit normal of the surface at a depth pixel, towards the camera, world axes.
///
/// With `P = z r` the surface has the tangents `P_u = z_u r + z r_u` and `P_v` alike; the slopes
/// `z_u`, `z_v` are least-squares over symmetric pairs of pixels up to [`REACH_PX`] away, in
/// three rows (columns). `None` with fewer than two pairs either way.
fn normal(map: &DepthMap, surface: &BitImage, x: i32, y: i32) -> Option<[f32; 3]> {
    let slope = |along: [i32; 2], across: [i32; 2]| {
        let (mut rise, mut run, mut pairs) = (0.0, 0.0, 0);
        for side in [-2, 0, 2] {
            for n in 1..=REACH_PX {
                let at = |sign: i32| {
                    let dx = sign * n * along[0] + side * across[0];
                    let dy = sign * n * along[1] + side * across[1];
                    surface.get_or_unset(x + dx, y + dy).then(|| map.z_m(x + dx, y + dy))
                };
                if let (Some(after), Some(before)) = (at(1), at(-1)) {
                    rise += n as f32 * (after - before);
                    run += (2 * n * n) as f32;
                    pairs += 1;
                }
            }
        }
        (pairs >= 2).then(|| rise / run)
    };
    let z_u = slope([1, 0], [0, 1])?;
    let z_v = slope([0, 1], [1, 0])?;
    let (x, y) = (x as usize, y as usize);
    let z = map.z_m(x as i32, y as i32);
    let ray = map.world_ray(x, y);
    // A pair on either side of the pixel was found, so the neighbours exist.
    let half = |a, b| difference(a, b).map(|d| d / 2.0);
    let ray_u = half(map.world_ray(x + 1, y), map.world_ray(x - 1, y));
    let ray_v = half(map.world_ray(x, y + 1), map.world_ray(x, y - 1));
    let tangent_u = [0, 1, 2].map(|k| z_u * ray[k] + z * ray_u[k]);
    let tangent_v = [0, 1, 2].map(|k| z_v * ray[k] + z * ray_v[k]);
    let n = cross(tangent_v, tangent_u);
    let length = dot(n, n).sqrt();
    let sign = if dot(n, ray) <= 0.0 { 1.0 } else { -1.0 };
    (length > 0.0).then(|| n.map(|x| sign * x / length))
}

fn difference(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
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
