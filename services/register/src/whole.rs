//! The sheet's motion as one rigid body, as a part of the M-step.
//!
//! A kernel in (u,v) says what neighbours in the sheet do alike. Where a folded sheet turns, layers
//! that lie on each other move alike, and neighbours across a crease against each other: it costs
//! the kernel as much as any deformation, so that a stack that is turned over fast was pulled out
//! of shape and left behind. So the prediction first moves as a whole, by t + ω × r about its
//! middle, and the kernel bends what is left:
//!
//! ```text
//! (Σ wₖ gₖgₖᵀ + σ²Λ) (t, ω) = Σ wₖ gₖ wayₖ,   g = (n, r × n),   Λ = 1/τ²
//! ```
//!
//! over the components' pulls (three rows each) and the contour's rows. τ is `rigid_error`, for ω
//! over half the sheet's side.

use crate::expectation::Components;
use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3, Vector6};

/// A rigid motion about a point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion {
    center_m: Vector3<f64>,
    turn: Rotation3<f64>,
    way_m: Vector3<f64>,
}

impl Motion {
    /// Where a point goes, metres.
    pub fn moved(&self, point_m: [f32; 3]) -> [f32; 3] {
        let arm_m = Vector3::from(point_m).cast::<f64>() - self.center_m;
        (self.turn * arm_m + self.center_m + self.way_m).cast::<f32>().into()
    }
}

/// The equations of a motion.
#[derive(Debug, Clone)]
pub(crate) struct Whole {
    center_m: Vector3<f64>,
    normal: Matrix6<f64>,
    right: Vector6<f64>,
}

impl Whole {
    /// About the middle of the nodes; nothing pulls yet.
    pub fn about(nodes_m: &[[f32; 3]]) -> Self {
        let sum: Vector3<f64> = nodes_m.iter().map(|p| Vector3::from(*p).cast::<f64>()).sum();
        let center_m = sum / nodes_m.len() as f64;
        Self { center_m, normal: Matrix6::zeros(), right: Vector6::zeros() }
    }

