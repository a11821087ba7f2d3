//! A node and a triangle, or two edges: distance, and how far a motion may go.

use nalgebra::Vector3;

/// Steps of conservative advancement at most; what is not through by then stays where it got to.
const ADVANCES: usize = 48;
/// Share of the proven distance that one step takes.
const STEP: f64 = 0.9;
/// Layers nearer than this do not come nearer at all, metres: it stands out of f32's rounding.
const HOLD_M: f64 = 1e-6;
/// Largest share of a distance that one step may take.
const APPROACH: f64 = 0.8;

/// A node and a triangle, or two edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Pair {
    pub nodes: [u32; 4],
    /// Whether it is two edges.
    pub edges: bool,
}

/// The nearest places of a pair.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Nearest {
    /// Weights of the four nodes; positive on the first side, negative on the second.
    pub weights: [f64; 4],
    /// From the second side to the first, metres.
    pub offset: Vector3<f64>,
    pub distance_m: f64,
}

impl Pair {
    /// The nearest places for these positions of the four nodes.
    pub fn nearest(&self, p: &[Vector3<f64>; 4]) -> Nearest {
        let weights = if self.edges { edge_weights(p) } else { triangle_weights(p) };
        let offset: Vector3<f64> = p.iter().zip(weights).map(|(p, w)| p * w).sum();
        Nearest { weights, offset, distance_m: offset.norm() }
    }

    /// How far the pair's nodes move relative to each other at most, metres.
    pub fn relative_m(&self, moves: &[Vector3<f64>; 4]) -> f64 {
        let mean = moves.iter().sum::<Vector3<f64>>() / 4.0;
        let [a, b, c, d] = moves.map(|m| (m - mean).norm());
        if self.edges { a.max(b) + c.max(d) } else { a + b.max(c).max(d) }
    }

    /// How far apart the boxes around both sides are, metres: the pair is no nearer than that.
    fn boxes_apart_m(&self, p: &[Vector3<f64>; 4]) -> f64 {
        let apart = |k: usize| {
            let [a, b, c, d] = [p[0][k], p[1][k], p[2][k], p[3][k]];
            let (first, second) = if self.edges {
                ((a.min(b), a.max(b)), (c.min(d), c.max(d)))
            } else {
                ((a, a), (b.min(c).min(d), b.max(c).max(d)))
            };
            (second.0 - first.1).max(first.0 - second.1)
        };
        apart(0).max(apart(1)).max(apart(2))
    }

    /// How far the first side lies beyond the second along a direction, metres.
    fn parted_m(&self, p: &[Vector3<f64>; 4], normal: &Vector3<f64>) -> f64 {
        let [a, b, c, d] = p.map(|p| p.dot(normal));
        if self.edges { a.min(b) - c.max(d) } else { a - b.max(c).max(d) }
    }

    /// Share of the motion from `from` to `to` that keeps the pair apart: additive conservative
    /// advancement. In its course the distance never falls below [`margin_m`] of the first one.
    ///
    /// Source: Li et al. 2021 (C-IPC), additive CCD.
    pub fn free_share(&self, from: &[Vector3<f64>; 4], to: &[Vector3<f64>; 4]) -> f64 {
        let moves = [0, 1, 2, 3].map(|k| to[k] - from[k]);
        if moves.iter().flatten().any(|c| !c.is_finite()) {
            return 0.0;
        }
        let relative_m = self.relative_m(&moves);
        let boxes_m = self.boxes_apart_m(from);
        if boxes_m > 0.0 && boxes_m - relative_m >= margin_m(boxes_m) {
            return 1.0; // Spares the nearest places, which are no nearer.
        }
        let first = self.nearest(from);
        let margin_m = margin_m(first.distance_m);
        if first.distance_m - relative_m >= margin_m {
            return 1.0;
        }
        // A plane that parts them before and after parts them all the way: motion is linear.
        if first.distance_m > 0.0 {
            let normal = first.offset / first.distance_m;
            if self.parted_m(from, &normal).min(self.parted_m(to, &normal)) >= 0.99 * margin_m {
                return 1.0;
            }
        }
        let mean = moves.iter().sum::<Vector3<f64>>() / 4.0;
        let mut share = 0.0;
        for advance in 0..ADVANCES {
            let at = [0, 1, 2, 3].map(|k| from[k] + (moves[k] - mean) * share);
            let free_m = self.nearest(&at).distance_m - margin_m;
            if free_m.is_nan() || free_m <= 0.0 {
                return if advance == 0 { 0.0 } else { 0.98 * share };
            }
            let step = STEP * free_m / relative_m;
            if step < 1e-4 {
                return share;
            }
            share += step;
            if share >= 1.0 {
                return 1.0;
            }
        }
        share
    }
}

/// How near a pair may come in one step, metres.
pub(crate) fn margin_m(distance_m: f64) -> f64 {
    distance_m.min(HOLD_M).max(distance_m * (1.0 - APPROACH))
}

