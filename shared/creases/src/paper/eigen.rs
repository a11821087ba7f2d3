//! Eigenvalues and eigenvectors of small symmetric matrices, by Jacobi's rotations.

/// Most sweeps; five or six suffice for rounding.
const SWEEPS_MAX: usize = 16;

/// Eigenvalues, largest first, and the unit eigenvectors as rows.
pub(crate) fn eigen<const N: usize>(mut a: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut v = [[0.0; N]; N];
    for (k, row) in v.iter_mut().enumerate() {
        row[k] = 1.0;
    }
    for _ in 0..SWEEPS_MAX {
        let off: f64 =
            (0..N).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| a[i][j].abs()).sum();
        let scale: f64 = (0..N).map(|i| a[i][i].abs()).sum();
        if off <= 1e-15 * scale {
            break;
        }
        for p in 0..N {
            for q in p + 1..N {
                rotate(&mut a, &mut v, p, q);
            }
        }
    }
    let mut order: [usize; N] = std::array::from_fn(|k| k);
    order.sort_by(|p, q| a[*q][*q].total_cmp(&a[*p][*p]));
    (order.map(|k| a[k][k]), order.map(|k| v[k]))
}

/// Makes a[p][q] zero.
fn rotate<const N: usize>(a: &mut [[f64; N]; N], v: &mut [[f64; N]; N], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let t = if theta == 0.0 { 1.0 } else { t };
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    for k in 0..N {
        (a[k][p], a[k][q]) = (c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]);
    }
    for k in 0..N {
        (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
        (v[p][k], v[q][k]) = (c * v[p][k] - s * v[q][k], s * v[p][k] + c * v[q][k]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_made_of_known_axes_gives_them_back() {
        let (sin, cos) = 0.3f64.sin_cos();
        let axes = [[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]];
        let values = [2.0, 7.0, -1.0];
        let at = |i: usize, j: usize| -> f64 {
            (0..3).map(|k| values[k] * axes[k][i] * axes[k][j]).sum()
        };
        let (found, vectors) =
            eigen::<3>(std::array::from_fn(|i| std::array::from_fn(|j| at(i, j))));
        for (k, (value, axis)) in
            [(7.0, axes[1]), (2.0, axes[0]), (-1.0, axes[2])].into_iter().enumerate()
        {
            assert!((found[k] - value).abs() < 1e-12);
            let along: f64 = (0..3).map(|i| vectors[k][i] * axis[i]).sum();
            assert!((along.abs() - 1.0).abs() < 1e-12);
        }
    }
}
