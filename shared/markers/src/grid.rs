//! A marker's corners by all borders between its black and its white modules.
//!
//! Whatever moves the border between ink and paper in an image (the camera's transfer curve, ink
//! that spreads, sharpening) moves it by one distance along its normal, towards the black or away
//! from it. The outer square alone cannot tell that from a square of another size. The pattern's
//! borders can: their black lies on this side of some and on that side of others.
//!
//! | symbol | meaning                                                       | unit |
//! |--------|---------------------------------------------------------------|------|
//! | `H`    | image from the unit square, 8 unknowns, h₃₃ = 1               | px   |
//! | `s`    | shift of every border towards its black, 1 unknown            | px   |
//! | `g_i`  | middle of the i-th border (a module's side), known            | 1    |
//! | `n_i`  | normal of its image, towards the black                        | 1    |
//! | `e_i`  | place of the edge along `n_i` from `H g_i + s n_i`, measured  | px   |
//!
//! Least Σ w_i (e_i − n_i·dH g_i − ds)² by Gauss–Newton; edges are measured anew at every step, and
//! w_i is Cauchy's. The corners are `H` of the unit square's: the grid's, without the shift.

use nalgebra::{SMatrix, SVector};

use crate::detect::{Line, Marker};
use crate::dictionary::Dictionary;
use crate::grey::GreyImage;
use crate::unit_square::UnitSquare;

/// Unknowns: eight of the homography, and the shift.
const UNKNOWNS: usize = 9;

/// Places along a border whose profiles are averaged, and the share of it that they cover: near
/// its ends are other borders.
const PLACES: usize = 5;
const PLACES_SHARE: f64 = 0.4;

/// Samples along the normal: their distance, and so many to each side where an edge counts. All
/// borders alike, since the window has a part in where an edge of uneven sides is found.
const STEP_PX: f64 = 0.25;
const REACH_STEPS: usize = 6;

/// A slope is measured over this many steps to each side: one pixel in all.
const SLOPE_STEPS: usize = 2;
const SAMPLES: usize = 2 * (REACH_STEPS + SLOPE_STEPS) + 1;

/// Least sum of squared slopes, (grey levels / pixel)², of an edge that counts.
const SLOPE_SQUARES_MIN: f64 = 25.0;

/// Distance from its place at which a border counts half, pixels.
const OUTLIER_PX: f64 = 0.2;

/// Narrower modules let neighbouring borders melt, pixels.
const MODULE_PX_MIN: f64 = 2.5;

/// Steps at most, and the step of the corners that ends them, pixels.
const STEPS_MAX: usize = 40;
const STEP_END_PX: f64 = 1e-3;

/// What is too uncertain or too far off to be taken, pixels.
const SHIFT_SIGMA_MAX_PX: f64 = 0.1;
const RMS_MAX_PX: f64 = 0.3;
const MOVE_MAX_MODULES: f64 = 0.3;

/// A marker's grid in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridFit {
    /// The grid's corners, in the order of [`Marker::corners_px`].
    pub corners_px: [[f64; 2]; 4],
    /// How far borders lie on the black's side of the grid, pixels: positive makes black smaller.
    pub shift_px: f64,
    /// Standard deviation of the shift, by the scatter of the borders.
    pub shift_sigma_px: f64,
    /// Standard deviation of a corner's coordinate, by the same.
    pub corner_sigma_px: f64,
    /// Borders that were found, each a module's side long.
    pub borders: usize,
    /// Their root mean square distance from where the fit has them, weighted as the fit does.
    pub rms_px: f64,
}

impl GridFit {
    /// Mean length of the sides, pixels.
    pub fn side_px(&self) -> f64 {
        let side = |k: usize| {
            let (a, b) = (self.corners_px[k], self.corners_px[(k + 1) % 4]);
            (b[0] - a[0]).hypot(b[1] - a[1])
        };
        (0..4).map(side).sum::<f64>() / 4.0
    }
}

