//! Positions between nodes, interpolated without reaching across a crease.

use orime_creases::Folds;

/// A material point as a weighted sum of four nodes; unused places have weight 0.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Blend {
    /// Node indices.
    pub nodes: [u32; 4],
    /// Weights; they sum to 1.
    pub weights: [f32; 4],
}

impl Blend {
    /// Where it is when the nodes are there.
    #[inline]
    pub fn position_m(&self, nodes_m: &[[f32; 3]]) -> [f32; 3] {
        let mut sum = [0f32; 3];
        for (node, weight) in self.nodes.iter().zip(self.weights) {
            let x = nodes_m[*node as usize];
            for axis in 0..3 {
                sum[axis] += weight * x[axis];
            }
        }
        sum
    }
}

/// Makes blends for a sheet folded in a certain way.
#[derive(Debug)]
pub(crate) struct Blender<'a> {
    folds: &'a Folds,
}

impl<'a> Blender<'a> {
    /// For a sheet with these folds.
    pub fn new(folds: &'a Folds) -> Self {
        Self { folds }
    }

    /// The material point (u, v), metres, as a part of the facet that holds it.
    pub fn at(&self, uv_m: [f64; 2]) -> Blend {
        if self.folds.facets().len() == 1 {
            return self.bilinear(uv_m);
        }
        self.within(self.folds.facet_at(uv_m), uv_m)
    }

    /// The material point (u, v), metres, as a part of `facet`.
    pub fn within(&self, facet: usize, uv_m: [f64; 2]) -> Blend {
        let blend = self.bilinear(uv_m);
        let is_member = |node: u32| self.folds.facets_of_node()[node as usize] & (1 << facet) != 0;
        let used = |(node, weight): (&u32, f32)| weight == 0.0 || is_member(*node);
        if blend.nodes.iter().zip(blend.weights).all(used) {
            return blend;
        }
        self.triangle(facet, uv_m).unwrap_or(blend)
    }

    fn cell(&self, uv_m: [f64; 2]) -> ([usize; 2], [f64; 2]) {
        let sheet = self.folds.sheet();
        let spacing = sheet.spacing_m();
        let mut cell = [0; 2];
        let mut rest = [0.0; 2];
        for axis in 0..2 {
            let at = (uv_m[axis] / spacing[axis]).clamp(0.0, (sheet.nodes[axis] - 1) as f64);
            // Points on a grid line must not be split by rounding between two cells.
            let at = if (at - at.round()).abs() < 1e-6 { at.round() } else { at };
            cell[axis] = (at as usize).min(sheet.nodes[axis] - 2);
            rest[axis] = at - cell[axis] as f64;
        }
        (cell, rest)
    }

    fn bilinear(&self, uv_m: [f64; 2]) -> Blend {
        let ([i, j], [s, t]) = self.cell(uv_m);
        let node = |di: usize, dj: usize| self.folds.sheet().index(i + di, j + dj) as u32;
        Blend {
            nodes: [node(0, 0), node(0, 1), node(1, 0), node(1, 1)],
            weights: [(1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t].map(|w| w as f32),
        }
    }

    /// Affinely from the three nodes of the facet, in a cell nearby, that need the least
    /// extrapolation.
    fn triangle(&self, facet: usize, uv_m: [f64; 2]) -> Option<Blend> {
        let ([i, j], [s, t]) = self.cell(uv_m);
        let mut best: Option<(f64, Blend)> = None;
        for (di, dj) in (-1..=1).flat_map(|di| (-1..=1).map(move |dj| (di, dj))) {
            let (Some(a), Some(b)) = (i.checked_add_signed(di), j.checked_add_signed(dj)) else {
                continue;
            };
            if a + 1 >= self.folds.sheet().nodes[0] || b + 1 >= self.folds.sheet().nodes[1] {
                continue;
            }
            let (s, t) = (s - di as f64, t - dj as f64);
            let node = |p: usize, q: usize| self.folds.sheet().index(a + p, b + q) as u32;
            let corners = [node(0, 0), node(0, 1), node(1, 0), node(1, 1)];
            let inside =
                corners.map(|n| self.folds.facets_of_node()[n as usize] & (1 << facet) != 0);
            // Weights of the four corners where the one named by the place is left out.
            let weights = [
                [0.0, 1.0 - s, 1.0 - t, s + t - 1.0],
                [1.0 - s, 0.0, s - t, t],
                [1.0 - t, t - s, 0.0, s],
                [1.0 - s - t, t, s, 0.0],
            ];
            for (out, weights) in weights.into_iter().enumerate() {
                if (0..4).any(|k| k != out && !inside[k]) {
                    continue;
                }
                let least = (0..4).filter(|k| *k != out).map(|k| weights[k]);
                let least = least.fold(f64::INFINITY, f64::min);
                if best.as_ref().is_none_or(|(other, _)| least > *other + 1e-9) {
                    let weights = weights.map(|w| w as f32);
                    best = Some((least, Blend { nodes: corners, weights }));
                }
            }
        }
        best.map(|(_, blend)| blend)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_creases::Line;
    use orime_geometry::SheetGrid;

    #[test]
    fn blends_are_exact_on_a_sheet_folded_along_any_line() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        for (from, to) in
            [([0.0, 0.0], [0.15, 0.15]), ([0.0, 0.151], [0.15, 0.0]), ([0.02, 0.0], [0.11, 0.15])]
        {
            let line = Line::through(from, to);
            let mut folds = Folds::flat(&sheet);
            folds.split(0, &line).unwrap();
            // Folded by a right angle: what lies right of the line goes up.
            let fold = |uv: [f64; 2]| {
                let side = line.side_m(uv);
                let foot = [
                    uv[0] + side.min(0.0) * line.direction[1],
                    uv[1] - side.min(0.0) * line.direction[0],
                ];
                [foot[0] as f32, foot[1] as f32, (-side).max(0.0) as f32]
            };
            // Nodes within the margin of both facets are a little off one of them.
            let margin_m = 0.25 * 0.15 / 24.0;
            let nodes: Vec<[f32; 3]> = sheet.uv_m().map(fold).collect();
            let blender = Blender::new(&folds);
            for uv in SheetGrid::new([0.15, 0.15], [61, 61]).uv_m() {
                let blend = blender.at(uv);
                let sum: f32 = blend.weights.iter().sum();
                assert!((sum - 1.0).abs() < 1e-5);
                let (found, exact) = (blend.position_m(&nodes), fold(uv));
                let error = (0..3).map(|k| (found[k] - exact[k]).powi(2)).sum::<f32>().sqrt();
                assert!(f64::from(error) < 1.5 * margin_m, "{uv:?}: {error}");
            }
        }
    }
}
