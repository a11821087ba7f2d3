//! The sheet's parts and where each is.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::FoldError;

/// An unfolded sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sheet {
    /// Extent along u and v, metres.
    pub size_m: [f64; 2],
    /// Thickness, metres: how far the middle surfaces of two stacked layers are apart.
    pub thickness_m: f64,
}

impl Sheet {
    /// Refuses sides and thicknesses that are not positive numbers.
    pub(crate) fn check(&self) -> Result<(), FoldError> {
        let length = |l: f64| l > 0.0 && l.is_finite();
        if self.size_m.iter().all(|l| length(*l)) && length(self.thickness_m) {
            return Ok(());
        }
        Err(FoldError::NotASheet { size_m: self.size_m, thickness_m: self.thickness_m })
    }

    /// Refuses sheets that are not square, for `fold`.
    pub(crate) fn check_square(&self, fold: &'static str) -> Result<f64, FoldError> {
        self.check()?;
        let [a, b] = self.size_m;
        if (a - b).abs() > 1e-9 {
            return Err(FoldError::NotSquare { fold, size_m: self.size_m });
        }
        Ok(a)
    }

    /// Corners in (u, v), counter-clockwise.
    pub(crate) fn corners_uv_m(&self) -> [[f64; 2]; 4] {
        let [a, b] = self.size_m;
        [[0.0, 0.0], [a, 0.0], [a, b], [0.0, b]]
    }
}

/// One part of the sheet, a convex polygon.
#[derive(Debug, Clone, PartialEq)]
pub struct Facet {
    /// Corners in material coordinates, metres, counter-clockwise. In a fold along lines the
    /// edge from the first corner to the second is a crease.
    pub corners_uv_m: Vec<[f64; 2]>,
}

impl Facet {
    /// How far inside the polygon a material point lies, metres; negative outside.
    pub fn inside_m(&self, uv_m: [f64; 2]) -> f64 {
        let corners = &self.corners_uv_m;
        (0..corners.len())
            .map(|k| {
                let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
                let [x, y] = [b[0] - a[0], b[1] - a[1]];
                (x * (uv_m[1] - a[1]) - y * (uv_m[0] - a[0])) / x.hypot(y)
            })
            .fold(f64::INFINITY, f64::min)
    }
}

/// Where one part is: (u, v) goes to `origin_m + u·along_u + v·along_v`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacetPose {
    /// World position that the map gives to (0, 0), metres.
    pub origin_m: Vector3<f64>,
    /// World metres per metre of u.
    pub along_u: Vector3<f64>,
    /// World metres per metre of v.
    pub along_v: Vector3<f64>,
}

impl FacetPose {
    /// World position of a material point, metres.
    pub fn position_m(&self, uv_m: [f64; 2]) -> Point3<f64> {
        Point3::from(self.origin_m + self.along_u * uv_m[0] + self.along_v * uv_m[1])
    }

    /// Unit normal of the side that looks up while the sheet lies flat.
    pub fn normal(&self) -> Vector3<f64> {
        self.along_u.cross(&self.along_v).normalize()
    }

    /// The same part after a rigid motion.
    pub fn moved(&self, motion: &Isometry3<f64>) -> Self {
        Self {
            origin_m: (motion * Point3::from(self.origin_m)).coords,
            along_u: motion * self.along_u,
            along_v: motion * self.along_v,
        }
    }

    /// Rigid: (u, v) is the plane z = 0 of `motion`.
    pub(crate) fn rigid(motion: &Isometry3<f64>) -> Self {
        let flat =
            Self { origin_m: Vector3::zeros(), along_u: Vector3::x(), along_v: Vector3::y() };
        flat.moved(motion)
    }
}

/// A straight crease of the sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crease {
    /// Ends in material coordinates, metres.
    pub ends_uv_m: [[f64; 2]; 2],
    /// The parts on its two sides; where paper bends smoothly, the last flat ones.
    pub facets: [usize; 2],
}

/// Parts that lie flat on each other for a while.
#[derive(Debug, Clone, PartialEq)]
pub struct Stack {
    /// First and last progress at which they do.
    pub during: [f64; 2],
    /// The parts, bottom to top.
    pub facets: Vec<usize>,
}
