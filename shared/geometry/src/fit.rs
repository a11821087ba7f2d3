//! Least-squares planes and rigid motions.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// A plane `normal · x = offset_m`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit normal.
    pub normal: Vector3<f64>,
    /// Signed distance from the origin, metres.
    pub offset_m: f64,
}

impl Plane {
    /// Signed distance of a point, metres.
    pub fn height_m(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) - self.offset_m
    }

    /// Total least squares through the points; `None` for fewer than three or a degenerate set.
    pub fn fit(points: &[Point3<f64>]) -> Option<Self> {
        if points.len() < 3 {
            return None;
        }
        let centre = centroid(points.iter().copied());
        let scatter: Matrix3<f64> = points
            .iter()
            .map(|p| {
                let d = p - centre;
                d * d.transpose()
            })
            .sum();
        let eigen = scatter.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        // A line or a point has no plane: the middle eigenvalue must stand out of rounding.
        let (middle, largest) = (eigen.eigenvalues[order[1]], eigen.eigenvalues[order[2]]);
        if middle.is_nan() || middle <= 1e-12 * largest.max(1e-30) {
            return None;
        }
        let normal: Vector3<f64> = eigen.eigenvectors.column(order[0]).into_owned();
        Some(Self { normal, offset_m: normal.dot(&centre.coords) })
    }
}

/// Mean of the points; the origin for none.
pub fn centroid(points: impl Iterator<Item = Point3<f64>>) -> Point3<f64> {
    let mut sum = Vector3::zeros();
    let mut count = 0usize;
    for point in points {
        sum += point.coords;
        count += 1;
    }
    Point3::from(sum / count.max(1) as f64)
}

/// The rigid motion that best maps `source` onto `target` with weights, least squares.
///
/// Source: Kabsch 1976, with Umeyama's sign correction, so the result is never a mirror image.
/// Returns `None` for fewer than three pairs, unequal lengths or no weight.
pub fn rigid(
    source: &[Point3<f64>],
    target: &[Point3<f64>],
    weight: impl Fn(usize) -> f64,
) -> Option<Isometry3<f64>> {
    if source.len() != target.len() || source.len() < 3 {
        return None;
    }
    let total: f64 = (0..source.len()).map(&weight).sum();
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let mean = |points: &[Point3<f64>]| -> Vector3<f64> {
        points.iter().enumerate().map(|(k, p)| p.coords * weight(k)).sum::<Vector3<f64>>() / total
    };
    let (source_mean, target_mean) = (mean(source), mean(target));
    let mut covariance = Matrix3::zeros();
    for (k, (s, t)) in source.iter().zip(target).enumerate() {
        covariance += (t.coords - target_mean) * (s.coords - source_mean).transpose() * weight(k);
    }
    let svd = covariance.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut fix = Matrix3::identity();
    // Singular values come sorted descending, so the weakest direction is the last.
    fix[(2, 2)] = (u.determinant() * v_t.determinant()).signum();
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * fix * v_t));
    let translation = target_mean - rotation * source_mean;
    Some(Isometry3::from_parts(Translation3::from(translation), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rigid_recovers_a_motion_and_never_mirrors() {
        let motion = Isometry3::new(Vector3::new(0.3, -1.0, 0.2), Vector3::new(0.4, -2.0, 1.1));
        // A flat set: the mirrored solution fits equally well, and must not be chosen.
        let source: Vec<Point3<f64>> = (0..12)
            .map(|k| Point3::new((k % 4) as f64 * 0.1, (k / 4) as f64 * 0.13, 0.0))
            .collect();
        let target: Vec<Point3<f64>> = source.iter().map(|p| motion * p).collect();
        let found = rigid(&source, &target, |_| 1.0).unwrap();
        assert!((found.to_homogeneous() - motion.to_homogeneous()).norm() < 1e-9);
        assert!(rigid(&source[..2], &target[..2], |_| 1.0).is_none());
    }

    #[test]
    fn plane_of_a_tilted_sheet() {
        let normal = Vector3::new(1.0, 2.0, 3.0).normalize();
        let (a, b) = (normal.cross(&Vector3::x()).normalize(), Vector3::new(3.0, 0.0, -1.0));
        let points: Vec<Point3<f64>> = (0..20)
            .map(|k| {
                let in_plane = a * (k % 5) as f64 + b.cross(&normal) * (k / 5) as f64;
                Point3::from(in_plane + normal * 0.7)
            })
            .collect();
        let plane = Plane::fit(&points).unwrap();
        assert!((plane.normal.dot(&normal).abs() - 1.0).abs() < 1e-9);
        assert!(points.iter().all(|p| plane.height_m(p).abs() < 1e-9));
        let line: Vec<Point3<f64>> = (0..9).map(|k| Point3::new(k as f64, 0.0, 0.0)).collect();
        assert_eq!(Plane::fit(&line), None);
    }
}