/// Why a marker's grid says nothing. Expected in operation: keep the detector's corners.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GridRefusal {
    /// Neighbouring borders melt.
    #[error("a module is {module_px:.1} px wide, need {MODULE_PX_MIN}")]
    TooSmall {
        /// The narrowest module.
        module_px: f64,
    },
    /// Hidden, or too faint.
    #[error("{found} of {all} borders were found, need half")]
    TooFewBorders {
        /// Those with an edge.
        found: usize,
        /// Those of the pattern.
        all: usize,
    },
    /// The borders do not say the shift: of a pattern that has (nearly) none inside, or of noise.
    #[error("the borders' shift is uncertain by {shift_sigma_px:.3} px, rms {rms_px:.2} px")]
    Uncertain {
        /// See [`GridFit`].
        shift_sigma_px: f64,
        /// See [`GridFit`].
        rms_px: f64,
    },
    /// The steps went astray or did not end.
    #[error("the grid does not settle near the marker's corners")]
    Unsettled,
}

/// The corners of a marker by its grid; `marker` is what [`crate::Detector`] found in `image`
/// with `dictionary`.
///
/// O(modules² · steps): about 50 borders of 85 samples a step, some ten steps; 0.3 ms a marker of
/// `DICT_4X4_50`, where finding all of an image costs 2 ms. Equal images give equal bits.
pub fn fit_grid(
    image: GreyImage<'_>,
    dictionary: &Dictionary,
    marker: &Marker,
) -> Result<GridFit, GridRefusal> {
    let modules = dictionary.modules();
    let borders = borders(dictionary, marker.id);
    let mut grid = Grid::new(&marker.corners_px);
    let module_px = grid.module_px_min(&borders, modules);
    if module_px.is_nan() || module_px < MODULE_PX_MIN {
        return Err(GridRefusal::TooSmall { module_px });
    }
    for _ in 0..STEPS_MAX {
        let rows: Vec<Row> =
            borders.iter().filter_map(|border| grid.measure(image, border, modules)).collect();
        if 2 * rows.len() < borders.len() || rows.len() <= UNKNOWNS {
            return Err(GridRefusal::TooFewBorders { found: rows.len(), all: borders.len() });
        }
        let Some(normal) = Normal::new(&rows) else { return Err(GridRefusal::Unsettled) };
        let moved_px = grid.step(&normal.step);
        let far = grid.corners_px().iter().zip(&marker.corners_px).any(|(a, b)| {
            let away_px = (a[0] - b[0]).hypot(a[1] - b[1]);
            away_px.is_nan() || away_px > MOVE_MAX_MODULES * module_px
        });
        if far {
            return Err(GridRefusal::Unsettled);
        }
        if moved_px < STEP_END_PX {
            return grid.result(&normal, rows.len());
        }
    }
    Err(GridRefusal::Unsettled)
}

/// The corners that a marker's grid has if its borders lie `shift_px` on the black's side of it:
/// the outer square's sides moved outwards by as much. For markers whose own grid says nothing, in
/// an image of whose shift other markers tell. The square as it is where its sides do not cross.
pub fn moved_outwards(corners_px: &[[f64; 2]; 4], shift_px: f64) -> [[f64; 2]; 4] {
    let sides = [0, 1, 2, 3].map(|k| {
        let (a, b) = (corners_px[k], corners_px[(k + 1) % 4]);
        let length_px = (b[0] - a[0]).hypot(b[1] - a[1]);
        // Outwards of a clockwise square, y being down.
        let normal = [(b[1] - a[1]) / length_px, (a[0] - b[0]) / length_px];
        Line { normal, offset_px: normal[0] * a[0] + normal[1] * a[1] + shift_px }
    });
    let mut moved = *corners_px;
    for k in 0..4 {
        let Some(corner) = sides[(k + 3) % 4].cross(&sides[k]) else { return *corners_px };
        moved[k] = corner;
    }
    moved
}

/// A module's side with black on one hand and white on the other.
#[derive(Debug, Clone, Copy)]
struct Border {
    /// Its middle in the unit square.
    middle: [f64; 2],
    /// 0 if it runs along u, 1 if along v.
    axis: usize,
    /// +1 if black lies towards growing v (or u), −1 if towards falling.
    black: f64,
}

