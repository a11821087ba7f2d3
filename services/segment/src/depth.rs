//! One camera's depth image in metres, and where its pixels lie in the world and in colour.

use std::ops::Range;

use orime_geometry::nalgebra::{Isometry3, Vector2};
use orime_geometry::{CameraModel, RgbdCamera};
use orime_lanes::{Lanes, Pass, Width};

use crate::bits::{BitImage, pack};
use crate::params::SegmentParams;
use crate::window::{View, Window};

/// Pixels around the depth image that hold no depth, so that neighbours need no bounds.
pub(crate) const PAD: usize = 8;

/// No colour pixel.
const NOWHERE: u32 = u32::MAX;

/// Geometry of a depth image, and the part of an image that was loaded last. Pixels are counted
/// from that part's corner.
#[derive(Debug)]
pub(crate) struct DepthMap {
    /// The part of the depth image that is looked at.
    pub window: Window,
    /// Its size.
    pub width: usize,
    pub height: usize,
    /// Size of the image.
    image: [usize; 2],
    /// Where the window of the colour image begins.
    color_start: [usize; 2],
    /// Focal lengths, pixels.
    pub focal_px: [f32; 2],
    /// Pixels with a depth that may be the sheet's.
    pub valid: BitImage,
    /// Depth of the whole image along the optical axis, metres, NaN where there is none or it is
    /// too far; padded on all sides. What is too near or beside the workspace can hide the sheet.
    /// Loaded in the window and [`PAD`] pixels around it.
    z_m: Vec<f32>,
    stride: usize,
    unit_m: f32,
    range_m: [f32; 2],
    workspace_m: Option<[[f32; 3]; 2]>,
    world: Rays,
    /// `None` where depth is registered to colour.
    color: Option<ColorLens>,
    pub lanes: Width,
}

/// Viewing rays of all pixels in some frame: a point is `origin_m + z ray`.
#[derive(Debug)]
struct Rays {
    /// By coordinate.
    rays: [Vec<f32>; 3],
    origin_m: [f32; 3],
}

impl Rays {
    fn new(camera: &CameraModel, target_from_depth: &Isometry3<f64>) -> Self {
        let mut rays = [(); 3].map(|()| Vec::with_capacity(camera.pixels()));
        for y in 0..camera.height {
            for x in 0..camera.width {
                let ray = camera.ray(Vector2::new(f64::from(x), f64::from(y)));
                let ray = (target_from_depth.rotation * ray).cast::<f32>();
                (0..3).for_each(|axis| rays[axis].push(ray[axis]));
            }
        }
        let origin_m = target_from_depth.translation.vector.cast::<f32>().into();
        Self { rays, origin_m }
    }

    fn point(&self, pixel: usize, z_m: f32) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.origin_m[axis] + z_m * self.rays[axis][pixel])
    }
}

/// One row of a depth image.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WorldRow<'a> {
    /// Depth, metres, NaN without one.
    pub z_m: &'a [f32],
    /// Viewing rays by coordinate: a point is `origin_m + z ray`.
    pub rays: [&'a [f32]; 3],
    pub origin_m: [f32; 3],
}

/// How the colour camera sees the depth image's points.
#[derive(Debug)]
struct ColorLens {
    /// Viewing rays of the depth pixels in the colour frame.
    rays: Rays,
    lens: CameraModel,
    /// Bit address of each depth pixel's colour pixel, for the loaded part, row by row.
    pixels: Vec<u32>,
    /// The part of the colour image that counts.
    window: Window,
}

impl ColorLens {
    fn new(camera: &RgbdCamera) -> Self {
        Self {
            rays: Rays::new(&camera.depth, &camera.color_from_depth),
            lens: camera.color.clone(),
            pixels: vec![NOWHERE; camera.depth.pixels()],
            window: Window::whole(camera.color.width as usize, camera.color.height as usize),
        }
    }

