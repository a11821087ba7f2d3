//! Straight lines in material coordinates.

/// A straight line in the sheet's plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Any point on it, (u, v), metres.
    pub point_m: [f64; 2],
    /// Unit direction.
    pub direction: [f64; 2],
}

impl Line {
    /// Through `a` and `b`, which must differ.
    pub fn through(a: [f64; 2], b: [f64; 2]) -> Self {
        let d = [b[0] - a[0], b[1] - a[1]];
        let length = d[0].hypot(d[1]);
        assert!(length > 0.0, "a line needs two points");
        Self { point_m: a, direction: [d[0] / length, d[1] / length] }
    }

    /// Signed distance of a point, metres, positive on the left of the direction.
    pub fn side_m(&self, uv_m: [f64; 2]) -> f64 {
        let d = [uv_m[0] - self.point_m[0], uv_m[1] - self.point_m[1]];
        self.direction[0] * d[1] - self.direction[1] * d[0]
    }

    /// Distance of a point along the line from [`Line::point_m`], metres.
    pub fn along_m(&self, uv_m: [f64; 2]) -> f64 {
        let d = [uv_m[0] - self.point_m[0], uv_m[1] - self.point_m[1]];
        self.direction[0] * d[0] + self.direction[1] * d[1]
    }

    /// Where the segment from `a` to `b` crosses the line; its ends must lie on different sides.
    pub(crate) fn crossing(&self, a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
        let (side_a, side_b) = (self.side_m(a), self.side_m(b));
        let t = side_a / (side_a - side_b);
        [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
    }
}
