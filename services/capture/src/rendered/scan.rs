//! Many faces in a colour image: 16 samples a pixel, each with its own depth test.
//!
//! A pixel has [`SUB_ROWS`] rows of two samples, each row shifted by another eighth of a sample,
//! so that edges of any direction cross the samples one after the other. With motion blur each
//! row of samples sees the scene at another instant of the exposure.

use std::ops::Range;

use orime_geometry::CameraModel;
use orime_geometry::nalgebra::{Isometry3, Vector3};

use super::ink::Ink;
use super::paint::{self, Fibres, Look};
use super::project::Projected;
use super::scene::{INSTANTS, Scene};

const SUB_ROWS: usize = 8;
const _: () = assert!(SUB_ROWS == INSTANTS, "a row of samples sees one instant");

/// Shift of each row of samples, eighths of a sample.
const PHASES: [usize; SUB_ROWS] = [0, 5, 2, 7, 4, 1, 6, 3];

/// No face: the table.
const TABLE: u8 = u8::MAX;

/// Most faces that a scene may have.
pub(super) const FACES_MAX: usize = TABLE as usize;

/// Room for one image's faces and one row's samples.
#[derive(Debug)]
pub(super) struct Scan {
    /// Faces that are seen, for each instant; the index says which face.
    layers: Vec<Vec<(u8, Projected)>>,
    /// Colour of each face as the lens sees it, 0 to 255.
    rgb: Vec<[f32; 3]>,
    /// One row of fibres for each face of the sheet.
    fibres: Vec<bool>,
    /// Faces of one instant, for their fibres.
    middle: Vec<Option<Projected>>,
    /// Whether each face shows its back.
    backs: Vec<bool>,
    /// For each row of samples, where each face's points lie on the sheet; only for print.
    lines: [Vec<Fibres>; SUB_ROWS],
    /// Which layers a row touches, for each instant.
    active: [Vec<usize>; INSTANTS],
    /// Nearest inverse depth of each sample of one row of samples.
    nearest: Vec<f32>,
    /// Which face each sample of a pixel row sees.
    seen: [Vec<u8>; SUB_ROWS],
}

impl Scan {
    pub fn new(width: usize) -> Self {
        Self {
            layers: (0..INSTANTS).map(|_| Vec::with_capacity(FACES_MAX)).collect(),
            rgb: Vec::with_capacity(FACES_MAX),
            fibres: Vec::with_capacity(FACES_MAX),
            middle: Vec::with_capacity(FACES_MAX),
            backs: Vec::with_capacity(FACES_MAX),
            lines: std::array::from_fn(|_| Vec::with_capacity(FACES_MAX)),
            active: std::array::from_fn(|_| Vec::with_capacity(FACES_MAX)),
            nearest: vec![0.0; 2 * width],
            seen: std::array::from_fn(|_| vec![TABLE; 2 * width]),
        }
    }

    /// Projects the scene's faces.
    pub fn prepare(&mut self, lens: &CameraModel, lens_from_world: &Isometry3<f64>, scene: &Scene) {
        let eye_m = lens_from_world.inverse().translation.vector;
        let project = |face: &super::scene::Face| {
            Projected::new(lens, lens_from_world, &face.pose, face.corners_uv_m())
        };
        self.rgb.clear();
        self.fibres.clear();
        self.middle.clear();
        self.backs.clear();
        // A gripper that lets go within the exposure is missing from some instants.
        let instants = if scene.is_blurred() { INSTANTS } else { 1 };
        let fullest = (0..instants).map(|k| scene.faces_at(k)).max_by_key(|faces| faces.len());
        for face in fullest.unwrap_or_default() {
            let light = paint::shade(&face.normal_towards(&eye_m)) as f32;
            self.rgb.push(face.rgb.map(|c| c * light));
            self.fibres.push(face.is_sheet);
            self.middle.push(project(face));
            self.backs.push(face.pose.normal().dot(&(eye_m - face.pose.origin_m)) < 0.0);
        }
        for (k, layers) in self.layers.iter_mut().enumerate() {
            layers.clear();
            if k < instants {
                let faces = (0..TABLE).zip(scene.faces_at(k));
                layers.extend(faces.filter_map(|(id, face)| Some((id, project(face)?))));
            }
        }
    }

    /// Paints the faces over row `y` of an image.
    pub fn paint_row(&mut self, y: usize, height: usize, look: &Look<'_>, row: &mut [u8]) {
        let width = row.len() / 3;
        let instants = if self.layers[1].is_empty() { 1 } else { INSTANTS };
        let Some(columns) = self.columns(y, height, width, instants) else { return };
        for (active, layers) in self.active.iter_mut().zip(&self.layers[..instants]) {
            active.clear();
            let touched = layers.iter().enumerate();
            let touched = touched.filter(|(_, (_, face))| face.rows(height).contains(&y));
            active.extend(touched.map(|(k, _)| k));
        }
        for sub in 0..SUB_ROWS {
            let samples = 2 * columns.start..2 * columns.end;
            self.nearest[samples.clone()].fill(0.0);
            self.seen[sub][samples].fill(TABLE);
            let layers = &self.layers[sub % instants];
            for k in &self.active[sub % instants] {
                let (id, face) = &layers[*k];
                let seen = &mut self.seen[sub];
                sample(face, *id, y, sub, &columns, &mut self.nearest, seen);
            }
        }
        if look.ink.is_some() {
            self.lay_lines(y, instants);
        }
        self.blend(y, columns, look, row);
    }