    /// Bit addresses per row of the window.
    fn stride(&self) -> usize {
        self.window.width.next_multiple_of(64)
    }

    /// Finds the colour pixels of a row of depth pixels from `start` on, into those from `out`
    /// on: `K D(origin + z ray)`, to the nearest centre.
    #[inline(always)]
    fn project_row(&mut self, start: usize, out: usize, z_m: &[f32]) {
        let (lens, window) = (&self.lens, self.window);
        let [left, top] = [window.x, window.y].map(|c| c as f32);
        let right = (window.x + window.width) as f32;
        let bottom = (window.y + window.height) as f32;
        let stride = self.stride() as u32;
        let corner = window.y as u32 * stride + window.x as u32;
        let [fx, fy, cx, cy] =
            [lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px].map(|value| value as f32);
        let [k1, k2, p1, p2, k3] = lens.distortion.map(|value| value as f32);
        let [origin_x, origin_y, origin_z] = self.rays.origin_m;
        let range = start..start + z_m.len();
        let [rays_x, rays_y, rays_z] = &self.rays.rays;
        let rays = rays_x[range.clone()].iter().zip(&rays_y[range.clone()]);
        let rays = rays.zip(&rays_z[range.clone()]);
        let pixels = &mut self.pixels[out..out + z_m.len()];
        for ((pixel, z), ((ray_x, ray_y), ray_z)) in pixels.iter_mut().zip(z_m).zip(rays) {
            let depth = origin_z + z * ray_z;
            let inverse = 1.0 / depth;
            let x = (origin_x + z * ray_x) * inverse;
            let y = (origin_y + z * ray_y) * inverse;
            let r2 = x * x + y * y;
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
            let v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
            let (u, v) = (fx * u + cx + 0.5, fy * v + cy + 0.5);
            // NaN (no depth) fails every comparison.
            let inside = (depth > 0.0) & (left <= u) & (u < right) & (top <= v) & (v < bottom);
            let (u, v) = if inside { (u, v) } else { (0.0, 0.0) };
            // SAFETY: both are finite and in [0, 2^31), or 0. The checked conversion keeps this
            // loop, a third of this camera's time, from running on whole vectors.
            let (u, v) = unsafe { (u.to_int_unchecked::<i32>(), v.to_int_unchecked::<i32>()) };
            let at = (v as u32).wrapping_mul(stride).wrapping_add(u as u32);
            *pixel = if inside { at.wrapping_sub(corner) } else { NOWHERE };
        }
    }
}

impl DepthMap {
    pub fn new(camera: &RgbdCamera, params: &SegmentParams) -> Self {
        let (width, height) = (camera.depth.width as usize, camera.depth.height as usize);
        let stride = width.next_multiple_of(64) + 2 * PAD;
        let color = (!camera.depth_is_registered()).then(|| ColorLens::new(camera));
        Self {
            window: Window::whole(width, height),
            width,
            height,
            image: [width, height],
            color_start: [0; 2],
            focal_px: [camera.depth.fx_px as f32, camera.depth.fy_px as f32],
            valid: BitImage::new(width, height),
            z_m: vec![f32::NAN; stride * (height + 2 * PAD)],
            stride,
            unit_m: camera.depth_m_per_unit as f32,
            range_m: [params.depth_min_m as f32, params.depth_max_m as f32],
            workspace_m: params.workspace_m.map(|b| b.map(|p| p.map(|x| x as f32))),
            world: Rays::new(&camera.depth, &camera.world_from_depth()),
            color,
            lanes: Width::available()[0],
        }
    }

    /// Looks at these parts of the images from the next [`Self::load`] on.
    pub fn enter(&mut self, view: &View) {
        self.window = view.depth;
        (self.width, self.height) = (view.depth.width, view.depth.height);
        self.valid.reshape(self.width, self.height);
        self.color_start = [view.color.x, view.color.y];
        if let Some(color) = &mut self.color {
            color.window = view.color;
        }
    }

