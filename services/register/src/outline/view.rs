//! One camera's contour, and which samples it should see as such.

use super::sample::Sample;
use crate::blend::Blend;
use crate::projector::Coordinates;
use crate::zbuffer::{EMPTY, ZBuffer};
use nalgebra::{Matrix3, Point3, Vector2, Vector3};
use orime_geometry::{Edgel, RgbdCamera};

/// Widest match along the contour, pixels.
const TANGENT_PX: f64 = 4.0;
/// Edgels this close to the nearest one along the normal are averaged with it, pixels.
const SAME_EDGE_PX: f64 = 2.5;
/// Least cosine between the normals of sample and edgel.
const COSINE_MIN: f64 = 0.8;
/// Side of the lookup cells, pixels.
const CELL_PX: usize = 16;
/// Where the model's depth image is asked along the normal, pixels outside and inside.
const ASK_PX: [f32; 2] = [1.2, 2.6];
/// Projected neighbours nearer than this tell no direction, pixels.
const LENGTH_PX_MIN: f64 = 1.5;
/// A step in depth from here on is an inner edge, metres.
const STEP_M: f32 = 4e-3;
/// Samples may move so far in the image before edgels are gathered for them anew, pixels.
const MARGIN_PX: f64 = 4.0;
/// Samples that have not moved farther are the contour that they were, pixels.
const MOVED_PX: f64 = 0.5;

/// What is asked about every sample: where it is, its neighbours, and points inside the sheet.
#[derive(Debug, Clone, Default)]
pub(super) struct Probes {
    count: usize,
    /// As the fields of [`Sample`], world frame, metres.
    points_m: [Coordinates; PROBES],
}

/// Points per sample.
const PROBES: usize = 5;

impl Probes {
    /// Takes over the samples, where the nodes are now.
    pub fn place(&mut self, samples: &[Sample], nodes_m: &[[f32; 3]]) {
        self.count = samples.len();
        let blends: [fn(&Sample) -> &Blend; PROBES] =
            [|s| &s.here, |s| &s.before, |s| &s.after, |s| &s.inside[0], |s| &s.inside[1]];
        for (points_m, blend) in self.points_m.iter_mut().zip(blends) {
            points_m.set(samples.iter().map(|sample| blend(sample).position_m(nodes_m)));
        }
    }
}

/// A sample that this camera should see as contour.
#[derive(Debug, Clone, Copy)]
pub(super) struct Silhouette {
    pub sample: u32,
    /// As [`Edgel::kind`].
    pub kind: u32,
    /// Unit normal out of the sheet, in the image.
    pub normal: Vector2<f64>,
    /// Where it was when it was classified.
    classified_px: Vector2<f64>,
    /// Where it was when edgels were gathered for it.
    gathered_px: Vector2<f64>,
    /// Their places among the view's candidates.
    candidates: [u32; 2],
}

/// Edgels of one camera in cells.
#[derive(Debug, Clone)]
pub(super) struct View {
    color_from_world: nalgebra::Isometry3<f64>,
    rotation: Matrix3<f64>,
    pub camera: RgbdCamera,
    columns: usize,
    cells: Vec<Vec<u32>>,
    buffer: ZBuffer,
    /// The probes in this image.
    projected: [Coordinates; PROBES],
    pub silhouettes: Vec<Silhouette>,
    /// Edgels that silhouettes may match: along the silhouette's normal and tangent, pixels.
    candidates: Vec<[f64; 2]>,
    /// Farthest that a silhouette has moved since it was classified, pixels.
    moved_px: f64,
}

impl View {
    pub fn new(camera: &RgbdCamera) -> Self {
        let color_from_world = camera.world_from_color.inverse();
        let columns = camera.color.width as usize / CELL_PX + 1;
        let rows = camera.color.height as usize / CELL_PX + 1;
        Self {
            rotation: color_from_world.rotation.to_rotation_matrix().into_inner(),
            color_from_world,
            camera: camera.clone(),
            columns,
            cells: vec![Vec::new(); columns * rows],
            buffer: ZBuffer::new(&camera.color, &camera.world_from_color, 1.0),
            projected: Default::default(),
            silhouettes: Vec::new(),
            candidates: Vec::new(),
            moved_px: f64::INFINITY,
        }
    }

    /// Forgets the edgels.
    pub fn clear(&mut self) {
        self.moved_px = f64::INFINITY;
        self.cells.iter_mut().for_each(Vec::clear);
    }

