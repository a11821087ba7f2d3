//! What a tracked sheet is measured by. Every definition has a test with a hand-computed answer.

pub mod bending;
pub mod folded;
pub mod order;

use orime_geometry::fit::{self, Plane};
use orime_geometry::nalgebra::Point3;
use orime_geometry::{Edgel, RgbdCamera, SheetGrid, Surface};

/// Eq. (5) of the paper: mean distance from each observed point to its nearest model *node*,
/// metres. It has a floor that no tracker can beat: see [`e_floor_m`]. `None` for an empty cloud.
pub fn e_m(cloud_m: &[[f32; 3]], nodes_m: &[[f32; 3]]) -> Option<f64> {
    mean(cloud_m.iter().map(|point| {
        let squared =
            nodes_m.iter().map(|node| distance2(*point, *node)).fold(f32::INFINITY, f32::min);
        f64::from(squared).sqrt()
    }))
}

/// What E is on a perfectly tracked sheet that is observed densely: 0.3826 of the node spacing
/// (the mean distance from a random point of a square to its nearest corner), metres.
pub fn e_floor_m(sheet: &SheetGrid) -> f64 {
    let [a, b] = sheet.spacing_m();
    0.3826 * (a * b).sqrt()
}

/// Mean distance from each observed point to the model's *surface*, metres. `None` for an empty
/// cloud.
pub fn surface_m(
    cloud_m: &[[f32; 3]],
    nodes_m: &[[f32; 3]],
    triangles: &[[u32; 3]],
) -> Option<f64> {
    let surface = Surface::new(nodes_m, triangles);
    mean(cloud_m.iter().map(|point| f64::from(surface.distance_m(*point))))
}

/// Mean distance from the nodes that `counts` to their nearest observed point, metres: the other
/// side of a Chamfer distance. `None` for an empty cloud or no node.
pub fn nodes_to_cloud_m(
    nodes_m: &[[f32; 3]],
    cloud_m: &[[f32; 3]],
    counts: impl Fn(usize) -> bool,
) -> Option<f64> {
    if cloud_m.is_empty() {
        return None;
    }
    let counted = nodes_m.iter().enumerate().filter(|(k, _)| counts(*k)).map(|(_, node)| *node);
    e_m(&counted.collect::<Vec<_>>(), cloud_m)
}

/// Mean and largest relative change of the distances between neighbouring nodes.
pub fn strain(nodes_m: &[[f32; 3]], edges: &[([u32; 2], f64)]) -> (f64, f64) {
    let strains = edges.iter().map(|([a, b], rest_m)| {
        let squared = distance2(nodes_m[*a as usize], nodes_m[*b as usize]);
        (f64::from(squared).sqrt() / rest_m - 1.0).abs()
    });
    let (mut sum, mut largest) = (0.0, 0f64);
    for strain in strains {
        sum += strain;
        largest = largest.max(strain);
    }
    (sum / edges.len().max(1) as f64, largest)
}

/// Distance of every node from where it truly is, metres, ascending.
pub fn vertex_errors_m(nodes_m: &[[f32; 3]], truth_m: &[[f32; 3]]) -> Vec<f64> {
    let mut errors: Vec<f64> =
        nodes_m.iter().zip(truth_m).map(|(a, b)| f64::from(distance2(*a, *b)).sqrt()).collect();
    errors.sort_by(f64::total_cmp);
    errors
}

/// Mean over the nodes of tracked minus true place, metres.
pub fn offset_m(nodes_m: &[[f32; 3]], truth_m: &[[f32; 3]]) -> Option<[f64; 3]> {
    let along = |axis: usize| {
        let ways = nodes_m.iter().zip(truth_m);
        mean(ways.map(|(a, b)| f64::from(a[axis]) - f64::from(b[axis])))
    };
    Some([along(0)?, along(1)?, along(2)?])
}

/// Mean distance of the nodes from the truth after the rigid motion that brings them nearest,
/// metres.
pub fn shape_error_m(nodes_m: &[[f32; 3]], truth_m: &[[f32; 3]]) -> Option<f64> {
    let points = |of: &[[f32; 3]]| -> Vec<Point3<f64>> {
        of.iter().map(|p| Point3::from(*p).cast()).collect()
    };
    let (nodes, truth) = (points(nodes_m), points(truth_m));
    let moved = fit::rigid(&nodes, &truth, |_| 1.0)?;
    mean(nodes.iter().zip(&truth).map(|(a, b)| (moved * a - b).norm()))
}

