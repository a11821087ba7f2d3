//! Where each facet and crease is in a round.

use crate::topology::{FacetMesh, Topology};
use nalgebra::Vector3;
use orime_creases::polar;

/// Rigid pose of a facet.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Pose {
    pub center_m: Vector3<f64>,
    pub center_uv_m: [f64; 2],
    pub u: Vector3<f64>,
    pub v: Vector3<f64>,
    pub normal: Vector3<f64>,
    /// Root mean square distance of the nodes from the pose, metres; infinite where the nodes
    /// do not span a plane.
    pub residual_m: f64,
}

impl Pose {
    /// Least squares: the polar factor of the 3 × 2 moment matrix [a b].
    pub fn fit(facet: &FacetMesh, x: &[Vector3<f64>]) -> Self {
        let Some((first, _)) = facet.core.first() else { return Self::unknown() };
        let origin = x[*first as usize];
        let (mut sum, mut a, mut b) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        let mut spread2 = 0.0;
        for (n, [u, v]) in &facet.core {
            let d = x[*n as usize] - origin;
            sum += d;
            a += d * *u;
            b += d * *v;
            spread2 += d.norm_squared();
        }
        let count = facet.core.len() as f64;
        let mean = sum / count;
        let Some((u, v, trace)) = polar(a, b) else { return Self::unknown() };
        let spread2 = spread2 / count - mean.norm_squared() + facet.core_radius_m.powi(2);
        Self {
            center_m: origin + mean,
            center_uv_m: facet.core_mean_m,
            u,
            v,
            normal: u.cross(&v),
            residual_m: (spread2 - 2.0 * trace / count).max(0.0).sqrt(),
        }
    }

    fn unknown() -> Self {
        Self { residual_m: f64::INFINITY, ..Self::default() }
    }

    pub fn is_known(&self) -> bool {
        self.residual_m.is_finite()
    }

    /// World position of a material point of the rigid facet, metres.
    pub fn position_m(&self, [u, v]: [f64; 2]) -> Vector3<f64> {
        let [du, dv] = [u - self.center_uv_m[0], v - self.center_uv_m[1]];
        self.center_m + self.u * du + self.v * dv
    }

    /// (u, v) below a point, and its height over the facet, metres.
    pub fn local_m(&self, position_m: &Vector3<f64>) -> ([f64; 2], f64) {
        let d = position_m - self.center_m;
        let uv = [self.center_uv_m[0] + d.dot(&self.u), self.center_uv_m[1] + d.dot(&self.v)];
        (uv, d.dot(&self.normal))
    }

    /// World direction of a material direction.
    pub fn along(&self, [u, v]: [f64; 2]) -> Vector3<f64> {
        self.u * u + self.v * v
    }
}

/// How a crease is folded.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Opening {
    /// Cosine of the angle between the two facets: −1 flat, 1 folded shut.
    pub cosine: f64,
    /// Unit direction from the crease into the wedge between its facets.
    pub inward: Vector3<f64>,
    /// Unit direction from the crease's first end to its second.
    pub axis: Vector3<f64>,
    /// World position of its middle, metres.
    pub middle_m: Vector3<f64>,
}

impl Opening {
    pub fn between(topology: &Topology, crease: usize, poses: &[Pose]) -> Self {
        let crease = &topology.creases[crease];
        let [left, right] = crease.facets.map(|f| &poses[f]);
        if !(left.is_known() && right.is_known()) {
            return Self { cosine: -1.0, ..Self::default() };
        }
        let [x, y] = crease.direction;
        let (a, b) = (left.along([-y, x]), right.along([y, -x]));
        let [p, q] = crease.ends_m;
        let middle = [0, 1].map(|axis| 0.5 * (p[axis] + q[axis]));
        let unit = |d: Vector3<f64>| d.try_normalize(1e-12).unwrap_or_else(Vector3::zeros);
        Self {
            cosine: a.dot(&b),
            inward: unit(a + b),
            axis: unit(left.along([x, y]) + right.along([x, y])),
            middle_m: (left.position_m(middle) + right.position_m(middle)) * 0.5,
        }
    }
}
