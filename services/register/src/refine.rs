//! Coarse grids are registered on one of half the spacing.
//!
//! Chords between nodes that are far apart are shorter than the paper between them where it
//! bends, so that links that keep their length would push the sheet out of a narrow bend.

use crate::blend::{Blend, Blender};
use orime_creases::Folds;
use orime_geometry::SheetGrid;

/// Nodes farther apart than this share of the sheet's side are too coarse.
const SPACING_MAX: f64 = 0.06;

/// A grid of half the spacing of another, of which every second node along u and v is the other's.
#[derive(Debug, Clone)]
pub(crate) struct Refinement {
    coarse: SheetGrid,
    fine: SheetGrid,
    /// The coarse folds that `fine_folds` were made of.
    folds: Folds,
    /// Where there are several facets: each fine node as a part of its own.
    blends: Vec<Blend>,
    /// The same folds of the fine grid.
    pub fine_folds: Folds,
    /// Targets and confidences of the fine grid.
    pub targets_m: Vec<[f32; 3]>,
    pub confidence: Vec<f32>,
}

impl Refinement {
    /// `None` where the grid is fine enough.
    pub fn of(coarse: &SheetGrid) -> Option<Self> {
        let side_m = (coarse.size_m[0] + coarse.size_m[1]) / 2.0;
        let [h_u, h_v] = coarse.spacing_m();
        if h_u.max(h_v) <= SPACING_MAX * side_m || coarse.nodes.iter().any(|n| *n < 4) {
            return None;
        }
        let fine = SheetGrid::new(coarse.size_m, coarse.nodes.map(|n| 2 * n - 1));
        Some(Self {
            folds: Folds::flat(coarse),
            blends: Vec::new(),
            fine_folds: Folds::flat(&fine),
            targets_m: vec![[0.0; 3]; fine.len()],
            confidence: vec![0.0; fine.len()],
            coarse: coarse.clone(),
            fine,
        })
    }

    /// The fine grid.
    pub fn sheet(&self) -> &SheetGrid {
        &self.fine
    }

    /// Takes over the folds of the coarse grid.
    pub fn refold(&mut self, folds: &Folds) {
        if self.folds.facets() != folds.facets() {
            self.folds.clone_from(folds);
            self.fine_folds = Folds::from_facets(&self.fine, folds.facets().to_vec());
            self.blends.clear();
            if folds.facets().len() > 1 {
                let blender = Blender::new(&self.folds);
                self.blends.extend(self.fine.uv_m().map(|uv| blender.at(uv)));
            }
        }
    }

    /// Positions of the coarse nodes to those of all: by cubic curves on a sheet without folds,
    /// within flat facets on one with them.
    pub fn refined_m(&self, coarse_m: &[[f32; 3]]) -> Vec<[f32; 3]> {
        if !self.blends.is_empty() {
            return self.blends.iter().map(|blend| blend.position_m(coarse_m)).collect();
        }
        let [rows, columns] = self.coarse.nodes;
        let mut fine_m = vec![[0.0; 3]; self.fine.len()];
        for i in 0..rows {
            let row = &coarse_m[self.coarse.index(i, 0)..][..columns];
            for j in 0..self.fine.nodes[1] {
                fine_m[self.fine.index(2 * i, j)] = halved(j, |k| row[k], columns);
            }
        }
        for j in 0..self.fine.nodes[1] {
            for i in (1..self.fine.nodes[0]).step_by(2) {
                let at = |k: usize| fine_m[self.fine.index(2 * k, j)];
                fine_m[self.fine.index(i, j)] = halved(i, at, rows);
            }
        }
        fine_m
    }

    /// Hands back what belongs to the coarse nodes.
    pub fn hand_back(&self, targets_m: &mut [[f32; 3]], confidence: &mut [f32]) {
        let [rows, columns] = self.coarse.nodes;
        for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
            let (from, to) = (self.fine.index(2 * i, 2 * j), self.coarse.index(i, j));
            confidence[to] = self.confidence[from];
            targets_m[to] = self.targets_m[from];
        }
    }
}

/// Point `fine` of a row whose every second point is one of `count` known ones: they themselves,
/// and between them cubics through four (at the ends, parabolas through three).
fn halved(fine: usize, known: impl Fn(usize) -> [f32; 3], count: usize) -> [f32; 3] {
    let k = fine / 2;
    if fine.is_multiple_of(2) {
        return known(k);
    }
    let sum = |weights: &[(usize, f32)]| {
        let mut sum = [0f32; 3];
        for (k, weight) in weights {
            let point = known(*k);
            (0..3).for_each(|axis| sum[axis] += weight * point[axis]);
        }
        sum
    };
    match k {
        0 => sum(&[(0, 0.375), (1, 0.75), (2, -0.125)]),
        k if k + 2 == count => sum(&[(k + 1, 0.375), (k, 0.75), (k - 1, -0.125)]),
        k => sum(&[(k - 1, -0.0625), (k, 0.5625), (k + 1, 0.5625), (k + 2, -0.0625)]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_creases::Line;

    #[test]
    fn fine_grids_are_left_alone() {
        assert!(Refinement::of(&SheetGrid::new([0.15, 0.15], [25, 25])).is_none());
        let refinement = Refinement::of(&SheetGrid::new([0.15, 0.15], [13, 13])).unwrap();
        assert_eq!(refinement.sheet().nodes, [25, 25]);
    }

    #[test]
    fn a_bend_stays_round_and_a_crease_sharp() {
        let sheet = SheetGrid::new([0.15, 0.15], [13, 13]);
        let mut refinement = Refinement::of(&sheet).unwrap();
        // Rolled about a radius of 40 mm: chords would cut 0.5 mm off.
        let rolled = |uv: [f64; 2]| {
            let (sin, cos) = (uv[0] / 0.04).sin_cos();
            [(0.04 * sin) as f32, uv[1] as f32, (0.04 - 0.04 * cos) as f32]
        };
        let error = |refinement: &Refinement, truth: &dyn Fn([f64; 2]) -> [f32; 3]| {
            let coarse: Vec<[f32; 3]> = sheet.uv_m().map(truth).collect();
            let found = refinement.refined_m(&coarse);
            let off = |(found, uv): (&[f32; 3], [f64; 2])| {
                let exact = truth(uv);
                (0..3).map(|k| (found[k] - exact[k]).abs()).fold(0f32, f32::max)
            };
            found.iter().zip(refinement.sheet().uv_m()).map(off).fold(0f32, f32::max)
        };
        let bend = error(&refinement, &rolled);
        assert!(bend < 1.5e-4, "{bend}");
        let line = Line::through([0.07, 0.0], [0.07, 0.15]);
        let mut folds = Folds::flat(&sheet);
        folds.split(0, &line).unwrap();
        refinement.refold(&folds);
        assert_eq!(refinement.fine_folds.facets().len(), 2);
        let folded = |uv: [f64; 2]| {
            let beyond = (uv[0] - 0.07).max(0.0);
            [(uv[0] - beyond) as f32, uv[1] as f32, beyond as f32]
        };
        let crease = error(&refinement, &folded);
        assert!(crease < 1e-6, "{crease}");
    }
}
