//! A depth image of the model sheet, as one camera would see it.

use crate::projector::{Coordinates, Projector};
use nalgebra::Isometry3;
use orime_geometry::{CameraModel, SheetGrid};
use orime_lanes::{LANES, Lanes, Pass, Width};

/// No triangle covers this pixel.
pub(crate) const EMPTY: u32 = u32::MAX;

/// Inverse depth and triangle per pixel.
#[derive(Debug, Clone)]
pub(crate) struct ZBuffer {
    projector: Projector,
    pub width: usize,
    pub height: usize,
    /// 1/z, 1/m; 0 where empty. A vector of room behind, as `triangle`.
    inverse_depth: Vec<f32>,
    /// Index of the front triangle, as a number; whatever was there before where empty.
    triangle: Vec<f32>,
    /// The nodes, and where they are in the image: column, row, 1/z; NaN where not in front.
    nodes_m: Coordinates,
    projected: Coordinates,
    /// Rows and columns that were drawn to and must be cleared.
    drawn: [usize; 4],
    lanes: Width,
}

impl ZBuffer {
    /// For a camera; `scale` ≤ 1 makes it coarser than the lens.
    pub fn new(lens: &CameraModel, world_from_camera: &Isometry3<f64>, scale: f64) -> Self {
        let width = (f64::from(lens.width) * scale).ceil() as usize;
        let height = (f64::from(lens.height) * scale).ceil() as usize;
        Self {
            projector: Projector::new(lens, world_from_camera, scale),
            width,
            height,
            inverse_depth: vec![0.0; width * height + LANES],
            triangle: vec![0.0; width * height + LANES],
            lanes: Width::available()[0],
            nodes_m: Coordinates::default(),
            projected: Coordinates::default(),
            drawn: [0; 4],
        }
    }

    /// Stands the camera elsewhere.
    pub fn stand(&mut self, world_from_camera: &Isometry3<f64>) {
        self.projector.stand(world_from_camera);
    }

    /// Draws the sheet.
    pub fn draw(&mut self, nodes_m: &[[f32; 3]], triangles: &[[u32; 3]]) {
        self.clear();
        self.nodes_m.set(nodes_m.iter().copied());
        self.projector.project(&self.nodes_m.axes, &mut self.projected);
        self.lanes.run(Draw { buffer: self, triangles });
    }

    /// Column, row and 1/z of world points, see [`Projector::project`].
    pub fn project(&self, at_m: &[Vec<f32>; 3], projected: &mut Coordinates) {
        self.projector.project(at_m, projected);
    }

    /// Triangle and 1/z at a pixel; `EMPTY` and 0 outside.
    #[inline]
    pub fn at(&self, column: f32, row: f32) -> (u32, f32) {
        let (x, y) = (column.round(), row.round());
        if !(0.0 <= x && x < self.width as f32 && 0.0 <= y && y < self.height as f32) {
            return (EMPTY, 0.0);
        }
        self.of_pixel(y as usize * self.width + x as usize)
    }

    #[inline]
    fn of_pixel(&self, at: usize) -> (u32, f32) {
        let inverse_depth = self.inverse_depth[at];
        (if inverse_depth > 0.0 { self.triangle[at] as u32 } else { EMPTY }, inverse_depth)
    }

    /// Whether `least` of the pixels from one left above to one right below a place are covered by
    /// a triangle that `is_asked_for`.
    #[inline]
    pub fn shows_around(
        &self,
        column: f32,
        row: f32,
        least: u32,
        is_asked_for: impl Fn(u32) -> bool,
    ) -> bool {
        let (x, y) = (column.round(), row.round());
        let [right, bottom] = [self.width, self.height].map(|size| size as f32 - 1.0);
        if !(0.0 <= x && x <= right && 0.0 <= y && y <= bottom) {
            return false;
        }
        let range =
            |at: f32, last: f32| (at - 1.0).max(0.0) as usize..(at + 1.0).min(last) as usize + 1;
        let mut count = 0;
        for y in range(y, bottom) {
            for at in range(x, right).map(|x| y * self.width + x) {
                let (triangle, _) = self.of_pixel(at);
                count += u32::from(triangle != EMPTY && is_asked_for(triangle));
                // Most places are seen, and told by their first pixels.
                if count >= least {
                    return true;
                }
            }
        }
        false
    }

