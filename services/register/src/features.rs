//! Recognised points of a printed sheet: several cameras' into one position per node, and a pose
//! from them alone.
//!
//! This is the paper's variant with ArUco features: each feature says which node it is, so that
//! nothing has to be associated. What cameras say about a node is merged without those that lie
//! off ([`merge`]); who stands alone must agree with the prediction.

mod merge;

use nalgebra::{Point3, Vector3};
use orime_geometry::{Feature, RgbdCamera, SheetGrid, fit};

use crate::isometry::Isometry;
use crate::params::RegisterParams;
use merge::{Limits, Sight, merge};

/// Cameras that agree about a node are this near to each other, share of the sheet's side.
const AGREE: f64 = 0.04;

/// A lone camera's feature must be this near to the prediction, share of the side.
const GATE: f32 = 0.1;

/// A camera's offset is learnt from nodes that this many agree about, if it sees so many of them;
/// the share of the residual by which it follows.
const OFFSET_CAMERAS_MIN: usize = 2;
const OFFSET_NODES_MIN: f64 = 8.0;
const OFFSET_RATE: f64 = 0.1;

/// Fewest nodes from which a pose is found.
const POSE_NODES_MIN: usize = 12;

/// Most that a pose found from features alone may leave of them (median), share of the side.
const POSE_ERROR_MAX: f32 = 0.03;

/// Rounds of the rigid fit, and the residual at which a node counts half, share of the side.
const RIGID_ROUNDS: usize = 20;
const RIGID_HALF: f64 = 0.03;

/// How far seen nodes carry others along: the deviation s, share of the side.
const CARRY: f32 = 0.04;

/// Rounds in which a flat sheet is bent to the features.
const BEND_ROUNDS: usize = 60;

/// A node's position by all cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fused {
    pub node: usize,
    /// World frame, metres.
    pub position_m: [f32; 3],
}

/// How fusing one step went.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct FusionReport {
    /// Features that are not finite, or of a node that the sheet does not have.
    pub rejected: u32,
    /// Share of the others that a fused position rests on.
    pub used_ratio: f32,
    /// Root mean square distance of these from it, metres.
    pub spread_m: f32,
}

/// Fuses features; keeps its room.
#[derive(Debug, Clone)]
pub(crate) struct Fusion {
    side_m: f32,
    isometry: Isometry,
    isometry_sweeps: u32,
    flat: Vec<Point3<f64>>,
    limits: Limits,
    sights: Vec<Sight>,
    /// By how much each camera sees everything displaced, world frame, metres: its calibration
    /// and its depth err. Learnt from what several see.
    offsets_m: Vec<Vector3<f64>>,
    /// Sum and number of each camera's residuals in this step.
    residuals_m: Vec<(Vector3<f64>, f64)>,
    /// The nodes that were seen in the last step, ascending.
    pub nodes: Vec<Fused>,
}

impl Fusion {
    /// `rest_m`: the sheet as it was made.
    pub fn new(params: &RegisterParams, sheet: &SheetGrid, rest_m: &[[f32; 3]]) -> Self {
        let side_m = (sheet.size_m[0] + sheet.size_m[1]) / 2.0;
        Self {
            side_m: side_m as f32,
            isometry: Isometry::new(sheet, rest_m, params.flatness),
            isometry_sweeps: params.isometry_sweeps.max(1),
            flat: rest_m.iter().map(|p| Point3::from(*p).cast()).collect(),
            limits: Limits {
                ray_error_ratio: params.ray_error_ratio,
                agree_m: AGREE * side_m,
                gate_m: f64::from(GATE) * side_m,
            },
            sights: Vec::new(),
            offsets_m: Vec::new(),
            residuals_m: Vec::new(),
            nodes: Vec::with_capacity(sheet.len()),
        }
    }

    /// Fuses the features of one step, seen by `cameras`, into `nodes`.
    pub fn fuse(
        &mut self,
        features: &[Feature],
        cameras: &[RgbdCamera],
        predicted_m: Option<&[[f32; 3]]>,
    ) -> FusionReport {
        self.offsets_m.resize(cameras.len(), Vector3::zeros());
        self.sights.clear();
        for feature in features {
            let is_sound = feature.position_m.iter().all(|c| c.is_finite())
                && (feature.node as usize) < self.flat.len();
            if is_sound {
                let camera = feature.camera as usize;
                let seen_m = Vector3::from(feature.position_m).cast::<f64>();
                let eye_m = cameras.get(camera).map(|c| c.world_from_color.translation.vector);
                let ray = eye_m.and_then(|eye_m| (seen_m - eye_m).try_normalize(1e-6));
                self.sights.push(Sight {
                    node: feature.node,
                    camera: feature.camera,
                    position_m: seen_m - self.offsets_m.get(camera).copied().unwrap_or_default(),
                    ray: ray.unwrap_or_default(),
                });
            }
        }
        self.sights.sort_by_key(|sight| (sight.node, sight.camera));
        self.merge(predicted_m, features.len())
    }