    /// Takes over the window of a raw image: values of the whole image, 0 where there is no
    /// return.
    pub fn load(&mut self, depth_units: &[u16]) {
        let lanes = self.lanes;
        lanes.run(TakeDepths { map: self, depth_units });
        lanes.run(MarkValid { map: self });
        self.apply_workspace();
        lanes.run(Project { map: self });
    }

    #[inline(always)]
    fn take_depths(&mut self, depth_units: &[u16]) {
        let ([_, high], unit_m) = (self.range_m, self.unit_m);
        let [columns, rows] = self.loaded();
        for y in rows {
            let raw = &depth_units[y * self.image[0]..][columns.clone()];
            let start = (y + PAD) * self.stride + PAD;
            let z_m = &mut self.z_m[start..][columns.clone()];
            for (z, raw) in z_m.iter_mut().zip(raw) {
                let depth_m = f32::from(*raw) * unit_m;
                let good = (*raw != 0) & (depth_m <= high);
                *z = if good { depth_m } else { f32::NAN };
            }
        }
    }

    #[inline(always)]
    fn mark_valid(&mut self) {
        let [low, _] = self.range_m;
        for y in 0..self.height {
            let start = self.index(0, y as i32);
            let z_m = &self.z_m[start..start + self.width];
            for (word, z) in self.valid.row_mut(y).iter_mut().zip(z_m.chunks(64)) {
                let mut bytes = [0; 64];
                for (byte, z) in bytes.iter_mut().zip(z) {
                    *byte = u8::from(*z >= low);
                }
                *word = pack(&bytes);
            }
        }
    }

    /// Columns and rows of the image that are loaded: the window and [`PAD`] around it.
    fn loaded(&self) -> [Range<usize>; 2] {
        let Window { x, y, width, height } = self.window;
        [(x, width, self.image[0]), (y, height, self.image[1])]
            .map(|(start, size, end)| start.saturating_sub(PAD)..(start + size + PAD).min(end))
    }

    /// Where the window of the colour image begins, pixels.
    pub fn color_start(&self) -> [usize; 2] {
        self.color_start
    }

    /// Depth in metres, NaN where there is none; `x`, `y` may be up to [`PAD`] outside.
    pub fn z_m(&self, x: i32, y: i32) -> f32 {
        self.z_m[self.index(x, y)]
    }

    /// Depth of the 64 pixels from `x` on in row `y`; both may be up to [`PAD`] outside.
    pub fn z_block(&self, x: i32, y: i32) -> &[f32] {
        let start = self.index(x, y);
        &self.z_m[start..start + 64]
    }

    /// Depths from a pixel four to the left of `x` and four above `y` on, and how far rows are
    /// apart; all nine columns and rows are there.
    #[inline(always)]
    pub fn z_around(&self, x: usize, y: usize) -> (&[f32], usize) {
        let start = self.index(x as i32 - 4, y as i32 - 4);
        (&self.z_m[start..start + 8 * self.stride + 9], self.stride)
    }

    /// World position of a pixel's point, metres.
    pub fn world_m(&self, x: usize, y: usize) -> [f32; 3] {
        self.world.point(self.pixel(x, y), self.z_m(x as i32, y as i32))
    }