/// All borders of a marker, the outer ones among them.
fn borders(dictionary: &Dictionary, id: u32) -> Vec<Border> {
    let modules = dictionary.modules();
    let is_black = |line: usize, place: usize, axis: usize| {
        let [row, column] = if axis == 0 { [line, place] } else { [place, line] };
        dictionary.is_black(id, row, column)
    };
    let share = |modules_from_start: f64| modules_from_start / modules as f64;
    let mut found = Vec::with_capacity(2 * modules * (modules + 1));
    for axis in 0..2 {
        for line in 0..=modules {
            for place in 0..modules {
                // Around the marker is paper.
                let before = line > 0 && is_black(line - 1, place, axis);
                let after = line < modules && is_black(line, place, axis);
                if before == after {
                    continue;
                }
                let mut middle = [share(place as f64 + 0.5), share(line as f64)];
                if axis == 1 {
                    middle.reverse();
                }
                found.push(Border { middle, axis, black: if after { 1.0 } else { -1.0 } });
            }
        }
    }
    found
}

/// One border's equation: `step · slopes = error_px`.
#[derive(Debug, Clone, Copy)]
struct Row {
    slopes: SVector<f64, UNKNOWNS>,
    error_px: f64,
}

/// Where the grid is, and how far borders lie beside it.
#[derive(Debug)]
struct Grid {
    /// Pixels are counted from here, so that the equations are well scaled.
    origin_px: [f64; 2],
    square: UnitSquare,
    shift_px: f64,
}

impl Grid {
    fn new(corners_px: &[[f64; 2]; 4]) -> Self {
        let origin_px = [0, 1].map(|k| corners_px.iter().map(|c| c[k]).sum::<f64>() / 4.0);
        let about = corners_px.map(|c| [c[0] - origin_px[0], c[1] - origin_px[1]]);
        Self { origin_px, square: UnitSquare::onto(&about), shift_px: 0.0 }
    }

    /// Corners in the image.
    fn corners_px(&self) -> [[f64; 2]; 4] {
        CORNERS.map(|[u, v]| {
            let [x, y] = self.square.map(u, v);
            [x + self.origin_px[0], y + self.origin_px[1]]
        })
    }

    /// Derivatives of the image point by u and by v, pixels.
    fn tangents(&self, [u, v]: [f64; 2]) -> [[f64; 2]; 2] {
        let [x, y] = self.square.map(u, v);
        let [a, b, [g, h, one]] = self.square.rows;
        let w = g * u + h * v + one;
        let along = |k: usize, p: f64| [(a[k] - x * p) / w, (b[k] - y * p) / w];
        [along(0, g), along(1, h)]
    }

    /// Unit vectors along a border and from it towards its black, and the width of a module across
    /// it times the modules of a side; in the image.
    fn directions(&self, border: &Border) -> ([f64; 2], [f64; 2], f64) {
        let tangents = self.tangents(border.middle);
        let (t, across) = (tangents[border.axis], tangents[1 - border.axis]);
        let length = t[0].hypot(t[1]);
        let t = [t[0] / length, t[1] / length];
        let side = -t[1] * across[0] + t[0] * across[1];
        let sign = border.black * side.signum();
        (t, [-sign * t[1], sign * t[0]], side.abs())
    }

    /// The narrowest module across any border, pixels.
    fn module_px_min(&self, borders: &[Border], modules: usize) -> f64 {
        let width = |border| self.directions(border).2 / modules as f64;
        borders.iter().map(width).fold(f64::INFINITY, f64::min)
    }

    /// Derivatives of `normal · H (u, v)` by the eight unknowns of `H`.
    fn slopes(&self, [u, v]: [f64; 2], normal: [f64; 2]) -> [f64; 8] {
        let [x, y] = self.square.map(u, v);
        let [_, _, [g, h, one]] = self.square.rows;
        let w = g * u + h * v + one;
        let [p, q] = normal.map(|n| n / w);
        let depth = -(p * x + q * y);
        [p * u, p * v, p, q * u, q * v, q, depth * u, depth * v]
    }

