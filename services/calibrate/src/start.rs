//! The first guess: which poses of markers, cameras and targets go together, by votes.
//!
//! Every view has up to two poses, one of them false. A relation between two markers or two
//! cameras is seen again and again; the true candidates agree with each other, the false ones with
//! nothing. Relations are chained along the tree of most votes.

use std::collections::{BTreeMap, BTreeSet};

use orime_geometry::nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

use orime_capture::TargetKind;

use crate::observe::{Observations, View};

/// Candidates that agree turn by less than this, radians.
const AGREE_RAD: f64 = 0.25;
/// Most candidates of a relation that are compared with each other.
const CANDIDATES_MAX: usize = 600;

/// A pose of the target that several views share.
pub type TargetKey = (u64, Option<u32>);

/// Which target pose a view is of.
pub fn target_key(kind: TargetKind, view: &View) -> TargetKey {
    (view.step, (kind == TargetKind::Free).then_some(view.id))
}

/// Where everything is, roughly.
#[derive(Debug, Clone)]
pub struct Layout {
    /// Maps a camera's colour frame into that of camera 0; `None` where no chain of views leads.
    pub first_from_camera: Vec<Option<Isometry3<f64>>>,
    /// Maps a marker into the target.
    pub target_from_marker: BTreeMap<u32, Isometry3<f64>>,
    /// Maps the target into camera 0.
    pub first_from_target: BTreeMap<TargetKey, Isometry3<f64>>,
}

/// Chains what was seen to a first guess.
pub fn layout(seen: &Observations, kind: TargetKind) -> Layout {
    let target_from_marker = match kind {
        TargetKind::Rigid => markers(seen),
        TargetKind::Free => seen.views.iter().map(|v| (v.id, Isometry3::identity())).collect(),
    };
    // What each camera thinks of each target pose.
    let mut by_target: BTreeMap<TargetKey, Vec<(usize, Isometry3<f64>)>> = BTreeMap::new();
    for view in &seen.views {
        let Some(marker) = target_from_marker.get(&view.id) else { continue };
        let poses = view.poses.iter().map(|pose| pose.camera_from_marker * marker.inverse());
        let entry = by_target.entry(target_key(kind, view)).or_default();
        entry.extend(poses.map(|pose| (view.camera, pose)));
    }
    let first_from_camera = cameras(&by_target, seen);
    let mut first_from_target = BTreeMap::new();
    for (key, candidates) in &by_target {
        let views: Vec<&View> = seen.views.iter().filter(|v| target_key(kind, v) == *key).collect();
        let placed = candidates.iter().filter_map(|(c, pose)| Some(first_from_camera[*c]? * pose));
        let error = |pose: &Isometry3<f64>| -> f64 {
            let each = views.iter().filter_map(|view| {
                let camera = first_from_camera[view.camera]?;
                let marker = target_from_marker.get(&view.id)?;
                Some(view_error(view, &(camera.inverse() * pose * marker), seen.side_m))
            });
            each.sum()
        };
        let best = placed.map(|pose| (error(&pose), pose)).min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, pose)) = best {
            first_from_target.insert(*key, pose);
        }
    }
    Layout { first_from_camera, target_from_marker, first_from_target }
}

/// How badly a pose explains a view's corners: capped squares of distances at z = 1.
fn view_error(view: &View, camera_from_marker: &Isometry3<f64>, side_m: f64) -> f64 {
    let corners = crate::square::corners_m(side_m);
    let each = corners.iter().zip(&view.rays).map(|(corner, ray)| {
        let p = camera_from_marker * corner;
        if p.z <= 1e-6 { 1.0 } else { (p.coords.xy() / p.z - ray).norm_squared() * 1e4 }
    });
    each.map(|e| e.min(1.0)).sum()
}

/// Where every marker sits on the body, the most seen one being its origin.
fn markers(seen: &Observations) -> BTreeMap<u32, Isometry3<f64>> {
    let mut images: BTreeMap<(u64, usize), Vec<&View>> = BTreeMap::new();
    let mut count: BTreeMap<u32, usize> = BTreeMap::new();
    for view in &seen.views {
        images.entry((view.step, view.camera)).or_default().push(view);
        *count.entry(view.id).or_default() += 1;
    }
    let mut relations: BTreeMap<(u32, u32), Vec<Candidate>> = BTreeMap::new();
    for (group, views) in images.values().enumerate() {
        for (k, a) in views.iter().enumerate() {
            for b in &views[k + 1..] {
                let (a, b) = if a.id < b.id { (a, b) } else { (b, a) };
                let of_pair = relations.entry((a.id, b.id)).or_default();
                for x in &a.poses {
                    let inverse = x.camera_from_marker.inverse();
                    let with = |y: &crate::square::SquarePose| inverse * y.camera_from_marker;
                    of_pair.extend(b.poses.iter().map(|y| Candidate { group, pose: with(y) }));
                }
            }
        }
    }
    let agree_m = seen.side_m;
    let agreed: BTreeMap<_, _> = relations
        .into_iter()
        .filter_map(|(pair, candidates)| Some((pair, consensus(&candidates, agree_m)?)))
        .collect();
    let root = count.iter().max_by_key(|(id, n)| (**n, std::cmp::Reverse(**id))).map(|(id, _)| *id);
    root.map(|root| spanning_tree(root, &agreed)).unwrap_or_default()
}