/// Nearest point of triangle p[1..] to p[0]. Source: Ericson, Real-Time Collision Detection, 5.1.5.
fn triangle_weights(p: &[Vector3<f64>; 4]) -> [f64; 4] {
    let [x, a, b, c] = p;
    let (ab, ac) = (b - a, c - a);
    let at = |d: Vector3<f64>| (ab.dot(&d), ac.dot(&d));
    let ((d1, d2), (d3, d4), (d5, d6)) = (at(x - a), at(x - b), at(x - c));
    let weights = |v: f64, w: f64| [1.0, v + w - 1.0, -v, -w];
    if d1 <= 0.0 && d2 <= 0.0 {
        return weights(0.0, 0.0);
    }
    if d3 >= 0.0 && d4 <= d3 {
        return weights(1.0, 0.0);
    }
    if d6 >= 0.0 && d5 <= d6 {
        return weights(0.0, 1.0);
    }
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return weights(d1 / (d1 - d3), 0.0);
    }
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return weights(0.0, d2 / (d2 - d6));
    }
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return weights(1.0 - w, w);
    }
    let sum = va + vb + vc;
    weights(vb / sum, vc / sum)
}

/// Nearest points of segments p[0]p[1] and p[2]p[3]: inside both, or at one of four ends.
fn edge_weights(p: &[Vector3<f64>; 4]) -> [f64; 4] {
    let (e, f, r) = (p[1] - p[0], p[3] - p[2], p[0] - p[2]);
    let (ee, ff, ef, er, fr) = (e.dot(&e), f.dot(&f), e.dot(&f), e.dot(&r), f.dot(&r));
    let weights = |s: f64, t: f64| [1.0 - s, s, t - 1.0, -t];
    let det = ee * ff - ef * ef;
    if det > 1e-9 * ee * ff {
        let (s, t) = ((ef * fr - er * ff) / det, (ee * fr - ef * er) / det);
        if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
            return weights(s, t);
        }
    }
    let share = |above: f64, below: f64| {
        if below > 0.0 { (above / below).clamp(0.0, 1.0) } else { 0.0 }
    };
    let ends = [
        (0.0, share(fr, ff)),
        (1.0, share(fr + ef, ff)),
        (share(-er, ee), 0.0),
        (share(ef - er, ee), 1.0),
    ];
    let distance2 = |(s, t): (f64, f64)| (r + e * s - f * t).norm_squared();
    let nearest = |a: (f64, f64), b: (f64, f64)| if distance2(b) < distance2(a) { b } else { a };
    let (s, t) = ends.into_iter().reduce(nearest).unwrap_or((0.0, 0.0));
    weights(s, t)
}

#[cfg(test)]
mod tests {
    use super::*;

    const VT: Pair = Pair { nodes: [0, 1, 2, 3], edges: false };
    const EE: Pair = Pair { nodes: [0, 1, 2, 3], edges: true };

    fn points(p: [[f64; 3]; 4]) -> [Vector3<f64>; 4] {
        p.map(Vector3::from)
    }

    #[test]
    fn distances_by_hand() {
        let corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        // Above the inside, beyond a side, beyond a corner.
        for (x, distance_m) in
            [([0.5, 0.5, 3.0], 3.0), ([1.0, -4.0, 3.0], 5.0), ([-3.0, 0.0, 4.0], 5.0)]
        {
            let p = points([x, corners[0], corners[1], corners[2]]);
            assert!((VT.nearest(&p).distance_m - distance_m).abs() < 1e-12);
        }
        // Crossing, beside each other's ends, parallel.
        let first = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        for (second, distance_m) in [
            ([[0.0, -1.0, 2.0], [0.0, 1.0, 2.0]], 2.0),
            ([[4.0, 4.0, 0.0], [4.0, 9.0, 0.0]], 5.0),
            ([[-5.0, 1.0, 0.0], [5.0, 1.0, 0.0]], 1.0),
        ] {
            let p = points([first[0], first[1], second[0], second[1]]);
            assert!((EE.nearest(&p).distance_m - distance_m).abs() < 1e-12);
        }
    }

    #[test]
    fn a_motion_through_is_stopped_before_and_one_together_is_free() {
        let from = points([[0.3, 0.3, 0.1], [0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let mut to = from;
        to[0].z = -0.1;
        let share = VT.free_share(&from, &to);
        // The distance may fall from 0.1 to 0.02, after 0.4 of the way.
        assert!(0.3 < share && share <= 0.4, "{share}");
        let together = from.map(|p| p + Vector3::new(0.0, 0.0, -7.0));
        assert_eq!(VT.free_share(&from, &together), 1.0);
        // What already touches may not come nearer, but may part.
        let mut touching = from;
        touching[0].z = 1e-7;
        assert_eq!(VT.free_share(&touching, &to), 0.0);
        let nan = to.map(|_| Vector3::repeat(f64::NAN));
        assert_eq!(VT.free_share(&from, &nan), 0.0);
    }
}
