//! One crease, fitted to the nodes on both sides of it.
//!
//! With s the distance from the line and t along it, a fold is linear in [1, s, t, |s|]; the
//! columns sgn s and t·sgn s correct the line's offset and direction, finer than the grid. Whether
//! it is a fold is a comparison with other shapes: a smooth bend [1, s, t, s², s³], and arcs, where
//! |s| is rounded off over a width.

use super::nodes::Nodes;
use super::normal::{Column, Normal, Plane};
use crate::line::Line;
use std::f64::consts::PI;

/// Farthest correction of one iteration, spacings.
const STEP_MAX: f64 = 0.7;
/// Widths of bends that count as kinks, as shares of the widest of them.
const NARROW: [f64; 3] = [0.33, 0.67, 1.0];
/// Widths of those that do not.
const WIDE: [f64; 3] = [1.35, 1.85, 2.5];
/// Half lengths of waves, as shares of the same; the first also halved.
const WAVES: [f64; 2] = [2.7, 1.9];
/// What another column of a model gains by fitting noise alone, log-likelihood: half of its three
/// coordinates, and something for noise that is smooth.
const COLUMN_WORTH: f64 = 2.0;
/// A bend wider than this share of the window cannot be told from a smooth one.
const WIDTH_MAX: f64 = 0.9;

/// A kink fitted to nodes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hinge {
    pub line: Line,
    /// Fold angle, radians, 0 to π.
    pub angle_rad: f64,
    /// 1 where the sides that u × v points away from come nearer, else −1.
    pub sign: f64,
    /// Σ weights.
    pub weight: f64,
    /// Squared distances from the best narrow bend and from the best wide or smooth one, m².
    pub narrow_m2: f64,
    pub wide_m2: f64,
    /// From the smooth one, which has one more column.
    pub smooth_m2: f64,
    /// World metres per material metre on both sides.
    pub stretch: [f64; 2],
    /// Mean and variance of t, metres, metres².
    pub along: [f64; 2],
    /// How far the window reached on the shorter side, metres.
    pub reach_m: f64,
}

/// A window on both sides of a line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Window<'a> {
    pub line: Line,
    /// How far it reaches on the right (s < 0) and on the left, metres.
    pub reach_m: [f64; 2],
    /// The convex piece that the line crosses: the window ends where the line leaves it.
    pub piece: &'a [[f64; 2]],
}

/// What a kink is compared with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bends {
    /// Narrower bends are kinks, metres.
    pub width_m: f64,
    /// Below this angle rivals do not matter, radians.
    pub angle_rad: f64,
    /// Wider ones too, where their radius is smaller than this, metres.
    pub radius_m: f64,
}

/// Room for a window's nodes: s, t, position, weight.
#[derive(Debug, Clone)]
pub(crate) struct Fitter {
    rows: Vec<Row>,
}

#[derive(Debug, Clone, Copy)]
struct Row {
    s: f64,
    t: f64,
    x: [f64; 3],
    weight: f64,
}

/// Scales of a window: mean of t, its half length, its greater reach; variance of t.
#[derive(Debug, Clone, Copy)]
struct Scale {
    middle_m: f64,
    half_m: f64,
    reach_m: f64,
    variance_m2: f64,
    weight: f64,
}

impl Fitter {
    pub fn new(nodes: usize) -> Self {
        Self { rows: Vec::with_capacity(nodes) }
    }

    /// Corrects the line `iterations` times and fits; `None` where too little is seen.
    pub fn fit(
        &mut self,
        nodes: &Nodes,
        members: impl Iterator<Item = u32> + Clone,
        window: Window,
        iterations: usize,
        bends: Bends,
    ) -> Option<Hinge> {
        let mut line = window.line;
        for _ in 0..iterations {
            let scale = self.gather(nodes, members.clone(), &line, &window)?;
            let [offset_m, slope] = self.correction(&scale, nodes.h_m);
            line = moved(&line, scale.middle_m, offset_m, slope);
            if offset_m.abs() + slope.abs() * scale.half_m < 0.02 * nodes.h_m {
                break;
            }
        }
        let scale = self.gather(nodes, members, &line, &window)?;
        Some(self.judge(&line, &scale, &window, bends))
    }

