//! Textures of table and paper: periodic tiles of smooth noise.

use super::noise::uniform;

/// A periodic, square brightness texture with values in about [-1, 1].
#[derive(Debug)]
pub(super) struct Texture {
    /// Texels along u and v, before the tile repeats.
    texels_per_m: [f32; 2],
    values: Vec<f32>,
}

const SIDE: usize = 512;

/// Makes texel numbers positive, so that truncation is flooring; a multiple of `SIDE`.
const BIAS: f32 = 32768.0;

impl Texture {
    /// Grain along x: long streaks of several widths.
    pub fn wood(seed: u64) -> Self {
        Self {
            texels_per_m: [400.0, 1600.0],
            values: octaves(seed ^ 0x3001, &[(16, 0.5), (6, 0.3), (2, 0.2)]),
        }
    }

    /// Fibres: fine and without direction.
    pub fn paper(seed: u64) -> Self {
        Self { texels_per_m: [2000.0; 2], values: octaves(seed ^ 0xbabe, &[(12, 0.5), (3, 0.5)]) }
    }

    /// Value at a point, metres.
    #[inline]
    pub fn at(&self, u_m: f32, v_m: f32) -> f32 {
        let x = (u_m * self.texels_per_m[0] + BIAS) as i32 as usize & (SIDE - 1);
        let y = (v_m * self.texels_per_m[1] + BIAS) as i32 as usize & (SIDE - 1);
        self.values[y * SIDE + x]
    }
}

/// Sum of smooth random lattices with these cell sizes (texels, powers of two or divisors of the
/// tile rounded down) and weights.
fn octaves(seed: u64, layers: &[(usize, f32)]) -> Vec<f32> {
    let mut values = vec![0.0; SIDE * SIDE];
    for (layer, (cell, weight)) in layers.iter().enumerate() {
        let n = SIDE / cell;
        let lattice: Vec<f32> = (0..n * n)
            .map(|k| (2.0 * uniform(seed + layer as u64, k as u64) - 1.0) as f32)
            .collect();
        for y in 0..SIDE {
            for x in 0..SIDE {
                let [fx, fy] = [x, y].map(|t| t as f32 * n as f32 / SIDE as f32);
                let (i, j) = (fx as usize, fy as usize);
                let [sx, sy] = [fx - i as f32, fy - j as f32].map(|s| s * s * (3.0 - 2.0 * s));
                let at = |i: usize, j: usize| lattice[(j % n) * n + i % n];
                let low = at(i, j) + sx * (at(i + 1, j) - at(i, j));
                let high = at(i, j + 1) + sx * (at(i + 1, j + 1) - at(i, j + 1));
                values[y * SIDE + x] += weight * (low + sy * (high - low));
            }
        }
    }
    values
}
