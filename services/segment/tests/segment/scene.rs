//! Rendered test scenes: flat rectangles before a table, seen by an RGB-D camera.

use orime_geometry::nalgebra::{Isometry3, Point3, Vector2, Vector3};
use orime_geometry::{CameraModel, Edgel, ObservedPoint, RgbdCamera, RgbdFrame, SheetGrid};
use orime_segment::{ObservedMut, SegmentParams, SegmentReport, Segmenter};

pub const WHITE: [u8; 3] = [235, 235, 240];
pub const DARK: [u8; 3] = [40, 35, 50];
pub const SKIN: [u8; 3] = [205, 130, 105];

/// A rectangle in its own z = 0 plane, centred.
#[derive(Debug, Clone)]
pub struct Patch {
    pub world_from_patch: Isometry3<f64>,
    pub size_m: [f64; 2],
    pub rgb: [u8; 3],
}

impl Patch {
    /// Facing a camera that looks along +z.
    pub fn facing(centre_m: [f64; 3], size_m: [f64; 2], rgb: [u8; 3]) -> Self {
        let world_from_patch = Isometry3::translation(centre_m[0], centre_m[1], centre_m[2]);
        Self { world_from_patch, size_m, rgb }
    }

    pub fn turned(mut self, axis_angle: [f64; 3]) -> Self {
        self.world_from_patch *= Isometry3::rotation(Vector3::from(axis_angle));
        self
    }

    /// Distance along a ray, if it hits.
    fn hit(&self, origin: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
        let origin = self.world_from_patch.inverse_transform_point(origin);
        let ray = self.world_from_patch.inverse_transform_vector(ray);
        let t = -origin.z / ray.z;
        let at = origin + ray * t;
        let inside = at.x.abs() <= self.size_m[0] / 2.0 && at.y.abs() <= self.size_m[1] / 2.0;
        (t > 0.0 && inside).then_some(t)
    }
}

/// Patches, the nearer hiding the farther, before a table that fills the view.
#[derive(Debug, Clone)]
pub struct Scene {
    pub patches: Vec<Patch>,
    pub table_rgb: [u8; 3],
    pub table_z_m: f64,
    /// Rays per side of a colour pixel.
    pub rays: u32,
}

impl Scene {
    pub fn new(patches: Vec<Patch>) -> Self {
        Self { patches, table_rgb: DARK, table_z_m: 0.62, rays: 8 }
    }

    fn trace(&self, origin: &Point3<f64>, ray: &Vector3<f64>) -> ([u8; 3], f64) {
        let table = (self.table_rgb, (self.table_z_m - origin.z) / ray.z);
        let hits = self.patches.iter().filter_map(|p| Some((p.rgb, p.hit(origin, ray)?)));
        hits.fold(table, |best, hit| if hit.1 < best.1 { hit } else { best })
    }

    /// The camera's two images; colour is averaged over `rays`² rays a pixel.
    pub fn render(&self, camera: &RgbdCamera) -> (Vec<u8>, Vec<u16>) {
        let mut color = Vec::new();
        let rays = |lens: &CameraModel, world: Isometry3<f64>, x: f64, y: f64| {
            let ray = world * lens.ray(Vector2::new(x, y));
            self.trace(&Point3::from(world.translation.vector), &ray)
        };
        for (x, y) in pixels(&camera.color) {
            let mut sum = [0.0; 3];
            for sub in 0..self.rays * self.rays {
                let [dx, dy] = [sub % self.rays, sub / self.rays]
                    .map(|k| (f64::from(k) + 0.5) / f64::from(self.rays) - 0.5);
                let (rgb, _) = rays(&camera.color, camera.world_from_color, x + dx, y + dy);
                let share = f64::from(self.rays * self.rays);
                (0..3).for_each(|k| sum[k] += f64::from(rgb[k]) / share);
            }
            color.extend(sum.map(|c| c.round() as u8));
        }
        let depth = pixels(&camera.depth)
            .map(|(x, y)| {
                let (_, z_m) = rays(&camera.depth, camera.world_from_depth(), x, y);
                (z_m / camera.depth_m_per_unit).round() as u16
            })
            .collect();
        (color, depth)
    }
}

fn pixels(lens: &CameraModel) -> impl Iterator<Item = (f64, f64)> + use<> {
    let (width, height) = (lens.width, lens.height);
    (0..height).flat_map(move |y| (0..width).map(move |x| (f64::from(x), f64::from(y))))
}

/// A lens of 150 × 120 pixels: not a whole number of words wide. At 0.6 m a pixel is 3 mm.
pub fn lens() -> CameraModel {
    CameraModel {
        width: 150,
        height: 120,
        fx_px: 200.0,
        fy_px: 200.0,
        cx_px: 74.5,
        cy_px: 59.5,
        distortion: [0.0; 5],
    }
}

/// A camera with registered depth at the world's origin, looking along +z; 0.1 mm a unit.
pub fn camera() -> RgbdCamera {
    RgbdCamera {
        name: "front".into(),
        color: lens(),
        depth: lens(),
        color_from_depth: Isometry3::identity(),
        world_from_color: Isometry3::identity(),
        depth_m_per_unit: 1e-4,
    }
}

/// The sheet of all scenes: 0.2 × 0.15 m.
pub fn sheet() -> SheetGrid {
    SheetGrid::new([0.2, 0.15], [9, 7])
}

/// The sheet, flat and facing the camera at 0.6 m.
pub fn flat_sheet() -> Patch {
    Patch::facing([0.0, 0.0, 0.6], [0.2, 0.15], WHITE)
}

/// What a segmentation gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    pub points: Vec<ObservedPoint>,
    pub edgels: Vec<Edgel>,
    pub report: SegmentReport,
}

/// A segmenter under test and the memory that it writes to.
#[derive(Debug)]
pub struct Bench {
    pub segmenter: Segmenter,
    pub cameras: Vec<RgbdCamera>,
}

impl Bench {
    pub fn new(params: &SegmentParams, cameras: Vec<RgbdCamera>) -> Self {
        let config = params.check().expect("the parameters are valid");
        Self { segmenter: Segmenter::new(&config, &cameras, &sheet()), cameras }
    }

    pub fn see(&mut self, scene: &Scene) -> Seen {
        let images: Vec<_> = self.cameras.iter().map(|c| scene.render(c)).collect();
        self.see_images(&images)
    }

    pub fn see_images(&mut self, images: &[(Vec<u8>, Vec<u16>)]) -> Seen {
        let frames: Vec<_> = images
            .iter()
            .map(|(color_rgb, depth_units)| Some(RgbdFrame { color_rgb, depth_units }))
            .collect();
        let mut points = vec![bytemuck::Zeroable::zeroed(); 40_000];
        let mut edgels = vec![bytemuck::Zeroable::zeroed(); 4_000];
        let out = ObservedMut { points: &mut points, edgels: &mut edgels, features: &mut [] };
        let report = self.segmenter.segment(&frames, out);
        points.truncate(report.points);
        edgels.truncate(report.edgels);
        Seen { points, edgels, report }
    }

    /// The mask of a camera, every fifth pixel.
    pub fn picture(&self, camera: usize) -> String {
        let lens = &self.cameras[camera].color;
        let mut picture = String::new();
        for y in (2..lens.height).step_by(5) {
            for x in (2..lens.width).step_by(5) {
                picture.push(if self.segmenter.is_sheet(camera, x, y) { '#' } else { '.' });
            }
            picture.push('\n');
        }
        picture
    }
}
