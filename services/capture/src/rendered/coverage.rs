//! How much of a pixel a convex polygon covers.

/// One edge of a polygon in the image: `a·x + b·y + c` is a pixel centre's distance from it,
/// pixels, positive inside; `a² + b² = 1`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Edge {
    pub a: f64,
    pub b: f64,
    pub c: f64,
}

/// Beyond this distance from an edge a pixel lies wholly on one side of it: half its diagonal.
pub(super) const REACH_PX: f64 = std::f64::consts::FRAC_1_SQRT_2;

impl Edge {
    /// Distance of a pixel's centre from the edge, pixels, positive inside.
    pub fn distance_px(&self, x: f64, y: f64) -> f64 {
        self.a * x + self.b * y + self.c
    }

    /// Share of the unit square round `(x, y)` that lies inside the edge. Exact.
    pub fn coverage(&self, x: f64, y: f64) -> f64 {
        let d = self.distance_px(x, y);
        let (low, high) = {
            let (a, b) = (self.a.abs(), self.b.abs());
            (a.min(b), a.max(b))
        };
        let half = if d.abs() <= (high - low) / 2.0 {
            // The edge crosses two opposite sides of the square.
            d.abs() / high
        } else {
            // It cuts off a corner, or misses the square.
            let rest = ((high + low) / 2.0 - d.abs()).max(0.0);
            if rest > 0.0 { 0.5 - rest * rest / (2.0 * high * low) } else { 0.5 }
        };
        0.5 + half.copysign(d)
    }
}

/// Share of the pixel at `(x, y)` that all edges leave.
///
/// Exact where at most one edge crosses the pixel, or two parallel ones; at corners it takes
/// away the doubly cut part twice (an error of less than a pixel per corner, in area).
pub(super) fn polygon(edges: &[Edge], x: f64, y: f64) -> f64 {
    let cut: f64 = edges.iter().map(|edge| 1.0 - edge.coverage(x, y)).sum();
    (1.0 - cut).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_covers_what_counting_says() {
        for (angle, d) in
            [(0.0, 0.2), (0.3, -0.1), (0.785, 0.4), (1.3, -0.55), (2.2, 0.05), (4.0, 0.6)]
        {
            let (b, a) = f64::sin_cos(angle);
            let edge = Edge { a, b, c: d };
            let n = 400;
            let mut inside = 0;
            for i in 0..n * n {
                let [x, y] = [i % n, i / n].map(|k| (f64::from(k) + 0.5) / f64::from(n) - 0.5);
                inside += i32::from(edge.distance_px(x, y) > 0.0);
            }
            let counted = f64::from(inside) / f64::from(n * n);
            let area = edge.coverage(0.0, 0.0);
            assert!((area - counted).abs() < 2e-3, "{angle} {d}: {area} against {counted}");
        }
    }

    #[test]
    fn slivers_cover_their_width() {
        // A strip 0.3 px wide through the middle of the pixel.
        let edges = [Edge { a: 1.0, b: 0.0, c: 0.1 }, Edge { a: -1.0, b: 0.0, c: 0.2 }];
        assert!((polygon(&edges, 0.0, 0.0) - 0.3).abs() < 1e-12);
    }
}
