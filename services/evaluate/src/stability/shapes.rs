//! Where targets want a sheet to be: folds by halves, pleats, a press, a crumple.

use super::Random;
use orime_creases::Facet;
use orime_geometry::SheetGrid;
use std::f64::consts::PI;

/// A grid of `nodes` × `nodes` over 0.21 m.
pub fn square(nodes: usize) -> SheetGrid {
    SheetGrid::new([0.21, 0.21], [nodes, nodes])
}

/// The facets between creases at these u and v, metres.
pub fn between(sheet: &SheetGrid, us: &[f64], vs: &[f64]) -> Vec<Facet> {
    let cuts = |at: &[f64], end: f64| -> Vec<f64> {
        [0.0].into_iter().chain(at.iter().copied()).chain([end]).collect()
    };
    let (us, vs) = (cuts(us, sheet.size_m[0]), cuts(vs, sheet.size_m[1]));
    let mut facets = Vec::new();
    for u in us.windows(2) {
        for v in vs.windows(2) {
            let corners_m = vec![[u[0], v[0]], [u[1], v[0]], [u[1], v[1]], [u[0], v[1]]];
            facets.push(Facet { corners_m });
        }
    }
    facets
}

/// A closed fold's targets go this share of half a turn too far (0.9°): they lie in each other.
const PAST: f64 = 1.005;

/// Turns what lies beyond `at` along one axis by a share of half a turn, about a line there.
pub fn turned([x, z]: [f64; 2], at: f64, share: f64) -> [f64; 2] {
    let (sin, cos) = (PI * share.clamp(0.0, PAST)).sin_cos();
    if x <= at {
        return [x, z];
    }
    [at + (x - at) * cos - z * sin, (x - at) * sin + z * cos]
}

/// The u of the grid line nearest to a share of the sheet, metres.
pub fn line_at(sheet: &SheetGrid, share: f64) -> f64 {
    let steps = (sheet.nodes[0] - 1) as f64;
    (share * steps).round() / steps * sheet.size_m[0]
}

/// A sheet folded in half up to three times, one after the other, each fold within `fold_s`.
pub fn halved(sheet: &SheetGrid, folds: usize, time_s: f64, fold_s: f64) -> Vec<[f32; 3]> {
    let (half, quarter) = (line_at(sheet, 0.5), line_at(sheet, 0.25));
    let share = |k: usize| (time_s - 1.2 * fold_s * k as f64) / fold_s;
    let place = |[u, v]: [f64; 2]| {
        let [mut x, mut y, mut z] = [u, v, 0.0];
        for k in 0..folds {
            match k {
                0 => [x, z] = turned([x, z], half, share(0)),
                1 => [y, z] = turned([y, z], half, share(1)),
                _ => [x, z] = turned([x, z], quarter, share(2)),
            }
        }
        [x as f32, y as f32, z as f32]
    };
    sheet.uv_m().map(place).collect()
}

/// Eight pleats that close within 1.5 s; the targets of closed pleats coincide.
pub fn pleated(sheet: &SheetGrid, time_s: f64) -> Vec<[f32; 3]> {
    let width = sheet.size_m[0] / 8.0;
    let (sin, cos) = (0.5 * PI * (time_s / 1.5).min(1.0)).sin_cos();
    let place = |[u, v]: [f64; 2]| {
        let pleat = ((u / width + 1e-9) as usize).min(7);
        let up = u - pleat as f64 * width;
        let up = if pleat % 2 == 1 { width - up } else { up };
        [(0.1 + (u - 0.1) * cos) as f32, v as f32, (up * sin) as f32]
    };
    sheet.uv_m().map(place).collect()
}

/// The free edge on a half circle over the sheet's middle, in the end `below_m` under the lower
/// half; `share` of half a turn.
pub fn pressed(sheet: &SheetGrid, share: f64, below_m: f64) -> Vec<[f32; 3]> {
    let [a, _] = sheet.size_m;
    let (sin, cos) = (PI * share).sin_cos();
    let place = |[u, v]: [f64; 2]| {
        let out = u - a / 2.0;
        if out <= 0.0 {
            return [u as f32, v as f32, 0.0];
        }
        let down = below_m * share.min(1.0);
        [(a / 2.0 + out * cos) as f32, v as f32, (out * sin - down) as f32]
    };
    sheet.uv_m().map(place).collect()
}

/// A ball of conflicting waves.
pub fn crumpled(sheet: &SheetGrid, random: &mut Random) -> Vec<[f32; 3]> {
    let a: [f64; 10] = std::array::from_fn(|_| random.symmetric());
    let k = 40.0;
    let place = |[u, v]: [f64; 2]| {
        let x = a[0] * (k * u + 6.0 * a[1]).sin() + a[2] * (k * v + 6.0 * a[3]).cos();
        let y = a[4] * (k * v + 6.0 * a[5]).sin() + a[6] * (k * u).cos();
        let z = a[7] * (k * (u + v)).sin() + a[8] * (k * u + 6.0 * a[9]).cos();
        [x, y, z].map(|c| (0.1 + 0.06 * c) as f32)
    };
    sheet.uv_m().map(place).collect()
}
