//! A rigid facet as one lens sees it.

use orime_geometry::CameraModel;
use orime_geometry::nalgebra::{Isometry3, Matrix3, Vector3};
use orime_origami::FacetPose;

use super::coverage::Edge;

/// Most corners of a facet: a rectangle cut by a line has five.
pub(super) const CORNERS_MAX: usize = 6;

/// A facet in the image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Projected {
    count: usize,
    corners_px: [[f64; 2]; CORNERS_MAX],
    edges: [Edge; CORNERS_MAX],
    /// Least and greatest column and row of the corners, pixels.
    bounds_px: [[f64; 2]; 2],
    /// `per_depth · (x, y, 1) = (u/z, v/z, 1/z)` for the facet's point at pixel `(x, y)`.
    pub per_depth: Matrix3<f64>,
}

impl Projected {
    /// Projects a convex polygon of a plane that lies in the world as `pose` says, or `None` where
    /// it is seen edge-on or lies behind the lens.
    pub fn new(
        lens: &CameraModel,
        lens_from_world: &Isometry3<f64>,
        pose: &FacetPose,
        corners_uv_m: &[[f64; 2]],
    ) -> Option<Self> {
        let pose = pose.moved(lens_from_world);
        let mut corners_px = [[0.0; 2]; CORNERS_MAX];
        let count = corners_uv_m.len().min(CORNERS_MAX);
        for (pixel, uv_m) in corners_px.iter_mut().zip(corners_uv_m) {
            *pixel = lens.project(&pose.position_m(*uv_m))?.into();
        }
        let plane = Matrix3::from_columns(&[pose.along_u, pose.along_v, pose.origin_m]);
        let intrinsics = Matrix3::new(
            lens.fx_px, 0.0, lens.cx_px, //
            0.0, lens.fy_px, lens.cy_px, //
            0.0, 0.0, 1.0,
        );
        let per_depth = (intrinsics * plane).try_inverse()?;
        let mut projected = Self {
            count,
            corners_px,
            edges: [Edge::default(); CORNERS_MAX],
            bounds_px: [[0.0; 2]; 2],
            per_depth,
        };
        projected.set_edges()?;
        Some(projected)
    }

    /// The same facet with its crease drawn where `other`'s crease is (the slit that the sheet's
    /// thickness leaves between the two is paper, too).
    pub fn closed_to(mut self, other: &Self) -> Option<Self> {
        self.corners_px[0] = other.corners_px[1];
        self.corners_px[1] = other.corners_px[0];
        self.set_edges()?;
        Some(self)
    }

    /// Whether the two facets lie on opposite sides of `self`'s crease in the image.
    pub fn opposes(&self, other: &Self) -> bool {
        let middle = |p: &Self| -> [f64; 2] {
            [0, 1]
                .map(|k| p.corners_px[..p.count].iter().map(|c| c[k]).sum::<f64>() / p.count as f64)
        };
        let crease = self.edges[0];
        let [a, b] = [middle(self), middle(other)].map(|[x, y]| crease.distance_px(x, y));
        a * b < 0.0
    }

    /// The edges, normals inwards; the crease comes first.
    pub fn edges(&self) -> &[Edge] {
        &self.edges[..self.count]
    }

    /// First and last image row that the facet may touch, within `0..height`; empty if none.
    pub fn rows(&self, height: usize) -> std::ops::Range<usize> {
        let [low, high] = [self.bounds_px[1][0] - 0.5, self.bounds_px[1][1] + 0.5];
        let clip = |y: f64| y.clamp(0.0, height as f64) as usize;
        clip(low.floor())..clip(high.ceil() + 1.0)
    }

    /// Depth of the polygon's plane at a pixel, metres.
    #[inline]
    pub fn depth(&self, x: usize, y: usize) -> f64 {
        let inverse = self.per_depth.row(2);
        1.0 / (inverse[0] * x as f64 + inverse[1] * y as f64 + inverse[2])
    }

    /// Leftmost and rightmost corner, pixels.
    pub fn columns(&self) -> [f64; 2] {
        self.bounds_px[0]
    }

    /// Columns in `0..width` of the pixel centres of row `y` that lie at least `inset_px` inside
    /// every edge (negative: at most so far outside).
    pub fn span(&self, y: usize, inset_px: f64, width: usize) -> std::ops::Range<usize> {
        let [low, high] = self.chord(y as f64, inset_px);
        let (low, high) = (low.max(0.0).ceil(), high.min(width as f64 - 1.0).floor());
        if low <= high { low as usize..high as usize + 1 } else { 0..0 }
    }

    /// Where the line at height `y` enters and leaves the polygon shrunk by `inset_px`; the first
    /// is the larger where it misses.
    #[inline]
    pub fn chord(&self, y: f64, inset_px: f64) -> [f64; 2] {
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for edge in self.edges() {
            let rest = inset_px - edge.b * y - edge.c;
            if edge.a > 1e-9 {
                low = f64::max(low, rest / edge.a);
            } else if edge.a < -1e-9 {
                high = f64::min(high, rest / edge.a);
            } else if rest > 0.0 {
                return [1.0, 0.0];
            }
        }
        [low, high]
    }

    fn set_edges(&mut self) -> Option<()> {
        let corners = &self.corners_px[..self.count];
        self.bounds_px = [0, 1].map(|k| {
            let values = corners.iter().map(|c| c[k]);
            let low = values.clone().fold(f64::INFINITY, f64::min);
            [low, values.fold(f64::NEG_INFINITY, f64::max)]
        });
        let next = |k: usize| corners[(k + 1) % corners.len()];
        let area: f64 = (0..corners.len())
            .map(|k| corners[k][0] * next(k)[1] - next(k)[0] * corners[k][1])
            .sum();
        if area.is_nan() || area.abs() <= 1e-6 {
            return None;
        }
        for (k, edge) in self.edges[..self.count].iter_mut().enumerate() {
            let ([x, y], [next_x, next_y]) = (corners[k], next(k));
            let normal = Vector3::new(y - next_y, next_x - x, 0.0) * area.signum();
            let length = normal.norm();
            // An edge without length bounds nothing.
            let [a, b] =
                if length > 1e-9 { [normal.x / length, normal.y / length] } else { [0.0; 2] };
            let c = if length > 1e-9 { -a * x - b * y } else { 1.0 };
            *edge = Edge { a, b, c };
        }
        Some(())
    }
}
