//! The square (preliminary) base in 580 steps, as moving vertices of eight triangles.
//!
//! Own frame, metres: c = OC = +x, d = OD = +y, z up, O = 0 on the table, A = (−r, 0),
//! B = (0, −r), r = L/√2; M, M′, N, N′ are the middles of AD, AB, CD, BC. Corners in (u, v):
//! A = (0, 0), B = (L, 0), C = (L, L), D = (0, L).
//!
//! ```text
//! fold 1   0..110   half ACB turns about AC onto ACD       bottom to top  ACD ACB
//! fold 2 110..200   half OA* turns about OD onto OC*       OCD OCB OAB OAD
//! squash 200..300   lift A 90° (200..240), open            x>0: ODN OBN′ OBM′ OAM′, x<0: ODM OAM
//! turn   300..400   rigid, about d, lifted
//! squash 400..540   lift C 90° (400..455), open            top to bottom  OCN ODN ODM OAM,
//!                                                           OCN′ OBN′ OBM′ OAM′
//! ```
//!
//! Zero-thickness positions are exact (isometric to rounding). Layers are offset by one vector per
//! vertex, interpolated in each triangle, so the surface stays continuous: lengths change by at
//! most 0.12 % at 0.1 mm. Hinge vertices reach the middle of the stack before a flap passes 90°.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4, PI};

use nalgebra::{Matrix2, Rotation3, Vector2, Vector3};

use crate::facet::{Crease, Facet, FacetPose, Stack};

/// Steps at 1×, as in the paper.
pub(crate) const STEPS: f64 = 580.0;
const T1: f64 = 110.0;
const T2: f64 = 200.0;
const T3_LIFTED: f64 = 240.0;
const T3: f64 = 300.0;
const T4: f64 = 400.0;
const T5_LIFTED: f64 = 455.0;
const T5: f64 = 540.0;

const O: usize = 0;
const A: usize = 1;
const B: usize = 2;
const C: usize = 3;
const D: usize = 4;
const M: usize = 5;
const MP: usize = 6;
const N: usize = 7;
const NP: usize = 8;

/// Corner and midpoint of each triangle; all have O. Going round O, so neighbours share a spoke.
const FACES: [[usize; 2]; 8] = [[A, M], [A, MP], [B, MP], [B, NP], [C, NP], [C, N], [D, N], [D, M]];

/// Clearance of the stack during the turn-over, metres.
const TURN_CLEARANCE_M: f64 = 0.02;

/// Depth of a grasp inside the moving corner or edge, metres along the sheet's axes.
const GRASP_M: f64 = 0.008;

type Vertices = [Vector3<f64>; 9];

/// The motion.
#[derive(Debug, Clone)]
pub(crate) struct SquareBase {
    side_m: f64,
    thickness_m: f64,
    rest: [Vector2<f64>; 9],
    /// Turns (u, v) offsets from O into multiples of the triangle's corner and midpoint.
    weights: [Matrix2<f64>; 8],
    /// What is carried through the turn-over.
    turned: Vertices,
}

impl SquareBase {
    pub fn new(side_m: f64, thickness_m: f64) -> Self {
        let (r, h) = (side_m * FRAC_1_SQRT_2, side_m * FRAC_1_SQRT_2 / 2.0);
        let rest = [
            [0.0, 0.0],
            [-r, 0.0],
            [0.0, -r],
            [r, 0.0],
            [0.0, r],
            [-h, h],
            [-h, -h],
            [h, h],
            [h, -h],
        ]
        .map(Vector2::from);
        let weights = FACES.map(|[a, b]| {
            let basis = Matrix2::from_columns(&[rest[a], rest[b]]);
            // A triangle's two edges are never parallel.
            basis.try_inverse().unwrap_or_else(Matrix2::zeros) * own_from_sheet()
        });
        let mut base = Self { side_m, thickness_m, rest, weights, turned: [Vector3::zeros(); 9] };
        base.turned = base.vertices_m(T3);
        base
    }

    /// The eight triangles, counter-clockwise in (u, v).
    pub fn facets(&self) -> Vec<Facet> {
        let triangle = |[a, b]: [usize; 2]| {
            let [p, q] = [a, b].map(|v| self.rest[v]);
            let corners = if p.perp(&q) > 0.0 { [O, a, b] } else { [O, b, a] };
            Facet { corners_uv_m: corners.map(|v| self.uv_m(v)).to_vec() }
        };
        FACES.map(triangle).to_vec()
    }

    /// The eight spokes.
    pub fn creases(&self) -> Vec<Crease> {
        (0..8)
            .filter_map(|k| {
                let next = (k + 1) % 8;
                let shared = FACES[k].into_iter().find(|v| FACES[next].contains(v))?;
                let ends_uv_m = [O, shared].map(|v| self.uv_m(v));
                Some(Crease { ends_uv_m, facets: [k, next] })
            })
            .collect()
    }

