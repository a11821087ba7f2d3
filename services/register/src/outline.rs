//! The sheet's outline in the colour images as rows of the M-step.
//!
//! Depth pins the sheet along its normal and hardly at all within its plane; the cloud even ends
//! short of the paper's edge, because depth is dropped there, and would shrink the model. The
//! contour is seen to a fraction of a pixel, and pins exactly that.
//!
//! Per border component v of the mixture and camera, with image normal n, matched offset r [px]
//! along n, focal length F and distance z:
//!
//! ```text
//! a = ∂(n·pixel)/∂v  [px/m],   target v + a r/|a|²,   weight ½ σ² h |a|²/σ_c²
//! h = min(1, 2σ_c/|r|)  (Huber)
//! ```
//!
//! Source: `../shared/design/outline.md`. Deviation: no rendering of the prediction decides which
//! parts of the border are silhouettes; the match itself does, by distance and normal.

use crate::mixture::Mixture;
use nalgebra::{Matrix3, Point3, Vector2, Vector3};
use orime_geometry::{Edgel, RgbdCamera, SheetGrid};

/// σ_c: how far the seen contour is from the paper's edge, pixels.
const SIGMA_PX: f64 = 1.0;
/// Widest match along the normal: in the first iterations, and later, pixels.
const REACH_PX: [f64; 2] = [12.0, 6.0];
/// Iterations that match wide.
const WIDE_ITERATIONS: u32 = 3;
/// Widest match along the contour, pixels.
const TANGENT_PX: f64 = 4.0;
/// Edgels this close to the nearest one along the normal are averaged with it, pixels.
const SAME_EDGE_PX: f64 = 2.5;
/// Least cosine between the normals of border and edgel.
const COSINE_MIN: f64 = 0.8;
/// An edgel this close to the projected border lies on it, pixels.
const ON_BORDER_PX: f64 = 6.0;
/// Side of the lookup cells, pixels.
const CELL_PX: usize = 16;

/// A component of the mixture on the sheet's border, and its neighbours.
#[derive(Debug, Clone, Copy)]
struct Border {
    component: u32,
    before: u32,
    after: u32,
    /// A component further inside the sheet.
    inside: u32,
}

/// Edgels of one camera in cells.
#[derive(Debug)]
struct View {
    color_from_world: nalgebra::Isometry3<f64>,
    rotation: Matrix3<f64>,
    camera: RgbdCamera,
    columns: usize,
    cells: Vec<Vec<u32>>,
}

/// A target for one component, from one camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    /// Component of the mixture.
    pub component: usize,
    /// Where it should be, relative to where it is, metres.
    pub offset_m: [f64; 3],
    /// Weight beside the E-step's Σp.
    pub weight: f64,
}

/// The contour of one frame set, ready to be matched.
#[derive(Debug)]
pub(crate) struct Outline {
    border: Vec<Border>,
    views: Vec<View>,
    edgels: Vec<Edgel>,
    /// Rows of the last [`Outline::matched`].
    pub rows: Vec<Row>,
}

impl Outline {
    /// The border of a mixture with `fine` components along u and v.
    pub fn new(sheet: &SheetGrid, per_cell: usize) -> Self {
        let [n, m] = Mixture::fine_nodes(sheet, per_cell);
        let at = |i: usize, j: usize| (i * m + j) as u32;
        let deep = |k: usize, count: usize| k.clamp(per_cell.min(count / 2), count - 1 - per_cell);
        let mut ring: Vec<(usize, usize)> = (0..m - 1).map(|j| (0, j)).collect();
        ring.extend((0..n - 1).map(|i| (i, m - 1)));
        ring.extend((1..m).rev().map(|j| (n - 1, j)));
        ring.extend((1..n).rev().map(|i| (i, 0)));
        let count = ring.len();
        let border = (0..count)
            // A corner has no normal.
            .filter(|k| {
                let (i, j) = ring[*k];
                !((i == 0 || i == n - 1) && (j == 0 || j == m - 1))
            })
            .map(|k| {
                let [(bi, bj), (i, j), (ai, aj)] =
                    [ring[(k + count - 1) % count], ring[k], ring[(k + 1) % count]];
                Border {
                    component: at(i, j),
                    before: at(bi, bj),
                    after: at(ai, aj),
                    inside: at(deep(i, n), deep(j, m)),
                }
            })
            .collect();
        Self { border, views: Vec::new(), edgels: Vec::new(), rows: Vec::new() }
    }