    /// Finds where on the sheet a row's samples lie.
    fn lay_lines(&mut self, y: usize, instants: usize) {
        for (sub, lines) in self.lines.iter_mut().enumerate() {
            lines.clear();
            lines.resize(self.rgb.len(), Fibres::none());
            for k in &self.active[sub % instants] {
                let (id, face) = &self.layers[sub % instants][*k];
                lines[usize::from(*id)] = Fibres::at_height(face, sample_y(y, sub));
            }
        }
    }

    /// Share of the light that a sample's print reflects.
    fn reflected(&self, ink: &Ink, id: u8, x: usize, sub: usize, n: usize) -> f32 {
        let k = usize::from(id);
        let x = x as f32 + (n as f32 + sample_phase(sub) as f32) / 2.0 - 0.5;
        ink.reflects(self.backs[k], self.lines[sub][k].uv_m(x))
    }

    /// Columns that any face touches in row `y`.
    fn columns(
        &self,
        y: usize,
        height: usize,
        width: usize,
        instants: usize,
    ) -> Option<Range<usize>> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (_, face) in self.layers[..instants].iter().flatten() {
            if face.rows(height).contains(&y) {
                let [start, end] = face.columns();
                (low, high) = (low.min(start), high.max(end));
            }
        }
        let start = (low - 0.5).floor().clamp(0.0, width as f64) as usize;
        let end = (high + 1.5).ceil().clamp(0.0, width as f64) as usize;
        (low <= high && start < end).then_some(start..end)
    }

    /// Mixes each pixel's samples.
    fn blend(&self, y: usize, columns: Range<usize>, look: &Look<'_>, row: &mut [u8]) {
        let mut last = (TABLE, Fibres::none());
        for x in columns {
            let ids: [[u8; 2]; SUB_ROWS] =
                std::array::from_fn(|sub| [self.seen[sub][2 * x], self.seen[sub][2 * x + 1]]);
            let first = ids[0][0];
            let pixel = &mut row[3 * x..3 * x + 3];
            let uniform = ids.as_flattened().iter().all(|id| *id == first);
            if uniform && first == TABLE {
                continue;
            }
            let mut mixed = [0.5; 3];
            let mut add = |id: u8, share: f32, pixel: &[u8]| {
                if id == TABLE {
                    (0..3).for_each(|c| mixed[c] += share * f32::from(pixel[c]));
                    return;
                }
                let k = usize::from(id);
                let mut light = share;
                if self.fibres[k] {
                    if last.0 != id {
                        last = (id, Fibres::new(self.middle[k].as_ref(), y));
                    }
                    light *= last.1.brightness(x, look);
                }
                (0..3).for_each(|c| mixed[c] += light * self.rgb[k][c]);
            };
            let share = 1.0 / (2 * SUB_ROWS) as f32;
            let is_printed = |id: u8| id != TABLE && self.fibres[usize::from(id)];
            let ink = look.ink.map(|ink| {
                let at = |sub: usize, n: usize, id: u8| {
                    if is_printed(id) { self.reflected(ink, id, x, sub, n) } else { 1.0 }
                };
                std::array::from_fn(|sub| [0, 1].map(|n| at(sub, n, ids[sub][n])))
            });
            let light: [[f32; 2]; SUB_ROWS] = ink.unwrap_or([[1.0; 2]; SUB_ROWS]);
            if uniform {
                let mean =
                    look.ink.map_or(1.0, |_| share * light.as_flattened().iter().sum::<f32>());
                add(first, mean, pixel);
            } else {
                let samples = ids.as_flattened().iter().zip(light.as_flattened());
                samples.for_each(|(id, light)| add(*id, share * light, pixel));
            }
            (0..3).for_each(|c| pixel[c] = mixed[c].min(255.0) as u8);
        }
    }
}

/// Height of a row of samples.
fn sample_y(y: usize, sub: usize) -> f64 {
    y as f64 + (sub as f64 + 0.5) / SUB_ROWS as f64 - 0.5
}

/// Shift of a row of samples, samples.
fn sample_phase(sub: usize) -> f64 {
    (PHASES[sub] as f64 + 0.5) / SUB_ROWS as f64
}

/// Depth-tests one face against one row of samples.
fn sample(
    face: &Projected,
    id: u8,
    y: usize,
    sub: usize,
    columns: &Range<usize>,
    nearest: &mut [f32],
    seen: &mut [u8],
) {
    let (y, phase) = (sample_y(y, sub), sample_phase(sub));
    // Sample n stands at column (n + phase) / 2 − 1/2.
    let [low, high] = face.chord(y, 0.0).map(|x| 2.0 * (x + 0.5) - phase);
    let low = low.max(2.0 * columns.start as f64);
    let high = high.min(2.0 * columns.end as f64 - 1.0);
    // Neither is negative here, so a cast rounds down.
    let start = low as usize + usize::from(low > (low as usize) as f64);
    if high < 0.0 || start > high as usize {
        return;
    }
    let end = high as usize + 1;
    let inverse = Vector3::from(face.per_depth.row(2).transpose());
    let step = (inverse.x / 2.0) as f32;
    let x = (start as f64 + phase) / 2.0 - 0.5;
    let first = (inverse.x * x + inverse.y * y + inverse.z) as f32;
    let samples = nearest[start..end].iter_mut().zip(&mut seen[start..end]);
    for (k, (nearest, seen)) in samples.enumerate() {
        let here = first + step * k as f32;
        if here > *nearest {
            (*nearest, *seen) = (here, id);
        }
    }
}