    /// Whether a pixel lies in the image.
    pub fn holds(&self, column: f32, row: f32) -> bool {
        let inside = |at: f32, size: usize| -0.5 <= at && at < size as f32 - 0.5;
        inside(column, self.width) && inside(row, self.height)
    }

    fn clear(&mut self) {
        let [top, bottom, left, right] = self.drawn;
        for y in top..bottom {
            self.inverse_depth[y * self.width + left..y * self.width + right].fill(0.0);
        }
        self.drawn = [0; 4];
    }
}

/// Draws all triangles, up to sixteen pixels of a row at a time.
struct Draw<'a> {
    buffer: &'a mut ZBuffer,
    triangles: &'a [[u32; 3]],
}

impl Pass for Draw<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let ZBuffer { width, height, inverse_depth, triangle, projected, .. } = self.buffer;
        let mut drawn = [*height, 0, *width, 0];
        let mut image = Image { size: [*width, *height], inverse_depth, triangle };
        for (index, corners) in self.triangles.iter().enumerate() {
            let [a, b, c] = *corners;
            let p = [projected.at(a as usize), projected.at(b as usize), projected.at(c as usize)];
            fill::<V>(&mut image, index as f32, p, &mut drawn);
        }
        self.buffer.drawn = drawn;
    }
}

/// What is drawn to.
struct Image<'a> {
    size: [usize; 2],
    inverse_depth: &'a mut [f32],
    triangle: &'a mut [f32],
}

/// Fills one triangle: 1/z is linear in the image.
#[inline(always)]
fn fill<V: Lanes>(image: &mut Image<'_>, index: f32, p: [[f32; 3]; 3], drawn: &mut [usize; 4]) {
    let area =
        (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]);
    if area.is_nan() || area.abs() <= 1e-6 {
        return;
    }
    let [columns, rows] = [range(&p, 0, image.size[0]), range(&p, 1, image.size[1])];
    if columns.is_empty() || rows.is_empty() {
        return;
    }
    drawn[0] = drawn[0].min(rows.start);
    drawn[1] = drawn[1].max(rows.end);
    drawn[2] = drawn[2].min(columns.start);
    drawn[3] = drawn[3].max(columns.end);
    // Barycentric weights of corners 1 and 2, linear in column and row.
    let inverse = 1.0 / area;
    let (b_x, b_y) = ((p[2][1] - p[0][1]) * inverse, -(p[2][0] - p[0][0]) * inverse);
    let (c_x, c_y) = (-(p[1][1] - p[0][1]) * inverse, (p[1][0] - p[0][0]) * inverse);
    let (w_b, w_c) = (V::splat(p[1][2] - p[0][2]), V::splat(p[2][2] - p[0][2]));
    const EDGE: f32 = 1e-5;
    let (least, most) = (V::splat(-EDGE), V::splat(1.0 + EDGE));
    for y in rows {
        let dy = y as f32 - p[0][1];
        for first in columns.clone().step_by(LANES) {
            let dx = V::splat(first as f32 - p[0][0]).add(steps::<V>());
            let b = V::splat(b_x).mul(dx).add(V::splat(b_y * dy));
            let c = V::splat(c_x).mul(dx).add(V::splat(c_y * dy));
            let mut bits = b.above(least) & c.above(least) & most.above(b.add(c));
            bits &= u16::MAX >> (LANES - (columns.end - first).min(LANES));
            if bits == 0 {
                continue;
            }
            let depth = V::splat(p[0][2]).add(b.mul(w_b)).add(c.mul(w_c));
            let at = y * image.size[0] + first;
            let depths: &mut [f32] = &mut image.inverse_depth[at..at + LANES];
            let triangles: &mut [f32] = &mut image.triangle[at..at + LANES];
            // SAFETY: both slices have sixteen numbers.
            unsafe {
                let before = V::load(depths.as_ptr());
                bits &= depth.above(before);
                depth.select(before, bits).store(depths.as_mut_ptr());
                let before = V::load(triangles.as_ptr());
                V::splat(index).select(before, bits).store(triangles.as_mut_ptr());
            }
        }
    }
}

/// Columns (axis 0) or rows that a triangle may cover.
#[inline(always)]
fn range(p: &[[f32; 3]; 3], axis: usize, size: usize) -> std::ops::Range<usize> {
    let least = p[0][axis].min(p[1][axis]).min(p[2][axis]);
    let most = p[0][axis].max(p[1][axis]).max(p[2][axis]);
    least.ceil().max(0.0) as usize..((most.floor() + 1.0).max(0.0) as usize).min(size)
}

