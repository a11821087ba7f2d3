//! One row of pictures for one step.

use orime_creases::Folds;
use orime_geometry::nalgebra::{Point3, Rotation3, Unit, Vector3};
use orime_geometry::{Edgel, ObservedPoint, RgbdCamera, SheetGrid};

use super::canvas::{Canvas, Color};
use super::view::{PAPER_BLUE, View};
use crate::summary::StepScore;

/// What a panel shows.
#[derive(Debug, Clone, Copy)]
pub struct PanelInput<'a> {
    /// The figures of the step, for the caption.
    pub score: &'a StepScore,
    /// The sheet.
    pub sheet: &'a SheetGrid,
    /// Tracked nodes; empty before the first pose.
    pub nodes_m: &'a [[f32; 3]],
    /// The sheet's facets.
    pub folds: &'a Folds,
    /// Cluster of every node, where there are clusters instead of facets; may be empty.
    pub clusters: &'a [u8],
    /// Observed cloud.
    pub cloud: &'a [ObservedPoint],
    /// Contour.
    pub edgels: &'a [Edgel],
    /// The camera whose image is shown, its index and image.
    pub camera: &'a RgbdCamera,
    /// Index of `camera` in the set.
    pub camera_index: usize,
    /// Its colour image, or `None` where it could not be read.
    pub color_rgb: Option<&'a [u8]>,
}

const IMAGE: [usize; 2] = [640, 480];
const CAPTION: usize = 30;
const GREEN: Color = [60, 255, 110];
const YELLOW: Color = [255, 196, 60];
const WHITE: Color = [235, 238, 245];
/// One colour per camera, in turn.
const CAMERAS: [Color; 6] =
    [[120, 190, 255], [255, 170, 110], [150, 230, 140], [240, 140, 220], [250, 230, 120], [160; 3]];

/// Front and back of the facets or clusters, in turn.
const FACETS: [[Color; 2]; 8] = [
    [[244, 240, 228], [232, 140, 92]],
    [[250, 214, 170], [206, 110, 70]],
    [[206, 232, 250], [104, 150, 200]],
    [[214, 244, 206], [110, 170, 100]],
    [[250, 206, 220], [200, 100, 130]],
    [[228, 214, 250], [140, 110, 190]],
    [[250, 244, 180], [190, 170, 70]],
    [[220, 220, 220], [130, 130, 130]],
];

/// Colour image with the mask's outline and the tracked grid, observed cloud, tracked sheet.
pub fn panel(input: &PanelInput<'_>) -> Canvas {
    let mut panel = Canvas::new(3 * IMAGE[0], IMAGE[1] + CAPTION, PAPER_BLUE);
    panel.place(&color_image(input), 0, CAPTION);
    panel.place(&cloud_image(input), IMAGE[0], CAPTION);
    panel.place(&sheet_image(input), 2 * IMAGE[0], CAPTION);
    let score = input.score;
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.2}"));
    let left = format!("step {}  {}  {}", score.step, input.camera.name, score.tracking);
    let middle = format!("observed: {} points", score.points);
    let mut right =
        format!("tracked, mm: E {}  surface {}", number(score.e_mm), number(score.surface_mm));
    if let Some(error) = score.vertex_error_mm_mean {
        right += &format!("  true error {error:.2}");
    }
    for (k, text) in [left, middle, right].iter().enumerate() {
        panel.text(k * IMAGE[0] + 8, 7, text, 2, WHITE);
    }
    panel
}

fn color_image(input: &PanelInput<'_>) -> Canvas {
    let (width, height) = (input.camera.color.width as usize, input.camera.color.height as usize);
    let Some(rgb) = input.color_rgb else {
        let mut missing = Canvas::new(IMAGE[0], IMAGE[1], [40, 20, 20]);
        missing.text(20, 20, "no image", 3, WHITE);
        return missing;
    };
    let mut image = Canvas::from_rgb(width, height, rgb);
    if input.nodes_m.len() == input.sheet.len() {
        draw_grid(&mut image, input);
    }
    for edgel in input.edgels.iter().filter(|e| e.camera as usize == input.camera_index) {
        let color = if edgel.kind == 0 { GREEN } else { [255, 80, 80] };
        image.dot(f64::from(edgel.position_px[0]), f64::from(edgel.position_px[1]), 1, color);
    }
    // Fit into the image's place, whatever the camera's aspect.
    let fitting = IMAGE[0].min(IMAGE[1] * width / height.max(1)).max(1);
    if fitting == width { image } else { image.scaled_to(fitting) }
}

