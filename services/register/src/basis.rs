//! The motion-coherence kernel's eigenbasis on the control points.

use nalgebra::{DMatrix, DVector};
use orime_geometry::SheetGrid;
use orime_lanes::{Lanes, Pass};

/// Control points of a sheet and the modes in which they may move together.
///
/// G[a,b] = exp(−|uv_a − uv_b|²/2β²) ≈ Q Λ Qᵀ, over material coordinates, so that it is constant
/// and layers that touch in space are not coupled.
#[derive(Debug, Clone)]
pub(crate) struct Basis {
    /// Control points along u and v.
    pub controls: [usize; 2],
    /// Eigenvectors, one row of K entries per control point.
    pub modes: DMatrix<f64>,
    /// Their eigenvalues, descending.
    pub eigenvalues: Vec<f64>,
    /// `modes`, rows padded with zeros to whole tiles.
    padded: Vec<f64>,
}

/// Four control points (or nodes) and their bilinear weights.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    /// Index of the lowest corner; the others are `+1`, `+stride`, `+stride+1`.
    pub base: u32,
    /// Weights of `base`, `base + 1`, `base + stride`, `base + stride + 1`.
    pub weights: [f32; 4],
}

impl Basis {
    /// `controls` points, evenly spaced over the sheet; at most `modes_max` modes, and only those
    /// whose eigenvalue is above 1e-7 of the largest.
    pub fn new(sheet: &SheetGrid, controls: [usize; 2], width_m: f64, modes_max: usize) -> Self {
        let control_sheet = SheetGrid::new(sheet.size_m, controls);
        let uv: Vec<[f64; 2]> = control_sheet.uv_m().collect();
        let kernel = DMatrix::from_fn(uv.len(), uv.len(), |a, b| {
            let squared = (uv[a][0] - uv[b][0]).powi(2) + (uv[a][1] - uv[b][1]).powi(2);
            (-squared / (2.0 * width_m * width_m)).exp()
        });
        let eigen = kernel.symmetric_eigen();
        let mut order: Vec<usize> = (0..uv.len()).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let largest = eigen.eigenvalues[order[0]];
        order.truncate(modes_max);
        order.retain(|k| eigen.eigenvalues[*k] > 1e-7 * largest);
        // The modes are read row by row (a control point's K entries): store them transposed.
        let modes =
            DMatrix::from_fn(order.len(), uv.len(), |k, a| eigen.eigenvectors[(a, order[k])]);
        let mut padded = Vec::new();
        for row in modes.as_slice().chunks_exact(order.len()) {
            padded.extend_from_slice(row);
            padded.resize(padded.len().next_multiple_of(TILE[0]), 0.0);
        }
        let eigenvalues = order.iter().map(|k| eigen.eigenvalues[*k]).collect();
        Self { controls, modes, eigenvalues, padded }
    }

    /// Number of control points.
    pub fn len(&self) -> usize {
        self.controls[0] * self.controls[1]
    }

    /// The K entries of control point `a`.
    pub fn row(&self, a: usize) -> &[f64] {
        let k = self.eigenvalues.len();
        &self.modes.as_slice()[a * k..(a + 1) * k]
    }
}

/// The reduced normal equations, one unknown per mode.
#[derive(Debug, Clone, Default)]
pub(crate) struct Equations {
    /// Qᵀ S Q, K × K, of which the lower triangle is filled, column by column.
    pub normal: Vec<f64>,
    /// Qᵀ F, one column per axis.
    pub right: [Vec<f64>; 3],
    /// S Q, a row of K numbers, padded, per control point.
    spread: Vec<f64>,
}

/// Rows and columns of the normal equations that are summed up together.
const TILE: [usize; 2] = [8, 4];