    /// Row `y`, for its points in the world.
    pub fn world_row(&self, y: usize) -> WorldRow<'_> {
        let start = self.index(0, y as i32);
        let first = self.pixel(0, y);
        WorldRow {
            z_m: &self.z_m[start..start + self.width],
            rays: self.world.rays.each_ref().map(|rays| &rays[first..first + self.width]),
            origin_m: self.world.origin_m,
        }
    }

    /// Viewing ray of a pixel in world axes, `z = 1` along the optical axis.
    #[inline(always)]
    pub fn world_ray(&self, x: usize, y: usize) -> [f32; 3] {
        let pixel = self.pixel(x, y);
        let [rays_x, rays_y, rays_z] = &self.world.rays;
        [rays_x[pixel], rays_y[pixel], rays_z[pixel]]
    }

    /// The depth pixels whose colour pixel is set in `mask`, into `out`. `words` says which
    /// words of `out` are asked for.
    pub fn look_up(&self, mask: &BitImage, within: Option<&BitImage>, out: &mut BitImage) {
        let Some(color) = &self.color else {
            out.copy_from(mask);
            out.and(&self.valid);
            return;
        };
        for y in 0..self.height {
            let pixels = &color.pixels[y * self.width..(y + 1) * self.width];
            for (k, chunk) in pixels.chunks(64).enumerate() {
                let asked = within.map_or(!0, |w| w.row(y)[k]) & self.valid.row(y)[k];
                let found = match chunk.first_chunk() {
                    _ if asked == 0 => 0,
                    Some(addresses) => mask.bits_at(addresses),
                    None => {
                        let mut addresses = [NOWHERE; 64];
                        addresses[..chunk.len()].copy_from_slice(chunk);
                        mask.bits_at(&addresses)
                    }
                };
                out.row_mut(y)[k] = found & asked;
            }
        }
    }

    /// Sets the colour pixels of the set depth pixels in `out`, which keeps what it had.
    pub fn splat(&self, depth_pixels: &BitImage, out: &mut BitImage) {
        let Some(color) = &self.color else {
            out.or(depth_pixels);
            return;
        };
        for y in 0..self.height {
            for k in 0..depth_pixels.words {
                let mut rest = depth_pixels.row(y)[k];
                while rest != 0 {
                    let x = 64 * k + rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    let at = color.pixels[y * self.width + x];
                    if at != NOWHERE {
                        out.set_at(at);
                    }
                }
            }
        }
    }

    /// The colour pixel (nearest) of a depth pixel of the loaded image.
    pub fn color_pixel(&self, x: usize, y: usize) -> Option<(usize, usize)> {
        let Some(color) = &self.color else { return Some((x, y)) };
        let at = color.pixels[y * self.width + x];
        // 32 bits: this is done for every pixel of the sheet.
        let stride = color.stride() as u32;
        let row = at / stride;
        (at != NOWHERE).then_some(((at - row * stride) as usize, row as usize))
    }

    /// Where a pixel's depth is.
    fn index(&self, x: i32, y: i32) -> usize {
        let (x, y) = (x + (self.window.x + PAD) as i32, y + (self.window.y + PAD) as i32);
        y as usize * self.stride + x as usize
    }

    /// Where a pixel's viewing ray is.
    fn pixel(&self, x: usize, y: usize) -> usize {
        (self.window.y + y) * self.image[0] + self.window.x + x
    }

    fn apply_workspace(&mut self) {
        let Some([low, high]) = self.workspace_m else { return };
        for y in 0..self.height {
            for x in 0..self.width {
                let point = self.world_m(x, y);
                if !(0..3).all(|axis| low[axis] <= point[axis] && point[axis] <= high[axis]) {
                    self.valid.unset(x, y);
                }
            }
        }
    }

    /// Finds each depth pixel's colour pixel.
    #[inline(always)]
    fn project(&mut self) {
        for y in 0..self.height {
            let (start, ray) = (self.index(0, y as i32), self.pixel(0, y));
            let Some(color) = &mut self.color else { return };
            color.project_row(ray, y * self.width, &self.z_m[start..start + self.width]);
        }
    }
}

/// Takes over depths.
struct TakeDepths<'a> {
    map: &'a mut DepthMap,
    depth_units: &'a [u16],
}

impl Pass for TakeDepths<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        self.map.take_depths(self.depth_units);
    }
}

/// Marks pixels that have a depth.
struct MarkValid<'a> {
    map: &'a mut DepthMap,
}

impl Pass for MarkValid<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        self.map.mark_valid();
    }
}

/// Finds colour pixels.
struct Project<'a> {
    map: &'a mut DepthMap,
}

impl Pass for Project<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        self.map.project();
    }
}
