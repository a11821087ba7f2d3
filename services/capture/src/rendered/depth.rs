//! The depth image of one camera: what a perfect one would see, then what a stereo camera makes
//! of it.

use orime_geometry::nalgebra::{Isometry3, Vector3};
use orime_geometry::{CameraModel, RgbdCamera};

use super::faults::Faults;
use super::measure::{self, Noise, Steps};
use super::noise::Grain;
use super::paint::LAMP;
use super::project::Projected;
use super::scan;
use super::scene::{Face, Scene};
use super::stereo::{Edges, Window};
use super::views::Model;

/// What one depth lens needs to draw frames without allocation.
#[derive(Debug)]
pub(super) struct DepthView {
    lens: CameraModel,
    lens_from_world: Isometry3<f64>,
    m_per_unit: f64,
    /// The table's depth, units; `NOTHING_UNITS` where the lens looks past it.
    table_units: Vec<f32>,
    /// What a perfect camera sees, units.
    exact_units: Vec<f32>,
    /// σ₀² and k² of the noise, in units of depth.
    variance_units: [f32; 2],
    /// Units by which everything reads too long.
    bias_units: f32,
    steps: Option<Steps>,
    edges: Edges,
    hole_rate: f64,
    grazing_cos: f32,
    saturation: f64,
    sees_sheet: bool,
    /// The scene's faces in this image, in their order.
    faces: Vec<Option<Projected>>,
}

/// Power of the lamp's mirror image on paper.
const GLOSS: i32 = 40;

impl DepthView {
    pub fn new(
        model: Model,
        faults: &Faults,
        (camera, bias_m): (&RgbdCamera, f64),
        table_units: Vec<f32>,
        hides_sheet: bool,
    ) -> Self {
        let unit_m = camera.depth_m_per_unit;
        let lens = camera.depth.clone();
        let focal_baseline = lens.fx_px * model.baseline_m() / unit_m;
        let mut variance = [
            (faults.noise_floor_m / unit_m).powi(2),
            (faults.noise_per_m * model.noise_ratio(&lens) * unit_m).powi(2),
        ];
        let step_px = faults.disparity_step_px;
        let steps = (step_px > 0.0).then(|| {
            // Rounding adds a twelfth of its step's square; the figures include it.
            let by_disparity = step_px / focal_baseline;
            variance[0] = (variance[0] - 1.0 / 12.0).max(0.0);
            variance[1] = (variance[1] - by_disparity.powi(2) / 12.0).max(0.0);
            Steps { focal_baseline: focal_baseline as f32, step_px: step_px as f32 }
        });
        Self {
            lens_from_world: camera.world_from_depth().inverse(),
            m_per_unit: unit_m,
            exact_units: table_units.clone(),
            table_units,
            variance_units: variance.map(|v| v as f32),
            bias_units: (-bias_m / unit_m) as f32,
            steps,
            edges: Edges {
                focal_baseline: focal_baseline as f32,
                shadow: faults.shadow as f32,
                flying_rate: faults.flying_rate as f32,
                far_units: (0.2 / unit_m) as f32,
            },
            hole_rate: faults.hole_rate,
            grazing_cos: if faults.grazing_deg < 90.0 {
                faults.grazing_deg.to_radians().cos() as f32
            } else {
                0.0
            },
            saturation: faults.saturation,
            sees_sheet: !hides_sheet,
            faces: Vec::with_capacity(scan::FACES_MAX),
            lens,
        }
    }

    /// Writes one image in units. `random` picks what does not come from `grain`.
    pub fn draw(&mut self, scene: &Scene, grain: &Grain<'_>, random: u64, units: &mut [u16]) {
        let window = self.draw_exact(scene);
        self.measure(grain, units);
        let other = grain.other();
        if let Some(window) = window {
            if self.grazing_cos > 0.0 || self.saturation > 0.0 {
                self.lose_returns(scene, &other, units);
            }
            let width = self.lens.width as usize;
            self.edges.apply(&self.exact_units, width, &window, random, units);
        }
        if self.hole_rate > 0.0 {
            self.punch_holes(&other, units);
        }
    }

    /// Fills `exact_units` with the nearest of table and faces; returns the part of the image
    /// that differs from the table's.
    fn draw_exact(&mut self, scene: &Scene) -> Option<Window> {
        self.exact_units.copy_from_slice(&self.table_units);
        self.faces.clear();
        if !self.sees_sheet {
            return None;
        }
        let (width, height) = (self.lens.width as usize, self.lens.height as usize);
        let mut window = Window::default();
        for face in scene.faces() {
            let face =
                Projected::new(&self.lens, &self.lens_from_world, &face.pose, face.corners_uv_m());
            if let Some(face) = &face {
                let rows = face.rows(height);
                let [left, right] = face.columns().map(|x| x.clamp(0.0, width as f64) as usize);
                window.include(rows.clone(), left..right + 1);
                for y in rows {
                    let row = &mut self.exact_units[y * width..(y + 1) * width];
                    measure::nearer(face, y, self.m_per_unit, row);
                }
            }
            self.faces.push(face);
        }
        (!window.rows.is_empty()).then_some(window)
    }

