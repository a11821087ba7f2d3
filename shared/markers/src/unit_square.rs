//! The projective map of a marker's own square into the image.

/// The projective map of the unit square onto four corners.
/// Source: Heckbert, "Fundamentals of Texture Mapping and Image Warping", 1989, section 2.2.3.
#[derive(Debug)]
pub(crate) struct UnitSquare {
    /// Applied to (u, v, 1); the last entry is 1.
    pub rows: [[f64; 3]; 3],
}

impl UnitSquare {
    /// (0,0), (1,0), (1,1), (0,1) go to the corners in order. These must be convex.
    pub fn onto(corners: &[[f64; 2]; 4]) -> Self {
        let [a, b, c, d] = *corners;
        let [bc, dc, sum] = [
            [b[0] - c[0], b[1] - c[1]],
            [d[0] - c[0], d[1] - c[1]],
            [a[0] - b[0] + c[0] - d[0], a[1] - b[1] + c[1] - d[1]],
        ];
        let area = bc[0] * dc[1] - dc[0] * bc[1];
        let g = (sum[0] * dc[1] - dc[0] * sum[1]) / area;
        let h = (bc[0] * sum[1] - sum[0] * bc[1]) / area;
        let row = |k: usize| [b[k] - a[k] + g * b[k], d[k] - a[k] + h * d[k], a[k]];
        Self { rows: [row(0), row(1), [g, h, 1.0]] }
    }

    /// Where (u, v) goes.
    pub fn map(&self, u: f64, v: f64) -> [f64; 2] {
        let [x, y, w] = self.rows.map(|[a, b, c]| a * u + b * v + c);
        [x / w, y / w]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_square_goes_onto_its_corners() {
        let corners = [[10.0, 20.0], [90.0, 5.0], [110.0, 80.0], [20.0, 70.0]];
        let square = UnitSquare::onto(&corners);
        for (k, [u, v]) in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].into_iter().enumerate()
        {
            let [x, y] = square.map(u, v);
            assert!((x - corners[k][0]).abs() < 1e-9 && (y - corners[k][1]).abs() < 1e-9);
        }
    }
}