/// 0, 1, … 15.
#[inline(always)]
fn steps<V: Lanes>() -> V {
    const STEPS: [f32; LANES] =
        [0., 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12., 13., 14., 15.];
    // SAFETY: the array has sixteen numbers.
    unsafe { V::load(STEPS.as_ptr()) }
}

/// Material coordinates of each triangle's centre, metres.
pub(crate) fn centres_m(sheet: &SheetGrid, triangles: &[[u32; 3]]) -> Vec<[f32; 2]> {
    let uv: Vec<[f64; 2]> = sheet.uv_m().collect();
    let centre = |corners: &[u32; 3]| {
        [0, 1].map(|axis| (corners.iter().map(|n| uv[*n as usize][axis]).sum::<f64>() / 3.0) as f32)
    };
    triangles.iter().map(centre).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens() -> CameraModel {
        CameraModel {
            width: 64,
            height: 48,
            fx_px: 60.0,
            fy_px: 60.0,
            cx_px: 31.5,
            cy_px: 23.5,
            distortion: [0.0; 5],
        }
    }

    #[test]
    fn the_nearer_layer_is_in_front_and_a_second_drawing_forgets_the_first() {
        // Two squares, 0.1 m apart in depth, the nearer half as wide.
        let square = |half: f32, z: f32| {
            [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]
        };
        let nodes: Vec<[f32; 3]> = square(0.1, 0.5).into_iter().chain(square(0.05, 0.4)).collect();
        let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let mut buffer = ZBuffer::new(&lens(), &Isometry3::identity(), 1.0);
        buffer.draw(&nodes, &triangles);
        let (triangle, inverse) = buffer.at(31.0, 20.0);
        assert!(triangle >= 2 && (inverse - 2.5).abs() < 1e-5);
        let (triangle, inverse) = buffer.at(31.5 + 11.0, 20.0);
        assert!(triangle < 2 && (inverse - 2.0).abs() < 1e-5);
        assert_eq!(buffer.at(2.0, 2.0).0, EMPTY);
        assert_eq!(buffer.at(-1.0, 2.0).0, EMPTY);
        // The nearer square ends at column 39.
        for (is_near, count) in [(true, 6), (false, 3)] {
            let is_asked_for = |triangle: u32| (triangle >= 2) == is_near;
            assert!(buffer.shows_around(39.0, 20.2, count, is_asked_for));
            assert!(!buffer.shows_around(39.0, 20.2, count + 1, is_asked_for));
        }
        assert!(!buffer.shows_around(f32::NAN, 20.0, 1, |_| true));
        // Every pixel inside is covered: no cracks along the diagonal.
        let covered = (0..48 * 64).filter(|k| buffer.of_pixel(*k).0 != EMPTY).count();
        assert_eq!(covered, 24 * 24);
        buffer.draw(&[[0.0, 0.0, -1.0]; 4], &triangles[..2]);
        assert_eq!((0..48 * 64).filter(|k| buffer.of_pixel(*k).0 != EMPTY).count(), 0);
    }

    #[test]
    fn every_width_draws_the_same_image() {
        let sheet = SheetGrid::new([0.15, 0.15], [9, 9]);
        // Rolled up, so that layers lie over each other.
        let rolled = sheet.flat_m().into_iter().map(|[x, y, _]| {
            let radius = 0.02 + 0.05 * (x + 0.075);
            let angle = (x + 0.075) * 60.0;
            [radius * angle.cos(), y, 0.3 + radius * angle.sin()]
        });
        let rolled: Vec<[f32; 3]> = rolled.collect();
        let image = |width: Width| {
            let mut buffer = ZBuffer::new(&lens(), &Isometry3::identity(), 1.0);
            buffer.lanes = width;
            buffer.draw(&rolled, &sheet.triangles());
            (0..48 * 64).map(|k| buffer.of_pixel(k)).collect::<Vec<_>>()
        };
        let portable = image(Width::Portable);
        assert!(portable.iter().filter(|pixel| pixel.0 != EMPTY).count() > 100);
        for width in Width::available() {
            assert!(image(width) == portable, "{width:?}");
        }
    }
}