    /// Takes the nodes of the window.
    fn gather(
        &mut self,
        nodes: &Nodes,
        members: impl Iterator<Item = u32>,
        line: &Line,
        window: &Window,
    ) -> Option<Scale> {
        self.rows.clear();
        let reach_m = window.reach_m;
        let [from_m, to_m] = chord(window.piece, line)?;
        let slack_m = 0.01 * nodes.h_m;
        let (d, p) = (line.direction, line.point_m);
        let mut counts = [0, 0];
        let (mut weight, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for n in members {
            let n = n as usize;
            let q = [nodes.uv_m[n][0] - p[0], nodes.uv_m[n][1] - p[1]];
            let (s, t) = (d[0] * q[1] - d[1] * q[0], d[0] * q[0] + d[1] * q[1]);
            let beside = -reach_m[0] < s && s < reach_m[1];
            let within = from_m - slack_m < t && t < to_m + slack_m;
            if beside && within && nodes.weight[n] > 0.0 {
                let row = Row { s, t, x: nodes.x_m[n], weight: nodes.weight[n] };
                counts[usize::from(s > 0.0)] += 1;
                (weight, sum, squares) =
                    (weight + row.weight, sum + row.weight * t, squares + row.weight * t * t);
                self.rows.push(row);
            }
        }
        if counts.iter().any(|count| *count < 5) || weight < 5.0 {
            return None;
        }
        let middle_m = sum / weight;
        let half_m = self.rows.iter().map(|r| (r.t - middle_m).abs()).fold(0.0, f64::max);
        // Far from the origin squares would swamp what is fitted.
        let origin = self.rows[0].x;
        for row in &mut self.rows {
            row.t -= middle_m;
            row.x = [0, 1, 2].map(|k| row.x[k] - origin[k]);
        }
        let scale = Scale {
            middle_m,
            half_m,
            reach_m: reach_m[0].max(reach_m[1]),
            variance_m2: (squares / weight - middle_m * middle_m).max(0.0),
            weight,
        };
        (half_m >= nodes.h_m).then_some(scale)
    }

    /// Offset (at the mean t) and slope by which the line is off.
    fn correction(&self, scale: &Scale, h_m: f64) -> [f64; 2] {
        let mut normal = Normal::<6>::new();
        for row in &self.rows {
            let (s, t) = (row.s / scale.reach_m, row.t / scale.half_m);
            let side = if s > 0.0 { 1.0 } else { -1.0 };
            normal.add([1.0, s, t, s.abs(), side, side * t], row.x, row.weight);
        }
        let (c, _) = normal.solve(1e-6);
        let bend = dot(&c[3], &c[3]) + 1e-30;
        let offset_m = -dot(&c[4], &c[3]) / bend * scale.reach_m;
        let slope = -dot(&c[5], &c[3]) / bend * scale.reach_m / scale.half_m;
        let slope_max = STEP_MAX * h_m / scale.half_m;
        [offset_m.clamp(-STEP_MAX * h_m, STEP_MAX * h_m), slope.clamp(-slope_max, slope_max)]
    }

    /// Fits the kink and, where it is folded enough to matter, its rivals.
    fn judge(&self, line: &Line, scale: &Scale, window: &Window, bends: Bends) -> Hinge {
        let mut plane = Normal::<3>::new();
        let mut kink = Column::NONE;
        let mut smooth = [Column::NONE; 2];
        let mut both = 0.0;
        for row in &self.rows {
            let (s, t) = (row.s / scale.reach_m, row.t / scale.half_m);
            let base = [1.0, s, t];
            plane.add(base, row.x, row.weight);
            kink.add(s.abs(), base, row.x, row.weight);
            smooth[0].add(s * s, base, row.x, row.weight);
            smooth[1].add(s * s * s, base, row.x, row.weight);
            both += row.weight * s * s * s * s * s;
        }
        let plane = Plane::new(&plane);
        let (kinked, kink_m2) = plane.with(&kink);
        let left = [0, 1, 2].map(|k| kinked[1][k] + kinked[3][k]);
        let right = [0, 1, 2].map(|k| kinked[1][k] - kinked[3][k]);
        let turn = cross(&right, &left);
        let angle_rad = dot(&turn, &turn).sqrt().atan2(dot(&left, &right));
        let mut hinge = Hinge {
            line: *line,
            angle_rad,
            sign: if dot(&turn, &kinked[2]) < 0.0 { 1.0 } else { -1.0 },
            weight: scale.weight,
            narrow_m2: kink_m2,
            wide_m2: f64::INFINITY,
            smooth_m2: plane.with_both(&smooth, both),
            stretch: [right, left].map(|d| dot(&d, &d).sqrt() / scale.reach_m),
            along: [scale.middle_m, scale.variance_m2],
            reach_m: window.reach_m[0].min(window.reach_m[1]),
        };
        if angle_rad > bends.angle_rad {
            self.fit_rivals(&mut hinge, scale, window, bends, &plane);
        }
        hinge
    }

    /// Arcs narrow and wide, and waves.
    fn fit_rivals(
        &self,
        hinge: &mut Hinge,
        scale: &Scale,
        window: &Window,
        bends: Bends,
        plane: &Plane,
    ) {
        let width = bends.width_m.max(bends.radius_m * hinge.angle_rad) / scale.reach_m;
        let narrow = NARROW.map(|share| share * width);
        let wide = WIDE.map(|share| share * width);
        let turns = WAVES.map(|share| PI * scale.reach_m / (share * bends.width_m));
        let mut arcs = [Column::NONE; NARROW.len() + WIDE.len()];
        let mut waves = [Column::NONE; 3];
        for row in &self.rows {
            let (s, t) = (row.s / scale.reach_m, row.t / scale.half_m);
            let (base, r) = ([1.0, s, t], s.abs());
            for (arc, width) in arcs.iter_mut().zip(narrow.iter().chain(&wide)) {
                let round = if r > width / 2.0 { r } else { s * s / width + width / 4.0 };
                arc.add(round, base, row.x, row.weight);
            }
            let [long, short] = turns.map(|turns| (turns * s).cos());
            waves[0].add(long, base, row.x, row.weight);
            waves[1].add(short, base, row.x, row.weight);
            // Half as long as the long one.
            waves[2].add(2.0 * long * long - 1.0, base, row.x, row.weight);
        }
        let seen = WIDTH_MAX * (window.reach_m[0] + window.reach_m[1]) / scale.reach_m;
        for (k, _) in narrow.iter().chain(&wide).enumerate().filter(|(_, w)| **w < seen) {
            let arc_m2 = plane.with(&arcs[k]).1;
            let best_m2 = if k < NARROW.len() { &mut hinge.narrow_m2 } else { &mut hinge.wide_m2 };
            *best_m2 = best_m2.min(arc_m2);
        }
        for wave in &waves {
            hinge.wide_m2 = hinge.wide_m2.min(plane.with(wave).1);
        }
    }
}

impl Hinge {
    /// Variance of a coordinate about the bend, m²; `floor_m` is what is not looked into.
    pub fn noise_m2(&self, floor_m: f64) -> f64 {
        (self.narrow_m2 / (3.0 * self.weight)).max(floor_m * floor_m)
    }

