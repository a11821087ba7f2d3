//! One camera's contour, and which samples it should see as such.

use super::bends::Bends;
use super::cells::Cells;
use super::matching::{Candidates, Gather, MARGIN_PX, Mark, Nearest, Silhouette};
use super::sample::Sample;
use crate::blend::Blend;
use crate::projector::Coordinates;
use crate::zbuffer::{EMPTY, ZBuffer};
use nalgebra::{Isometry3, Matrix3, Point3, Vector2, Vector3};
use orime_geometry::{CameraModel, Edgel, RgbdCamera};
use orime_lanes::{LANES, Width};
use std::ops::Range;

/// Where the model's depth image is asked along the normal, pixels outside and inside.
const ASK_PX: [f32; 2] = [1.2, 2.6];
/// Projected neighbours nearer than this tell no direction, pixels.
const LENGTH_PX_MIN: f64 = 1.5;
/// A step in depth from here on is an inner edge, metres.
const STEP_M: f32 = 4e-3;
/// Samples that have not moved farther are the contour that they were, pixels.
const MOVED_PX: f32 = 0.5;

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

/// Kinds of edgels.
const KINDS: usize = 2;

/// The contour of one camera.
#[derive(Debug, Clone)]
pub(super) struct View {
    color_from_world: Isometry3<f64>,
    rotation: Matrix3<f64>,
    pub lens: CameraModel,
    /// Edgels, by their kind.
    cells: [Cells; KINDS],
    buffer: ZBuffer,
    /// The probes in this image.
    projected: [Coordinates; PROBES],
    pub silhouettes: Vec<Silhouette>,
    candidates: Candidates,
    /// Where the silhouettes are, in the world and in the image.
    positions_m: Coordinates,
    pixels: Coordinates,
    /// Signed distance from each silhouette to the nearest matching edge, pixels; NaN without.
    pub offsets_px: Vec<f32>,
    /// As [`Mark::marks`].
    marks: Vec<f32>,
    /// Farthest that a silhouette has moved since it was classified, pixels.
    moved_px: f32,
    lanes: Width,
}

impl View {
    pub fn new(camera: &RgbdCamera) -> Self {
        let cells = Cells::new(camera.color.width, camera.color.height);
        let mut view = Self {
            rotation: Matrix3::identity(),
            color_from_world: Isometry3::identity(),
            lens: camera.color.clone(),
            cells: [cells.clone(), cells],
            buffer: ZBuffer::new(&camera.color, &camera.world_from_color, 1.0),
            projected: Default::default(),
            silhouettes: Vec::new(),
            candidates: Candidates::default(),
            positions_m: Coordinates::default(),
            pixels: Coordinates::default(),
            offsets_px: Vec::new(),
            marks: Vec::new(),
            moved_px: f32::INFINITY,
            lanes: Width::available()[0],
        };
        view.stand(camera);
        view
    }

    /// Stands it where a camera of the same lens does.
    pub fn stand(&mut self, camera: &RgbdCamera) {
        self.color_from_world = camera.world_from_color.inverse();
        self.rotation = self.color_from_world.rotation.to_rotation_matrix().into_inner();
        self.buffer.stand(&camera.world_from_color);
    }

    /// Adds an edgel to those that [`Self::sort`] takes over; one out of the image is left out.
    pub fn insert(&mut self, edgel: &Edgel) {
        let size = [self.lens.width, self.lens.height].map(|px| px as f32);
        let is_inside = (0..2).all(|axis| (0.0..size[axis]).contains(&edgel.position_px[axis]));
        if let Some(cells) = self.cells.get_mut(edgel.kind as usize).filter(|_| is_inside) {
            cells.insert(edgel);
        }
    }

    /// Takes over the edgels that were inserted, in place of those before.
    pub fn sort(&mut self) {
        self.moved_px = f32::INFINITY;
        self.cells.iter_mut().for_each(Cells::sort);
    }

    /// Whether there are no edgels.
    pub fn is_empty(&self) -> bool {
        self.cells.iter().all(|cells| cells.len() == 0)
    }

    /// Forgets which samples are contour.
    pub fn forget(&mut self) {
        self.moved_px = f32::INFINITY;
        self.silhouettes.clear();
    }

    /// Whether the sheet has moved so far in this image that other samples may be contour.
    pub fn has_moved(&self) -> bool {
        self.moved_px > MOVED_PX
    }

    /// Finds the samples that are contour in the model's own image, and the edgels near them.
    pub fn classify(&mut self, probes: &Probes, nodes_m: &[[f32; 3]], triangles: &[[u32; 3]]) {
        self.buffer.draw(nodes_m, triangles);
        self.project(probes, 0..PROBES);
        self.silhouettes.clear();
        self.candidates.clear();
        self.moved_px = 0.0;
        for index in 0..probes.count {
            if let Some((kind, normal, pixel)) = self.silhouette(index) {
                self.silhouettes.push(Silhouette {
                    sample: index as u32,
                    kind,
                    normal: normal.cast::<f32>().into(),
                    classified_px: pixel,
                    gathered_px: pixel,
                    candidates: [0; 2],
                });
                self.gather(self.silhouettes.len() - 1, pixel);
            }
        }
    }