/// Extent along u and v: mean straight distance between the ends of the grid lines, metres.
///
/// A buckled sheet comes out shorter than its material.
pub fn extent_m(nodes_m: &[[f32; 3]], sheet: &SheetGrid) -> [f64; 2] {
    let [n, m] = sheet.nodes;
    let chord = |a: usize, b: usize| f64::from(distance2(nodes_m[a], nodes_m[b])).sqrt();
    let along_u: f64 = (0..m).map(|j| chord(sheet.index(0, j), sheet.index(n - 1, j))).sum();
    let along_v: f64 = (0..n).map(|i| chord(sheet.index(i, 0), sheet.index(i, m - 1))).sum();
    [along_u / m as f64, along_v / n as f64]
}

/// Root mean square distance of the *visible* nodes from their best plane, metres. Visible are
/// nodes with an observed point within one grid spacing; `None` for fewer than three.
pub fn planarity_m(nodes_m: &[[f32; 3]], cloud_m: &[[f32; 3]], sheet: &SheetGrid) -> Option<f64> {
    let [a, b] = sheet.spacing_m();
    let reach2 = (a.max(b) as f32).powi(2);
    let visible: Vec<Point3<f64>> = nodes_m
        .iter()
        .filter(|node| cloud_m.iter().any(|point| distance2(**node, *point) < reach2))
        .map(|node| Point3::from(*node).cast())
        .collect();
    let plane = Plane::fit(&visible)?;
    Some(mean(visible.iter().map(|p| plane.height_m(p).powi(2)))?.sqrt())
}

/// Median distance from the sheet's contour in the colour images to the outline of the projected
/// sheet, pixels: whether the tracked edges lie on the seen edges. `None` without silhouettes.
///
/// The outline is the border of the grid, so this means something while the sheet is not folded.
pub fn outline_px(
    nodes_m: &[[f32; 3]],
    edgels: &[Edgel],
    cameras: &[RgbdCamera],
    sheet: &SheetGrid,
) -> Option<f64> {
    let mut distances = Vec::new();
    for (index, camera) in cameras.iter().enumerate() {
        let color_from_world = camera.world_from_color.inverse();
        let border: Option<Vec<[f64; 2]>> = border(sheet)
            .into_iter()
            .map(|k| {
                let point = color_from_world * Point3::from(nodes_m[k]).cast::<f64>();
                camera.color.project(&point).map(|p| [p.x, p.y])
            })
            .collect();
        let Some(border) = border else { continue };
        let mine = edgels.iter().filter(|e| e.camera as usize == index && e.kind == 0);
        distances.extend(mine.map(|edgel| {
            let p = edgel.position_px.map(f64::from);
            (0..border.len())
                .map(|k| segment_distance(p, border[k], border[(k + 1) % border.len()]))
                .fold(f64::INFINITY, f64::min)
        }));
    }
    distances.sort_by(f64::total_cmp);
    percentile(&distances, 0.5)
}

/// The value below which a share of the ascending values lies (nearest rank); `None` for none.
pub fn percentile(ascending: &[f64], share: f64) -> Option<f64> {
    let rank = (share * ascending.len() as f64).ceil() as usize;
    ascending.get(rank.max(1) - 1).copied()
}

/// Mean; `None` for none.
pub fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0usize);
    for value in values {
        sum += value;
        count += 1;
    }
    (count > 0).then(|| sum / count as f64)
}

/// Node indices round the grid's border.
fn border(sheet: &SheetGrid) -> Vec<usize> {
    let [n, m] = sheet.nodes;
    let mut ring: Vec<usize> = (0..m - 1).map(|j| sheet.index(0, j)).collect();
    ring.extend((0..n - 1).map(|i| sheet.index(i, m - 1)));
    ring.extend((1..m).rev().map(|j| sheet.index(n - 1, j)));
    ring.extend((1..n).rev().map(|i| sheet.index(i, 0)));
    ring
}

