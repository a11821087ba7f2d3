//! A virtual camera with a depth buffer: draws surfaces and points.

use orime_geometry::nalgebra::{Isometry3, Point3, Vector3};

use super::canvas::{Canvas, Color};

/// A perspective view of one canvas.
#[derive(Debug)]
pub struct View {
    canvas: Canvas,
    depth_m: Vec<f32>,
    view_from_world: Isometry3<f64>,
    focal_px: f64,
}

/// Background of every view.
pub const PAPER_BLUE: Color = [24, 28, 38];

impl View {
    /// Looks from `eye` at `target`; `up` is the world direction that points up in the image.
    pub fn new(size: [usize; 2], eye: Point3<f64>, target: Point3<f64>, up: Vector3<f64>) -> Self {
        // `look_at_rh` looks along −z with y up; optical frames look along +z with y down.
        let flip = orime_geometry::nalgebra::UnitQuaternion::from_axis_angle(
            &Vector3::x_axis(),
            std::f64::consts::PI,
        );
        Self {
            canvas: Canvas::new(size[0], size[1], PAPER_BLUE),
            depth_m: vec![f32::INFINITY; size[0] * size[1]],
            view_from_world: Isometry3::from_parts(Default::default(), flip)
                * Isometry3::look_at_rh(&eye, &target, &up),
            focal_px: 1.6 * size[0].min(size[1]) as f64,
        }
    }

    /// The picture, at half the size (each pixel the mean of four).
    pub fn finish(self) -> Canvas {
        self.canvas.halved()
    }

    /// Column, row and distance of a point; `None` behind the view.
    fn project(&self, point: [f32; 3]) -> Option<[f64; 3]> {
        let p = self.view_from_world * Point3::from(point).cast::<f64>();
        (p.z > 1e-3).then(|| {
            [
                self.focal_px * p.x / p.z + self.canvas.width as f64 / 2.0,
                self.focal_px * p.y / p.z + self.canvas.height as f64 / 2.0,
                p.z,
            ]
        })
    }

    /// A square of `2·radius + 1` pixels at a point, where nothing is in front of it.
    pub fn point(&mut self, point: [f32; 3], radius: i64, color: Color) {
        let Some([x, y, z]) = self.project(point) else { return };
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                self.plot(x.round() as i64 + dx, y.round() as i64 + dy, z as f32, color);
            }
        }
    }

    /// A line in space, drawn slightly in front of surfaces that hold it.
    pub fn line(&mut self, a: [f32; 3], b: [f32; 3], color: Color) {
        let (Some(a), Some(b)) = (self.project(a), self.project(b)) else { return };
        let steps = (b[0] - a[0]).hypot(b[1] - a[1]).ceil().clamp(1.0, 4000.0) as usize;
        for k in 0..=steps {
            let t = k as f64 / steps as f64;
            let [x, y, z] = [0, 1, 2].map(|c| a[c] + t * (b[c] - a[c]));
            self.plot(x.round() as i64, y.round() as i64, z as f32 * 0.997, color);
        }
    }

    /// A triangle, lit from the viewer; the two sides have different colours.
    pub fn triangle(&mut self, corners: [[f32; 3]; 3], front: Color, back: Color) {
        let world = corners.map(|c| Point3::from(c).cast::<f64>());
        let seen = world.map(|p| self.view_from_world * p);
        let normal = (seen[1] - seen[0]).cross(&(seen[2] - seen[0]));
        let Some(normal) = normal.try_normalize(1e-18) else { return };
        let facing = -normal.dot(&seen[0].coords.normalize());
        let light = Vector3::new(-0.35, -0.5, -0.8).normalize();
        let lit = 0.35 + 0.65 * (normal * facing.signum()).dot(&light).max(0.0);
        let color = if facing > 0.0 { front } else { back }.map(|c| (f64::from(c) * lit) as u8);
        let projected = corners.map(|c| self.project(c));
        let [Some(a), Some(b), Some(c)] = projected else { return };
        self.fill([a, b, c], color);
    }

    fn fill(&mut self, [a, b, c]: [[f64; 3]; 3], color: Color) {
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        if area.abs() < 1e-9 {
            return;
        }
        let limit = |axis: usize, size: usize| {
            let (low, high) =
                (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
            (low.floor().max(0.0) as i64, high.ceil().min(size as f64 - 1.0) as i64)
        };
        let (x_range, y_range) = (limit(0, self.canvas.width), limit(1, self.canvas.height));
        for y in y_range.0..=y_range.1 {
            for x in x_range.0..=x_range.1 {
                let (px, py) = (x as f64 - a[0], y as f64 - a[1]);
                let s = (px * (c[1] - a[1]) - (c[0] - a[0]) * py) / area;
                let t = ((b[0] - a[0]) * py - px * (b[1] - a[1])) / area;
                if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
                    let z = 1.0 / ((1.0 - s - t) / a[2] + s / b[2] + t / c[2]);
                    self.plot(x, y, z as f32, color);
                }
            }
        }
    }

    fn plot(&mut self, x: i64, y: i64, z: f32, color: Color) {
        if x < 0 || y < 0 || x >= self.canvas.width as i64 || y >= self.canvas.height as i64 {
            return;
        }
        let depth = &mut self.depth_m[y as usize * self.canvas.width + x as usize];
        if z < *depth {
            *depth = z;
            self.canvas.set(x, y, color);
        }
    }
}