    /// Takes over the contour of a frame set; edgels that are not finite are left out.
    pub fn fill(&mut self, edgels: &[Edgel], cameras: &[RgbdCamera]) {
        if self.views.len() != cameras.len()
            || self.views.iter().zip(cameras).any(|(view, camera)| view.camera != *camera)
        {
            self.views = cameras.iter().map(View::new).collect();
        }
        self.edgels.clear();
        self.edgels.extend(
            edgels.iter().filter(|edgel| {
                edgel.position_px.iter().chain(&edgel.normal).all(|c| c.is_finite())
            }),
        );
        for view in &mut self.views {
            view.cells.iter_mut().for_each(Vec::clear);
        }
        for (k, edgel) in self.edgels.iter().enumerate() {
            let Some(view) = self.views.get_mut(edgel.camera as usize) else { continue };
            if let Some(cell) = view.cell(edgel.position_px.map(f64::from)) {
                view.cells[cell].push(k as u32);
            }
        }
    }

    /// Whether there is anything to match.
    pub fn is_empty(&self) -> bool {
        self.edgels.is_empty() || self.views.is_empty()
    }

    /// Share of the seen silhouettes that lie within [`ON_BORDER_PX`] of the projected border;
    /// `None` where there are none. A fold is a silhouette too, so a folded sheet has less.
    pub fn explained(&self, positions_m: &[[f32; 3]]) -> Option<f64> {
        let (mut on_border, mut all) = (0usize, 0usize);
        for (index, view) in self.views.iter().enumerate() {
            let pixel = |m: u32| view.pixel(positions_m[m as usize]);
            // Both halves, so that the corners, which are no component here, are passed.
            let border: Vec<[Vector2<f64>; 2]> = self
                .border
                .iter()
                .flat_map(|b| [(b.before, b.component), (b.component, b.after)])
                .filter_map(|(a, b)| Some([pixel(a)?, pixel(b)?]))
                .collect();
            let seen = self.edgels.iter().filter(|e| e.camera as usize == index && e.kind == 0);
            for edgel in seen {
                let at = Vector2::from(edgel.position_px).cast::<f64>();
                all += 1;
                let near = |ends: &[Vector2<f64>; 2]| distance_px(at, *ends) < ON_BORDER_PX;
                on_border += usize::from(border.iter().any(near));
            }
        }
        (all > 0).then(|| on_border as f64 / all as f64)
    }

    /// Matches the border, where it is now, to the contour: fills `rows`.
    pub fn matched(&mut self, positions_m: &[[f32; 3]], iteration: u32, variance_m2: f64) {
        self.rows.clear();
        let reach_px = REACH_PX[usize::from(iteration >= WIDE_ITERATIONS)];
        for view in &self.views {
            for border in &self.border {
                let Some(probe) = view.probe(border, positions_m) else { continue };
                let Some(offset_px) = view.nearest(&probe, &self.edgels, reach_px) else {
                    continue;
                };
                let huber = (2.0 * SIGMA_PX / offset_px.abs()).min(1.0);
                let squared = probe.gradient.norm_squared();
                let offset = probe.gradient * (offset_px / squared);
                self.rows.push(Row {
                    component: border.component as usize,
                    offset_m: [offset.x, offset.y, offset.z],
                    weight: 0.5 * variance_m2 * huber * squared / (SIGMA_PX * SIGMA_PX),
                });
            }
        }
    }
}

/// A border component in an image.
struct Probe {
    pixel: Vector2<f64>,
    /// Unit normal out of the sheet, in the image.
    normal: Vector2<f64>,
    /// ∂(normal·pixel)/∂position, world frame, px/m.
    gradient: Vector3<f64>,
}

impl View {
    fn new(camera: &RgbdCamera) -> Self {
        let color_from_world = camera.world_from_color.inverse();
        let columns = camera.color.width as usize / CELL_PX + 1;
        let rows = camera.color.height as usize / CELL_PX + 1;
        Self {
            rotation: color_from_world.rotation.to_rotation_matrix().into_inner(),
            color_from_world,
            camera: camera.clone(),
            columns,
            cells: vec![Vec::new(); columns * rows],
        }
    }

