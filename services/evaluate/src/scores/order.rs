//! Whether the layers of a folded sheet lie on each other as they should.

use super::folded::STACK_M;
use orime_geometry::SheetGrid;
use orime_geometry::nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Farthest that the tracked layers may have slid along each other to be compared, cells.
const SLID: usize = 2;

/// Closer than this along both sides of the sheet a node and a place are one layer, spacings.
const ONE_LAYER: f64 = SLID as f64 + 2.0;

/// Cosine of the angle between neighbouring triangles from which there is a crease.
const CREASE_COS: f64 = 0.7;

/// Pairs of a node and another layer near it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LayerOrder {
    /// Pairs in the true sheet that were found in the tracked one.
    pub pairs: u32,
    /// Those in which the node lies on another side of the layer than in truth.
    pub wrong: u32,
}

/// Compares on which side of its neighbouring layers each node lies.
///
/// A pair is a node and a triangle of the true sheet whose normal through the node meets it, at
/// most 5 mm away, and which is four spacings away along the sheet. In the tracked sheet the side
/// is that of the triangle under the node that is nearest in material to the true one; where none
/// is within two cells the pair is not counted. Nor are nodes and triangles at a true crease:
/// which side of it such a node lies on is a matter of tenths of a millimetre.
pub fn layer_order(nodes_m: &[[f32; 3]], truth_m: &[[f32; 3]], sheet: &SheetGrid) -> LayerOrder {
    let place = |x: &[[f32; 3]]| -> Vec<Point3<f64>> {
        x.iter().map(|p| Point3::from(*p).cast()).collect()
    };
    let (tracked, truth) = (place(nodes_m), place(truth_m));
    let uv_m: Vec<[f64; 2]> = sheet.uv_m().collect();
    let triangles = sheet.triangles();
    let spacing_m = sheet.spacing_m();
    let at_crease = at_crease(&truth, &triangles);
    // Those at a crease are emptied, not left out: a cell's triangles are found by their number.
    let mut whole = triangles.clone();
    for triangle in whole.iter_mut().filter(|t| t.iter().any(|n| at_crease[*n as usize])) {
        *triangle = [0; 3];
    }
    let reach_m = STACK_M + spacing_m[0].hypot(spacing_m[1]);
    let mut order = LayerOrder::default();
    for (k, p) in truth.iter().enumerate().filter(|(k, _)| !at_crease[*k]) {
        for triangle in &whole {
            let corners = triangle.map(|n| truth[n as usize]);
            if (corners[0] - p).norm_squared() > reach_m * reach_m {
                continue;
            }
            let Some((weights, height_m)) = over(p, &corners) else { continue };
            if !(1e-6..STACK_M).contains(&height_m.abs()) {
                continue;
            }
            let at_m = material(&weights, triangle, &uv_m);
            let apart = [0, 1].map(|axis| (at_m[axis] - uv_m[k][axis]).abs() / spacing_m[axis]);
            if apart.iter().all(|spacings| *spacings < ONE_LAYER) {
                continue;
            }
            if let Some(side) = side(&tracked[k], &tracked, at_m, sheet, &whole, &uv_m) {
                order.pairs += 1;
                order.wrong += u32::from(side * height_m <= 0.0);
            }
        }
    }
    order
}

/// Nodes between triangles of very different directions.
fn at_crease(x: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<bool> {
    let mut first: Vec<Option<Vector3<f64>>> = vec![None; x.len()];
    let mut at_crease = vec![false; x.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|n| x[n as usize]);
        let normal = (b - a).cross(&(c - a)).normalize();
        for node in triangle.map(|n| n as usize) {
            at_crease[node] |= first[node].get_or_insert(normal).dot(&normal) < CREASE_COS;
        }
    }
    at_crease
}

