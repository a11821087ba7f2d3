//! Recognised points of a printed sheet: several cameras' into one position per node, and a pose
//! from them alone.
//!
//! This is the paper's variant with ArUco features: each feature says which node it is, so that
//! nothing has to be associated. What cameras say about a node is merged by its median, without
//! those that lie off it; who stands alone must agree with the prediction.

use nalgebra::Point3;
use orime_geometry::{Feature, SheetGrid, fit};

use crate::isometry::Isometry;
use crate::params::RegisterParams;

/// Cameras that agree about a node are this near to each other, share of the sheet's side.
const AGREE: f32 = 0.04;

/// A lone camera's feature must be this near to the prediction, share of the side.
const GATE: f32 = 0.1;

/// Fewest nodes from which a pose is found.
const POSE_NODES_MIN: usize = 12;

/// Most that a pose found from features alone may leave of them (median), share of the side.
const POSE_ERROR_MAX: f32 = 0.03;

/// Rounds of the rigid fit, and the residual at which a node counts half, share of the side.
const RIGID_ROUNDS: usize = 20;
const RIGID_HALF: f64 = 0.03;

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
#[derive(Debug)]
pub(crate) struct Fusion {
    side_m: f32,
    isometry: Isometry,
    isometry_sweeps: u32,
    flat: Vec<Point3<f64>>,
    sorted: Vec<Feature>,
    /// The nodes that were seen in the last step, ascending.
    pub nodes: Vec<Fused>,
}

impl Fusion {
    /// `rest_m`: the sheet as it was made.
    pub fn new(params: &RegisterParams, sheet: &SheetGrid, rest_m: &[[f32; 3]]) -> Self {
        Self {
            side_m: ((sheet.size_m[0] + sheet.size_m[1]) / 2.0) as f32,
            isometry: Isometry::new(sheet, rest_m, params.flatness),
            isometry_sweeps: params.isometry_sweeps.max(1),
            flat: rest_m.iter().map(|p| Point3::from(*p).cast()).collect(),
            sorted: Vec::new(),
            nodes: Vec::with_capacity(sheet.len()),
        }
    }

    /// Fuses the features of one step into `nodes`.
    pub fn fuse(&mut self, features: &[Feature], predicted_m: Option<&[[f32; 3]]>) -> FusionReport {
        let count = self.flat.len();
        let sound =
            |f: &&Feature| f.position_m.iter().all(|c| c.is_finite()) && (f.node as usize) < count;
        self.sorted.clear();
        self.sorted.extend(features.iter().filter(sound));
        self.sorted.sort_by_key(|f| (f.node, f.camera));
        self.nodes.clear();
        let (mut used, mut squares) = (0, 0.0);
        for group in self.sorted.chunk_by(|a, b| a.node == b.node) {
            let node = group[0].node as usize;
            let predicted = predicted_m.map(|nodes_m| nodes_m[node]);
            let Some(centre) = centre(group, predicted, self.side_m) else { continue };
            let near = |f: &&Feature| distance(f.position_m, centre) <= AGREE * self.side_m;
            let position_m = mean(group.iter().filter(near).map(|f| f.position_m));
            for feature in group.iter().filter(near) {
                squares += distance(feature.position_m, position_m).powi(2);
                used += 1;
            }
            self.nodes.push(Fused { node, position_m });
        }
        FusionReport {
            rejected: (features.len() - self.sorted.len()) as u32,
            used_ratio: used as f32 / self.sorted.len().max(1) as f32,
            spread_m: (squares / used.max(1) as f32).sqrt(),
        }
    }

    /// Share of the fused nodes that lie near where `nodes_m` has them; 1 for none.
    pub fn agreement(&self, nodes_m: &[[f32; 3]]) -> f32 {
        let near = |f: &&Fused| distance(f.position_m, nodes_m[f.node]) <= GATE * self.side_m;
        let count = self.nodes.iter().filter(near).count();
        if self.nodes.is_empty() { 1.0 } else { count as f32 / self.nodes.len() as f32 }
    }

    /// A pose of every node from the fused ones alone: the flat sheet where most of them are,
    /// bent to the others without stretching it. `None` where they are too few or do not fit.
    pub fn pose(&self) -> Option<Vec<[f32; 3]>> {
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

/// What most cameras say about a node: of three and more the median; of two that agree their mean;
/// else the one nearest to the prediction, if it is near.
fn centre(group: &[Feature], predicted_m: Option<[f32; 3]>, side_m: f32) -> Option<[f32; 3]> {
    let positions = || group.iter().map(|f| f.position_m);
    let middle = if group.len() >= 3 { median(positions()) } else { mean(positions()) };
    let near = positions().filter(|p| distance(*p, middle) <= AGREE * side_m).count();
    if near >= 2 {
        return Some(middle);
    }
    let Some(predicted) = predicted_m else {
        return (group.len() == 1).then_some(middle);
    };
    positions()
        .min_by(|a, b| distance(*a, predicted).total_cmp(&distance(*b, predicted)))
        .filter(|p| distance(*p, predicted) <= GATE * side_m)
}

/// Median of each coordinate.
fn median(positions: impl Iterator<Item = [f32; 3]> + Clone) -> [f32; 3] {
    let mut values = [0.0; CAMERAS_MAX];
    [0, 1, 2].map(|axis| {
        let mut count = 0;
        for (value, position) in values.iter_mut().zip(positions.clone()) {
            *value = position[axis];
            count += 1;
        }
        let values = &mut values[..count];
        values.sort_unstable_by(f32::total_cmp);
        (values[(count - 1) / 2] + values[count / 2]) / 2.0
    })
}

/// Most features of one node that count for its median.
const CAMERAS_MAX: usize = 16;

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