fn segment_distance(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (d, e) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length2 = d[0] * d[0] + d[1] * d[1];
    let at =
        if length2 > 0.0 { ((d[0] * e[0] + d[1] * e[1]) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (e[0] - at * d[0]).hypot(e[1] - at * d[1])
}

fn distance2(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::CameraModel;
    use orime_geometry::nalgebra::Isometry3;

    fn flat() -> (SheetGrid, Vec<[f32; 3]>) {
        let sheet = SheetGrid::new([0.2, 0.1], [3, 2]);
        let nodes = sheet.flat_m(); // x ∈ {−0.1, 0, 0.1}, y ∈ {−0.05, 0.05}
        (sheet, nodes)
    }

    fn near(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-6, "{found} instead of {expected}");
    }

    #[test]
    fn e_and_surface_by_hand() {
        let (sheet, nodes) = flat();
        // Above a node; above the middle of a cell, (0.05, 0.05, 0.1) from its corners.
        let cloud = [[0.1, 0.05, 0.03], [0.05, 0.0, 0.1]];
        near(e_m(&cloud, &nodes).unwrap(), (0.03 + 0.015f64.sqrt()) / 2.0);
        near(surface_m(&cloud, &nodes, &sheet.triangles()).unwrap(), (0.03 + 0.1) / 2.0);
        assert_eq!(e_m(&[], &nodes), None);
        // The node below the first point is 30 mm from it; all others do not count.
        let below = |k: usize| nodes[k] == [0.1, 0.05, 0.0];
        near(nodes_to_cloud_m(&nodes, &cloud, below).unwrap(), 0.03);
        assert_eq!(nodes_to_cloud_m(&nodes, &[], |_| true), None);
        near(e_floor_m(&SheetGrid::new([0.15, 0.15], [25, 25])), 0.00239125);
    }

    #[test]
    fn strain_extent_and_errors_by_hand() {
        let (sheet, nodes) = flat();
        let stretched: Vec<[f32; 3]> = nodes.iter().map(|p| [p[0] * 1.1, p[1], p[2]]).collect();
        let (mean, largest) = strain(&stretched, &sheet.edges());
        near(mean, 0.1 * 4.0 / 7.0); // Four of the seven edges run along u.
        near(largest, 0.1);
        let [u, v] = extent_m(&stretched, &sheet);
        near(u, 0.22);
        near(v, 0.1);
        let errors = vertex_errors_m(&stretched, &nodes);
        near(errors[0], 0.0);
        near(errors[5], 0.01);
        near(percentile(&errors, 0.5).unwrap(), 0.01); // 0, 0, and four times 10 mm.
        near(percentile(&errors, 0.3).unwrap(), 0.0);
        assert_eq!(percentile(&[], 0.5), None);
        near(shape_error_m(&stretched, &nodes).unwrap(), 0.01 * 4.0 / 6.0); // The ends' nodes.
        // Moved and turned by a quarter, the shape is what it was.
        let elsewhere: Vec<[f32; 3]> =
            stretched.iter().map(|p| [0.3 - p[1], p[0] - 0.2, 0.1 + p[2]]).collect();
        near(shape_error_m(&elsewhere, &nodes).unwrap(), 0.01 * 4.0 / 6.0);
        for (found, expected) in offset_m(&elsewhere, &nodes).unwrap().iter().zip([0.3, -0.2, 0.1])
        {
            near(*found, expected);
        }
        assert_eq!((offset_m(&[], &[]), shape_error_m(&[], &[])), (None, None));
    }

    #[test]
    fn planarity_looks_at_what_is_visible() {
        let sheet = SheetGrid::new([0.4, 0.4], [5, 5]);
        let mut nodes = sheet.flat_m();
        nodes[24][2] = 0.3; // A hidden corner is folded up.
        let cloud: Vec<[f32; 3]> = nodes[..20].to_vec();
        near(planarity_m(&nodes, &cloud, &sheet).unwrap(), 0.0);
        assert!(planarity_m(&nodes, &nodes.clone(), &sheet).unwrap() > 0.01);
        assert_eq!(planarity_m(&nodes, &[], &sheet), None);
    }

    #[test]
    fn outline_is_measured_in_pixels() {
        let (sheet, mut nodes) = flat();
        nodes.iter_mut().for_each(|p| p[2] = 1.0);
        let lens = CameraModel {
            width: 200,
            height: 100,
            fx_px: 500.0,
            fy_px: 500.0,
            cx_px: 100.0,
            cy_px: 50.0,
            distortion: [0.0; 5],
        };
        let camera = RgbdCamera {
            name: "c".into(),
            color: lens.clone(),
            depth: lens,
            color_from_depth: Isometry3::identity(),
            world_from_color: Isometry3::identity(),
            depth_m_per_unit: 0.001,
        };
        // The sheet's border projects to x ∈ [50, 150], y ∈ [25, 75].
        let edgel = |x, y| Edgel { position_px: [x, y], normal: [0.0; 2], camera: 0, kind: 0 };
        let edgels = [edgel(52.0, 50.0), edgel(100.0, 22.0), edgel(153.0, 79.0)];
        near(outline_px(&nodes, &edgels, &[camera], &sheet).unwrap(), 3.0);
    }
}