    /// Merges the sights by node.
    fn merge(&mut self, predicted_m: Option<&[[f32; 3]]>, features: usize) -> FusionReport {
        self.nodes.clear();
        self.residuals_m.clear();
        self.residuals_m.resize(self.offsets_m.len(), (Vector3::zeros(), 0.0));
        let rejected = (features - self.sights.len()) as u32;
        let (mut used, mut squares) = (0, 0.0);
        for group in self.sights.chunk_by_mut(|a, b| a.node == b.node) {
            let node = group[0].node as usize;
            let predicted = predicted_m.map(|nodes_m| Vector3::from(nodes_m[node]).cast::<f64>());
            let Some((position_m, count)) = merge(group, predicted, &self.limits) else { continue };
            for sight in &group[..count] {
                squares += sight.distance_m(&position_m, &self.limits).powi(2);
                let residual = self.residuals_m.get_mut(sight.camera as usize);
                if let Some((sum, weight)) = residual.filter(|_| count >= OFFSET_CAMERAS_MIN) {
                    *sum += sight.position_m - position_m;
                    *weight += 1.0;
                }
            }
            used += count;
            self.nodes.push(Fused { node, position_m: position_m.cast::<f32>().into() });
        }
        for (offset_m, (sum, weight)) in self.offsets_m.iter_mut().zip(&self.residuals_m) {
            if *weight >= OFFSET_NODES_MIN {
                let limit_m = f64::from(GATE * self.side_m);
                *offset_m = (*offset_m + sum * (OFFSET_RATE / weight)).cap_magnitude(limit_m);
            }
        }
        FusionReport {
            rejected,
            used_ratio: used as f32 / self.sights.len().max(1) as f32,
            spread_m: (squares / used.max(1) as f64).sqrt() as f32,
        }
    }

    /// Share of the fused nodes that lie near where `nodes_m` has them; 1 for none.
    pub fn agreement(&self, nodes_m: &[[f32; 3]]) -> f32 {
        let near = |f: &&Fused| distance(f.position_m, nodes_m[f.node]) <= GATE * self.side_m;
        let count = self.nodes.iter().filter(near).count();
        if self.nodes.is_empty() { 1.0 } else { count as f32 / self.nodes.len() as f32 }
    }

    /// Gives nodes that were not seen a target with a confidence of up to `confidence_max`: where
    /// they are in `state_m`, moved as the seen nodes near them in space are to move.
    ///
    /// w[h,k] = exp(−|x[h] − x[k]|²/2s²),  target[h] = x[h] + Σ_k w (t[k] − x[k]) / Σ_k w
    ///
    /// O(hidden · seen).
    pub fn carry(
        &self,
        state_m: &[[f32; 3]],
        confidence_max: f32,
        targets_m: &mut [[f32; 3]],
        confidence: &mut [f32],
    ) {
        let two_s2_m2 = 2.0 * (CARRY * self.side_m).powi(2);
        for (h, x) in state_m.iter().enumerate() {
            if confidence[h] == 1.0 {
                continue;
            }
            let (mut total, mut moved) = (0.0, [0.0; 3]);
            for seen in &self.nodes {
                let at = state_m[seen.node];
                let weight = (-distance(*x, at).powi(2) / two_s2_m2).exp();
                total += weight;
                (0..3).for_each(|k| moved[k] += weight * (seen.position_m[k] - at[k]));
            }
            if total > 1e-3 {
                targets_m[h] = [0, 1, 2].map(|k| x[k] + moved[k] / total);
                confidence[h] = confidence_max * total.min(1.0);
            }
        }
    }

    /// A pose of every node from the fused ones alone: the flat sheet where most of them are,
    /// bent to the others without stretching it. `None` where they are too few or do not fit.
    pub fn pose(&mut self) -> Option<Vec<[f32; 3]>> {
        if self.nodes.len() < POSE_NODES_MIN {
            return None;
        }
        let source: Vec<Point3<f64>> = self.nodes.iter().map(|f| self.flat[f.node]).collect();
        let target: Vec<Point3<f64>> =
            self.nodes.iter().map(|f| Point3::from(f.position_m).cast()).collect();
        let half_m2 = (RIGID_HALF * f64::from(self.side_m)).powi(2);
        let mut weights = vec![1.0; source.len()];
        let mut motion = fit::rigid(&source, &target, |k| weights[k])?;
        for _ in 0..RIGID_ROUNDS {
            for ((weight, s), t) in weights.iter_mut().zip(&source).zip(&target) {
                *weight = half_m2 / (half_m2 + (motion * s - t).norm_squared());
            }
            motion = fit::rigid(&source, &target, |k| weights[k])?;
        }
        let mut nodes_m: Vec<[f32; 3]> =
            self.flat.iter().map(|p| (motion * p).coords.cast::<f32>().into()).collect();
        for _ in 0..BEND_ROUNDS {
            for fused in &self.nodes {
                let node = &mut nodes_m[fused.node];
                *node = mean([*node, fused.position_m].into_iter());
            }
            self.isometry.project(&mut nodes_m, self.isometry_sweeps);
        }
        let mut errors: Vec<f32> =
            self.nodes.iter().map(|f| distance(f.position_m, nodes_m[f.node])).collect();
        let middle = errors.len() / 2;
        let median = *errors.select_nth_unstable_by(middle, f32::total_cmp).1;
        (median <= POSE_ERROR_MAX * self.side_m).then_some(nodes_m)
    }
}

