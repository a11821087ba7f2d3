//! What a finder makes of a scene.

use super::noise::Noise;
use super::scene::Scene;
use crate::finder::CreaseFinder;
use crate::line::Line;
use std::time::Instant;

/// A crease counts as found where a boundary is nearer than this, spacings.
const NEAR: f64 = 1.5;
/// Share of a group's creases that must be found.
const FOUND_SHARE: f64 = 0.8;

/// Figures of one run.
#[derive(Debug, Clone)]
pub struct Score {
    /// Fold angle of each group when it was found, degrees; `None` where it never was.
    pub found_deg: Vec<Option<f64>>,
    /// Facets or clusters at the end, and at most.
    pub facets: [usize; 2],
    /// Mean share of labels that changed in a step that kept the number of facets.
    pub flips: f64,
    /// Mean error of the final lines' directions, degrees.
    pub line_deg: f64,
    /// Mean error of the final lines' offset at the creases' middles, metres.
    pub line_m: f64,
    /// Mean and longest time of a step, milliseconds.
    pub step_ms: [f64; 2],
    /// Steps in which the folds changed.
    pub changes: usize,
}

/// Plays a scene with noise to a finder. `hidden` says how sure node `n` is at step `t`.
pub fn score(
    scene: &Scene,
    finder: &mut CreaseFinder,
    noise: &mut Noise,
    confidence: impl Fn(usize, usize) -> f32,
) -> Score {
    let sheet = &scene.sheet;
    let near_m = NEAR * sheet.spacing_m().into_iter().fold(0.0, f64::max);
    let samples: Vec<Vec<[f64; 2]>> = (0..scene.groups()).map(|g| points(scene, g)).collect();
    let mut found_deg = vec![None; samples.len()];
    let mut labels: Vec<u8> = finder.clusters().to_vec();
    let (mut flips, mut kept, mut most, mut changes) = (0.0, 0.0f64, 1, 0);
    let mut step_ms = [0.0f64; 2];
    let mut sure = vec![1.0; sheet.len()];
    for (t, exact_m) in scene.positions_m.iter().enumerate() {
        let seen_m = noise.add(exact_m);
        sure.iter_mut().enumerate().for_each(|(n, c)| *c = confidence(t, n));
        let start = Instant::now();
        changes += usize::from(finder.step(&seen_m, &sure));
        let ms = start.elapsed().as_secs_f64() * 1e3;
        step_ms = [step_ms[0] + ms / scene.positions_m.len() as f64, step_ms[1].max(ms)];
        let now = finder.clusters();
        if count(now) == count(&labels) {
            let changed = now.iter().zip(&labels).filter(|(a, b)| a != b).count();
            flips += changed as f64 / now.len() as f64;
            kept += 1.0;
        }
        most = most.max(count(now));
        labels.copy_from_slice(now);
        let borders = borders(scene, now);
        for (group, points) in samples.iter().enumerate() {
            let angle_deg = scene.angles_rad[t][group].to_degrees();
            let close =
                |p: &&[f64; 2]| borders.iter().any(|b| (b[0] - p[0]).hypot(b[1] - p[1]) < near_m);
            let share = points.iter().filter(close).count() as f64 / points.len() as f64;
            if found_deg[group].is_none() && share > FOUND_SHARE && angle_deg > 1.0 {
                found_deg[group] = Some(angle_deg);
            }
        }
    }
    let [line_deg, line_m] = line_errors(scene, finder, &labels);
    let facets = [count(&labels), most];
    Score { found_deg, facets, flips: flips / kept.max(1.0), line_deg, line_m, step_ms, changes }
}

fn count(labels: &[u8]) -> usize {
    let mut seen = [false; 256];
    labels.iter().for_each(|l| seen[usize::from(*l)] = true);
    seen.iter().filter(|s| **s).count()
}

/// Points along the creases of a group.
fn points(scene: &Scene, group: usize) -> Vec<[f64; 2]> {
    let creases = scene.creases.iter().filter(|crease| crease.group == group);
    creases
        .flat_map(|crease| {
            let [a, b] = crease.ends_m;
            (0..60).map(move |k| {
                let part = (f64::from(k) + 0.5) / 60.0;
                [0, 1].map(|axis| a[axis] + part * (b[axis] - a[axis]))
            })
        })
        .collect()
}

/// Middles between neighbouring nodes that have different labels.
fn borders(scene: &Scene, labels: &[u8]) -> Vec<[f64; 2]> {
    let uv: Vec<[f64; 2]> = scene.sheet.uv_m().collect();
    let mut middles = Vec::new();
    for ([a, b], _) in scene.sheet.edges() {
        let (a, b) = (a as usize, b as usize);
        if labels[a] != labels[b] {
            middles.push([0, 1].map(|axis| (uv[a][axis] + uv[b][axis]) / 2.0));
        }
    }
    middles
}

/// Mean errors of direction (degrees) and offset at the middle (metres) over the true creases:
/// of the finder's own line where it has one, else of the line through the labels' borders.
fn line_errors(scene: &Scene, finder: &CreaseFinder, labels: &[u8]) -> [f64; 2] {
    let near_m = NEAR * scene.sheet.spacing_m().into_iter().fold(0.0, f64::max);
    let borders = borders(scene, labels);
    let mut errors = [0.0; 2];
    let mut count = 0.0;
    for crease in &scene.creases {
        let [a, b] = crease.ends_m;
        let middle = [0, 1].map(|axis| (a[axis] + b[axis]) / 2.0);
        let truth = Line::through(a, b);
        let along =
            |p: &[f64; 2]| (p[0] - a[0]) * truth.direction[0] + (p[1] - a[1]) * truth.direction[1];
        let length_m = along(&b);
        let near: Vec<[f64; 2]> = borders
            .iter()
            .filter(|p| truth.side_m(**p).abs() < near_m && (0.0..=length_m).contains(&along(p)))
            .copied()
            .collect();
        let own = finder.folds().creases().iter().map(|crease| crease.line());
        let turned = |line: &Line| {
            let sine =
                line.direction[0] * truth.direction[1] - line.direction[1] * truth.direction[0];
            sine.abs().asin()
        };
        let apart = |line: &Line| line.side_m(middle).abs() + turned(line) * length_m / 2.0;
        let own = own.min_by(|p, q| apart(p).total_cmp(&apart(q)));
        let own = own.filter(|_| finder.cluster_fits().is_empty());
        if let Some(line) = own.or_else(|| through(&near)) {
            errors[0] += turned(&line).to_degrees();
            errors[1] += line.side_m(middle).abs();
            count += 1.0;
        }
    }
    if count == 0.0 { [f64::NAN; 2] } else { errors.map(|e| e / count) }
}

/// The line with the least squared distances from points.
fn through(points: &[[f64; 2]]) -> Option<Line> {
    let n = points.len() as f64;
    if points.len() < 3 {
        return None;
    }
    let center = [0, 1].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / n);
    let moment = |i: usize, j: usize| -> f64 {
        points.iter().map(|p| (p[i] - center[i]) * (p[j] - center[j])).sum()
    };
    let turn = 0.5 * (2.0 * moment(0, 1)).atan2(moment(0, 0) - moment(1, 1));
    Some(Line { point_m: center, direction: [turn.cos(), turn.sin()] })
}