    /// Takes some of the probes into this image.
    fn project(&mut self, probes: &Probes, which: Range<usize>) {
        for k in which {
            self.buffer.project(&probes.points_m[k].axes, &mut self.projected[k]);
        }
    }

    /// Gathers the edgels that a silhouette may match from around a pixel.
    fn gather(&mut self, index: usize, pixel: [f32; 2]) {
        let silhouette = &mut self.silhouettes[index];
        self.lanes.run(Gather {
            cells: &self.cells[silhouette.kind as usize],
            pixel,
            reach_px: super::REACH_PX[0],
            silhouette,
            candidates: &mut self.candidates,
        });
    }

    /// Kind of edge, outward normal and pixel of a sample that is contour.
    fn silhouette(&self, index: usize) -> Option<(u32, Vector2<f64>, [f32; 2])> {
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
            return is_contour.then_some((0, normal, [here[0], here[1]]));
        }
        // What lies outside is farther off, and what lies inside is the sample's own layer.
        let behind = |at: (u32, f32)| at.0 == EMPTY || 1.0 / at.1 > 1.0 / here[2] + STEP_M;
        let own = |at: (u32, f32)| at.0 != EMPTY && (1.0 / at.1 - 1.0 / here[2]).abs() < STEP_M;
        (behind(near) && behind(far) && own(inner)).then_some((1, normal, [here[0], here[1]]))
    }

    /// Looks for the silhouettes' edges, where the samples are now: fills `offsets_px`.
    pub fn look_up(&mut self, samples_m: &[[f32; 3]], reach_px: f32) {
        self.positions_m.set(self.silhouettes.iter().map(|s| samples_m[s.sample as usize]));
        self.buffer.project(&self.positions_m.axes, &mut self.pixels);
        for index in 0..self.silhouettes.len() {
            let pixel = [self.pixels.axes[0][index], self.pixels.axes[1][index]];
            let from = |place: [f32; 2]| [pixel[0] - place[0], pixel[1] - place[1]];
            let silhouette = &self.silhouettes[index];
            let [x, y] = from(silhouette.classified_px);
            self.moved_px = self.moved_px.max(x.abs()).max(y.abs());
            let [x, y] = from(silhouette.gathered_px);
            if x.hypot(y) > MARGIN_PX {
                self.gather(index, pixel);
            }
        }
        self.lanes.run(Nearest {
            silhouettes: &self.silhouettes,
            candidates: &self.candidates,
            pixels: &self.pixels,
            reach_px,
            offsets_px: &mut self.offsets_px,
        });
    }

    /// ∂(normal·pixel)/∂position of a position that is seen, world frame, px/m.
    pub fn gradient(&self, position_m: [f32; 3], normal: [f32; 2]) -> Vector3<f64> {
        let here = self.color_from_world * Point3::from(position_m).cast::<f64>();
        let lens = &self.lens;
        let (fx, fy) = (lens.fx_px * f64::from(normal[0]), lens.fy_px * f64::from(normal[1]));
        let in_camera = Vector3::new(fx, fy, -(fx * here.x + fy * here.y) / here.z) / here.z;
        self.rotation.tr_mul(&in_camera)
    }

    /// Marks the seen silhouettes within a distance of the projected border or a crease, and no
    /// others.
    pub fn explain(&mut self, probes: &Probes, within_px: f32) {
        self.project(probes, 0..3);
        self.marks.clear();
        self.marks.resize(self.cells[0].len() + LANES, 0.0);
        self.mark(probes.count, within_px);
    }

    /// Marks those as well that lie where the sheet turns its other side to this camera.
    pub fn explain_bends(
        &mut self,
        bends: &Bends,
        nodes_m: &[[f32; 3]],
        triangles: &[[u32; 3]],
        within_px: f32,
    ) {
        let eye_m = self.color_from_world.inverse().translation.vector.cast::<f32>();
        let joints = bends.seen_from(eye_m, nodes_m, triangles);
        let at = |share: f32| {
            joints.iter().map(move |ends_m| {
                [0, 1, 2].map(|k| (1.0 - share) * ends_m[0][k] + share * ends_m[1][k])
            })
        };
        let mut points_m = Coordinates::default();
        for (share, projected) in [0.5, 0.0, 1.0].into_iter().zip(&mut self.projected) {
            points_m.set(at(share));
            self.buffer.project(&points_m.axes, projected);
        }
        self.mark(joints.len(), within_px);
    }

    /// Marks what lies near the first pieces that are projected.
    fn mark(&mut self, count: usize, within_px: f32) {
        let [here, before, after, ..] = &self.projected;
        let (cells, pieces) = (&self.cells[0], [before, here, after]);
        self.lanes.run(Mark { cells, pieces, count, within_px, marks: &mut self.marks });
    }

    /// How many silhouettes are marked, and how many there are.
    pub fn marked(&self) -> [usize; 2] {
        [self.marks.iter().filter(|mark| **mark > 0.0).count(), self.cells[0].len()]
    }
}