/// Projects every third grid line, the border in full.
fn draw_grid(image: &mut Canvas, input: &PanelInput<'_>) {
    let color_from_world = input.camera.world_from_color.inverse();
    let pixel: Vec<Option<[f64; 2]>> = input
        .nodes_m
        .iter()
        .map(|node| {
            let point = color_from_world * Point3::from(*node).cast::<f64>();
            input.camera.color.project(&point).map(|p| [p.x, p.y])
        })
        .collect();
    for (a, b, is_border) in grid_lines(input.sheet) {
        if let (Some(a), Some(b)) = (pixel[a], pixel[b]) {
            image.line(a, b, YELLOW, if is_border { 0.9 } else { 0.35 });
        }
    }
}

/// Pairs of neighbouring nodes on every third grid line and on the border.
fn grid_lines(sheet: &SheetGrid) -> Vec<(usize, usize, bool)> {
    let [n, m] = sheet.nodes;
    let mut lines = Vec::new();
    for i in 0..n {
        for j in 0..m {
            let (row_border, column_border) = (i == 0 || i == n - 1, j == 0 || j == m - 1);
            if j + 1 < m && (row_border || i % 3 == 0) {
                lines.push((sheet.index(i, j), sheet.index(i, j + 1), row_border));
            }
            if i + 1 < n && (column_border || j % 3 == 0) {
                lines.push((sheet.index(i, j), sheet.index(i + 1, j), column_border));
            }
        }
    }
    lines
}

/// The view for cloud and sheet: from the first camera's side, turned a quarter of a right angle,
/// so that depth shows.
fn view(input: &PanelInput<'_>) -> View {
    let positions: Vec<[f32; 3]> = if input.nodes_m.is_empty() {
        input.cloud.iter().map(|p| p.position_m).collect()
    } else {
        input.nodes_m.to_vec()
    };
    let count = positions.len().max(1) as f32;
    let mut centre = [0f32; 3];
    for p in &positions {
        for axis in 0..3 {
            centre[axis] += p[axis] / count;
        }
    }
    let target = Point3::from(centre).cast::<f64>();
    let world_from_color = input.camera.world_from_color;
    let up = world_from_color.rotation * -Vector3::y();
    let from_camera = Point3::from(world_from_color.translation.vector) - target;
    let direction = from_camera.try_normalize(1e-9).unwrap_or(-Vector3::z());
    let right = Unit::new_normalize(up.cross(&direction));
    let tilted = Rotation3::from_axis_angle(&right, 0.45)
        * Rotation3::from_axis_angle(&Unit::new_normalize(up), 0.35)
        * direction;
    let distance_m = 2.3 * (input.sheet.size_m[0] + input.sheet.size_m[1]) / 2.0;
    View::new([2 * IMAGE[0], 2 * IMAGE[1]], target + tilted * distance_m, target, up)
}

fn cloud_image(input: &PanelInput<'_>) -> Canvas {
    let mut view = view(input);
    let eye = input.camera.world_from_color.rotation * -Vector3::z();
    for point in input.cloud {
        let normal = Vector3::from(point.normal).cast::<f64>();
        let lit = 0.45 + 0.55 * normal.dot(&eye).abs().min(1.0);
        let color = CAMERAS[point.camera as usize % CAMERAS.len()];
        view.point(point.position_m, 2, color.map(|c| (f64::from(c) * lit) as u8));
    }
    view.finish()
}

fn sheet_image(input: &PanelInput<'_>) -> Canvas {
    let mut view = view(input);
    let nodes = input.nodes_m;
    if nodes.len() == input.sheet.len() {
        let uv_m: Vec<[f64; 2]> = input.sheet.uv_m().collect();
        for triangle in input.sheet.triangles() {
            let [front, back] = FACETS[label(input, &uv_m, triangle) % FACETS.len()];
            view.triangle(triangle.map(|k| nodes[k as usize]), front, back);
        }
        for (a, b, is_border) in grid_lines(input.sheet) {
            let color = if is_border { [30, 30, 34] } else { [120, 120, 130] };
            view.line(nodes[a], nodes[b], color);
        }
    }
    view.finish()
}

/// The facet or cluster of a triangle.
fn label(input: &PanelInput<'_>, uv_m: &[[f64; 2]], triangle: [u32; 3]) -> usize {
    if input.folds.facets().len() > 1 {
        let corners = triangle.map(|k| uv_m[k as usize]);
        return input.folds.facet_at(
            [0, 1].map(|axis| corners.iter().map(|corner| corner[axis]).sum::<f64>() / 3.0),
        );
    }
    // Most of three, which is the middle one where two are equal.
    let mut labels = triangle.map(|k| input.clusters.get(k as usize).copied().unwrap_or(0));
    labels.sort_unstable();
    usize::from(labels[1])
}