/// Height of a node over the part of the sheet round a material point; `None` where it lies beside.
fn side(
    p: &Point3<f64>,
    x: &[Point3<f64>],
    at_m: [f64; 2],
    sheet: &SheetGrid,
    triangles: &[[u32; 3]],
    uv_m: &[[f64; 2]],
) -> Option<f64> {
    let spacing_m = sheet.spacing_m();
    let around = |axis: usize| {
        let cell = (at_m[axis] / spacing_m[axis]) as usize;
        cell.saturating_sub(SLID)..(cell + SLID + 1).min(sheet.nodes[axis] - 1)
    };
    let cells = around(0).flat_map(|i| around(1).map(move |j| i * (sheet.nodes[1] - 1) + j));
    let under = cells.flat_map(|cell| &triangles[2 * cell..2 * cell + 2]).filter_map(|triangle| {
        let (weights, height_m) = over(p, &triangle.map(|n| x[n as usize]))?;
        let [u, v] = material(&weights, triangle, uv_m);
        Some(((u - at_m[0]).hypot(v - at_m[1]), height_m))
    });
    under.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, height_m)| height_m)
}

/// Barycentric weights of a point's foot on a triangle, and its height over it, metres; `None` if
/// the foot is outside.
fn over(p: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> Option<([f64; 3], f64)> {
    let normal: Vector3<f64> = (b - a).cross(&(c - a));
    let square = normal.norm_squared();
    if square < 1e-24 {
        return None;
    }
    let weight =
        |from: &Point3<f64>, to: &Point3<f64>| (to - from).cross(&(p - from)).dot(&normal) / square;
    let weights = [weight(b, c), weight(c, a), weight(a, b)];
    weights.iter().all(|w| *w >= -1e-9).then(|| (weights, (p - a).dot(&normal) / square.sqrt()))
}

fn material(weights: &[f64; 3], triangle: &[u32; 3], uv_m: &[[f64; 2]]) -> [f64; 2] {
    let mean = |axis: usize| {
        let corners = weights.iter().zip(triangle);
        corners.map(|(weight, node)| weight * uv_m[*node as usize][axis]).sum()
    };
    [mean(0), mean(1)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet whose right half is folded over, `gap_m` above the left one and slid by `slid_m`.
    fn folded(gap_m: f32, slid_m: f32) -> (SheetGrid, Vec<[f32; 3]>) {
        let sheet = SheetGrid::new([0.2, 0.1], [17, 9]);
        let fold = |p: &[f32; 3]| {
            if p[0] > 1e-6 { [slid_m - p[0], p[1] + slid_m, gap_m] } else { *p }
        };
        let nodes = sheet.flat_m().iter().map(fold).collect();
        (sheet, nodes)
    }

    #[test]
    fn a_flap_above_is_right_and_one_below_is_wrong() {
        let (sheet, truth) = folded(0.0002, 0.0);
        let right = layer_order(&truth, &truth, &sheet);
        assert_eq!(right.wrong, 0);
        // Each half has 8 x 9 nodes; those within two spacings of the crease are neighbours of what
        // lies across. A foot at a corner lies in up to eight triangles.
        assert!((100..800).contains(&right.pairs), "{right:?}");
        let (_, below) = folded(-0.0002, 0.0);
        let wrong = layer_order(&below, &truth, &sheet);
        assert!(wrong.pairs >= right.pairs * 9 / 10, "{wrong:?}");
        assert_eq!(wrong.wrong, wrong.pairs);
        // Slid by a spacing it is still above.
        let (_, slid) = folded(0.0001, 0.0125);
        let still = layer_order(&slid, &truth, &sheet);
        assert_eq!(still.wrong, 0);
        assert!(still.pairs > right.pairs / 2, "{still:?}");
    }

    #[test]
    fn the_order_is_that_of_the_sheet_and_not_of_the_room() {
        // The whole stack upside down: what was above is below, and on the same side.
        let (sheet, truth) = folded(0.0002, 0.0);
        let over: Vec<[f32; 3]> = truth.iter().map(|p| [-p[0], p[1], -p[2]]).collect();
        assert_eq!(layer_order(&over, &truth, &sheet).wrong, 0);
    }

    #[test]
    fn a_flat_sheet_has_no_layers() {
        let (sheet, truth) = folded(0.0002, 0.0);
        let flat = sheet.flat_m();
        assert_eq!(layer_order(&flat, &flat, &sheet), LayerOrder::default());
        // Followed flat, a folded sheet shows none of its pairs.
        assert_eq!(layer_order(&flat, &truth, &sheet).pairs, 0);
    }
}