    /// Noise, bias and rounding.
    fn measure(&self, grain: &Grain<'_>, units: &mut [u16]) {
        let width = self.lens.width as usize;
        let rows = units.chunks_exact_mut(width).zip(self.exact_units.chunks_exact(width));
        for (y, (out, row)) in rows.enumerate() {
            let mut start = 0;
            for values in grain.row(y, width) {
                let end = start + values.len();
                let noise = Noise {
                    values,
                    sign: grain.sign,
                    variance: self.variance_units,
                    bias: self.bias_units,
                };
                match &self.steps {
                    None => measure::quantise(&row[start..end], &noise, &mut out[start..end]),
                    Some(steps) => measure::quantise_disparity(
                        &row[start..end],
                        &noise,
                        steps,
                        &mut out[start..end],
                    ),
                }
                start = end;
            }
        }
    }

    /// Holes anywhere, in blobs.
    fn punch_holes(&self, grain: &Grain<'_>, units: &mut [u16]) {
        let width = self.lens.width as usize;
        let low = grain.quantile(self.hole_rate);
        for (y, row) in units.chunks_exact_mut(width).enumerate() {
            let values = grain.row(y, width).into_iter().flatten();
            for (unit, value) in row.iter_mut().zip(values) {
                if *value < low {
                    *unit = 0;
                }
            }
        }
    }

    /// Takes away what is seen at a grazing angle and where paper mirrors the lamp.
    fn lose_returns(&self, scene: &Scene, grain: &Grain<'_>, units: &mut [u16]) {
        let (width, height) = (self.lens.width as usize, self.lens.height as usize);
        for (face, projected) in scene.faces().iter().zip(&self.faces) {
            let Some(projected) = projected else { continue };
            let Some(glance) = self.glance(face) else { continue };
            for y in projected.rows(height) {
                let row = y * width..(y + 1) * width;
                let (exact, out) = (&self.exact_units[row.clone()], &mut units[row]);
                let span = projected.span(y, 0.0, width);
                let [first, rest] = grain.row(y, width);
                for x in span {
                    // Another face may be nearer here; the faces' own planes tell.
                    let own = projected.depth(x, y) / self.m_per_unit;
                    if (own as f32 - exact[x]).abs() > 1e-3 * exact[x] {
                        continue;
                    }
                    let ragged = if x < first.len() { first[x] } else { rest[x - first.len()] };
                    let ray = self.lens.ray([x as f64, y as f64].into());
                    if glance.loses(&ray, f64::from(ragged)) {
                        out[x] = 0;
                    }
                }
            }
        }
    }

    /// How the face is seen, or `None` if none of its corners comes near to being lost.
    fn glance(&self, face: &Face) -> Option<Glance> {
        let normal = self.lens_from_world * face.pose.normal();
        let lamp = self.lens_from_world * LAMP;
        let glance = Glance {
            normal,
            lamp,
            grazing_cos: f64::from(self.grazing_cos),
            mirror_min: if face.is_sheet && self.saturation > 0.0 {
                (1.0 - self.saturation).powf(1.0 / f64::from(GLOSS))
            } else {
                f64::INFINITY
            },
        };
        let near = face.corners_uv_m().iter().any(|uv_m| {
            let ray = (self.lens_from_world * face.pose.position_m(*uv_m)).coords;
            let direction = ray.normalize();
            direction.dot(&normal).abs() < 2.0 * glance.grazing_cos
                || glance.mirror(&direction) > glance.mirror_min - 0.05
        });
        near.then_some(glance)
    }
}

/// One face as the rays of a lens meet it; lens frame.
#[derive(Debug)]
struct Glance {
    normal: Vector3<f64>,
    lamp: Vector3<f64>,
    grazing_cos: f64,
    mirror_min: f64,
}

impl Glance {
    /// Cosine between normal and the middle of ray and lamp, on the side that is seen.
    fn mirror(&self, direction: &Vector3<f64>) -> f64 {
        let towards = -self.normal * self.normal.dot(direction).signum();
        towards.dot(&(self.lamp - direction).normalize())
    }

    /// Whether nothing returns along this ray; `ragged` is a unit normal number.
    fn loses(&self, ray: &Vector3<f64>, ragged: f64) -> bool {
        let direction = ray.normalize();
        let cos = direction.dot(&self.normal).abs();
        cos < self.grazing_cos * (1.0 + 0.15 * ragged)
            || self.mirror(&direction) > self.mirror_min + 0.0002 * ragged
    }
}
