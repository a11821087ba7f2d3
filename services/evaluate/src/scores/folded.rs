//! Scores of a folded sheet: what is hidden, how many layers, whether they pass through each other.

use orime_geometry::nalgebra::{Isometry3, Point3, Vector3};
use orime_geometry::{CameraModel, RgbdCamera};
use std::collections::HashMap;

/// A node counts as hidden if something of the sheet is this much in front of it, metres.
const IN_FRONT_M: f64 = 0.0015;
/// Images for visibility are rendered this much smaller.
const SHRINK: f64 = 0.5;
/// Layers farther apart than this are not one stack, metres.
pub(super) const STACK_M: f64 = 0.005;

/// Whether each node can be seen by at least one camera: inside its colour image, and nothing of
/// the sheet in front of it. Hands and grippers are not known here, so what they hide counts as
/// visible.
pub fn visible(nodes_m: &[[f32; 3]], triangles: &[[u32; 3]], cameras: &[RgbdCamera]) -> Vec<bool> {
    let mut seen = vec![false; nodes_m.len()];
    for camera in cameras {
        let lens = small(&camera.color);
        let from_world = camera.world_from_color.inverse();
        let depth = render(nodes_m, triangles, &lens, &from_world);
        for (node, seen) in nodes_m.iter().zip(&mut seen) {
            let point = from_world * Point3::from(*node).cast::<f64>();
            *seen |= lens.project(&point).is_some_and(|pixel| {
                let (x, y) = (pixel.x.round(), pixel.y.round());
                let inside =
                    x >= 0.0 && y >= 0.0 && x < f64::from(lens.width) && y < f64::from(lens.height);
                inside
                    && point.z < depth[y as usize * lens.width as usize + x as usize] + IN_FRONT_M
            });
        }
    }
    seen
}

fn small(lens: &CameraModel) -> CameraModel {
    CameraModel {
        width: (f64::from(lens.width) * SHRINK) as u32,
        height: (f64::from(lens.height) * SHRINK) as u32,
        fx_px: lens.fx_px * SHRINK,
        fy_px: lens.fy_px * SHRINK,
        cx_px: lens.cx_px * SHRINK,
        cy_px: lens.cy_px * SHRINK,
        distortion: lens.distortion,
    }
}

/// Nearest distance along +Z per pixel; infinite where nothing is.
fn render(
    nodes_m: &[[f32; 3]],
    triangles: &[[u32; 3]],
    lens: &CameraModel,
    from_world: &Isometry3<f64>,
) -> Vec<f64> {
    let (width, height) = (lens.width as usize, lens.height as usize);
    let mut depth = vec![f64::INFINITY; width * height];
    let projected: Vec<Option<[f64; 3]>> = nodes_m
        .iter()
        .map(|node| {
            let point = from_world * Point3::from(*node).cast::<f64>();
            lens.project(&point).map(|pixel| [pixel.x, pixel.y, point.z])
        })
        .collect();
    for triangle in triangles {
        let [Some(a), Some(b), Some(c)] = triangle.map(|k| projected[k as usize]) else { continue };
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        if area.abs() < 1e-9 {
            continue;
        }
        let range = |axis: usize, size: usize| {
            let low = a[axis].min(b[axis]).min(c[axis]).ceil().max(0.0) as usize;
            let high = a[axis].max(b[axis]).max(c[axis]).floor().min(size as f64 - 1.0);
            low..(high + 1.0).max(0.0) as usize
        };
        for y in range(1, height) {
            for x in range(0, width) {
                let (px, py) = (x as f64 - a[0], y as f64 - a[1]);
                let s = (px * (c[1] - a[1]) - (c[0] - a[0]) * py) / area;
                let t = ((b[0] - a[0]) * py - px * (b[1] - a[1])) / area;
                if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
                    let z = 1.0 / ((1.0 - s - t) / a[2] + s / b[2] + t / c[2]);
                    let here = &mut depth[y * width + x];
                    *here = here.min(z);
                }
            }
        }
    }
    depth
}