    /// Standard error of the angle, radians.
    pub fn error_rad(&self, noise_m2: f64) -> f64 {
        (noise_m2 * 24.0 / (0.5 * self.weight)).sqrt() / self.reach_m
    }

    /// Log-likelihood ratio of narrow bends against wide and smooth ones.
    pub fn evidence(&self, noise_m2: f64) -> f64 {
        let ratio = |other_m2: f64| (other_m2 - self.narrow_m2) / (2.0 * noise_m2);
        ratio(self.wide_m2).min(ratio(self.smooth_m2) + COLUMN_WORTH)
    }

    /// The middle of the nodes along the line, (u, v), metres.
    pub fn middle_m(&self) -> [f64; 2] {
        let line = &self.line;
        [0, 1].map(|k| line.point_m[k] + self.along[0] * line.direction[k])
    }
}

/// Where a line enters and leaves a convex polygon, as distances along it, metres.
pub(crate) fn chord(corners_m: &[[f64; 2]], line: &Line) -> Option<[f64; 2]> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let next = corners_m.iter().cycle().skip(1);
    for (a, b) in corners_m.iter().zip(next) {
        let (side_a, side_b) = (line.side_m(*a), line.side_m(*b));
        if (side_a >= 0.0) != (side_b >= 0.0) {
            let t = line.along_m(line.crossing(*a, *b));
            (low, high) = (low.min(t), high.max(t));
        }
    }
    (low < high).then_some([low, high])
}

/// The line shifted to its left by an offset at distance `at_m` along it, and turned there.
pub(crate) fn moved(line: &Line, at_m: f64, offset_m: f64, slope: f64) -> Line {
    let d = line.direction;
    let left = [-d[1], d[0]];
    let point_m = [0, 1].map(|k| line.point_m[k] + at_m * d[k] + offset_m * left[k]);
    let to = [0, 1].map(|k| point_m[k] + d[k] + slope * left[k]);
    Line::through(point_m, to)
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