/// Adds up the normal equations.
pub(crate) struct Reduce<'a> {
    /// Q.
    pub basis: &'a Basis,
    /// S: each control point's coupling to its nine neighbours; row major, own place 4.
    pub stencil: &'a [[f64; 9]],
    /// F: a force per control point.
    pub force: &'a [[f64; 3]],
    /// Receives the sums.
    pub equations: &'a mut Equations,
}

impl Pass for Reduce<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { basis, stencil, force, equations } = self;
        let Equations { normal, right, spread } = equations;
        let k = basis.eigenvalues.len();
        let padded = k.next_multiple_of(TILE[0]);
        spread.clear();
        spread.resize(padded * basis.len(), 0.0);
        for numbers in right.iter_mut() {
            numbers.clear();
            numbers.resize(k, 0.0);
        }
        let stride = basis.controls[1] as isize;
        for (a, spread) in spread.chunks_exact_mut(padded).enumerate() {
            let row = basis.row(a);
            for axis in 0..3 {
                add(&mut right[axis], force[a][axis], row);
            }
            for (place, weight) in stencil[a].iter().enumerate() {
                if *weight != 0.0 {
                    let (di, dj) = (place as isize / 3 - 1, place as isize % 3 - 1);
                    let other = basis.row((a as isize + di * stride + dj) as usize);
                    add(&mut spread[..k], *weight, other);
                }
            }
        }
        normal.clear();
        normal.resize(k * k, 0.0);
        for column in (0..k).step_by(TILE[1]) {
            for row in (column / TILE[0] * TILE[0]..k).step_by(TILE[0]) {
                let tile = tile(&basis.padded, spread, padded, row, column);
                for (j, sums) in tile.iter().enumerate().take(k - column) {
                    for (i, sum) in sums.iter().enumerate().take(k - row) {
                        normal[(column + j) * k + row + i] = *sum;
                    }
                }
            }
        }
    }
}

/// Σ_a spread[a, column + j]·modes[a, row + i].
#[inline(always)]
fn tile(
    modes: &[f64],
    spread: &[f64],
    padded: usize,
    row: usize,
    column: usize,
) -> [[f64; TILE[0]]; TILE[1]] {
    let mut sums = [[0.0; TILE[0]]; TILE[1]];
    for (modes, spread) in modes.chunks_exact(padded).zip(spread.chunks_exact(padded)) {
        let (modes, spread) = (&modes[row..row + TILE[0]], &spread[column..column + TILE[1]]);
        for j in 0..TILE[1] {
            for i in 0..TILE[0] {
                sums[j][i] += spread[j] * modes[i];
            }
        }
    }
    sums
}

/// Moves the control points by the modes.
pub(crate) struct Expand<'a> {
    /// Q.
    pub basis: &'a Basis,
    /// How far each mode moves, metres, one column per axis.
    pub modes: &'a [DVector<f64>; 3],
    /// Receives how far each control point moves, metres.
    pub moved: &'a mut [[f32; 3]],
}

impl Pass for Expand<'_> {
    #[inline(always)]
    fn run<V: Lanes>(self) {
        // Loops, not closures: those would be compiled without the vectors.
        for (a, moved) in self.moved.iter_mut().enumerate() {
            let row = self.basis.row(a);
            for (moved, modes) in moved.iter_mut().zip(self.modes) {
                *moved = product(modes.as_slice(), row) as f32;
            }
        }
    }
}

/// sum ← sum + weight·row.
#[inline(always)]
fn add(sum: &mut [f64], weight: f64, row: &[f64]) {
    for (sum, entry) in sum.iter_mut().zip(row) {
        *sum += weight * entry;
    }
}

/// Σ a·b in eight lanes, so that every width of vectors gives the same bits.
#[inline(always)]
fn product(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 8];
    let whole = a.len() / 8 * 8;
    for first in (0..whole).step_by(8) {
        let (a, b) = (&a[first..first + 8], &b[first..first + 8]);
        for k in 0..8 {
            lanes[k] += a[k] * b[k];
        }
    }
    for k in whole..a.len() {
        lanes[k - whole] += a[k] * b[k];
    }
    ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6]))
        + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]))
}