    /// Forgets which samples are contour.
    pub fn forget(&mut self) {
        self.moved_px = f64::INFINITY;
        self.silhouettes.clear();
    }

    /// Adds an edgel, which has this index among all.
    pub fn insert(&mut self, index: u32, edgel: &Edgel) {
        let [x, y] = edgel.position_px.map(f64::from);
        let (width, height) = (self.camera.color.width, self.camera.color.height);
        if 0.0 <= x && x < f64::from(width) && 0.0 <= y && y < f64::from(height) {
            self.cells[y as usize / CELL_PX * self.columns + x as usize / CELL_PX].push(index);
        }
    }

    pub fn pixel(&self, position_m: [f32; 3]) -> Option<Vector2<f64>> {
        let point = self.color_from_world * Point3::from(position_m).cast::<f64>();
        self.camera.color.project(&point)
    }

    /// Whether the sheet has moved so far in this image that other samples may be contour.
    pub fn has_moved(&self) -> bool {
        self.moved_px > MOVED_PX
    }

    /// Finds the samples that are contour in the model's own image, and the edgels near them.
    pub fn classify(
        &mut self,
        probes: &Probes,
        nodes_m: &[[f32; 3]],
        triangles: &[[u32; 3]],
        edgels: &[Edgel],
    ) {
        self.buffer.draw(nodes_m, triangles);
        for (points_m, projected) in probes.points_m.iter().zip(&mut self.projected) {
            self.buffer.project(&points_m.axes, projected);
        }
        self.silhouettes.clear();
        self.candidates.clear();
        self.moved_px = 0.0;
        for index in 0..probes.count {
            if let Some((kind, normal, pixel)) = self.silhouette(index) {
                self.silhouettes.push(Silhouette {
                    sample: index as u32,
                    kind,
                    normal,
                    classified_px: pixel,
                    gathered_px: pixel,
                    candidates: [0; 2],
                });
                self.gather(self.silhouettes.len() - 1, pixel, edgels);
            }
        }
    }

    /// Gathers the edgels that a silhouette may match from around a pixel.
    fn gather(&mut self, index: usize, pixel: Vector2<f64>, edgels: &[Edgel]) {
        let Silhouette { normal: outward, kind, .. } = self.silhouettes[index];
        let tangent = Vector2::new(-outward.y, outward.x);
        let reach_px = super::REACH_PX[0] + MARGIN_PX;
        let first = self.candidates.len() as u32;
        let mut candidates = std::mem::take(&mut self.candidates);
        candidates.extend(self.cells_near(pixel, reach_px.hypot(TANGENT_PX)).filter_map(|k| {
            let edgel = &edgels[k as usize];
            let position = Vector2::from(edgel.position_px).cast::<f64>();
            let across = outward.dot(&(position - pixel)).abs();
            let along = tangent.dot(&(position - pixel)).abs();
            (edgel.kind == kind
                && across < reach_px
                && along < TANGENT_PX + MARGIN_PX
                && outward.dot(&Vector2::from(edgel.normal).cast::<f64>()) > COSINE_MIN)
                .then(|| [outward.dot(&position), tangent.dot(&position)])
        }));
        self.candidates = candidates;
        let silhouette = &mut self.silhouettes[index];
        silhouette.gathered_px = pixel;
        silhouette.candidates = [first, self.candidates.len() as u32];
    }

