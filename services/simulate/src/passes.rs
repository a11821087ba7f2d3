//! What a substep does to the nodes, pass by pass; `simulator.rs` has the equations.

use crate::links::{Colour, Hold};
use crate::params::TrackParams;
use orime_creases::Folds;

/// Virtual zero-rest-length springs to the targets, with a capped acceleration.
pub(crate) fn pull(
    track: &TrackParams,
    targets: &[(u32, f32, [f32; 3])],
    dt_s: f32,
    x: &mut [[f32; 3]],
) {
    let omega_dt = std::f32::consts::TAU * track.frequency_hz as f32 * dt_s;
    let move_max_m = track.acceleration_max_m_per_s2 as f32 * dt_s * dt_s;
    for (node, confidence, target) in targets {
        let stiffness = omega_dt * omega_dt * confidence;
        let ratio = stiffness / (1.0 + stiffness);
        let x = &mut x[*node as usize];
        let offset = [0, 1, 2].map(|axis| (target[axis] - x[axis]) * ratio);
        let length = offset.iter().map(|c| c * c).sum::<f32>().sqrt();
        let cap = if length > move_max_m { move_max_m / length } else { 1.0 };
        for axis in 0..3 {
            x[axis] += offset[axis] * cap;
        }
    }
}

/// Every node goes that share of the way to its place.
pub(crate) fn hold(share: f32, places: &[(u32, f32, [f32; 3])], x: &mut [[f32; 3]]) {
    for (node, _, place) in places {
        let x = &mut x[*node as usize];
        for axis in 0..3 {
            x[axis] += share * (place[axis] - x[axis]);
        }
    }
}

/// Projects one colour of distance links.
pub(crate) fn project(
    colour: &Colour,
    weight_per_kg: f32,
    alpha_per_kg: f32,
    gamma: f32,
    x: &mut [[f32; 3]],
    before: &[[f32; 3]],
) {
    let denominator = (1.0 + gamma) * 2.0 * weight_per_kg + alpha_per_kg;
    for ((ends, rest_m), hold) in colour.ends.iter().zip(&colour.rest_m).zip(&colour.holds) {
        let [a, b] = ends.map(|n| n as usize);
        let (xa, xb, oa, ob) = (x[a], x[b], before[a], before[b]);
        let d = [xb[0] - xa[0], xb[1] - xa[1], xb[2] - xa[2]];
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        let violation = length - rest_m;
        let idle = match hold {
            Hold::Length => false,
            Hold::Growth => violation <= 0.0,
            Hold::Nothing => true,
        };
        if idle || length < 1e-9 {
            continue; // Coincident nodes have no direction; their other links part them.
        }
        let closing = d[0] * ((xb[0] - ob[0]) - (xa[0] - oa[0]))
            + d[1] * ((xb[1] - ob[1]) - (xa[1] - oa[1]))
            + d[2] * ((xb[2] - ob[2]) - (xa[2] - oa[2]));
        let s = (violation + gamma * closing / length) / denominator; // [kg m]
        let scale = weight_per_kg * s / length;
        for axis in 0..3 {
            x[a][axis] = xa[axis] + scale * d[axis];
            x[b][axis] = xb[axis] - scale * d[axis];
        }
    }
}

/// Moves each facet's nodes that share of the way to the facet's best rigid pose.
pub(crate) fn hold_facets(
    folds: &Folds,
    strength: f64,
    forward: bool,
    uv_m: &[[f64; 2]],
    x: &mut [[f32; 3]],
) {
    let count = folds.facets().len();
    for at in 0..count {
        let facet = if forward { at } else { count - 1 - at };
        if folds.members(facet).len() < 3 {
            continue;
        }
        let frame = folds.frame(facet, x);
        for node in folds.members(facet) {
            let node = *node as usize;
            let goal = frame.position_m(uv_m[node]);
            for axis in 0..3 {
                let way = goal[axis] - f64::from(x[node][axis]);
                x[node][axis] += (strength * way) as f32;
            }
        }
    }
}

/// Lifts nodes out of the table and shortens their way along it, no further than back to where
/// they were.
pub(crate) fn rest_on_table(height_m: f32, friction: f32, before: &[[f32; 3]], x: &mut [[f32; 3]]) {
    for (x, before) in x.iter_mut().zip(before) {
        let depth_m = height_m - x[2];
        if depth_m > 0.0 {
            x[2] = height_m;
            let way = [x[0] - before[0], x[1] - before[1]];
            let length = way[0].hypot(way[1]);
            let share = if length > 0.0 { (friction * depth_m / length).min(1.0) } else { 0.0 };
            x[0] -= share * way[0];
            x[1] -= share * way[1];
        }
    }
}
