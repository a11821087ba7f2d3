//! Straight fold lines in a sheet's material plane.

/// A directed straight line in (u, v); the side on its left is the one that moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoldLine {
    /// A point of the line, material coordinates, metres.
    pub point_m: [f64; 2],
    /// Direction from the u axis towards the v axis, radians.
    pub angle_rad: f64,
}

impl FoldLine {
    /// Book fold: through the middle along v; the half with small u moves.
    pub fn book(size_m: [f64; 2]) -> Self {
        let point_m = size_m.map(|l| l / 2.0);
        Self { point_m, angle_rad: std::f64::consts::FRAC_PI_2 }
    }

    /// Along the diagonal from (0, 0); the half with the corner at u = 0 moves.
    pub fn diagonal(size_m: [f64; 2]) -> Self {
        Self { point_m: [0.0; 2], angle_rad: size_m[1].atan2(size_m[0]) }
    }

    /// Unit direction of the line in (u, v).
    pub fn direction(&self) -> [f64; 2] {
        let (sin, cos) = self.angle_rad.sin_cos();
        [cos, sin]
    }

    /// Signed distance of a material point, metres; positive on the side that moves.
    pub fn side_m(&self, uv_m: [f64; 2]) -> f64 {
        let [c, s] = self.direction();
        c * (uv_m[1] - self.point_m[1]) - s * (uv_m[0] - self.point_m[0])
    }

    /// The part of a convex polygon on the side of `sign` (1 = moving, -1 = fixed), keeping its
    /// orientation. Sutherland and Hodgman's clipping by one line.
    pub(crate) fn clip(&self, polygon: &[[f64; 2]], sign: f64) -> Vec<[f64; 2]> {
        let mut kept = Vec::with_capacity(polygon.len() + 1);
        for (k, a) in polygon.iter().enumerate() {
            let b = polygon[(k + 1) % polygon.len()];
            let (side_a, side_b) = (sign * self.side_m(*a), sign * self.side_m(b));
            if side_a >= -ON_LINE_M {
                kept.push(*a);
            }
            let crosses = (side_a > ON_LINE_M && side_b < -ON_LINE_M)
                || (side_a < -ON_LINE_M && side_b > ON_LINE_M);
            if crosses {
                let t = side_a / (side_a - side_b);
                kept.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
            }
        }
        kept
    }
}

/// Nearer than this a point counts as on the line, metres.
pub(crate) const ON_LINE_M: f64 = 1e-12;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_by_hand() {
        let book = FoldLine::book([0.2, 0.3]);
        assert!((book.side_m([0.0, 0.1]) - 0.1).abs() < 1e-15);
        assert!((book.side_m([0.2, 0.3]) + 0.1).abs() < 1e-15);
        let diagonal = FoldLine::diagonal([0.3, 0.4]);
        assert!(diagonal.side_m([0.3, 0.4]).abs() < 1e-15);
        // Height of the 3-4-5 triangle over its hypotenuse.
        assert!((diagonal.side_m([0.0, 0.4]) - 0.24).abs() < 1e-15);
    }

    #[test]
    fn clipping_a_square_by_its_diagonal_leaves_two_triangles() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let line = FoldLine::diagonal([1.0, 1.0]);
        assert_eq!(line.clip(&square, 1.0), [[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        assert_eq!(line.clip(&square, -1.0), [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]);
    }
}