    fn cell(&self, [x, y]: [f64; 2]) -> Option<usize> {
        let (width, height) = (self.camera.color.width, self.camera.color.height);
        let inside = 0.0 <= x && x < f64::from(width) && 0.0 <= y && y < f64::from(height);
        inside.then(|| y as usize / CELL_PX * self.columns + x as usize / CELL_PX)
    }

    fn pixel(&self, position_m: [f32; 3]) -> Option<Vector2<f64>> {
        let point = self.color_from_world * Point3::from(position_m).cast::<f64>();
        self.camera.color.project(&point)
    }

    fn probe(&self, border: &Border, positions_m: &[[f32; 3]]) -> Option<Probe> {
        let point =
            |m: u32| self.color_from_world * Point3::from(positions_m[m as usize]).cast::<f64>();
        let here = point(border.component);
        let lens = &self.camera.color;
        let pixel = lens.project(&here)?;
        let along = lens.project(&point(border.after))? - lens.project(&point(border.before))?;
        // Seen end on, a border has no direction.
        let along = along.try_normalize(1.0)?;
        let mut normal = Vector2::new(along.y, -along.x);
        let inward = lens.project(&point(border.inside))? - pixel;
        // Seen edge on, a sheet has no outside.
        if normal.dot(&inward).abs() < 0.5 {
            return None;
        }
        if normal.dot(&inward) > 0.0 {
            normal = -normal;
        }
        let (fx, fy) = (lens.fx_px * normal.x, lens.fy_px * normal.y);
        let in_camera = Vector3::new(fx, fy, -(fx * here.x + fy * here.y) / here.z) / here.z;
        Some(Probe { pixel, normal, gradient: self.rotation.transpose() * in_camera })
    }

    /// Signed distance along the normal to the nearest matching edge, pixels.
    fn nearest(&self, probe: &Probe, edgels: &[Edgel], reach_px: f64) -> Option<f64> {
        let tangent = Vector2::new(-probe.normal.y, probe.normal.x);
        let span = reach_px.hypot(TANGENT_PX);
        let candidates = || {
            self.cells_near(probe.pixel, span).filter_map(|k| {
                let edgel = &edgels[k as usize];
                let normal = Vector2::from(edgel.normal).cast::<f64>();
                let offset = Vector2::from(edgel.position_px).cast::<f64>() - probe.pixel;
                let (across, along) = (probe.normal.dot(&offset), tangent.dot(&offset));
                (across.abs() < reach_px
                    && along.abs() < TANGENT_PX
                    && normal.dot(&probe.normal) > COSINE_MIN)
                    .then_some((across, along))
            })
        };
        let (first, _) = candidates().min_by(|a, b| {
            let cost = |c: &(f64, f64)| c.0.abs() + 0.25 * c.1.abs();
            cost(a).total_cmp(&cost(b))
        })?;
        let (mut sum, mut weights) = (0.0, 0.0);
        for (across, along) in candidates() {
            if (across - first).abs() < SAME_EDGE_PX {
                let weight = 1.0 / (1.0 + along * along);
                sum += weight * across;
                weights += weight;
            }
        }
        Some(sum / weights)
    }

    /// Edgels in the cells that a square of half side `span` touches.
    fn cells_near(&self, pixel: Vector2<f64>, span: f64) -> impl Iterator<Item = u32> + '_ {
        let rows = self.cells.len() / self.columns;
        let range = |centre: f64, count: usize| {
            let cell = |at: f64| ((at / CELL_PX as f64).max(0.0) as usize).min(count);
            cell(centre - span)..(cell(centre + span) + 1).min(count)
        };
        let (xs, ys) = (range(pixel.x, self.columns), range(pixel.y, rows));
        ys.flat_map(move |y| xs.clone().map(move |x| y * self.columns + x))
            .flat_map(|cell| self.cells[cell].iter().copied())
    }
}

