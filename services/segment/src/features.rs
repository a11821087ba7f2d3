//! Markers of a printed sheet: found in colour, lifted by depth.
//!
//! A marker's corners are nodes of the sheet (`orime_markers::SheetLayout`). Their depth comes from
//! the pixels inside the marker alone, by a robust plane: at a crease or at the sheet's edge a
//! corner's neighbours lie on something else. A marker without enough depth, with none that is a
//! plane, or whose sides do not come out as long as they were printed gives nothing.

use orime_geometry::nalgebra::{Isometry3, Point3, Vector2, Vector3};
use orime_geometry::{Feature, RgbdCamera, SheetGrid};
use orime_markers::{CornerPlace, Detector, DetectorParams, GreyImage, SheetPrint, grey_from_rgb};

use crate::bits::BitImage;
use crate::depth::DepthMap;
use crate::plane::{DepthPlane, Sample};

/// How far round the last mask markers are looked for, pixels.
const MARGIN_PX: usize = 40;

/// Depth pixels nearer than this to a marker's outline do not count as its own, colour pixels.
const INSET_PX: f64 = 1.0;

/// Largest relative error of a side's length.
const SIDE_ERROR_MAX: f64 = 0.35;

/// What a marker's plane may leave of its depths, metres, and that times the square of the
/// distance: a bent marker leaves more.
const RMS_M_MAX: f64 = 0.0015;
const RMS_GROWTH_PER_M: f64 = 0.006;

/// Least cosine between the sight and a marker's normal.
const COSINE_MIN: f64 = 0.25;

/// A marker in the image.
#[derive(Debug, Clone, Copy)]
struct Found {
    corners_px: [[f64; 2]; 4],
    places: [CornerPlace; 4],
}

/// Finds the markers of one camera's frames; keeps its room.
#[derive(Debug)]
pub(crate) struct FeatureFinder {
    camera_index: u32,
    camera: RgbdCamera,
    depth_from_color: Isometry3<f64>,
    world_from_depth: Isometry3<f64>,
    size_m: [f64; 2],
    print: SheetPrint,
    detector: Detector,
    grey: Vec<u8>,
    crop: Vec<u8>,
    /// Columns and rows of the colour image in which markers are looked for.
    region: [std::ops::Range<usize>; 2],
    found: Vec<Found>,
    /// Per colour pixel, the marker (counted from 1) that it lies well inside of.
    labels: Vec<u16>,
    /// Depth pixels with the label of their marker.
    samples: Vec<(u16, Sample)>,
    /// Those of one marker.
    own: Vec<Sample>,
    gaps: Vec<f64>,
    /// Features of the last frame.
    pub features: Vec<Feature>,
}

impl FeatureFinder {
    /// Panics where the sheet cannot be printed, see `SegmentConfig::check_sheet`.
    pub fn new(index: u32, camera: &RgbdCamera, sheet: &SheetGrid) -> Self {
        let (print, detector) =
            match (SheetPrint::new(sheet.nodes), DetectorParams::default().check()) {
                (Ok(print), Ok(config)) => {
                    let detector = Detector::new(&config, print.dictionary().clone());
                    (print, detector)
                }
                _ => panic!("a sheet of {:?} nodes carries no markers", sheet.nodes),
            };
        Self {
            camera_index: index,
            depth_from_color: camera.color_from_depth.inverse(),
            world_from_depth: camera.world_from_depth(),
            size_m: sheet.size_m,
            print,
            detector,
            grey: Vec::with_capacity(camera.color.pixels()),
            crop: Vec::with_capacity(camera.color.pixels()),
            region: [0..camera.color.width as usize, 0..camera.color.height as usize],
            found: Vec::new(),
            labels: vec![0; camera.color.pixels()],
            samples: Vec::with_capacity(camera.depth.pixels()),
            own: Vec::with_capacity(camera.depth.pixels()),
            gaps: Vec::with_capacity(camera.depth.pixels()),
            features: Vec::with_capacity(sheet.len()),
            camera: camera.clone(),
        }
    }

    /// Forgets the last frame, and says where the sheet was in it: there markers are looked for
    /// next, or everywhere where none were found.
    pub fn look_near(&mut self, mask: &BitImage) {
        self.region = match mask.bounds().filter(|_| !self.found.is_empty()) {
            Some(sheet) => {
                let left = (sheet.x / 64 * 64).saturating_sub(MARGIN_PX);
                let right = (sheet.x + sheet.width).next_multiple_of(64) + MARGIN_PX;
                let top = sheet.y.saturating_sub(MARGIN_PX);
                let bottom = sheet.y + sheet.height + MARGIN_PX;
                [left..right.min(mask.width), top..bottom.min(mask.height)]
            }
            None => [0..mask.width, 0..mask.height],
        };
        self.found.clear();
        self.features.clear();
    }

    /// Finds the markers of one frame, whose depth is loaded, and their corners in the world.
    pub fn find(&mut self, color_rgb: &[u8], map: &DepthMap) {
        self.detect(color_rgb);
        if self.found.is_empty() {
            return;
        }
        self.label();
        self.gather(map);
        let samples = std::mem::take(&mut self.samples);
        for run in samples.chunk_by(|a, b| a.0 == b.0) {
            self.own.clear();
            self.own.extend(run.iter().map(|(_, sample)| *sample));
            let found = self.found[usize::from(run[0].0) - 1];
            self.lift(&found);
        }
        self.samples = samples;
    }

    /// Marks the pixels of all found markers: ink is sheet.
    pub fn add_ink(&self, sheet_colored: &mut BitImage) {
        for found in &self.found {
            let size = [sheet_colored.width, sheet_colored.height];
            fill(&found.corners_px, 0.0, size, |x, y| sheet_colored.set(x, y));
        }
    }