    /// What lies on what while nothing moves.
    pub fn stacks() -> Vec<Stack> {
        let [oam, oamp, obmp, obnp, ocnp, ocn, odn, odm] = [0, 1, 2, 3, 4, 5, 6, 7];
        let stack = |t: [f64; 2], facets: &[usize]| Stack {
            during: t.map(|t| t / STEPS),
            facets: facets.to_vec(),
        };
        vec![
            stack([T1; 2], &[odm, obmp]),
            stack([T1; 2], &[oam, oamp]),
            stack([T1; 2], &[odn, obnp]),
            stack([T1; 2], &[ocn, ocnp]),
            stack([T2; 2], &[odn, obnp, obmp, odm]),
            stack([T2; 2], &[ocn, ocnp, oamp, oam]),
            stack([T3; 2], &[odn, obnp, obmp, oamp]),
            stack([T3; 2], &[odm, oam]),
            stack([T3; 2], &[ocn, ocnp]),
            stack([T5, STEPS], &[oam, odm, odn, ocn]),
            stack([T5, STEPS], &[oamp, obmp, obnp, ocnp]),
        ]
    }

    /// Material points that are held, with first and last step.
    pub fn grasps(&self) -> Vec<([f64; 2], [f64; 2])> {
        let l = self.side_m;
        let near = |near_start: [bool; 2]| {
            near_start.map(|start| if start { GRASP_M } else { l - GRASP_M })
        };
        vec![
            (near([false, true]), [0.0, T1]),
            (near([true, true]), [T1, T3]),
            (near([false, false]), [T3, T4]),
            ([GRASP_M / 2.0, l / 2.0], [T3, T4]),
            (near([false, false]), [T4, T5]),
        ]
    }

    /// Maps (u, v) of each triangle into the flat sheet's own frame (origin at u = v = 0).
    pub fn pose(&self, progress: f64, poses: &mut [FacetPose]) {
        let vertices = self.vertices_m(progress * STEPS);
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), FRAC_PI_4);
        let middle = Vector2::repeat(self.side_m / 2.0);
        for ((pose, [a, b]), weights) in poses.iter_mut().zip(FACES).zip(&self.weights) {
            let [p, q] = [a, b].map(|v| turn * (vertices[v] - vertices[O]));
            let along = |column: usize| p * weights[(0, column)] + q * weights[(1, column)];
            let (along_u, along_v) = (along(0), along(1));
            let o = turn * vertices[O] + Vector3::new(middle.x, middle.y, 0.0);
            *pose = FacetPose {
                origin_m: o - along_u * middle.x - along_v * middle.y,
                along_u,
                along_v,
            };
        }
    }

    fn uv_m(&self, vertex: usize) -> [f64; 2] {
        let offset = own_from_sheet().transpose() * self.rest[vertex];
        [offset.x + self.side_m / 2.0, offset.y + self.side_m / 2.0]
    }

    /// Positions of O, A, B, C, D, M, M′, N, N′ at step `t` in the own frame, metres.
    pub fn vertices_m(&self, t: f64) -> [Vector3<f64>; 9] {
        let angles = Angles::at(t);
        let mut at = self.rest.map(|p| Vector3::new(p.x, p.y, 0.0));
        for v in [B, MP, NP] {
            let (sin, cos) = angles.fold_1.sin_cos();
            at[v] = Vector3::new(at[v].x, at[v].y * cos, -at[v].y * sin);
        }
        let height = [0.0, 0.5, 1.0, 0.5, 0.0, 0.0, 1.0, 0.0, 1.0].map(|k| k * ease(t / T1));
        let mut layers = height.map(|k| Vector3::z() * k);
        if t > T1 {
            fold_2(&angles, &height, &mut at, &mut layers);
        }
        if t > T3_LIFTED {
            let tip = squash(Vector3::z(), angles.a);
            self.place([A, M, MP], tip, &mut at);
            let ends = [(A, 3.0), (M, 1.0), (MP, 2.5), (D, 0.0)];
            settle(ease((t - T3_LIFTED) / (T3 - T3_LIFTED)), &ends, &mut layers);
        }
        if t > T4 {
            let (sin, cos) = angles.c[0].sin_cos();
            for (v, k) in [(C, 0.5), (N, 0.0), (NP, 1.0)] {
                at[v] = Vector3::new(at[v].x * cos, at[v].y, -at[v].x * sin);
                layers[v] = Vector3::new((k - 1.5) * sin, 0.0, (k - 1.5) * cos + 1.5);
            }
            // The hinges meet before the flap stands upright.
            layers[D] = Vector3::z() * (1.5 * sin);
        }
        if t > T5_LIFTED {
            let tip = squash(-Vector3::z(), angles.c);
            self.place([C, N, NP], tip, &mut at);
            let ends = [(C, 0.0), (N, 0.5), (NP, 0.5), (M, 2.5), (B, 1.5)];
            settle(ease((t - T5_LIFTED) / (T5 - T5_LIFTED)), &ends, &mut layers);
        }
        for (p, layer) in at.iter_mut().zip(layers) {
            *p += layer * self.thickness_m;
        }
        self.turn_over(t, angles.turn, at)
    }

    /// Corner, outer and inner midpoint of a flap in the directions that `squash` gave.
    fn place(&self, vertices: [usize; 3], directions: [Vector3<f64>; 3], at: &mut Vertices) {
        let lengths = [self.side_m * FRAC_1_SQRT_2, self.side_m / 2.0, self.side_m / 2.0];
        for ((v, direction), length) in vertices.into_iter().zip(directions).zip(lengths) {
            at[v] = direction * length;
        }
    }

    /// Turns the stack about d: +x over +z to −x; the carried stack's hull rests on the table or
    /// is lifted over it.
    fn turn_over(&self, t: f64, turn: f64, at: Vertices) -> Vertices {
        let (sin, cos) = turn.sin_cos();
        let rotate =
            |p: Vector3<f64>| Vector3::new(p.x * cos - p.z * sin, p.y, p.x * sin + p.z * cos);
        let mut turned = at.map(rotate);
        if t > T3 {
            let low = self.turned.iter().map(|p| rotate(*p).z).fold(0.0, f64::min);
            for p in &mut turned {
                p.z += TURN_CLEARANCE_M * sin * sin - low;
            }
        }
        turned
    }
}

