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
}
