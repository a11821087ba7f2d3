//! One virtual RGB-D camera: where it stands, truly and as published, and what it prepares.

use orime_geometry::RgbdCamera;
use orime_geometry::nalgebra::{
    Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector2, Vector3,
};

use super::color::ColorView;
use super::depth::DepthView;
use super::faults::Faults;
use super::measure::{self, NOTHING_UNITS};
use super::noise::uniform;
use super::paint;
use super::params::RenderedParams;
use super::table::Texture;
use super::views::ViewParams;

/// The camera that stands as `view` says.
pub(super) fn rgbd(params: &RenderedParams, view: &ViewParams) -> RgbdCamera {
    let (color, depth, color_from_depth) =
        view.model.lenses(params.size_px, params.depth_registered);
    RgbdCamera {
        name: view.name.clone(),
        color,
        depth,
        color_from_depth,
        world_from_color: looking_at(view.eye_m, view.look_at_m),
        depth_m_per_unit: view.model.depth_m_per_unit(params.depth_m_per_unit),
    }
}

/// The same camera where it truly stands: moved and turned by the calibration's errors, each in
/// a random direction.
pub(super) fn displaced(published: &RgbdCamera, faults: &Faults, seed: u64) -> RgbdCamera {
    let direction = |salt: u64| {
        let z = 2.0 * uniform(seed, salt) - 1.0;
        let (sin, cos) = (std::f64::consts::TAU * uniform(seed, salt + 1)).sin_cos();
        let across = (1.0 - z * z).sqrt();
        Unit::new_normalize(Vector3::new(across * cos, across * sin, z))
    };
    if faults.calibration_error_m == 0.0 && faults.calibration_error_deg == 0.0 {
        return published.clone();
    }
    let turn =
        UnitQuaternion::from_axis_angle(&direction(0), faults.calibration_error_deg.to_radians());
    let shift = direction(2).into_inner() * faults.calibration_error_m;
    let error = Isometry3::from_parts(Translation3::from(shift), turn);
    RgbdCamera { world_from_color: published.world_from_color * error, ..published.clone() }
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
    pub color: ColorView,
    pub depth: DepthView,
    /// By how much of a period its shutter is later than camera 0's, -0.5 to 0.5.
    pub late_periods: f64,
}

impl VirtualCamera {
    /// The camera with index `index` that stands where `camera` says.
    pub fn new(
        params: &RenderedParams,
        faults: &Faults,
        (index, camera): (usize, &RgbdCamera),
        wood: &Texture,
    ) -> Self {
        let view = &params.views[index];
        let ground =
            Ground { is_seen_from_below: view.eye_m[2] < 0.0, is_glass: params.glass_table };
        let random = |salt: u64| uniform(params.seed ^ 0xca11_b0b1, 64 * index as u64 + salt);
        let bias_m = faults.bias_m * (0.88 + 0.34 * random(0));
        let spread = if index == 0 { 0.0 } else { faults.shutter_spread };
        let table_rgb = table_rgb(params, camera, wood, &ground);
        let table_units = table_units(camera, &ground);
        Self {
            color: ColorView::new(params, faults, camera, table_rgb, ground.hides_sheet()),
            depth: DepthView::new(
                view.model,
                faults,
                (camera, bias_m),
                table_units,
                ground.hides_sheet(),
            ),
            late_periods: spread * (2.0 * random(1) - 1.0),
        }
    }
}

/// The table as a camera sees it.
#[derive(Debug, Clone, Copy)]
struct Ground {
    is_seen_from_below: bool,
    is_glass: bool,
}

impl Ground {
    /// Whether there is table on the ray; else there is the room, without return.
    fn is_there(&self) -> bool {
        !(self.is_seen_from_below && self.is_glass)
    }

    fn hides_sheet(&self) -> bool {
        self.is_seen_from_below && !self.is_glass
    }
}

/// Colour of the room over a glass table, 0 to 255.
const ROOM_RGB: [f64; 3] = [58.0, 60.0, 64.0];

