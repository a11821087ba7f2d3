//! Sums over nodes from which the best rigid fit of a flat piece follows in closed form.

/// Σw, Σwx (3), Σwq (2), Σwxqᵀ (6), Σw|x|², Σw|q|²; x world, q material, metres.
pub(crate) type Moments = [f64; 14];

/// Adds one node.
#[inline]
pub(crate) fn add(sums: &mut Moments, weight: f64, x: [f64; 3], q: [f64; 2]) {
    let [wu, wv] = q.map(|c| weight * c);
    sums[0] += weight;
    for k in 0..3 {
        sums[1 + k] += weight * x[k];
        sums[6 + k] += x[k] * wu;
        sums[9 + k] += x[k] * wv;
    }
    sums[4] += wu;
    sums[5] += wv;
    sums[12] += weight * (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    sums[13] += wu * q[0] + wv * q[1];
}

/// Σw|x − (R q + t)|² of the best rotation and translation, m². With M the centred Σ w x qᵀ and
/// G = MᵀM: c_xx + c_qq − 2 √(tr G + 2 √det G), the sum of M's singular values in closed form.
#[inline]
pub(crate) fn rigid_cost(from: &Moments, to: &Moments) -> f64 {
    let d = |k: usize| to[k] - from[k];
    let n = d(0);
    if n < 1.0 {
        return f64::INFINITY;
    }
    let x = [d(1), d(2), d(3)];
    let (u, v) = (d(4) / n, d(5) / n);
    let a = [d(6) - x[0] * u, d(7) - x[1] * u, d(8) - x[2] * u];
    let b = [d(9) - x[0] * v, d(10) - x[1] * v, d(11) - x[2] * v];
    let spread =
        d(12) - (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) / n + d(13) - (u * u + v * v) * n;
    let dot = |p: &[f64; 3], q: &[f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let (aa, bb, ab) = (dot(&a, &a), dot(&b, &b), dot(&a, &b));
    let det = (aa * bb - ab * ab).max(0.0);
    (spread - 2.0 * (aa + bb + 2.0 * det.sqrt()).sqrt()).max(0.0)
}