/// Distance from a pixel to a straight piece of border.
fn distance_px(at: Vector2<f64>, [a, b]: [Vector2<f64>; 2]) -> f64 {
    let along = b - a;
    let place = (along.dot(&(at - a)) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (a + along * place - at).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;
    use orime_geometry::CameraModel;

    fn camera() -> RgbdCamera {
        let lens = CameraModel {
            width: 640,
            height: 480,
            fx_px: 600.0,
            fy_px: 600.0,
            cx_px: 320.0,
            cy_px: 240.0,
            distortion: [0.0; 5],
        };
        RgbdCamera {
            name: "overhead".into(),
            color: lens.clone(),
            depth: lens,
            color_from_depth: Isometry3::identity(),
            world_from_color: Isometry3::identity(),
            depth_m_per_unit: 0.001,
        }
    }

    /// Edgels of a rectangle ±75 mm at 0.5 m, shifted in the image.
    fn rectangle(shift_px: [f32; 2]) -> Vec<Edgel> {
        let half = 90.0; // 0.075 m · 600 px / 0.5 m
        let side = (-44..=44).map(|k| 2.0 * k as f32);
        side.flat_map(|s| {
            [([half, s], [1.0, 0.0]), ([-half, s], [-1.0, 0.0])]
                .into_iter()
                .chain([([s, half], [0.0, 1.0]), ([s, -half], [0.0, -1.0])])
        })
        .map(|(p, normal)| Edgel {
            position_px: [320.0 + p[0] + shift_px[0], 240.0 + p[1] + shift_px[1]],
            normal,
            camera: 0,
            kind: 0,
        })
        .collect()
    }

    #[test]
    fn a_shift_in_the_image_is_a_shift_in_the_plane() {
        let sheet = SheetGrid::new([0.15, 0.15], [9, 9]);
        let mut mixture = Mixture::new(&sheet, 2);
        let mut nodes = sheet.flat_m();
        nodes.iter_mut().for_each(|p| p[2] = 0.5);
        mixture.place(&nodes);
        let mut outline = Outline::new(&sheet, 2);
        // 3 px right and 2 px up at 0.5 m and 600 px are 2.5 mm and 1.67 mm.
        outline.fill(&rectangle([3.0, -2.0]), &[camera()]);
        outline.matched(&mixture.positions_m, 0, 1e-6);
        assert_eq!(outline.rows.len(), 4 * 15);
        for row in &outline.rows {
            let [x, y, z] = row.offset_m;
            let p = mixture.positions_m[row.component];
            if p[0].abs() > 0.0749 {
                assert!((x - 0.0025).abs() < 2e-4 && y.abs() < 1e-9, "{row:?} at {p:?}");
            } else {
                assert!((y + 0.00167).abs() < 2e-4 && x.abs() < 1e-9, "{row:?} at {p:?}");
            }
            // The gradient also has a part along the viewing ray; it is small here.
            assert!(z.abs() < 5e-4);
        }
        assert_eq!(outline.explained(&mixture.positions_m), Some(1.0));
        outline.fill(&rectangle([20.0, 0.0]), &[camera()]);
        let share = outline.explained(&mixture.positions_m).unwrap();
        assert!((0.4..0.7).contains(&share), "two of four sides still match: {share}");
    }

    #[test]
    fn edges_of_something_else_do_not_match() {
        let sheet = SheetGrid::new([0.15, 0.15], [9, 9]);
        let mut nodes = sheet.flat_m();
        nodes.iter_mut().for_each(|p| p[2] = 0.5);
        let mut mixture = Mixture::new(&sheet, 2);
        mixture.place(&nodes);
        let mut outline = Outline::new(&sheet, 2);
        let mut inward = rectangle([0.0, 0.0]);
        inward.iter_mut().for_each(|e| e.normal = e.normal.map(|c| -c));
        let nan = Edgel { position_px: [f32::NAN; 2], ..inward[0] };
        let elsewhere = Edgel { camera: 7, ..inward[0] };
        inward.extend([nan, elsewhere]);
        outline.fill(&inward, &[camera()]);
        outline.matched(&mixture.positions_m, 0, 1e-6);
        assert!(outline.rows.is_empty(), "a contour that faces the other way is another's");
        outline.fill(&[], &[]);
        assert!(outline.is_empty());
    }
}