/// The table's colour image. Bilinear filtering is not needed: the grain is coarser than pixels.
fn table_rgb(
    params: &RenderedParams,
    camera: &RgbdCamera,
    wood: &Texture,
    ground: &Ground,
) -> Vec<u8> {
    let lens = &camera.color;
    let up = if ground.is_seen_from_below { -Vector3::z() } else { Vector3::z() };
    let light = paint::shade(&up);
    let mut rgb = Vec::with_capacity(3 * lens.pixels());
    for y in 0..lens.height {
        for x in 0..lens.width {
            let pixel = Vector2::new(f64::from(x), f64::from(y));
            let ray = lens.ray(pixel);
            let point = table_point(&camera.world_from_color, &ray);
            // Natural vignetting, cos⁴ of the angle off the axis, at half its strength.
            let vignette = 0.5 + 0.5 * ray.norm_squared().powi(-2);
            if !ground.is_there() {
                rgb.extend(ROOM_RGB.map(|c| (c * vignette + 0.5) as u8));
                continue;
            }
            let grain = point.map_or(0.0, |point| wood.at(point.x as f32, point.y as f32));
            let brightness = light * vignette * (1.0 + params.texture * f64::from(grain));
            rgb.extend(params.table_rgb.map(|c| (f64::from(c) * brightness + 0.5) as u8));
        }
    }
    rgb
}

/// The table's depth image in units.
fn table_units(camera: &RgbdCamera, ground: &Ground) -> Vec<f32> {
    let lens = &camera.depth;
    let world_from_depth = camera.world_from_depth();
    let mut units = Vec::with_capacity(lens.pixels());
    for y in 0..lens.height {
        for x in 0..lens.width {
            let ray = lens.ray(Vector2::new(f64::from(x), f64::from(y)));
            let point = table_point(&world_from_depth, &ray).filter(|_| ground.is_there());
            let depth = point.map(|point| {
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
    let towards = if eye.z > 0.0 { direction.z < -1e-6 } else { direction.z > 1e-6 };
    towards.then(|| Point3::from(eye - direction * (eye.z / direction.z)))
}

#[cfg(test)]
mod tests {
    use super::super::faults::{FaultParams, FaultPreset};
    use super::super::views::Viewpoints;
    use super::*;

    const WOOD: Ground = Ground { is_seen_from_below: false, is_glass: false };

    #[test]
    fn the_target_is_in_the_middle_and_up_is_up() {
        let params = RenderedParams::default();
        for view in Viewpoints::Three.views().iter().chain(&Viewpoints::Five.views()) {
            let camera = rgbd(&params, view);
            let see = |point: [f64; 3]| {
                let point = camera.world_from_color.inverse_transform_point(&Point3::from(point));
                camera.color.project(&point).unwrap()
            };
            let target = see(view.look_at_m);
            let middle = Vector2::new(camera.color.cx_px, camera.color.cy_px);
            assert!((target - middle).norm() < 1e-9, "{}", view.name);
            let [x, y, z] = view.look_at_m;
            let vertical = ["overhead", "below"].contains(&view.name.as_str());
            let raised = if vertical { [x, y + 0.05, z] } else { [x, y, z + 0.05] };
            assert!(see(raised).y < target.y - 20.0, "{}", view.name);
        }
    }

    #[test]
    fn the_overhead_camera_measures_its_own_height() {
        let params = RenderedParams { depth_registered: true, ..RenderedParams::default() };
        let units = table_units(&rgbd(&params, &Viewpoints::Three.views()[0]), &WOOD);
        assert!(units.iter().all(|z| (z - 520.0).abs() < 1e-3));
    }

    #[test]
    fn the_published_place_is_off_by_exactly_the_error() {
        let camera = rgbd(&RenderedParams::default(), &Viewpoints::Five.views()[1]);
        let faults = FaultParams::default().over(FaultPreset::Real);
        let truth = displaced(&camera, &faults, 3);
        let error = camera.world_from_color.inverse() * truth.world_from_color;
        assert!((error.translation.vector.norm() - 0.001).abs() < 1e-12);
        assert!((error.rotation.angle().to_degrees() - 0.2).abs() < 1e-9);
    }
}