/// Where every camera stands relative to camera 0.
fn cameras(
    by_target: &BTreeMap<TargetKey, Vec<(usize, Isometry3<f64>)>>,
    seen: &Observations,
) -> Vec<Option<Isometry3<f64>>> {
    let mut relations: BTreeMap<(usize, usize), Vec<Candidate>> = BTreeMap::new();
    for (group, poses) in by_target.values().enumerate() {
        for (a, a_from_target) in poses {
            for (b, b_from_target) in poses.iter().filter(|(b, _)| a < b) {
                let pose = a_from_target * b_from_target.inverse();
                relations.entry((*a, *b)).or_default().push(Candidate { group, pose });
            }
        }
    }
    // Far apart cameras turn a marker's small error of angle into a large one of place.
    let distance_m = |pose: &Isometry3<f64>| pose.translation.vector.norm();
    let agreed: BTreeMap<_, _> = relations
        .into_iter()
        .filter_map(|(pair, candidates)| {
            let mean = candidates.iter().map(|c| distance_m(&c.pose)).sum::<f64>();
            let agree_m = 0.15 * mean / candidates.len() as f64 + seen.side_m;
            Some((pair, consensus(&candidates, agree_m)?))
        })
        .collect();
    let tree = spanning_tree(0, &agreed);
    (0..seen.cameras.len()).map(|camera| tree.get(&camera).copied()).collect()
}

/// One sight of a relation; of one group at most one candidate is true.
#[derive(Debug, Clone)]
struct Candidate {
    group: usize,
    pose: Isometry3<f64>,
}

/// The relation with the most votes (one a group), averaged over those who voted.
fn consensus(candidates: &[Candidate], agree_m: f64) -> Option<(Isometry3<f64>, usize)> {
    let stride = candidates.len().div_ceil(CANDIDATES_MAX).max(1);
    let agree = |a: &Candidate, b: &Candidate| {
        (a.pose.translation.vector - b.pose.translation.vector).norm() < agree_m
            && a.pose.rotation.angle_to(&b.pose.rotation) < AGREE_RAD
    };
    let voters =
        |a: &Candidate| -> Vec<&Candidate> { candidates.iter().filter(|b| agree(a, b)).collect() };
    let votes =
        |voters: &[&Candidate]| voters.iter().map(|c| c.group).collect::<BTreeSet<_>>().len();
    let tries = candidates.iter().step_by(stride).map(voters);
    // The first of equals, so that results repeat.
    let best = tries.map(|v| (votes(&v), v)).reduce(|a, b| if b.0 > a.0 { b } else { a })?;
    Some((mean(best.1.iter().map(|c| &c.pose)), best.0))
}

/// Mean of poses that are near each other.
fn mean<'a>(poses: impl Iterator<Item = &'a Isometry3<f64>>) -> Isometry3<f64> {
    let (mut translation, mut rotation, mut n) = (Vector3::zeros(), Quaternion::default(), 0.0);
    for pose in poses {
        let q = pose.rotation.into_inner();
        let sign = if rotation.coords.dot(&q.coords) < 0.0 { -1.0 } else { 1.0 };
        rotation.coords += q.coords * sign;
        translation += pose.translation.vector;
        n += 1.0;
    }
    let translation = Translation3::from(translation / f64::max(n, 1.0));
    Isometry3::from_parts(translation, UnitQuaternion::from_quaternion(rotation))
}

/// Chains relations `a_from_b` from `root` outwards, those with the most votes first.
fn spanning_tree<K: Ord + Copy>(
    root: K,
    relations: &BTreeMap<(K, K), (Isometry3<f64>, usize)>,
) -> BTreeMap<K, Isometry3<f64>> {
    let mut placed = BTreeMap::from([(root, Isometry3::identity())]);
    loop {
        let next = relations
            .iter()
            .filter(|((a, b), _)| placed.contains_key(a) != placed.contains_key(b))
            .reduce(|x, y| if y.1.1 > x.1.1 { y } else { x });
        let Some(((a, b), (a_from_b, _))) = next else { return placed };
        match (placed.get(a).copied(), placed.get(b).copied()) {
            (Some(to_a), None) => placed.insert(*b, to_a * a_from_b),
            (None, Some(to_b)) => placed.insert(*a, to_b * a_from_b.inverse()),
            _ => return placed,
        };
    }
}
