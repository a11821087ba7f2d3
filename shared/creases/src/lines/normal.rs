//! Weighted least squares of a point in space against a few columns.

/// Normal equations of `C` columns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Normal<const C: usize> {
    a: [[f64; C]; C],
    b: [[f64; 3]; C],
    yy: f64,
}

impl<const C: usize> Normal<C> {
    pub fn new() -> Self {
        Self { a: [[0.0; C]; C], b: [[0.0; 3]; C], yy: 0.0 }
    }

    #[inline]
    pub fn add(&mut self, phi: [f64; C], y: [f64; 3], weight: f64) {
        for i in 0..C {
            let p = weight * phi[i];
            for j in 0..=i {
                self.a[i][j] += p * phi[j];
            }
            for k in 0..3 {
                self.b[i][k] += p * y[k];
            }
        }
        self.yy += weight * (y[0] * y[0] + y[1] * y[1] + y[2] * y[2]);
    }

    /// Coefficients and what remains of Σw|y|²; diagonals grow by `1 + ridge`.
    pub fn solve(&self, ridge: f64) -> ([[f64; 3]; C], f64) {
        let mut l = self.a;
        let mut c = self.b;
        for i in 0..C {
            l[i][i] *= 1.0 + ridge;
            for j in 0..=i {
                let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
                let rest = l[i][j] - sum;
                // A column that the others explain gets no weight.
                l[i][j] = if i != j {
                    rest / l[j][j]
                } else if rest > 1e-13 * self.a[i][i].abs() && rest > 0.0 {
                    rest.sqrt()
                } else {
                    f64::INFINITY
                };
            }
            for k in 0..3 {
                let sum: f64 = (0..i).map(|j| l[i][j] * c[j][k]).sum();
                c[i][k] = (c[i][k] - sum) / l[i][i];
            }
        }
        let explained: f64 = c.iter().flatten().map(|z| z * z).sum();
        for i in (0..C).rev() {
            for k in 0..3 {
                let sum: f64 = (i + 1..C).map(|j| l[j][i] * c[j][k]).sum();
                c[i][k] = (c[i][k] - sum) / l[i][i];
            }
        }
        (c, (self.yy - explained).max(0.0))
    }
}

/// One more column beside three others.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Column {
    with: [f64; 3],
    own: f64,
    y: [f64; 3],
}

impl Column {
    pub const NONE: Self = Self { with: [0.0; 3], own: 0.0, y: [0.0; 3] };

    #[inline]
    pub fn add(&mut self, phi: f64, base: [f64; 3], y: [f64; 3], weight: f64) {
        let p = weight * phi;
        for k in 0..3 {
            self.with[k] += p * base[k];
            self.y[k] += p * y[k];
        }
        self.own += p * phi;
    }
}

/// Three columns that are solved once, so that a fourth costs little.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane {
    inverse: [[f64; 3]; 3],
    coefficients: [[f64; 3]; 3],
    rest: f64,
}

/// What is left of a column, and of its products with y, beside the others.
#[derive(Debug, Clone, Copy)]
struct Left {
    shares: [f64; 3],
    own: f64,
    y: [f64; 3],
}

impl Plane {
    pub fn new(normal: &Normal<3>) -> Self {
        let (coefficients, rest) = normal.solve(0.0);
        let mut inverse = [[0.0; 3]; 3];
        let unit =
            Normal::<3> { b: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], ..*normal };
        inverse.copy_from_slice(&unit.solve(0.0).0);
        Self { inverse, coefficients, rest }
    }

    /// Coefficients and what remains with a fourth column.
    pub fn with(&self, column: &Column) -> ([[f64; 3]; 4], f64) {
        let left = self.left(column);
        let fourth = left.y.map(|y| y / left.own);
        let mut all = [[0.0; 3]; 4];
        for i in 0..3 {
            for k in 0..3 {
                all[i][k] = self.coefficients[i][k] - left.shares[i] * fourth[k];
            }
        }
        all[3] = fourth;
        let gain: f64 = left.y.iter().map(|y| y * y / left.own).sum();
        (all, (self.rest - gain).max(0.0))
    }

    /// What remains with two more columns, whose product sums up to `both`.
    pub fn with_both(&self, columns: &[Column; 2], both: f64) -> f64 {
        let [a, b] = [0, 1].map(|k| self.left(&columns[k]));
        let shared: f64 = (0..3).map(|i| a.shares[i] * columns[1].with[i]).sum();
        let cross = both - shared;
        let own = b.own - cross * cross / a.own;
        let first: f64 = a.y.iter().map(|y| y * y / a.own).sum();
        let second: f64 = (0..3)
            .map(|k| (b.y[k] - a.y[k] * cross / a.own).powi(2) / own.max(f64::MIN_POSITIVE))
            .sum();
        (self.rest - first - second).max(0.0)
    }

    fn left(&self, column: &Column) -> Left {
        let shares = self.inverse.map(|row| (0..3).map(|j| row[j] * column.with[j]).sum::<f64>());
        let explained: f64 = (0..3).map(|i| shares[i] * column.with[i]).sum();
        let rest = column.own - explained;
        // A column that the others explain gains nothing.
        let own = if rest > 1e-12 * column.own { rest } else { f64::INFINITY };
        let y = [0, 1, 2].map(|k| {
            column.y[k] - (0..3).map(|i| self.coefficients[i][k] * column.with[i]).sum::<f64>()
        });
        Left { shares, own, y }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_line_is_found_and_a_spare_column_does_no_harm() {
        let mut normal = Normal::<3>::new();
        for k in 0..5 {
            let s = f64::from(k);
            normal.add([1.0, s, 2.0 * s], [1.0 + 3.0 * s, -s, 2.0], 0.5);
        }
        let (c, rest) = normal.solve(0.0);
        assert!(rest < 1e-9, "{rest}");
        for (k, slope) in [3.0, -1.0, 0.0].into_iter().enumerate() {
            assert!((c[1][k] + 2.0 * c[2][k] - slope).abs() < 1e-9);
        }
    }

    #[test]
    fn more_columns_beside_three_are_as_solved_together() {
        let mut random = crate::trial::Random::new(5);
        let (mut four, mut five, mut three) =
            (Normal::<4>::new(), Normal::<5>::new(), Normal::new());
        let mut columns = [Column::NONE; 2];
        let mut both = 0.0;
        for _ in 0..40 {
            let [a, b, p, q, w] = [(); 5].map(|()| random.uniform());
            let y = [(); 3].map(|()| random.normal());
            four.add([1.0, a, b, p], y, w);
            five.add([1.0, a, b, p, q], y, w);
            three.add([1.0, a, b], y, w);
            columns[0].add(p, [1.0, a, b], y, w);
            columns[1].add(q, [1.0, a, b], y, w);
            both += w * p * q;
        }
        let plane = Plane::new(&three);
        let (apart, rest) = plane.with(&columns[0]);
        let (together, expected) = four.solve(0.0);
        assert!((rest - expected).abs() < 1e-10 * expected);
        for (a, b) in apart.iter().flatten().zip(together.iter().flatten()) {
            assert!((a - b).abs() < 1e-9);
        }
        let expected = five.solve(0.0).1;
        assert!((plane.with_both(&columns, both) - expected).abs() < 1e-10 * expected);
    }
}
