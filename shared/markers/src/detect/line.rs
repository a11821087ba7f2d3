//! Lines through points.

/// Points where `normal · p = offset`; the normal has unit length.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    pub normal: [f64; 2],
    pub offset_px: f64,
}

/// A point and how much it counts.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Weighted {
    pub point: [f64; 2],
    pub weight: f64,
}

impl Line {
    /// The line with the least weighted sum of squared distances; `None` without weight.
    pub(super) fn fit(points: impl Iterator<Item = Weighted> + Clone) -> Option<Self> {
        let (mut sum, mut mean) = (0.0, [0.0; 2]);
        for Weighted { point, weight } in points.clone() {
            sum += weight;
            mean = [0, 1].map(|k| mean[k] + weight * point[k]);
        }
        if sum.is_nan() || sum <= 1e-9 {
            return None;
        }
        mean = mean.map(|m| m / sum);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for Weighted { point, weight } in points {
            let [x, y] = [point[0] - mean[0], point[1] - mean[1]];
            xx += weight * x * x;
            xy += weight * x * y;
            yy += weight * y * y;
        }
        // Half the angle of the covariance's main axis.
        let (sin, cos) = (0.5 * (2.0 * xy).atan2(xx - yy)).sin_cos();
        Some(Self { normal: [-sin, cos], offset_px: cos * mean[1] - sin * mean[0] })
    }

    /// Distance of a point, positive on the normal's side.
    pub(super) fn distance_px(&self, point: [f64; 2]) -> f64 {
        self.normal[0] * point[0] + self.normal[1] * point[1] - self.offset_px
    }

    /// Where two lines cross; `None` where they are within 0.06° of parallel.
    pub(crate) fn cross(&self, other: &Self) -> Option<[f64; 2]> {
        let ([a, b], [c, d]) = (self.normal, other.normal);
        let sine = a * d - c * b;
        (sine.abs() > 1e-3).then(|| {
            [
                (self.offset_px * d - other.offset_px * b) / sine,
                (a * other.offset_px - c * self.offset_px) / sine,
            ]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_go_through_their_points_and_cross_where_they_should() {
        let line = |points: [[f64; 2]; 3]| {
            Line::fit(points.into_iter().map(|point| Weighted { point, weight: 2.0 })).unwrap()
        };
        let level = line([[0.0, 3.0], [5.0, 3.0], [9.0, 3.0]]);
        let steep = line([[1.0, 0.0], [2.0, 2.0], [3.0, 4.0]]);
        let [x, y] = level.cross(&steep).unwrap();
        assert!((x - 2.5).abs() < 1e-12 && (y - 3.0).abs() < 1e-12);
        assert!((level.distance_px([7.0, 4.5]).abs() - 1.5).abs() < 1e-12);
        assert!(level.cross(&level).is_none());
        assert!(Line::fit([Weighted::default()].into_iter()).is_none());
    }
}