/// Turns (u, v) offsets from the middle into the own frame.
fn own_from_sheet() -> Matrix2<f64> {
    Matrix2::new(1.0, 1.0, -1.0, 1.0) * FRAC_1_SQRT_2
}

/// 0 to 1 with zero velocity at both ends.
fn ease(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// How far each move is, radians.
struct Angles {
    fold_1: f64,
    fold_2: f64,
    /// Lift φ and opening δ of flap A.
    a: [f64; 2],
    turn: f64,
    /// Lift φ and opening δ of flap C.
    c: [f64; 2],
}

impl Angles {
    fn at(t: f64) -> Self {
        let done = |from: f64, to: f64| ease((t - from) / (to - from));
        let flap = |from: f64, lifted: f64, to: f64| {
            [FRAC_PI_2 * done(from, lifted), FRAC_PI_2 * (1.0 - done(lifted, to))]
        };
        Self {
            fold_1: PI * done(0.0, T1),
            fold_2: PI * done(T1, T2),
            a: flap(T2, T3_LIFTED, T3),
            turn: PI * done(T3, T4),
            c: flap(T4, T5_LIFTED, T5),
        }
    }
}

/// Turns the half OA* (already double) about y through z = 1.5 layers: −x over +z to +x.
fn fold_2(angles: &Angles, height: &[f64; 9], at: &mut Vertices, layers: &mut Vertices) {
    let (sin, cos) = (angles.fold_2 - angles.a[0]).sin_cos();
    let rotate = |p: Vector3<f64>| Vector3::new(p.x * cos + p.z * sin, p.y, -p.x * sin + p.z * cos);
    let middle = Vector3::z() * 1.5;
    for v in [A, M, MP] {
        at[v] = rotate(at[v]);
        layers[v] = rotate(Vector3::z() * (height[v] - 1.5)) + middle;
    }
    // The hinges reach the middle height before the layers meet.
    let s = angles.fold_2.min(FRAC_PI_2).sin();
    layers[D] = middle * s;
    layers[B] = Vector3::z() * (1.0 + 0.5 * s);
    layers[O] = middle * s;
}

/// A flap with its tip along +x on the stack, hinge +y, free side `up`: directions of its tip, its
/// outer and its inner midpoint, lifted by φ and opened to δ.
fn squash(up: Vector3<f64>, [phi, delta]: [f64; 2]) -> [Vector3<f64>; 3] {
    let (c, d) = (Vector3::x(), Vector3::y());
    let e = c * phi.cos() + up * phi.sin();
    let away = up * phi.cos() - c * phi.sin();
    let half = delta / 2.0;
    let mid = d * half.cos() + e * half.sin();
    let cos = (FRAC_PI_4.cos() / half.cos()).clamp(-1.0, 1.0);
    let sin = (1.0 - cos * cos).sqrt();
    [d * delta.cos() + e * delta.sin(), mid * cos + away * sin, mid * cos - away * sin]
}

/// Brings layer offsets to their heights at a move's end.
fn settle(done: f64, ends: &[(usize, f64)], layers: &mut Vertices) {
    for (v, height) in ends {
        layers[*v] = layers[*v] * (1.0 - done) + Vector3::z() * (done * height);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps, thickness (m) and nine vertices (mm) that `design/square_base.py` prints.
    const REFERENCE: &str = include_str!("../tests/square_base.txt");

    #[test]
    fn agrees_with_the_reference() {
        let mut lines = 0;
        for line in REFERENCE.lines() {
            let numbers: Vec<f64> = line.split(' ').map(|n| n.parse().unwrap()).collect();
            let base = SquareBase::new(0.15, numbers[1]);
            let vertices = base.vertices_m(numbers[0]);
            for (v, expected_mm) in numbers[2..].chunks_exact(3).enumerate() {
                for k in 0..3 {
                    let off_m = (vertices[v][k] - expected_mm[k] * 1e-3).abs();
                    assert!(off_m < 1e-11, "vertex {v} at step {}: {off_m} m", numbers[0]);
                }
            }
            lines += 1;
        }
        assert_eq!(lines, 40);
    }
}
