//! The folded sheet in a colour image: Lambert shading, fibres, exact coverage at the edges.

use orime_geometry::CameraModel;
use orime_geometry::nalgebra::{Isometry3, Vector3};

use super::coverage::{self, REACH_PX};
use super::ink::Ink;
use super::project::Projected;
use super::scene::Face;
use super::table::Texture;

/// Towards the lamp, world frame, unit length.
pub(super) const LAMP: Vector3<f64> = Vector3::new(-0.317, -0.423, 0.849);

/// Brightness of a surface with this unit normal towards the viewer: the lamp, light from all
/// around, and what shines through when the lamp is behind. A flat table has 1.
pub(super) fn shade(normal: &Vector3<f64>) -> f64 {
    let lit = normal.dot(&LAMP);
    let direct = if lit > 0.0 { 0.65 * lit } else { -0.15 * lit };
    0.45 + direct
}

/// What the sheet is made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look<'a> {
    /// Fibres.
    pub paper: &'a Texture,
    /// Relative strength of the fibres.
    pub texture: f32,
    /// Print; drawn only where faces are sampled.
    pub ink: Option<&'a Ink>,
}

/// The two facets of a folded sheet as one colour lens sees them.
///
/// All lenses are above the table, and the moving facet lies above the fixed one's plane, so the
/// moving facet is painted over the fixed one, and both over the table.
#[derive(Debug)]
pub(super) struct Painted<'a> {
    facets: [Option<Projected>; 2],
    /// Whether the facets lie on opposite sides of the crease in the image: then their coverages
    /// add up along it. Otherwise one hides the other, and the larger coverage counts.
    opposite: bool,
    /// Colour of each facet, 0 to 255.
    rgb: [[f32; 3]; 2],
    look: Look<'a>,
}

impl<'a> Painted<'a> {
    pub fn new(
        lens: &CameraModel,
        lens_from_world: &Isometry3<f64>,
        faces: &[Face; 2],
        look: Look<'a>,
    ) -> Self {
        let [mut fixed, moving] = [0, 1].map(|k| {
            Projected::new(lens, lens_from_world, &faces[k].pose, faces[k].corners_uv_m())
        });
        let mut opposite = false;
        if let (Some(f), Some(m)) = (&fixed, &moving)
            && f.opposes(m)
        {
            opposite = true;
            fixed = f.closed_to(m);
        }
        let eye_m = lens_from_world.inverse().translation.vector;
        let rgb = faces.map(|face| {
            let light = shade(&face.normal_towards(&eye_m)) as f32;
            face.rgb.map(|c| c * light)
        });
        Self { facets: [fixed, moving], opposite, rgb, look }
    }

    /// Paints the sheet over row `y`. `cover` is room for one row per facet, all zero before and
    /// after.
    pub fn paint_row(&self, y: usize, height: usize, cover: &mut [Vec<f32>; 2], row: &mut [u8]) {
        let (mut start, mut end) = (row.len(), 0);
        for (facet, cover) in self.facets.iter().zip(&mut *cover) {
            let Some(facet) = facet else { continue };
            if !facet.rows(height).contains(&y) {
                continue;
            }
            let touched = cover_row(facet, y, cover);
            if !touched.is_empty() {
                start = start.min(touched.start);
                end = end.max(touched.end);
            }
        }
        if start < end {
            self.blend(y, start..end, cover, row);
            cover.iter_mut().for_each(|cover| cover[start..end].fill(0.0));
        }
    }

    /// Mixes table, fixed and moving facet by their coverages.
    fn blend(
        &self,
        y: usize,
        columns: std::ops::Range<usize>,
        cover: &[Vec<f32>; 2],
        row: &mut [u8],
    ) {
        let fibres = [0, 1].map(|k| Fibres::new(self.facets[k].as_ref(), y));
        for x in columns {
            let moving = cover[1][x];
            let fixed = if self.opposite {
                cover[0][x].min(1.0 - moving)
            } else {
                (cover[0][x] - moving).max(0.0)
            };
            let table = 1.0 - fixed - moving;
            let mut mixed = [0.5; 3];
            for (share, k) in [(fixed, 0), (moving, 1)] {
                if share > 0.0 {
                    let light = share * fibres[k].brightness(x, &self.look);
                    (0..3).for_each(|c| mixed[c] += light * self.rgb[k][c]);
                }
            }
            let pixel = &mut row[3 * x..3 * x + 3];
            if table > 0.0 {
                (0..3).for_each(|c| mixed[c] += table * f32::from(pixel[c]));
            }
            (0..3).for_each(|c| pixel[c] = mixed[c] as u8);
        }
    }
}

/// Writes one facet's coverage of row `y`; returns the columns it touched.
fn cover_row(facet: &Projected, y: usize, cover: &mut [f32]) -> std::ops::Range<usize> {
    let touched = facet.span(y, -REACH_PX, cover.len());
    let inside = facet.span(y, REACH_PX, cover.len());
    let inside = if inside.is_empty() { touched.start..touched.start } else { inside };
    let at = |x: usize| coverage::polygon(facet.edges(), x as f64, y as f64) as f32;
    (touched.start..inside.start).for_each(|x| cover[x] = at(x));
    cover[inside.clone()].fill(1.0);
    (inside.end..touched.end).for_each(|x| cover[x] = at(x));
    touched
}

/// The paper's texture along one row of one facet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fibres {
    /// `(u/z, v/z, 1/z)` at column 0, and its change per column.
    start: [f32; 3],
    step: [f32; 3],
}

impl Fibres {
    /// Fibres that nobody looks at.
    pub fn none() -> Self {
        Self { start: [0.0, 0.0, 1.0], step: [0.0; 3] }
    }

    pub fn new(facet: Option<&Projected>, y: usize) -> Self {
        facet.map_or_else(Self::none, |facet| Self::at_height(facet, y as f64))
    }

    /// The same between rows.
    pub fn at_height(facet: &Projected, y: f64) -> Self {
        let m = &facet.per_depth;
        Self {
            start: [0, 1, 2].map(|r| (m[(r, 1)] * y + m[(r, 2)]) as f32),
            step: [0, 1, 2].map(|r| m[(r, 0)] as f32),
        }
    }

    #[inline]
    pub fn brightness(&self, x: usize, look: &Look<'_>) -> f32 {
        let [u_m, v_m] = self.uv_m(x as f32);
        1.0 + look.texture * look.paper.at(u_m, v_m)
    }

    /// Point of the sheet that is seen at a column, metres.
    #[inline]
    pub fn uv_m(&self, x: f32) -> [f32; 2] {
        let [u, v, w] = [0, 1, 2].map(|k| self.start[k] + self.step[k] * x);
        let z = 1.0 / w;
        [u * z, v * z]
    }
}
