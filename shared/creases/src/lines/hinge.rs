//! One crease, fitted to the nodes on both sides of it.
//!
//! With s the distance from the line and t along it, a fold is linear in [1, s, t, |s|]; the
//! columns sgn s and t·sgn s correct the line's offset and direction, finer than the grid. Whether
//! it is a fold is a comparison with other shapes: a smooth bend [1, s, t, s², s³], and arcs, where
//! |s| is rounded off over a width.

use super::nodes::Nodes;
use super::normal::Normal;
use crate::line::Line;

/// Farthest correction of one iteration, spacings.
const STEP_MAX: f64 = 0.7;
/// Widths of the arcs that a kink competes with, each over the one before.
const ARC_GROWTH: f64 = 1.35;
const ARCS: usize = 5;

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
    /// Squared distances from the kink, the smooth bend and the best wide arc, m².
    pub kink_m2: f64,
    pub smooth_m2: f64,
    pub arc_m2: f64,
    /// World metres per material metre on both sides.
    pub stretch: [f64; 2],
    /// Mean and variance of t, metres, metres².
    pub along: [f64; 2],
    /// How far the window reached on both sides, metres.
    pub window_m: [f64; 2],
}

/// A window on both sides of a line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Window {
    pub line: Line,
    /// How far it reaches on the right (s < 0) and on the left, metres.
    pub reach_m: [f64; 2],
}

/// What a kink is compared with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bends {
    /// Narrower bends are kinks, metres.
    pub width_m: f64,
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
            let scale = self.gather(nodes, members.clone(), &line, window.reach_m)?;
            let [offset_m, slope] = self.correction(&scale, nodes.h_m);
            line = moved(&line, scale.middle_m, offset_m, slope);
            if offset_m.abs() + slope.abs() * scale.half_m < 0.02 * nodes.h_m {
                break;
            }
        }
        let scale = self.gather(nodes, members, &line, window.reach_m)?;
        Some(self.judge(&line, &scale, window.reach_m, bends))
    }

    /// Takes the nodes of the window.
    fn gather(
        &mut self,
        nodes: &Nodes,
        members: impl Iterator<Item = u32>,
        line: &Line,
        reach_m: [f64; 2],
    ) -> Option<Scale> {
        self.rows.clear();
        let (d, p) = (line.direction, line.point_m);
        let mut counts = [0, 0];
        let (mut weight, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for n in members {
            let n = n as usize;
            let q = [nodes.uv_m[n][0] - p[0], nodes.uv_m[n][1] - p[1]];
            let (s, t) = (d[0] * q[1] - d[1] * q[0], d[0] * q[0] + d[1] * q[1]);
            if -reach_m[0] < s && s < reach_m[1] && nodes.weight[n] > 0.0 {
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

    /// Fits the kink and its rivals.
    fn judge(&self, line: &Line, scale: &Scale, window_m: [f64; 2], bends: Bends) -> Hinge {
        let (mut kink, mut smooth) = (Normal::<4>::new(), Normal::<5>::new());
        for row in &self.rows {
            let (s, t) = (row.s / scale.reach_m, row.t / scale.half_m);
            kink.add([1.0, s, t, s.abs()], row.x, row.weight);
            smooth.add([1.0, s, t, s * s, s * s * s], row.x, row.weight);
        }
        let ((c, kink_m2), (_, smooth_m2)) = (kink.solve(1e-9), smooth.solve(1e-9));
        let left = [0, 1, 2].map(|k| c[1][k] + c[3][k]);
        let right = [0, 1, 2].map(|k| c[1][k] - c[3][k]);
        let turn = cross(&right, &left);
        let angle_rad = dot(&turn, &turn).sqrt().atan2(dot(&left, &right));
        let width_m = bends.width_m.max(bends.radius_m * angle_rad);
        let stretch = [right, left].map(|d| dot(&d, &d).sqrt() / scale.reach_m);
        Hinge {
            line: *line,
            angle_rad,
            sign: if dot(&turn, &c[2]) < 0.0 { 1.0 } else { -1.0 },
            weight: scale.weight,
            kink_m2,
            smooth_m2,
            arc_m2: self.best_arc_m2(scale, window_m, width_m),
            stretch,
            along: [scale.middle_m, scale.variance_m2],
            window_m,
        }
    }

    /// Squared distances from the best arc at least `width_m` wide, m².
    fn best_arc_m2(&self, scale: &Scale, window_m: [f64; 2], width_m: f64) -> f64 {
        let mut width = width_m / scale.reach_m;
        if width_m >= 0.9 * (window_m[0] + window_m[1]) {
            return f64::INFINITY;
        }
        let mut least_m2 = f64::INFINITY;
        for _ in 0..ARCS {
            let mut arc = Normal::<4>::new();
            for row in &self.rows {
                let (s, t) = (row.s / scale.reach_m, row.t / scale.half_m);
                let r = s.abs();
                let round = if r > width / 2.0 { r } else { s * s / width + width / 4.0 };
                arc.add([1.0, s, t, round], row.x, row.weight);
            }
            least_m2 = least_m2.min(arc.solve(1e-9).1);
            width *= ARC_GROWTH;
        }
        least_m2
    }
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
