//! One virtual RGB-D camera: its lenses, its prepared table, and how it draws the sheet.

use orime_geometry::nalgebra::{
    Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3,
};
use orime_geometry::{CameraModel, RgbdCamera};
use orime_origami::HalfFold;

use super::measure::{self, NOTHING_UNITS, Noise};
use super::noise::Grain;
use super::paint::{self, Look, Painted};
use super::params::{RenderedParams, ViewParams};
use super::project::Projected;
use super::table::Texture;

/// The camera that stands as `view` says.
pub(super) fn rgbd(params: &RenderedParams, view: &ViewParams) -> RgbdCamera {
    let [width, height] = params.size_px;
    // Focal lengths and centres of a real D415 at 640 × 480, scaled to the image's width.
    let scale = f64::from(width) / 640.0;
    let lens = |f_px: f64, center_px: [f64; 2]| CameraModel {
        width,
        height,
        fx_px: f_px * scale,
        fy_px: f_px * scale,
        cx_px: (f64::from(width) - 1.0) / 2.0 + center_px[0] * scale,
        cy_px: (f64::from(height) - 1.0) / 2.0 + center_px[1] * scale,
        distortion: [0.0; 5],
    };
    let color = lens(610.0, [4.2, 1.7]);
    let (depth, color_from_depth) = if params.depth_registered {
        (color.clone(), Isometry3::identity())
    } else {
        let turn = Vector3::new(-0.0049, 0.0061, 0.0008);
        (lens(598.0, [-1.3, 3.1]), Isometry3::new(Vector3::new(0.015, 0.0, 0.0), turn))
    };
    RgbdCamera {
        name: view.name.clone(),
        color,
        depth,
        color_from_depth,
        world_from_color: looking_at(view.eye_m, view.look_at_m),
        depth_m_per_unit: params.depth_m_per_unit,
    }
}

/// Optical pose: +Z from `eye_m` to `target_m`, image up as near as can be to world z (or to
/// world y when looking straight down).
fn looking_at(eye_m: [f64; 3], target_m: [f64; 3]) -> Isometry3<f64> {
    let eye = Vector3::from(eye_m);
    let forward = (Vector3::from(target_m) - eye).normalize();
    let up = if forward.z.abs() > 0.99 { Vector3::y() } else { Vector3::z() };
    let right = forward.cross(&up).normalize();
    let down = forward.cross(&right);
    let axes = Matrix3::from_columns(&[right, down, forward]);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Isometry3::from_parts(Translation3::from(eye), turn)
}

/// What one camera needs to draw frames without allocation.
#[derive(Debug)]
pub(super) struct VirtualCamera {
    camera: RgbdCamera,
    /// The table without the sheet, as the colour lens sees it.
    table_rgb: Vec<u8>,
    /// The table's depth, units; [`NOTHING_UNITS`] where the lens looks past it.
    table_units: Vec<f32>,
    /// σ₀² and k² of the depth noise, in units of depth.
    noise_units: [f32; 2],
    hole_rate: f64,
    sheet_rgb: [f32; 3],
    sheet_texture: f32,
    /// Coverage of one row by the fixed and the moving facet.
    coverage: [Vec<f32>; 2],
    depth_row: Vec<f32>,
}

impl VirtualCamera {
    pub fn new(params: &RenderedParams, camera: &RgbdCamera, wood: &Texture) -> Self {
        let unit_m = params.depth_m_per_unit;
        let sigma0 = params.noise_floor_m / unit_m;
        let k = params.noise_per_m * unit_m;
        Self {
            table_rgb: table_rgb(params, camera, wood),
            table_units: table_units(camera),
            noise_units: [sigma0.powi(2) as f32, k.powi(2) as f32],
            hole_rate: params.hole_rate,
            sheet_rgb: params.sheet_rgb.map(f32::from),
            sheet_texture: params.texture as f32 * 0.1,
            coverage: [(); 2].map(|()| vec![0.0; camera.color.width as usize]),
            depth_row: vec![0.0; camera.depth.width as usize],
            camera: camera.clone(),
        }
    }

    /// Writes one depth image: the nearest of table and sheet, with noise, in units.
    pub fn draw_depth(
        &mut self,
        fold: &HalfFold,
        poses: &[Isometry3<f64>; 2],
        grain: &Grain<'_>,
        units: &mut [u16],
    ) {
        let lens = &self.camera.depth;
        let (width, height) = (lens.width as usize, lens.height as usize);
        let lens_from_world = self.camera.world_from_depth().inverse();
        let facets =
            [0, 1].map(|k| Projected::new(lens, &(lens_from_world * poses[k]), &fold.facets()[k]));
        let holes = (self.hole_rate > 0.0).then(|| grain.other());
        for y in 0..height {
            let row = &mut self.depth_row[..];
            row.copy_from_slice(&self.table_units[y * width..(y + 1) * width]);
            for facet in facets.iter().flatten() {
                if facet.rows(height).contains(&y) {
                    measure::nearer(facet, y, self.camera.depth_m_per_unit, row);
                }
            }
            let out = &mut units[y * width..(y + 1) * width];
            let mut start = 0;
            for noise in grain.row(y, width) {
                let end = start + noise.len();
                let noise = Noise { values: noise, sign: grain.sign, variance: self.noise_units };
                measure::quantise(&row[start..end], &noise, &mut out[start..end]);
                start = end;
            }
            if let Some(holes) = &holes {
                let low = holes.quantile(self.hole_rate);
                let values = holes.row(y, width).into_iter().flatten();
                for (unit, value) in out.iter_mut().zip(values) {
                    if *value < low {
                        *unit = 0;
                    }
                }
            }
        }
    }

