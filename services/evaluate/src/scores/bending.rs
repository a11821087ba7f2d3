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

/// How far the tracked creases are from the true ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CreaseErrors {
    /// Mean difference of the fold angle, degrees.
    pub angle_deg: f64,
    /// Mean distance between where the tracked and the true line bend, in the sheet's own
    /// coordinates, metres.
    pub position_m: f64,
    /// Crossings of a grid line and a true crease that were compared.
    pub crossings: usize,
}

/// A grid line bends at a true crease if it turns there by more than this, radians (20°).
const CREASE_RAD: f64 = 0.349;
/// Nodes on each side of a crease over which the fold angle is measured.
const ARM: usize = 3;

/// Compares tracked and true creases wherever a grid line crosses one that stands alone.
///
/// At a crossing near node i the fold angle is that between the line's directions three nodes
/// before and three after; the position is the mean of the nodes' places between, weighted with
/// the angle by which the line turns at each. Crossings nearer than three nodes to the border or
/// to another crease are left out. `None` where nothing is left.
pub fn crease_errors(
    nodes_m: &[[f32; 3]],
    truth_m: &[[f32; 3]],
    sheet: &SheetGrid,
) -> Option<CreaseErrors> {
    let [h_u, h_v] = sheet.spacing_m();
    let [n, m] = sheet.nodes;
    let along_u = (0..m).map(|j| ((0..n).map(|i| sheet.index(i, j)).collect::<Vec<_>>(), h_u));
    let along_v = (0..n).map(|i| ((0..m).map(|j| sheet.index(i, j)).collect::<Vec<_>>(), h_v));
    let (mut angle, mut position, mut crossings) = (0.0, 0.0, 0usize);
    for (line, spacing_m) in along_u.chain(along_v) {
        for at in crossings_of(truth_m, &line) {
            let (Some(truly), Some(found)) = (bend(truth_m, &line, at), bend(nodes_m, &line, at))
            else {
                continue;
            };
            angle += (truly.0 - found.0).abs();
            position += (truly.1 - found.1).abs() * spacing_m;
            crossings += 1;
        }
    }
    (crossings > 0).then(|| CreaseErrors {
        angle_deg: (angle / crossings as f64).to_degrees(),
        position_m: position / crossings as f64,
        crossings,
    })
}

/// Places on a line where the truth bends sharply and stays straight for [`ARM`] nodes around.
fn crossings_of(truth_m: &[[f32; 3]], line: &[usize]) -> Vec<usize> {
    let turn = |k: usize| turn_rad(truth_m, [line[k - 1], line[k], line[k + 1]]).unwrap_or(0.0);
    let turns: Vec<f64> =
        (0..line.len()).map(|k| if 0 < k && k + 1 < line.len() { turn(k) } else { 0.0 }).collect();
    (ARM..line.len().saturating_sub(ARM))
        .filter(|k| {
            let around = k - ARM + 1..k + ARM;
            let largest = around.clone().all(|other| turns[other] <= turns[*k]);
            // A crease between two nodes turns the line at both.
            let alone = around
                .filter(|other| other.abs_diff(*k) > 1)
                .all(|other| turns[other] < 0.2 * turns[*k]);
            turns[*k] > CREASE_RAD && largest && alone
        })
        .collect()
}

/// Fold angle, radians, and place, in nodes, of the bend around node `at` of a line.
fn bend(x: &[[f32; 3]], line: &[usize], at: usize) -> Option<(f64, f64)> {
    let point = |k: usize| Point3::from(x[line[k]]).cast::<f64>();
    let before = point(at - ARM + 1) - point(at - ARM);
    let after = point(at + ARM) - point(at + ARM - 1);
    if before.norm() < 1e-9 || after.norm() < 1e-9 {
        return None;
    }
    let (mut sum, mut weights) = (0.0, 0.0);
    for k in at - ARM + 1..at + ARM {
        let turn = turn_rad(x, [line[k - 1], line[k], line[k + 1]])?;
        sum += turn * k as f64;
        weights += turn;
    }
    (weights > 1e-6).then(|| (angle(&before, &after), sum / weights))
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
    #[test]
    fn a_crease_in_the_wrong_place_and_too_flat_is_measured() {
        let sheet = SheetGrid::new([0.24, 0.12], [13, 7]);
        // Folded along u = u₀ by an angle, h = 20 mm; lines along v stay straight.
        let folded = |u0: f64, degrees: f64| -> Vec<[f32; 3]> {
            let (sin, cos) = degrees.to_radians().sin_cos();
            sheet
                .uv_m()
                .map(|[u, v]| {
                    let beyond = (u - u0).max(0.0);
                    [(u.min(u0) + beyond * cos) as f32, v as f32, (beyond * sin) as f32]
                })
                .collect()
        };
        let truth = folded(0.12, 90.0);
        let same = crease_errors(&truth, &truth, &sheet).unwrap();
        assert_eq!(same.crossings, 7);
        assert!(same.angle_deg < 1e-3 && same.position_m < 1e-6);
        // One grid step beside, 80° instead of 90°.
        let off = crease_errors(&folded(0.14, 80.0), &truth, &sheet).unwrap();
        assert!((off.angle_deg - 10.0).abs() < 0.01, "{off:?}");
        assert!((off.position_m - 0.02).abs() < 1e-4, "{off:?}");
        assert_eq!(crease_errors(&truth, &sheet.flat_m(), &sheet), None);
    }
}