/// Bilinear interpolation from a grid of `from` points to one of `to` points over the same sheet.
pub(crate) fn corners(from: [usize; 2], to: [usize; 2]) -> Vec<Corner> {
    let place = |k: usize, axis: usize| -> (usize, f64) {
        let at = k as f64 * (from[axis] - 1) as f64 / (to[axis] - 1) as f64;
        // Points on a grid line must not be split by rounding between two cells.
        let at = if (at - at.round()).abs() < 1e-9 { at.round() } else { at };
        let cell = (at as usize).min(from[axis] - 2);
        (cell, at - cell as f64)
    };
    let mut corners = Vec::with_capacity(to[0] * to[1]);
    for i in 0..to[0] {
        for j in 0..to[1] {
            let ((a, s), (b, t)) = (place(i, 0), place(j, 1));
            corners.push(Corner {
                base: (a * from[1] + b) as u32,
                weights: [(1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t]
                    .map(|w| w as f32),
            });
        }
    }
    corners
}

impl Corner {
    /// A material point among the control points of a sheet (see [`Basis::new`]).
    pub fn at(sheet: &SheetGrid, controls: [usize; 2], uv_m: [f64; 2]) -> Self {
        let place = |axis: usize| {
            let at = uv_m[axis] / sheet.size_m[axis] * (controls[axis] - 1) as f64;
            let cell = (at.max(0.0) as usize).min(controls[axis] - 2);
            (cell, at - cell as f64)
        };
        let ((a, s), (b, t)) = (place(0), place(1));
        Self {
            base: (a * controls[1] + b) as u32,
            weights: [(1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t].map(|w| w as f32),
        }
    }

    /// Indices of the four corners in a grid whose rows are `stride` long.
    pub fn indices(&self, stride: usize) -> [usize; 4] {
        let base = self.base as usize;
        [base, base + 1, base + stride, base + stride + 1]
    }

    /// The interpolated vector.
    pub fn interpolate(&self, grid: &[[f32; 3]], stride: usize) -> [f32; 3] {
        let corners = self.indices(stride).map(|k| grid[k]);
        [0, 1, 2]
            .map(|axis| corners.iter().zip(self.weights).map(|(corner, w)| corner[axis] * w).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_rebuild_the_kernel() {
        let sheet = SheetGrid::new([0.15, 0.21], [9, 11]);
        let basis = Basis::new(&sheet, [5, 6], 0.05, 400);
        assert_eq!(basis.controls, [5, 6]);
        let uv: Vec<[f64; 2]> = SheetGrid::new(sheet.size_m, basis.controls).uv_m().collect();
        for (a, b) in [(0, 0), (3, 17), (29, 4)] {
            let rebuilt: f64 = (0..basis.eigenvalues.len())
                .map(|k| basis.row(a)[k] * basis.eigenvalues[k] * basis.row(b)[k])
                .sum();
            let squared = (uv[a][0] - uv[b][0]).powi(2) + (uv[a][1] - uv[b][1]).powi(2);
            assert!((rebuilt - (-squared / 0.005).exp()).abs() < 1e-5);
        }
    }

    #[test]
    fn interpolation_is_exact_on_linear_fields_and_on_the_nodes() {
        let from = SheetGrid::new([0.3, 0.2], [4, 5]);
        let to = SheetGrid::new([0.3, 0.2], [10, 9]);
        for (corner, [u, v]) in corners(from.nodes, to.nodes).iter().zip(to.uv_m()) {
            let p = corner.interpolate(&from.flat_m(), from.nodes[1]);
            assert!((f64::from(p[0]) - (u - 0.15)).abs() < 1e-6);
            assert!((f64::from(p[1]) - (v - 0.10)).abs() < 1e-6);
        }
    }
}
