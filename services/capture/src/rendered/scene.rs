//! Everything that moves, as plane faces at one exposure.

use orime_geometry::nalgebra::Vector3;
use orime_origami::{FacetPose, Pose, Sequence};

use super::occluder::{self, Occluder};
use super::project::CORNERS_MAX;

/// Times within one exposure at which a blurred colour image sees the scene.
pub(super) const INSTANTS: usize = 8;

/// A plane, convex polygon in the world.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    count: usize,
    corners_uv_m: [[f64; 2]; CORNERS_MAX],
    /// Maps the corners' plane into the world.
    pub pose: FacetPose,
    /// Colour in full light, 0 to 255.
    pub rgb: [f32; 3],
    /// Whether it is the sheet, which has fibres, two sides, and shines through.
    pub is_sheet: bool,
}

impl Face {
    /// A face of up to [`CORNERS_MAX`] corners.
    pub fn new(corners: &[[f64; 2]], pose: FacetPose, rgb: [f32; 3], is_sheet: bool) -> Self {
        let mut corners_uv_m = [[0.0; 2]; CORNERS_MAX];
        let count = corners.len().min(CORNERS_MAX);
        corners_uv_m[..count].copy_from_slice(&corners[..count]);
        Self { count, corners_uv_m, pose, rgb, is_sheet }
    }

    /// Corners in the face's own plane, metres.
    pub fn corners_uv_m(&self) -> &[[f64; 2]] {
        &self.corners_uv_m[..self.count]
    }

    /// Unit normal of the side that `eye_m` sees.
    pub fn normal_towards(&self, eye_m: &Vector3<f64>) -> Vector3<f64> {
        let normal = self.pose.normal();
        normal * normal.dot(&(eye_m - self.pose.origin_m)).signum()
    }
}

/// The sheet and what hides it.
#[derive(Debug)]
pub(super) struct Scene {
    sequence: Sequence,
    occluder: Occluder,
    sheet_rgb: [f32; 3],
    pose: Pose,
    faces: Vec<Face>,
    blurred: Vec<Vec<Face>>,
}

impl Scene {
    pub fn new(sequence: Sequence, occluder: Occluder, sheet_rgb: [u8; 3], blur: bool) -> Self {
        let pose = sequence.pose(0.0);
        let room = sequence.facets().len() + occluder::FACES_MAX;
        let instants = if blur { INSTANTS } else { 0 };
        Self {
            sequence,
            occluder,
            sheet_rgb: sheet_rgb.map(f32::from),
            pose,
            faces: Vec::with_capacity(room),
            blurred: (0..instants).map(|_| Vec::with_capacity(room)).collect(),
        }
    }

    /// The folded sheet's description.
    pub fn sequence(&self) -> &Sequence {
        &self.sequence
    }

    /// Moves everything to `progress`; a blurred image gathers `shutter` of progress round it.
    pub fn set(&mut self, progress: f64, shutter: f64) {
        let Self { sequence, occluder, sheet_rgb, pose, faces, blurred } = self;
        let mut gather = |progress: f64, faces: &mut Vec<Face>| {
            sequence.update(pose, progress.clamp(0.0, 1.0));
            faces.clear();
            let parts = sequence.facets().iter().zip(&pose.facets);
            faces.extend(
                parts.map(|(facet, pose)| Face::new(&facet.corners_uv_m, *pose, *sheet_rgb, true)),
            );
            occluder.add_faces(sequence.grippers(pose), faces);
        };
        for (k, faces) in blurred.iter_mut().enumerate() {
            let share = (k as f64 + 0.5) / INSTANTS as f64 - 0.5;
            gather(progress + share * shutter, faces);
        }
        gather(progress, faces);
    }

    /// The faces in the middle of the exposure: first the sheet's parts, in their order.
    pub fn faces(&self) -> &[Face] {
        &self.faces
    }

    /// The faces in the share `k` of [`INSTANTS`] of the exposure.
    pub fn faces_at(&self, k: usize) -> &[Face] {
        self.blurred.get(k).unwrap_or(&self.faces)
    }

    /// Whether colour images are blurred by motion.
    pub fn is_blurred(&self) -> bool {
        !self.blurred.is_empty()
    }
}
