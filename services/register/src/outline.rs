//! The sheet's outline in the colour images as rows of the M-step.
//!
//! Depth pins the sheet along its normal and hardly at all within its plane; the cloud even ends
//! short of the paper's edge, because depth is dropped there, and would shrink the model. The
//! contour is seen to a fraction of a pixel, and pins exactly that. On a folded sheet the creases
//! are contour too.
//!
//! Per sample v of border or crease and camera, with image normal n, matched offset r [px]
//! along n, focal length F and distance z:
//!
//! ```text
//! a = ∂(n·pixel)/∂v  [px/m],   target v + a r/|a|²,   weight ½ σ² h |a|²/σ_c²
//! h = min(1, 2σ_c/|r|)  (Huber)
//! ```
//!
//! A sample counts as silhouette where the model's own depth image is empty outside of it and
//! covered inside, and as inner edge where what lies outside is farther off.
//!
//! Source: `../shared/design/outline.md`.

mod bends;
mod cells;
mod matching;
mod sample;
mod view;

pub(crate) use sample::Sample;

use crate::blend::Blender;
use bends::Bends;
use nalgebra::Vector3;
use orime_creases::Folds;
use orime_geometry::{Edgel, RgbdCamera, SheetGrid};
use view::{Probes, View};

/// σ_c: how far the seen contour is from the paper's edge, pixels.
const SIGMA_PX: f64 = 1.0;
/// Widest match along the normal: in the first iterations, and later, pixels.
const REACH_PX: [f32; 2] = [12.0, 6.0];
/// Iterations at which silhouettes are looked for, the second time where the sheet has moved in
/// the image; from then on, matches are narrow.
const CLASSIFY_AT: [u32; 2] = [0, 4];
/// An edgel this close to the projected border lies on it, pixels.
const ON_BORDER_PX: f32 = 6.0;
/// Where border and creases explain less of the contour than this, bends are asked as well.
const EXPLAINED: f64 = 0.95;

/// A target for one sample, from one camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    /// Index of the sample.
    pub sample: usize,
    /// Index of the camera.
    pub camera: u32,
    /// Unit direction in which it moves along the contour's normal in that image the fastest, out
    /// of the sheet, world frame.
    pub normal: Vector3<f64>,
    /// How far it should move that way, metres.
    pub way_m: f64,
    /// Share of its weight that a far match keeps.
    pub huber: f64,
    /// Weight beside the E-step's Σp.
    pub weight: f64,
}

/// The contour of one frame set, ready to be matched.
#[derive(Debug, Clone)]
pub(crate) struct Outline {
    triangles: Vec<[u32; 3]>,
    bends: Bends,
    spacing_m: f64,
    controls: [usize; 2],
    /// Border first, then creases.
    pub samples: Vec<Sample>,
    /// Where the samples are now, world frame, metres.
    pub positions_m: Vec<[f32; 3]>,
    views: Vec<View>,
    probes: Probes,
    /// Rows of the last [`Outline::matched`].
    pub rows: Vec<Row>,
}

impl Outline {
    /// The outline of a sheet whose control points are `controls`, sampled at `per_cell` samples
    /// per grid cell.
    pub fn new(sheet: &SheetGrid, controls: [usize; 2], per_cell: usize) -> Self {
        let [h_u, h_v] = sheet.spacing_m();
        let triangles = sheet.triangles();
        let mut outline = Self {
            bends: Bends::of(&triangles),
            triangles,
            spacing_m: 0.5 * (h_u + h_v) / per_cell as f64,
            controls,
            samples: Vec::new(),
            positions_m: Vec::new(),
            views: Vec::new(),
            probes: Probes::default(),
            rows: Vec::new(),
        };
        let flat = Folds::flat(sheet);
        outline.refold(&flat, &Blender::new(&flat));
        outline
    }

    /// Takes over other folds.
    pub fn refold(&mut self, folds: &Folds, blender: &Blender<'_>) {
        let sheet = folds.sheet();
        self.samples.clear();
        let layout = sample::Layout { sheet, controls: self.controls, spacing_m: self.spacing_m };
        layout.border(blender, &mut self.samples);
        layout.creases(folds, blender, &mut self.samples);
        self.views.iter_mut().for_each(View::forget);
    }

    /// Takes over the contour of a frame set; edgels that are not finite are left out.
    pub fn fill(&mut self, edgels: &[Edgel], cameras: &[RgbdCamera]) {
        if !self.views.iter().map(|view| &view.lens).eq(cameras.iter().map(|c| &c.color)) {
            self.views = cameras.iter().map(View::new).collect();
        }
        for (view, camera) in self.views.iter_mut().zip(cameras) {
            view.stand(camera);
        }
        let finite = |e: &&Edgel| e.position_px.iter().chain(&e.normal).all(|c| c.is_finite());
        for edgel in edgels.iter().filter(finite) {
            if let Some(view) = self.views.get_mut(edgel.camera as usize) {
                view.insert(edgel);
            }
        }
        self.views.iter_mut().for_each(View::sort);
        self.rows.clear();
    }

    /// Whether there is nothing to match.
    pub fn is_empty(&self) -> bool {
        self.views.iter().all(View::is_empty)
    }

    /// Moves the samples with the sheet's nodes.
    pub fn place(&mut self, nodes_m: &[[f32; 3]]) {
        self.positions_m.clear();
        self.positions_m.extend(self.samples.iter().map(|s| s.here.position_m(nodes_m)));
    }