    /// Writes one colour image: the table, and over it the sheet with anti-aliased edges.
    pub fn draw_color(
        &mut self,
        fold: &HalfFold,
        poses: &[Isometry3<f64>; 2],
        paper: &Texture,
        rgb: &mut [u8],
    ) {
        let lens = &self.camera.color;
        let lens_from_world = self.camera.world_from_color.inverse();
        let look = Look { rgb: self.sheet_rgb, paper, texture: self.sheet_texture };
        let sheet = Painted::new(lens, &lens_from_world, fold, poses, look);
        let stride = 3 * lens.width as usize;
        let rows = rgb.chunks_exact_mut(stride).zip(self.table_rgb.chunks_exact(stride));
        for (y, (row, table)) in rows.enumerate() {
            row.copy_from_slice(table);
            sheet.paint_row(y, lens.height as usize, &mut self.coverage, row);
        }
    }
}

/// The table's colour image. Bilinear filtering is not needed: the grain is coarser than pixels.
fn table_rgb(params: &RenderedParams, camera: &RgbdCamera, wood: &Texture) -> Vec<u8> {
    let lens = &camera.color;
    let light = paint::shade(&Vector3::z());
    let mut rgb = Vec::with_capacity(3 * lens.pixels());
    for y in 0..lens.height {
        for x in 0..lens.width {
            let pixel = Vector2::new(f64::from(x), f64::from(y));
            let ray = lens.ray(pixel);
            let grain = table_point(&camera.world_from_color, &ray)
                .map_or(0.0, |point| wood.at(point.x as f32, point.y as f32));
            // Natural vignetting, cos⁴ of the angle off the axis, at half its strength.
            let vignette = 0.5 + 0.5 * ray.norm_squared().powi(-2);
            let brightness = light * vignette * (1.0 + params.texture * f64::from(grain));
            rgb.extend(params.table_rgb.map(|c| (f64::from(c) * brightness + 0.5) as u8));
        }
    }
    rgb
}

/// The table's depth image in units.
fn table_units(camera: &RgbdCamera) -> Vec<f32> {
    let lens = &camera.depth;
    let world_from_depth = camera.world_from_depth();
    let mut units = Vec::with_capacity(lens.pixels());
    for y in 0..lens.height {
        for x in 0..lens.width {
            let ray = lens.ray(Vector2::new(f64::from(x), f64::from(y)));
            let depth = table_point(&world_from_depth, &ray).map(|point| {
                (world_from_depth.inverse_transform_point(&point).z / camera.depth_m_per_unit)
                    as f32
            });
            units.push(depth.filter(|z| *z < measure::RAW_MAX).unwrap_or(NOTHING_UNITS));
        }
    }
    units
}

/// Where a lens's ray meets the table, z = 0.
fn table_point(world_from_lens: &Isometry3<f64>, ray: &Vector3<f64>) -> Option<Point3<f64>> {
    let eye = world_from_lens.translation.vector;
    let direction = world_from_lens * ray;
    (direction.z < -1e-6).then(|| Point3::from(eye - direction * (eye.z / direction.z)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_is_in_the_middle_and_up_is_up() {
        let params = RenderedParams::default();
        for view in &params.views {
            let camera = rgbd(&params, view);
            let see = |point: [f64; 3]| {
                let point = camera.world_from_color.inverse_transform_point(&Point3::from(point));
                camera.color.project(&point).unwrap()
            };
            let target = see(view.look_at_m);
            let middle = Vector2::new(camera.color.cx_px, camera.color.cy_px);
            assert!((target - middle).norm() < 1e-9, "{}", view.name);
            let [x, y, z] = view.look_at_m;
            let raised = if view.name == "overhead" { [x, y + 0.05, z] } else { [x, y, z + 0.05] };
            assert!(see(raised).y < target.y - 20.0, "{}", view.name);
        }
    }

    #[test]
    fn the_overhead_camera_measures_its_own_height() {
        let params = RenderedParams { depth_registered: true, ..RenderedParams::default() };
        let units = table_units(&rgbd(&params, &params.views[0]));
        assert!(units.iter().all(|z| (z - 520.0).abs() < 1e-3));
    }
}