    fn detect(&mut self, color_rgb: &[u8]) {
        let lens = &self.camera.color;
        let (width, height) = (lens.width as usize, lens.height as usize);
        let [columns, rows] = self.region.clone();
        if grey_from_rgb(width, height, color_rgb, &mut self.grey).is_err() {
            return;
        }
        self.crop.clear();
        for y in rows.clone() {
            self.crop.extend(&self.grey[y * width..][columns.clone()]);
        }
        let Ok(image) = GreyImage::new(columns.len(), rows.len(), &self.crop) else { return };
        for marker in self.detector.detect(image) {
            let Some(printed) = self.print.marker(marker.id) else { continue };
            let shift = [columns.start as f64, rows.start as f64];
            let corners_px = marker.corners_px.map(|c| [0, 1].map(|k| c[k] + shift[k]));
            self.found.push(Found { corners_px, places: printed.corners });
        }
    }

    fn label(&mut self) {
        let (width, height) = (self.camera.color.width as usize, self.camera.color.height as usize);
        self.labels.fill(0);
        for (label, found) in (1..).zip(&self.found) {
            let labels = &mut self.labels;
            fill(&found.corners_px, INSET_PX, [width, height], |x, y| {
                labels[y * width + x] = label
            });
        }
    }

    /// Collects the depth pixels of all markers, by marker.
    fn gather(&mut self, map: &DepthMap) {
        let width = self.camera.color.width as usize;
        self.samples.clear();
        for y in 0..map.height {
            for x in (0..map.width).filter(|x| map.valid.get(*x, y)) {
                let Some((column, row)) = map.color_pixel(x, y) else { continue };
                let label = self.labels[row * width + column];
                if label > 0 {
                    let ray = self.camera.depth.ray(Vector2::new(x as f64, y as f64));
                    let z_m = f64::from(map.z_m(x as i32, y as i32));
                    self.samples.push((label, Sample { ray, z_m }));
                }
            }
        }
        // Stable: equal frames give equal sums.
        self.samples.sort_by_key(|(label, _)| *label);
    }

    /// Adds the corners of a marker whose depth pixels are `own`.
    fn lift(&mut self, found: &Found) {
        let [a, b, c, _] = found.places.map(|place| self.material_m(&place));
        let diagonal_m = (a - c).norm();
        let Some(plane) = DepthPlane::fit(&self.own, diagonal_m, &mut self.gaps) else { return };
        let z_m = self.own[0].z_m;
        let bent = plane.rms_m > RMS_M_MAX + RMS_GROWTH_PER_M * z_m * z_m;
        if bent || plane.cosine(&self.own[0].ray) < COSINE_MIN {
            return;
        }
        let origin_m = self.depth_from_color.translation.vector;
        let mut corners_m = [Vector3::zeros(); 4];
        for (corner_m, pixel) in corners_m.iter_mut().zip(found.corners_px) {
            let ray = self.depth_from_color.rotation * self.camera.color.ray(pixel.into());
            let Some(met) = plane.meet(&origin_m, &ray) else { return };
            *corner_m = met;
        }
        let sides_m = [(a - b).norm(), (b - c).norm()];
        for k in 0..4 {
            let side_m = (corners_m[k] - corners_m[(k + 1) % 4]).norm();
            if (side_m / sides_m[k % 2] - 1.0).abs() > SIDE_ERROR_MAX {
                return;
            }
        }
        for (corner_m, place) in corners_m.iter().zip(found.places) {
            let Some(node) = place.node else { continue };
            let world_m = self.world_from_depth * Point3::from(*corner_m);
            self.features.push(Feature {
                position_m: world_m.coords.cast::<f32>().into(),
                node: node as u32,
                camera: self.camera_index,
                pixels: plane.kept as f32,
            });
        }
    }

    /// Where on the sheet a corner is, metres.
    fn material_m(&self, place: &CornerPlace) -> Vector2<f64> {
        Vector2::from([0, 1].map(|k| place.uv_share[k] * self.size_m[k]))
    }
}

/// Calls `set` for each pixel at least `inset_px` inside a convex quadrangle, clockwise.
fn fill(
    corners_px: &[[f64; 2]; 4],
    inset_px: f64,
    [width, height]: [usize; 2],
    mut set: impl FnMut(usize, usize),
) {
    let bounds = [0, 1].map(|k| {
        let values = corners_px.map(|corner| corner[k]);
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        [low, values.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
    });
    let clip = |[low, high]: [f64; 2], end: usize| {
        low.ceil().clamp(0.0, end as f64) as usize..(high + 1.0).clamp(0.0, end as f64) as usize
    };
    for y in clip(bounds[1], height) {
        for x in clip(bounds[0], width) {
            let inside = (0..4).all(|k| {
                let (a, b) = (corners_px[k], corners_px[(k + 1) % 4]);
                let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
                let across = dx * (y as f64 - a[1]) - dy * (x as f64 - a[0]);
                across >= inset_px * dx.hypot(dy)
            });
            if inside {
                set(x, y);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quadrangle_is_filled_to_its_inset() {
        let square = [[1.0, 1.0], [5.0, 1.0], [5.0, 4.0], [1.0, 4.0]];
        let count = |inset_px| {
            let mut pixels = Vec::new();
            fill(&square, inset_px, [8, 8], |x, y| pixels.push((x, y)));
            pixels
        };
        assert_eq!(count(0.0).len(), 5 * 4);
        assert_eq!(count(1.0), [(2, 2), (3, 2), (4, 2), (2, 3), (3, 3), (4, 3)]);
    }
}
