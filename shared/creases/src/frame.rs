//! Rigid poses of facets.

use nalgebra::{Point3, Vector3};
use orime_geometry::SheetGrid;

/// A facet's pose: material point (u, v) lies at `center_m + (u − u₀)·u + (v − v₀)·v`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacetFrame {
    /// World position of the members' mean, metres.
    pub center_m: Point3<f64>,
    /// Material coordinates of the members' mean, metres.
    pub center_uv_m: [f64; 2],
    /// Unit direction of growing u.
    pub u: Vector3<f64>,
    /// Unit direction of growing v.
    pub v: Vector3<f64>,
    /// u × v.
    pub normal: Vector3<f64>,
    /// Root mean square distance of the members from the pose, metres.
    pub residual_m: f64,
}

impl FacetFrame {
    /// (u, v) as world x and y.
    pub(crate) fn flat() -> Self {
        Self {
            center_m: Point3::origin(),
            center_uv_m: [0.0; 2],
            u: Vector3::x(),
            v: Vector3::y(),
            normal: Vector3::z(),
            residual_m: 0.0,
        }
    }

    /// Least-squares rigid pose of these nodes: the polar factor of the 3 × 2 moment matrix.
    pub fn fit(sheet: &SheetGrid, nodes: &[u32], positions_m: &[[f32; 3]]) -> Self {
        let [h_u, h_v] = sheet.spacing_m();
        let uv = |n: u32| {
            let n = n as usize;
            [(n / sheet.nodes[1]) as f64 * h_u, (n % sheet.nodes[1]) as f64 * h_v]
        };
        let x = |n: u32| Vector3::from(positions_m[n as usize].map(f64::from));
        let count = nodes.len().max(1) as f64;
        let (mut center, mut center_uv_m) = (Vector3::zeros(), [0.0; 2]);
        for n in nodes {
            center += x(*n) / count;
            let [u, v] = uv(*n);
            center_uv_m = [center_uv_m[0] + u / count, center_uv_m[1] + v / count];
        }
        let (mut a, mut b) = (Vector3::zeros(), Vector3::zeros());
        let mut spread = 0.0;
        for n in nodes {
            let [u, v] = [uv(*n)[0] - center_uv_m[0], uv(*n)[1] - center_uv_m[1]];
            let d = x(*n) - center;
            a += d * u;
            b += d * v;
            spread += u * u + v * v + d.norm_squared();
        }
        let (u, v, trace) = polar(a, b).unwrap_or_else(|| along_a_line(a, b));
        let residual_m = ((spread - 2.0 * trace).max(0.0) / count).sqrt();
        let normal = u.cross(&v);
        Self { center_m: center.into(), center_uv_m, u, v, normal, residual_m }
    }

    /// Where a material point lies, world frame, metres.
    pub fn position_m(&self, uv_m: [f64; 2]) -> Point3<f64> {
        self.center_m
            + self.u * (uv_m[0] - self.center_uv_m[0])
            + self.v * (uv_m[1] - self.center_uv_m[1])
    }

    /// The material point right below or above a position (world frame, metres).
    pub fn uv_of(&self, position_m: [f32; 3]) -> [f64; 2] {
        let d = Vector3::from(position_m.map(f64::from)) - self.center_m.coords;
        [self.center_uv_m[0] + d.dot(&self.u), self.center_uv_m[1] + d.dot(&self.v)]
    }
}

/// The nearest pair of orthonormal vectors to (a, b), and the sum of the singular values; `None`
/// where a and b span no plane, or are not finite.
///
/// M = [a b], MᵀM = [[p, q], [q, r]], S = √(MᵀM) in closed form, U = M·S⁻¹.
pub fn polar(a: Vector3<f64>, b: Vector3<f64>) -> Option<(Vector3<f64>, Vector3<f64>, f64)> {
    let (p, q, r) = (a.dot(&a), a.dot(&b), b.dot(&b));
    let root_det = (p * r - q * q).max(0.0).sqrt();
    let trace = (p + r + 2.0 * root_det).sqrt();
    if !trace.is_finite() || root_det <= 1e-9 * (p + r) {
        return None;
    }
    // S = (MᵀM + √det·1)/trace;  S⁻¹ = [[r + d, −q], [−q, p + d]]/(trace·d).
    let scale = 1.0 / (trace * root_det);
    let u = (a * (r + root_det) - b * q) * scale;
    let v = (b * (p + root_det) - a * q) * scale;
    Some((u, v, trace))
}

/// Any frame that holds the line or point that a and b span.
fn along_a_line(a: Vector3<f64>, b: Vector3<f64>) -> (Vector3<f64>, Vector3<f64>, f64) {
    let longer = if a.norm_squared() >= b.norm_squared() { a } else { b };
    let u = longer.try_normalize(0.0).unwrap_or_else(Vector3::x);
    let away = if u.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    (u, (away - u * u.dot(&away)).normalize(), a.norm().hypot(b.norm()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_fits_a_turned_facet_exactly() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.8, 2.0);
        let x: Vec<[f32; 3]> = sheet
            .uv_m()
            .map(|[u, v]| (turn * Vector3::new(u, v, 0.0)).cast::<f32>().into())
            .collect();
        let nodes: Vec<u32> = (0..sheet.len() as u32).collect();
        let frame = FacetFrame::fit(&sheet, &nodes, &x);
        assert!((frame.u - turn * Vector3::x()).norm() < 1e-6);
        assert!((frame.normal - turn * Vector3::z()).norm() < 1e-6);
        assert!(frame.residual_m < 1e-6, "{}", frame.residual_m);
    }
}
