//! How a contact moves its nodes, and what is counted while it does.

use nalgebra::Vector3;

/// More than rounding does to a height, metres.
pub(crate) const ROUNDING_M: f64 = 1e-9;

/// The contacts of one sweep that were nearer than their gaps.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Worst {
    /// How many were.
    pub count: u32,
    /// How many were below half their gap.
    pub unsettled: u32,
    /// Largest shortfall, metres.
    pub short_m: f64,
}

impl Worst {
    pub fn note(&mut self, gap_m: f64, height_m: f64) {
        self.count += 1;
        self.unsettled += u32::from(height_m < 0.5 * gap_m);
        self.short_m = self.short_m.max(gap_m - height_m);
    }
}

/// Moves nodes so that Σ weightₖ·xₖ changes by `push`, the mobile ones more.
///
/// Δxₖ = push · weightₖ·mₖ / Σ weightⱼ²·mⱼ
pub(crate) fn weighted_push(
    x: &mut [Vector3<f64>],
    mobility: &[f64],
    nodes: &[u32],
    weights: &[f64],
    push: Vector3<f64>,
) {
    let shares = nodes.iter().zip(weights).map(|(n, w)| w * w * mobility[*n as usize]);
    let sum: f64 = shares.sum();
    if sum <= 1e-12 {
        return; // All of them are held.
    }
    for (n, w) in nodes.iter().zip(weights) {
        x[*n as usize] += push * (w * mobility[*n as usize] / sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weighted_sum_moves_by_the_push_and_held_nodes_stay() {
        let mut x = vec![Vector3::zeros(); 3];
        weighted_push(&mut x, &[1.0, 0.0, 0.5], &[0, 1, 2], &[1.0, -0.4, -0.6], Vector3::z());
        assert_eq!(x[1], Vector3::zeros());
        assert!((x[0].z - 0.6 * x[2].z - 1.0).abs() < 1e-12);
        let before = x.clone();
        weighted_push(&mut x, &[0.0; 3], &[0, 1, 2], &[1.0, -0.4, -0.6], Vector3::z());
        assert_eq!(x, before);
    }
}