    /// What the E-step gave the components pulls at them.
    pub fn add_components(&mut self, components: &Components, weight: f64) {
        let Components { at_m: [x, y, z], mass, pull_m: [a, b, c], .. } = components;
        let (mut total, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
        let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
        for (m, mass) in mass.iter().enumerate().filter(|(_, mass)| **mass > 0.0) {
            let mass = f64::from(*mass);
            let arm = Vector3::new(x[m], y[m], z[m]).cast::<f64>() - self.center_m;
            let pull = Vector3::new(a[m], b[m], c[m]).cast::<f64>();
            total += mass;
            first += arm * mass;
            second += arm * (arm * mass).transpose();
            force += pull;
            torque += arm.cross(&pull);
        }
        // δ = t + ω × r = t − [r]ω
        let lever = -first.cross_matrix();
        let inertia = Matrix3::identity() * second.trace() - second;
        let add = |of: &mut Matrix6<f64>, at: (usize, usize), block: Matrix3<f64>| {
            let mut part = of.fixed_view_mut::<3, 3>(at.0, at.1);
            part += block * weight;
        };
        add(&mut self.normal, (0, 0), Matrix3::identity() * total);
        add(&mut self.normal, (0, 3), lever);
        add(&mut self.normal, (3, 0), lever.transpose());
        add(&mut self.normal, (3, 3), inertia);
        let [x, y, z, a, b, c] = [force.x, force.y, force.z, torque.x, torque.y, torque.z];
        self.right += Vector6::new(x, y, z, a, b, c) * weight;
    }

    /// A point that should go `way_m` along `normal`.
    pub fn add_row(&mut self, point_m: [f32; 3], normal: &Vector3<f64>, way_m: f64, weight: f64) {
        let turn = (Vector3::from(point_m).cast::<f64>() - self.center_m).cross(normal);
        let g = Vector6::new(normal.x, normal.y, normal.z, turn.x, turn.y, turn.z);
        self.normal += g * (g * weight).transpose();
        self.right += g * (weight * way_m);
    }

    /// The motion that is most likely where deviations of `way_m` and `angle_rad` are expected and
    /// pulls vary by `variance_m2`; `None` if nothing is finite.
    pub fn solve(mut self, variance_m2: f64, way_m: f64, angle_rad: f64) -> Option<Motion> {
        for k in 0..3 {
            self.normal[(k, k)] += variance_m2 / (way_m * way_m);
            self.normal[(3 + k, 3 + k)] += variance_m2 / (angle_rad * angle_rad);
        }
        let motion = self.normal.cholesky()?.solve(&self.right);
        let way_m = Vector3::new(motion[0], motion[1], motion[2]);
        let turn = Rotation3::new(Vector3::new(motion[3], motion[4], motion[5]));
        let is_finite = motion.iter().all(|c| c.is_finite());
        is_finite.then_some(Motion { center_m: self.center_m, turn, way_m })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Components that are pulled to where they would lie after a small motion, as they are given.
    fn pulled(turn_rad: [f64; 3], way_m: [f64; 3]) -> (Whole, Components) {
        let mut components = Components::new(64);
        let turn = Rotation3::new(Vector3::from(turn_rad));
        for m in 0..50 {
            let k = m as f64;
            let at = Vector3::new(0.07 * (k * 0.7).sin(), 0.05 * (1.3 * k).cos(), 0.001 * k);
            let to = turn * at + Vector3::from(way_m);
            components.mass[m] = 0.5 + (m % 3) as f32;
            for axis in 0..3 {
                components.at_m[axis][m] = at[axis] as f32;
                let pull = f64::from(components.mass[m]) * (to - at)[axis];
                components.pull_m[axis][m] = pull as f32;
            }
        }
        let mut whole = Whole::about(&[[0.0; 3]]);
        whole.add_components(&components, 0.2);
        (whole, components)
    }

    #[test]
    fn a_turned_and_shifted_cloud_is_met() {
        let (turn, way) = ([0.004, -0.006, 0.003], [0.001, 0.002, -0.0015]);
        let (whole, components) = pulled(turn, way);
        let motion = whole.solve(1e-12, 0.005, 0.07).unwrap();
        for m in 0..50 {
            let at = [0, 1, 2].map(|axis| components.at_m[axis][m]);
            let moved = motion.moved(at);
            for axis in 0..3 {
                let to = at[axis] + components.pull_m[axis][m] / components.mass[m];
                assert!((moved[axis] - to).abs() < 1e-5, "{moved:?} at {m}");
            }
        }
    }

    #[test]
    fn rows_move_along_their_normals_and_weak_pulls_little() {
        let mut whole = Whole::about(&[[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]);
        for x in [-0.05, 0.05] {
            whole.add_row([x, 0.0, 0.0], &Vector3::z(), 0.002, 3.0);
        }
        let near = |motion: Motion, z_m: f32| {
            let [x, y, z] = motion.moved([0.01, 0.02, 0.03]);
            assert!((x - 0.01).abs() < 1e-6 && (y - 0.02).abs() < 1e-6, "{motion:?}");
            assert!((z - 0.03 - z_m).abs() < 1e-5, "{motion:?}");
        };
        near(whole.clone().solve(1e-12, 0.005, 0.07).unwrap(), 0.002);
        near(whole.solve(1.0, 0.005, 0.07).unwrap(), 0.0);
        let nothing = Whole::about(&[[0.0; 3]]).solve(1e-6, 0.005, 0.07).unwrap();
        assert_eq!(nothing.moved([0.1, 0.2, 0.3]), [0.1, 0.2, 0.3]);
        let (mut spoilt, _) = pulled([0.0; 3], [0.0; 3]);
        spoilt.add_row([0.0; 3], &Vector3::z(), f64::NAN, 1.0);
        assert!(spoilt.solve(1e-6, 0.005, 0.07).is_none());
    }
}
