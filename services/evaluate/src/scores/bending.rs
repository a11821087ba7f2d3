//! Scores of bending: wrinkles where the sheet is truly flat, and the angle where it is folded.

use orime_geometry::SheetGrid;
use orime_geometry::nalgebra::{Point3, Vector3};

/// Below this turn, the truth counts as flat at a node, radians (1°).
const FLAT_RAD: f64 = 0.01745;

/// Mean turning angle of the tracked grid lines at the nodes where the true ones are straight,
/// degrees: wrinkles. `None` where the truth is straight nowhere.
pub fn wrinkle_deg(nodes_m: &[[f32; 3]], truth_m: &[[f32; 3]], sheet: &SheetGrid) -> Option<f64> {
    let turns = lines(sheet).filter_map(|row| {
        let truly = turn_rad(truth_m, row)?;
        if truly < FLAT_RAD { turn_rad(nodes_m, row) } else { None }
    });
    super::mean(turns).map(f64::to_degrees)
}

/// Three nodes in a row, along u and along v.
fn lines(sheet: &SheetGrid) -> impl Iterator<Item = [usize; 3]> + '_ {
    let [n, m] = sheet.nodes;
    (0..n).flat_map(move |i| {
        (0..m).flat_map(move |j| {
            let along_u = (0 < i && i + 1 < n)
                .then(|| [sheet.index(i - 1, j), sheet.index(i, j), sheet.index(i + 1, j)]);
            let along_v = (0 < j && j + 1 < m)
                .then(|| [sheet.index(i, j - 1), sheet.index(i, j), sheet.index(i, j + 1)]);
            along_u.into_iter().chain(along_v)
        })
    })
}

/// Angle by which a line turns at its middle node, radians; `None` for coincident nodes.
fn turn_rad(x: &[[f32; 3]], [a, b, c]: [usize; 3]) -> Option<f64> {
    let [a, b, c] = [a, b, c].map(|k| Point3::from(x[k]).cast::<f64>());
    let (before, after) = (b - a, c - b);
    if before.norm() < 1e-9 || after.norm() < 1e-9 {
        return None;
    }
    Some(angle(&before, &after))
}

/// Angle between two vectors, exact for small ones too.
fn angle(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrinkles_count_and_true_folds_do_not() {
        let sheet = SheetGrid::new([0.2, 0.2], [5, 5]);
        let flat = sheet.flat_m();
        let fold = |p: &[f32; 3]| if p[0] > 1e-6 { [0.0, p[1], p[0]] } else { *p };
        let truth: Vec<[f32; 3]> = flat.iter().map(fold).collect();
        assert!(wrinkle_deg(&truth, &truth, &sheet).unwrap() < 1e-3);
        // A zigzag of ±10° slopes along v turns by 20° at each of its inner nodes.
        let slope = 10f32.to_radians();
        let h = 0.05;
        let zigzag: Vec<[f32; 3]> = (0..25)
            .map(|k| {
                let (i, j) = (k / 5, k % 5);
                let y = j as f32 * h * slope.cos();
                [i as f32 * h, y, if j % 2 == 1 { h * slope.sin() } else { 0.0 }]
            })
            .collect();
        // Half of the thirty rows run along v and turn by 20°, the others are straight.
        let found = wrinkle_deg(&zigzag, &flat, &sheet).unwrap();
        assert!((found - 10.0).abs() < 1e-3, "{found}");
    }
}