/// How many layers of the sheet lie on top of each node: triangles that a ray straight up (world
/// +z) crosses within 5 mm, those at the node itself excepted.
pub fn layers_above(nodes_m: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<u32> {
    let points: Vec<Point3<f64>> = nodes_m.iter().map(|p| Point3::from(*p).cast()).collect();
    points
        .iter()
        .enumerate()
        .map(|(k, p)| {
            let above = triangles.iter().filter(|triangle| {
                if triangle.contains(&(k as u32)) {
                    return false;
                }
                let [a, b, c] = triangle.map(|n| points[n as usize]);
                height_above(p, &a, &b, &c).is_some_and(|h| 1e-6 < h && h < STACK_M)
            });
            // A ray through an edge meets two triangles of one layer: count distinct heights.
            let mut heights: Vec<f64> = above
                .filter_map(|t| {
                    let [a, b, c] = t.map(|n| points[n as usize]);
                    height_above(p, &a, &b, &c)
                })
                .collect();
            heights.sort_by(f64::total_cmp);
            heights.dedup_by(|a, b| (*a - *b).abs() < 2e-5);
            heights.len() as u32
        })
        .collect()
}

/// Height at which the vertical through `p` meets a triangle, above `p`.
fn height_above(p: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>) -> Option<f64> {
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if area.abs() < 1e-12 {
        return None;
    }
    let s = ((p.x - a.x) * (c.y - a.y) - (c.x - a.x) * (p.y - a.y)) / area;
    let t = ((b.x - a.x) * (p.y - a.y) - (p.x - a.x) * (b.y - a.y)) / area;
    let inside = s >= -1e-9 && t >= -1e-9 && s + t <= 1.0 + 1e-9;
    inside.then(|| a.z + s * (b.z - a.z) + t * (c.z - a.z) - p.z)
}

/// Pairs of a mesh edge and a triangle that cross, in f64: both ends more than 1 µm off the
/// triangle's plane on different sides, the crossing strictly inside. Pairs that share a node are
/// left out, since neighbours always touch.
pub fn self_intersections(nodes_m: &[[f32; 3]], triangles: &[[u32; 3]]) -> usize {
    let points: Vec<Point3<f64>> = nodes_m.iter().map(|p| Point3::from(*p).cast()).collect();
    let mut edges: Vec<[u32; 2]> = triangles
        .iter()
        .flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let longest = edges
        .iter()
        .map(|[a, b]| (points[*a as usize] - points[*b as usize]).norm())
        .fold(1e-6, f64::max);
    let cell = |p: f64| (p / longest).floor() as i64;
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let span = |ends: &[Point3<f64>], axis: usize| {
        let low = ends.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = ends.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        cell(low)..=cell(high)
    };
    let covered = |ends: &[Point3<f64>]| -> Vec<[i64; 3]> {
        let (xs, ys, zs) = (span(ends, 0), span(ends, 1), span(ends, 2));
        xs.flat_map(|x| {
            let zs = zs.clone();
            ys.clone().flat_map(move |y| zs.clone().map(move |z| [x, y, z]))
        })
        .collect()
    };
    for (k, triangle) in triangles.iter().enumerate() {
        for key in covered(&triangle.map(|n| points[n as usize])) {
            cells.entry(key).or_default().push(k as u32);
        }
    }
    let mut crossings = 0;
    let mut tried = vec![usize::MAX; triangles.len()];
    for (e, edge) in edges.iter().enumerate() {
        let ends = edge.map(|n| points[n as usize]);
        for key in covered(&ends) {
            for t in cells.get(&key).into_iter().flatten() {
                let triangle = &triangles[*t as usize];
                // An edge and a triangle may share several cells.
                if std::mem::replace(&mut tried[*t as usize], e) == e
                    || triangle.iter().any(|n| edge.contains(n))
                {
                    continue;
                }
                crossings += usize::from(crosses(&ends, &triangle.map(|n| points[n as usize])));
            }
        }
    }
    crossings
}

fn crosses([p, q]: &[Point3<f64>; 2], [a, b, c]: &[Point3<f64>; 3]) -> bool {
    const OFF_PLANE_M: f64 = 1e-6;
    let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-18) else { return false };
    let (hp, hq) = (normal.dot(&(p - a)), normal.dot(&(q - a)));
    if hp.abs() <= OFF_PLANE_M || hq.abs() <= OFF_PLANE_M || (hp > 0.0) == (hq > 0.0) {
        return false;
    }
    let at = p + (q - p) * (hp / (hp - hq));
    let inside = |from: &Point3<f64>, to: &Point3<f64>| -> f64 {
        let side: Vector3<f64> = (to - from).cross(&(at - from));
        normal.dot(&side)
    };
    inside(a, b) > 0.0 && inside(b, c) > 0.0 && inside(c, a) > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::SheetGrid;
    use orime_geometry::nalgebra::{Translation3, UnitQuaternion};

    /// A sheet in the plane z = 0, its right half folded over onto the left, `gap_m` above it.
    fn folded(gap_m: f32) -> (SheetGrid, Vec<[f32; 3]>) {
        let sheet = SheetGrid::new([0.2, 0.1], [9, 5]);
        let fold = |p: &[f32; 3]| if p[0] > 1e-6 { [-p[0], p[1], gap_m] } else { *p };
        let nodes = sheet.flat_m().iter().map(fold).collect();
        (sheet, nodes)
    }

    fn overhead() -> RgbdCamera {
        let lens = CameraModel {
            width: 640,
            height: 480,
            fx_px: 600.0,
            fy_px: 600.0,
            cx_px: 320.0,
            cy_px: 240.0,
            distortion: [0.0; 5],
        };
        // Half a metre up, looking down.
        let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        RgbdCamera {
            name: "overhead".into(),
            color: lens.clone(),
            depth: lens,
            color_from_depth: Isometry3::identity(),
            world_from_color: Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.5), down),
            depth_m_per_unit: 0.001,
        }
    }

    #[test]
    fn the_lower_layer_is_hidden_and_has_one_above() {
        let (sheet, nodes) = folded(0.004);
        let triangles = sheet.triangles();
        let seen = visible(&nodes, &triangles, &[overhead()]);
        let layers = layers_above(&nodes, &triangles);
        for (k, p) in nodes.iter().enumerate() {
            let inner = p[0].abs() > 0.03 && p[0].abs() < 0.09 && p[1].abs() < 0.04;
            if inner {
                assert_eq!(seen[k], p[2] > 0.0, "{p:?}");
                assert_eq!(layers[k], u32::from(p[2] == 0.0), "{p:?}");
            }
        }
        assert!(visible(&nodes, &triangles, &[]).iter().all(|seen| !seen));
    }

    #[test]
    fn layers_that_cross_are_counted_and_others_not() {
        let (sheet, nodes) = folded(0.004);
        let triangles = sheet.triangles();
        assert_eq!(self_intersections(&nodes, &triangles), 0);
        assert_eq!(self_intersections(&sheet.flat_m(), &triangles), 0);
        // The flap's free edge is pushed through the lower layer, shifted off its nodes.
        let mut crossed = nodes.clone();
        for j in 0..5 {
            let tip = &mut crossed[sheet.index(8, j)];
            *tip = [tip[0] + 0.011, tip[1] + 0.007, -0.004];
        }
        assert!(self_intersections(&crossed, &triangles) >= 4);
    }

    #[test]
    fn two_triangles_that_pierce_each_other_cross_twice() {
        let nodes = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.2, 0.2, -1.0],
            [0.2, 0.2, 1.0],
            [5.0, 5.0, 0.5],
        ];
        // The upright edge 3–4 pierces the first triangle, and the edge 1–2 the second.
        assert_eq!(self_intersections(&nodes, &[[0, 1, 2], [3, 4, 5]]), 2);
        let beside = nodes.map(|p: [f32; 3]| if p[0] == 0.2 { [0.8, 0.8, p[2]] } else { p });
        assert_eq!(self_intersections(&beside, &[[0, 1, 2], [3, 4, 5]]), 0);
    }
}