    /// The edge at a border; `None` where there is none.
    fn measure(&self, image: GreyImage<'_>, border: &Border, modules: usize) -> Option<Row> {
        let (_, normal, _) = self.directions(border);
        let mut profile = [0.0_f64; SAMPLES];
        for place in 0..PLACES {
            let share = ((place as f64 + 0.5) / PLACES as f64 - 0.5) * PLACES_SHARE;
            let mut at = border.middle;
            at[border.axis] += share / modules as f64;
            let [x, y] = self.square.map(at[0], at[1]);
            for (k, sample) in profile.iter_mut().enumerate() {
                let steps = k as f64 - (REACH_STEPS + SLOPE_STEPS) as f64;
                let out_px = self.shift_px + steps * STEP_PX;
                let [x, y] = [
                    x + self.origin_px[0] + out_px * normal[0],
                    y + self.origin_px[1] + out_px * normal[1],
                ];
                *sample += f64::from(image.sample(x as f32, y as f32)) / PLACES as f64;
            }
        }
        let (mut squares, mut moment) = (0.0, 0.0);
        for k in 0..=2 * REACH_STEPS {
            let slope = (profile[k] - profile[k + 2 * SLOPE_STEPS]).max(0.0);
            squares += slope * slope;
            moment += slope * slope * (k as f64 - REACH_STEPS as f64) * STEP_PX;
        }
        let mut slopes = SVector::<f64, UNKNOWNS>::zeros();
        slopes.as_mut_slice()[..8].copy_from_slice(&self.slopes(border.middle, normal));
        slopes[8] = 1.0;
        (squares > SLOPE_SQUARES_MIN).then(|| Row { slopes, error_px: moment / squares })
    }

    /// Takes a step; the largest motion of a corner or of the shift, pixels.
    fn step(&mut self, step: &SVector<f64, UNKNOWNS>) -> f64 {
        let before = self.corners_px();
        for k in 0..8 {
            self.square.rows[k / 3][k % 3] += step[k];
        }
        self.shift_px += step[8];
        let after = self.corners_px();
        let moved = before.iter().zip(after).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
        moved.fold(step[8].abs(), f64::max)
    }

    fn result(&self, normal: &Normal, borders: usize) -> Result<GridFit, GridRefusal> {
        let shift_sigma_px = normal.covariance[(8, 8)].sqrt();
        let rms_px = normal.rms_px;
        let sure = shift_sigma_px <= SHIFT_SIGMA_MAX_PX && rms_px <= RMS_MAX_PX;
        if !sure {
            return Err(GridRefusal::Uncertain { shift_sigma_px, rms_px });
        }
        let homography = normal.covariance.fixed_view::<8, 8>(0, 0);
        let axes = [[1.0, 0.0], [0.0, 1.0]];
        let each = CORNERS.into_iter().flat_map(|corner| axes.map(|axis| (corner, axis)));
        let variances = each.map(|(corner, axis)| {
            let slopes = SVector::<f64, 8>::from(self.slopes(corner, axis));
            slopes.dot(&(homography * slopes))
        });
        Ok(GridFit {
            corners_px: self.corners_px(),
            shift_px: self.shift_px,
            shift_sigma_px,
            corner_sigma_px: (variances.sum::<f64>() / 8.0).sqrt(),
            borders,
            rms_px,
        })
    }
}

/// The unit square's corners, in the order of a marker's.
const CORNERS: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

/// The solved equations.
#[derive(Debug)]
struct Normal {
    step: SVector<f64, UNKNOWNS>,
    covariance: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    rms_px: f64,
}

impl Normal {
    /// `None` where the borders do not determine all unknowns.
    fn new(rows: &[Row]) -> Option<Self> {
        let mut matrix = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut right = SVector::<f64, UNKNOWNS>::zeros();
        let (mut sum, mut squares) = (0.0, 0.0);
        for Row { slopes, error_px } in rows {
            let weight = 1.0 / (1.0 + (error_px / OUTLIER_PX).powi(2));
            matrix += slopes * slopes.transpose() * weight;
            right += slopes * (weight * error_px);
            sum += weight;
            squares += weight * error_px * error_px;
        }
        let factor = matrix.cholesky()?;
        let freedom = (sum * (1.0 - UNKNOWNS as f64 / rows.len() as f64)).max(1e-9);
        Some(Self {
            step: factor.solve(&right),
            covariance: factor.inverse() * (squares / freedom),
            rms_px: (squares / sum.max(1e-9)).sqrt(),
        })
    }
}