    /// Kind of edge, outward normal and pixel of a sample that is contour.
    fn silhouette(&self, index: usize) -> Option<(u32, Vector2<f64>, Vector2<f64>)> {
        let [here, before, after, inside @ ..] = &self.projected;
        let pixel = |p: [f32; 3]| Vector2::new(f64::from(p[0]), f64::from(p[1]));
        let place = |of: &Coordinates| {
            let p = of.at(index);
            (!p[0].is_nan()).then_some(p)
        };
        let here = place(here)?;
        let along = pixel(place(after)?) - pixel(place(before)?);
        let along = along.try_normalize(LENGTH_PX_MIN)?;
        let mut normal = Vector2::new(along.y, -along.x);
        let depth = |inside| Some(normal.dot(&(pixel(place(inside)?) - pixel(here))));
        let [a, b] = [depth(&inside[0])?, depth(&inside[1])?];
        // Seen edge on, a sheet has no outside; nor has a crease whose facets lie on both sides.
        if a * b <= 0.0 || a.abs().max(b.abs()) < 0.5 {
            return None;
        }
        if a > 0.0 {
            normal = -normal;
        }
        let ask = |px: f32| {
            let [x, y] = [here[0] + px * normal.x as f32, here[1] + px * normal.y as f32];
            self.buffer.holds(x, y).then(|| self.buffer.at(x, y))
        };
        let [near, far] = [ask(ASK_PX[0])?, ask(ASK_PX[1])?];
        let [inner, deep] = [ask(-ASK_PX[0])?, ask(-ASK_PX[1])?];
        if near.0 == EMPTY && far.0 == EMPTY {
            let is_contour = inner.0 != EMPTY || deep.0 != EMPTY;
            return is_contour.then(|| (0, normal, pixel(here)));
        }
        // What lies outside is farther off, and what lies inside is the sample's own layer.
        let behind = |at: (u32, f32)| at.0 == EMPTY || 1.0 / at.1 > 1.0 / here[2] + STEP_M;
        let own = |at: (u32, f32)| at.0 != EMPTY && (1.0 / at.1 - 1.0 / here[2]).abs() < STEP_M;
        (behind(near) && behind(far) && own(inner)).then(|| (1, normal, pixel(here)))
    }

    /// Pixel of a position, and ∂(normal·pixel)/∂position, world frame, px/m.
    pub fn probe(
        &self,
        position_m: [f32; 3],
        normal: Vector2<f64>,
    ) -> Option<(Vector2<f64>, Vector3<f64>)> {
        let here = self.color_from_world * Point3::from(position_m).cast::<f64>();
        let lens = &self.camera.color;
        let pixel = lens.project(&here)?;
        let (fx, fy) = (lens.fx_px * normal.x, lens.fy_px * normal.y);
        let in_camera = Vector3::new(fx, fy, -(fx * here.x + fy * here.y) / here.z) / here.z;
        Some((pixel, self.rotation.transpose() * in_camera))
    }

    /// Signed distance along the normal of a silhouette, which is at `pixel` now, to the nearest
    /// matching edge, pixels.
    pub fn nearest(
        &mut self,
        index: usize,
        pixel: Vector2<f64>,
        edgels: &[Edgel],
        reach_px: f64,
    ) -> Option<f64> {
        let silhouette = &self.silhouettes[index];
        self.moved_px = self.moved_px.max((pixel - silhouette.classified_px).amax());
        if (pixel - silhouette.gathered_px).norm() > MARGIN_PX {
            self.gather(index, pixel, edgels);
        }
        let Silhouette { normal, candidates: [first, end], .. } = self.silhouettes[index];
        let here = [normal.dot(&pixel), normal.x * pixel.y - normal.y * pixel.x];
        let candidates = &self.candidates[first as usize..end as usize];
        let matches = || {
            let offset = |at: &[f64; 2]| (at[0] - here[0], at[1] - here[1]);
            candidates
                .iter()
                .map(offset)
                .filter(|(across, along)| across.abs() < reach_px && along.abs() < TANGENT_PX)
        };
        let cost = |c: &(f64, f64)| c.0.abs() + 0.25 * c.1.abs();
        let (first, _) = matches().min_by(|a, b| cost(a).total_cmp(&cost(b)))?;
        let (mut sum, mut weights) = (0.0, 0.0);
        for (across, along) in matches() {
            if (across - first).abs() < SAME_EDGE_PX {
                let weight = 1.0 / (1.0 + along * along);
                sum += weight * across;
                weights += weight;
            }
        }
        Some(sum / weights)
    }

    /// Edgels in the cells that a square of half side `span` touches.
    pub fn cells_near(&self, pixel: Vector2<f64>, span: f64) -> impl Iterator<Item = u32> + '_ {
        let rows = self.cells.len() / self.columns;
        let range = |centre: f64, count: usize| {
            let cell = |at: f64| ((at / CELL_PX as f64).max(0.0) as usize).min(count);
            cell(centre - span)..(cell(centre + span) + 1).min(count)
        };
        let (xs, ys) = (range(pixel.x, self.columns), range(pixel.y, rows));
        ys.flat_map(move |y| xs.clone().map(move |x| y * self.columns + x))
            .flat_map(|cell| self.cells[cell].iter().copied())
    }
}
