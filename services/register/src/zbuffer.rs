//! A depth image of the model sheet, as one camera would see it.

use nalgebra::{Isometry3, Point3, Vector2};
use orime_geometry::{CameraModel, SheetGrid};

/// No triangle covers this pixel.
pub(crate) const EMPTY: u32 = u32::MAX;

/// Inverse depth and triangle per pixel.
#[derive(Debug, Clone)]
pub(crate) struct ZBuffer {
    camera_from_world: Isometry3<f64>,
    lens: CameraModel,
    /// Pixels of this buffer per pixel of the lens.
    scale: f64,
    pub width: usize,
    pub height: usize,
    /// 1/z, 1/m; 0 where empty.
    inverse_depth: Vec<f32>,
    triangle: Vec<u32>,
    /// Projected nodes: column, row, 1/z; NaN where not in front of the camera.
    projected: Vec<[f32; 3]>,
    /// Rows and columns that were drawn to and must be cleared.
    drawn: [usize; 4],
}

impl ZBuffer {
    /// For a camera; `scale` ≤ 1 makes it coarser than the lens.
    pub fn new(lens: &CameraModel, world_from_camera: &Isometry3<f64>, scale: f64) -> Self {
        let width = (f64::from(lens.width) * scale).ceil() as usize;
        let height = (f64::from(lens.height) * scale).ceil() as usize;
        Self {
            camera_from_world: world_from_camera.inverse(),
            lens: lens.clone(),
            scale,
            width,
            height,
            inverse_depth: vec![0.0; width * height],
            triangle: vec![EMPTY; width * height],
            projected: Vec::new(),
            drawn: [0; 4],
        }
    }

    /// Draws the sheet.
    pub fn draw(&mut self, nodes_m: &[[f32; 3]], triangles: &[[u32; 3]]) {
        self.clear();
        self.projected.clear();
        for node in nodes_m {
            let projected = self.project(*node);
            self.projected.push(projected.unwrap_or([f32::NAN; 3]));
        }
        let mut drawn = [self.height, 0, self.width, 0];
        for (index, corners) in triangles.iter().enumerate() {
            let p = corners.map(|node| self.projected[node as usize]);
            self.fill(index as u32, p, &mut drawn);
        }
        self.drawn = drawn;
    }

    /// Column, row and 1/z of a world point; `None` behind the camera.
    pub fn project(&self, point_m: [f32; 3]) -> Option<[f32; 3]> {
        let point = self.camera_from_world * Point3::from(point_m).cast::<f64>();
        let pixel: Vector2<f64> = self.lens.project(&point)? * self.scale;
        Some([pixel.x as f32, pixel.y as f32, (1.0 / point.z) as f32])
    }

    /// Triangle and 1/z at a pixel; `EMPTY` and 0 outside.
    #[inline]
    pub fn at(&self, column: f32, row: f32) -> (u32, f32) {
        let (x, y) = (column.round(), row.round());
        if !(0.0 <= x && x < self.width as f32 && 0.0 <= y && y < self.height as f32) {
            return (EMPTY, 0.0);
        }
        let at = y as usize * self.width + x as usize;
        (self.triangle[at], self.inverse_depth[at])
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
            self.triangle[y * self.width + left..y * self.width + right].fill(EMPTY);
        }
        self.drawn = [0; 4];
    }

    /// Fills one triangle: 1/z is linear in the image.
    fn fill(&mut self, index: u32, p: [[f32; 3]; 3], drawn: &mut [usize; 4]) {
        let area =
            (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]);
        if area.is_nan() || area.abs() <= 1e-6 {
            return;
        }
        let least = |axis: usize| p[0][axis].min(p[1][axis]).min(p[2][axis]);
        let most = |axis: usize| p[0][axis].max(p[1][axis]).max(p[2][axis]);
        let range = |axis: usize, size: usize| {
            let first = least(axis).ceil().max(0.0) as usize;
            first..((most(axis).floor() + 1.0).max(0.0) as usize).min(size)
        };
        let (columns, rows) = (range(0, self.width), range(1, self.height));
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        *drawn = [
            drawn[0].min(rows.start),
            drawn[1].max(rows.end),
            drawn[2].min(columns.start),
            drawn[3].max(columns.end),
        ];
        // Barycentric weights of corners 1 and 2, linear in column and row.
        let inverse = 1.0 / area;
        let b_x = (p[2][1] - p[0][1]) * inverse;
        let b_y = -(p[2][0] - p[0][0]) * inverse;
        let c_x = -(p[1][1] - p[0][1]) * inverse;
        let c_y = (p[1][0] - p[0][0]) * inverse;
        let (w_b, w_c) = (p[1][2] - p[0][2], p[2][2] - p[0][2]);
        const EDGE: f32 = -1e-5;
        for y in rows {
            let dy = y as f32 - p[0][1];
            for x in columns.clone() {
                let dx = x as f32 - p[0][0];
                let (b, c) = (b_x * dx + b_y * dy, c_x * dx + c_y * dy);
                if b >= EDGE && c >= EDGE && b + c <= 1.0 - EDGE {
                    let inverse_depth = p[0][2] + b * w_b + c * w_c;
                    let at = y * self.width + x;
                    if inverse_depth > self.inverse_depth[at] {
                        self.inverse_depth[at] = inverse_depth;
                        self.triangle[at] = index;
                    }
                }
            }
        }
    }
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
        // Every pixel inside is covered: no cracks along the diagonal.
        let covered = (0..48 * 64).filter(|k| buffer.triangle[*k] != EMPTY).count();
        assert_eq!(covered, 24 * 24);
        buffer.draw(&[[0.0, 0.0, -1.0]; 4], &triangles[..2]);
        assert_eq!((0..48 * 64).filter(|k| buffer.triangle[*k] != EMPTY).count(), 0);
    }
}
