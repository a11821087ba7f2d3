//! Material points that can be contour: on the sheet's border and on its creases.

use crate::basis::Corner;
use crate::blend::{Blend, Blender};
use orime_creases::Folds;
use orime_geometry::SheetGrid;

/// How far inside the sheet the point lies that tells the inside, grid spacings.
const INSIDE: f64 = 1.0;
/// Samples this close to a corner or to the end of a crease are left out, sample spacings: where
/// two edges meet there is no normal.
const LANDMARK: f64 = 0.6;

/// A point of border or crease, and what is around it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    /// The point.
    pub here: Blend,
    /// Its neighbour on one side along the border or crease.
    pub before: Blend,
    /// Its neighbour on the other side.
    pub after: Blend,
    /// Points further inside the sheet: of both facets for a crease, twice the same for the border.
    pub inside: [Blend; 2],
    /// Its place among the control points.
    pub corner: Corner,
}

/// Points evenly spaced between two landmarks, without these.
fn along(ends_m: [[f64; 2]; 2], spacing_m: f64) -> impl Iterator<Item = ([f64; 2], [[f64; 2]; 2])> {
    let [a, b] = ends_m;
    let length = (b[0] - a[0]).hypot(b[1] - a[1]);
    let count = (length / spacing_m).round().max(1.0) as usize;
    let at = move |k: f64| {
        let t = (k / count as f64).clamp(0.0, 1.0);
        [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
    };
    (0..=count)
        .map(|k| k as f64)
        .filter(move |k| LANDMARK < *k && *k < count as f64 - LANDMARK)
        .map(move |k| (at(k), [at(k - 1.0), at(k + 1.0)]))
}

/// How a sheet is sampled.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layout<'a> {
    pub sheet: &'a SheetGrid,
    /// Control points along u and v.
    pub controls: [usize; 2],
    /// Distance between samples, metres.
    pub spacing_m: f64,
}

impl Layout<'_> {
    /// The border's samples, counter-clockwise.
    pub fn border(&self, blender: &Blender<'_>, samples: &mut Vec<Sample>) {
        let Self { sheet, controls, spacing_m } = *self;
        let [a, b] = sheet.size_m;
        let inside_m = INSIDE * sheet.spacing_m()[0].min(sheet.spacing_m()[1]);
        let corners = [[0.0, 0.0], [a, 0.0], [a, b], [0.0, b], [0.0, 0.0]];
        for ends in corners.windows(2) {
            for (uv, [before, after]) in along([ends[0], ends[1]], spacing_m) {
                let inward = [0, 1].map(|axis| {
                    let size = sheet.size_m[axis];
                    uv[axis].clamp(inside_m.min(size / 2.0), size - inside_m.min(size / 2.0))
                });
                let inside = blender.at(inward);
                samples.push(Sample {
                    here: blender.at(uv),
                    before: blender.at(before),
                    after: blender.at(after),
                    inside: [inside; 2],
                    corner: Corner::at(sheet, controls, uv),
                });
            }
        }
    }

    /// The samples of all creases.
    pub fn creases(&self, folds: &Folds, blender: &Blender<'_>, samples: &mut Vec<Sample>) {
        let Self { sheet, controls, spacing_m } = *self;
        let inside_m = INSIDE * sheet.spacing_m()[0].min(sheet.spacing_m()[1]);
        for crease in folds.creases() {
            let d = crease.line().direction;
            let [left, right] = crease.facets;
            for (uv, [before, after]) in along(crease.ends_m, spacing_m) {
                let beside =
                    |sign: f64| [uv[0] - sign * inside_m * d[1], uv[1] + sign * inside_m * d[0]];
                samples.push(Sample {
                    here: blender.within(left, uv),
                    before: blender.within(left, before),
                    after: blender.within(left, after),
                    inside: [
                        blender.within(left, beside(1.0)),
                        blender.within(right, beside(-1.0)),
                    ],
                    corner: Corner::at(sheet, controls, uv),
                });
            }
        }
    }
}