fn mean(positions: impl Iterator<Item = [f32; 3]>) -> [f32; 3] {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for position in positions {
        (0..3).for_each(|axis| sum[axis] += position[axis]);
        count += 1.0;
    }
    sum.map(|s| s / f32::max(count, 1.0))
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f32>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, UnitQuaternion};

    fn fusion() -> (Fusion, SheetGrid) {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        (Fusion::new(&RegisterParams::default(), &sheet, &sheet.flat_m()), sheet)
    }

    /// Every other node of a sheet that is folded by `fold_rad` about its middle, in some pose.
    fn folded(sheet: &SheetGrid, fold_rad: f32) -> (Vec<[f32; 3]>, Vec<Feature>) {
        let turn = UnitQuaternion::from_euler_angles(0.4, -0.3, 2.1);
        let pose = Isometry3::from_parts(nalgebra::Vector3::new(0.1, -0.2, 0.6).into(), turn);
        let place = |[x, y, _]: [f32; 3]| {
            let (sin, cos) = fold_rad.sin_cos();
            let local = if x > 0.0 { [x * cos, y, x * sin] } else { [x, y, 0.0] };
            (pose * Point3::from(local)).into()
        };
        let truth: Vec<[f32; 3]> = sheet.flat_m().into_iter().map(place).collect();
        let control = |n: &usize| (n / 25).is_multiple_of(2) && (n % 25).is_multiple_of(2);
        let feature =
            |n: usize| Feature { position_m: truth[n], node: n as u32, camera: 0, pixels: 100.0 };
        let features = (0..sheet.len()).filter(control).map(feature).collect();
        (truth, features)
    }

    #[test]
    fn a_pose_is_found_from_features_alone_flat_or_folded() {
        for (fold_rad, worst_m) in [(0.0, 1e-4), (1.2, 0.004)] {
            let (mut fusion, sheet) = fusion();
            let (truth, mut features) = folded(&sheet, fold_rad);
            features[7].position_m[2] = f32::NAN;
            features[9].node = 9999;
            let report = fusion.fuse(&features, &[], None);
            assert_eq!((report.rejected, report.used_ratio), (2, 1.0));
            assert_eq!(fusion.nodes.len(), 167);
            let pose = fusion.pose().unwrap();
            let error = |(a, b): (&[f32; 3], &[f32; 3])| distance(*a, *b);
            let worst = pose.iter().zip(&truth).map(error).fold(0.0, f32::max);
            assert!(worst < worst_m, "folded by {fold_rad}: {worst} m");
            assert_eq!(fusion.agreement(&truth), 1.0);
        }
        let (mut fusion, sheet) = fusion();
        let (_, features) = folded(&sheet, 0.0);
        fusion.fuse(&features[..8], &[], None);
        assert_eq!(fusion.pose(), None);
    }

    #[test]
    fn features_that_fit_no_sheet_give_no_pose() {
        let (mut fusion, sheet) = fusion();
        let (_, mut features) = folded(&sheet, 0.0);
        for (k, feature) in features.iter_mut().enumerate() {
            feature.position_m[k % 3] += 0.2 * ((k as f32 * 78.233).sin() * 43758.547).fract();
        }
        fusion.fuse(&features, &[], None);
        assert_eq!(fusion.pose(), None);
    }

    #[test]
    fn hidden_nodes_move_with_the_seen_ones_near_them() {
        let (mut fusion, sheet) = fusion();
        let (state, features) = folded(&sheet, 0.0);
        let moved = |f: &Feature| {
            let mut f = *f;
            f.position_m[0] += 0.003;
            f
        };
        let features: Vec<Feature> = features[..60].iter().map(moved).collect();
        fusion.fuse(&features, &[], Some(&state));
        let (mut targets, mut confidence) = (state.clone(), vec![0.0; state.len()]);
        fusion.carry(&state, 0.05, &mut targets, &mut confidence);
        // Node (1, 1) has seen nodes all round; the far corner has none near.
        assert!((targets[26][0] - state[26][0] - 0.003).abs() < 1e-6);
        assert!(confidence[26] > 0.04 && confidence[624] == 0.0);
    }
}