    /// How many of the seen silhouettes lie within [`ON_BORDER_PX`] of the projected border, of a
    /// crease or of where paper bends out of sight, and how many there are.
    pub fn explained(&mut self, nodes_m: &[[f32; 3]]) -> [usize; 2] {
        self.probes.place(&self.samples, nodes_m);
        for view in &mut self.views {
            view.explain(&self.probes, ON_BORDER_PX);
        }
        let sums = self.marked();
        if (sums[0] as f64) >= EXPLAINED * sums[1] as f64 {
            return sums;
        }
        for view in &mut self.views {
            view.explain_bends(&self.bends, nodes_m, &self.triangles, ON_BORDER_PX);
        }
        self.marked()
    }

    fn marked(&self) -> [usize; 2] {
        let counts = self.views.iter().map(View::marked);
        counts.fold([0, 0], |[near, all], [n, a]| [near + n, all + a])
    }

    /// Moves the samples; what `rows` still ask of them is what is left along their normals.
    pub fn follow(&mut self, moved: impl Fn([f32; 3]) -> [f32; 3]) {
        for row in &mut self.rows {
            let from = Vector3::from(self.positions_m[row.sample]);
            let way_m = Vector3::from(moved(from.into())) - from;
            row.way_m -= row.normal.dot(&way_m.cast::<f64>());
        }
        for position_m in &mut self.positions_m {
            *position_m = moved(*position_m);
        }
    }

    /// Matches the samples, where the nodes are now, to the contour: fills `rows`.
    pub fn matched(&mut self, nodes_m: &[[f32; 3]], iteration: u32, variance_m2: f64) {
        self.place(nodes_m);
        self.rows.clear();
        let reach_px = REACH_PX[usize::from(iteration >= CLASSIFY_AT[1])];
        if CLASSIFY_AT.contains(&iteration) {
            self.probes.place(&self.samples, nodes_m);
        }
        for (camera, view) in self.views.iter_mut().enumerate() {
            if iteration == CLASSIFY_AT[0] || iteration == CLASSIFY_AT[1] && view.has_moved() {
                view.classify(&self.probes, nodes_m, &self.triangles);
            }
            view.look_up(&self.positions_m, reach_px);
            for (silhouette, offset_px) in view.silhouettes.iter().zip(&view.offsets_px) {
                if offset_px.is_nan() {
                    continue;
                }
                let (sample, offset_px) = (silhouette.sample as usize, f64::from(*offset_px));
                let gradient = view.gradient(self.positions_m[sample], silhouette.normal);
                let huber = (2.0 * SIGMA_PX / offset_px.abs()).min(1.0);
                let squared = gradient.norm_squared();
                let px_per_m = squared.sqrt();
                self.rows.push(Row {
                    sample,
                    camera: camera as u32,
                    normal: gradient / px_per_m,
                    way_m: offset_px / px_per_m,
                    huber,
                    weight: 0.5 * variance_m2 * huber * squared / (SIGMA_PX * SIGMA_PX),
                });
            }
        }
    }
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
        let mut nodes = sheet.flat_m();
        nodes.iter_mut().for_each(|p| p[2] = 0.5);
        let mut outline = Outline::new(&sheet, [5, 5], 2);
        // 3 px right and 2 px up at 0.5 m and 600 px are 2.5 mm and 1.67 mm.
        outline.fill(&rectangle([3.0, -2.0]), &[camera()]);
        outline.matched(&nodes, 0, 1e-6);
        assert_eq!(outline.rows.len(), 4 * 15);
        for row in &outline.rows {
            let [x, y, z]: [f64; 3] = (row.normal * row.way_m).into();
            let p = outline.positions_m[row.sample];
            if p[0].abs() > 0.0749 {
                assert!((x - 0.0025).abs() < 2e-4 && y.abs() < 1e-9, "{row:?} at {p:?}");
            } else {
                assert!((y + 0.00167).abs() < 2e-4 && x.abs() < 1e-9, "{row:?} at {p:?}");
            }
            // The gradient also has a part along the viewing ray; it is small here.
            assert!(z.abs() < 5e-4);
        }
        let [near, all] = outline.explained(&nodes);
        assert!(near == all && all > 0);
        outline.fill(&rectangle([20.0, 0.0]), &[camera()]);
        let [near, all] = outline.explained(&nodes);
        let share = near as f64 / all as f64;
        assert!((0.4..0.7).contains(&share), "two of four sides still match: {share}");
    }

    #[test]
    fn edges_of_something_else_do_not_match() {
        let sheet = SheetGrid::new([0.15, 0.15], [9, 9]);
        let mut nodes = sheet.flat_m();
        nodes.iter_mut().for_each(|p| p[2] = 0.5);
        let mut outline = Outline::new(&sheet, [5, 5], 2);
        let mut inward = rectangle([0.0, 0.0]);
        inward.iter_mut().for_each(|e| e.normal = e.normal.map(|c| -c));
        let nan = Edgel { position_px: [f32::NAN; 2], ..inward[0] };
        let elsewhere = Edgel { camera: 7, ..inward[0] };
        inward.extend([nan, elsewhere]);
        outline.fill(&inward, &[camera()]);
        outline.matched(&nodes, 0, 1e-6);
        assert!(outline.rows.is_empty(), "a contour that faces the other way is another's");
        outline.fill(&[], &[]);
        assert!(outline.is_empty());
    }
}
