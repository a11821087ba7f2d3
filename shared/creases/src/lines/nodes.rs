//! The nodes of one step: positions, weights, and how noisy they are.

use crate::finder::UNSEEN_CONFIDENCE;
use orime_geometry::SheetGrid;

/// What a step sees of the sheet.
#[derive(Debug, Clone)]
pub(crate) struct Nodes {
    pub sheet: SheetGrid,
    /// The wider spacing of the grid, metres.
    pub h_m: f64,
    /// World positions, metres; finite wherever the weight is not 0.
    pub x_m: Vec<[f64; 3]>,
    /// Material coordinates, metres.
    pub uv_m: Vec<[f64; 2]>,
    /// Weights, 0 to 1.
    pub weight: Vec<f64>,
    /// Standard deviation of the noise that neighbours do not share, per coordinate, metres.
    pub noise_m: f64,
    differences: Vec<f64>,
}

impl Nodes {
    pub fn new(sheet: &SheetGrid) -> Self {
        let [h_u, h_v] = sheet.spacing_m();
        Self {
            sheet: sheet.clone(),
            h_m: h_u.max(h_v),
            x_m: vec![[0.0; 3]; sheet.len()],
            uv_m: sheet.uv_m().collect(),
            weight: vec![0.0; sheet.len()],
            noise_m: 0.0,
            differences: Vec::with_capacity(6 * sheet.len()),
        }
    }

    /// Takes over one step; nodes that are missing, unseen or not finite weigh nothing.
    pub fn read(&mut self, positions_m: &[[f32; 3]], confidence: &[f32]) {
        for n in 0..self.x_m.len() {
            let x = positions_m.get(n).copied().unwrap_or([f32::NAN; 3]);
            let sure = f64::from(confidence.get(n).copied().unwrap_or(1.0));
            let finite = x.iter().all(|c| c.is_finite()) && sure.is_finite();
            let is_seen = finite && sure > f64::from(UNSEEN_CONFIDENCE);
            self.weight[n] = if is_seen { sure.min(1.0) } else { 0.0 };
            self.x_m[n] = if finite { x.map(f64::from) } else { [0.0; 3] };
        }
        self.noise_m = self.white_noise_m();
    }

    /// Median of |third difference| along rows and columns, over 0.6745·√20: exact for white
    /// noise, blind to bends that are wide against the spacing and to creases, which are few.
    fn white_noise_m(&mut self) -> f64 {
        let [rows, columns] = self.sheet.nodes;
        self.differences.clear();
        for (stride, length, across, lines) in
            [(1, columns, columns, rows), (columns, rows, 1, columns)]
        {
            for line in 0..lines {
                for at in 0..length.saturating_sub(3) {
                    let [a, b, c, d] = [0, 1, 2, 3].map(|k| line * across + (at + k) * stride);
                    if [a, b, c, d].iter().all(|n| self.weight[*n] > 0.0) {
                        let x = &self.x_m;
                        let third = |k: usize| x[d][k] - x[a][k] + 3.0 * (x[b][k] - x[c][k]);
                        self.differences.extend([0, 1, 2].map(|k| third(k).abs()));
                    }
                }
            }
        }
        let middle = self.differences.len() / 2;
        if self.differences.is_empty() {
            return 0.0;
        }
        let (_, median, _) = self.differences.select_nth_unstable_by(middle, f64::total_cmp);
        *median / (0.6745 * 20f64.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_nobody_saw_weighs_nothing_and_what_is_barely_seen_does() {
        let sheet = SheetGrid::new([0.1, 0.1], [2, 2]);
        let mut nodes = Nodes::new(&sheet);
        let positions_m = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [f32::NAN; 3]];
        nodes.read(&positions_m, &[UNSEEN_CONFIDENCE, 0.11, 2.0, 1.0]);
        assert_eq!(nodes.weight, [0.0, f64::from(0.11f32), 1.0, 0.0]);
        assert_eq!(nodes.x_m[3], [0.0; 3]);
    }
}
