//! Clusters as facets: straight cuts that part the labels best.

use crate::folds::{FACETS_MAX, Facet, Folds};
use crate::line::Line;

/// Share of nodes on the wrong side that a cut may leave.
const WRONG_MAX: f64 = 0.15;
/// A piece counts as one cluster once this share of its nodes is.
const PURE: f64 = 0.95;

/// Replaces the folds' facets by pieces that follow the labels as well as straight cuts can.
pub(crate) fn show(folds: &mut Folds, labels: &[u8]) {
    let sheet = folds.sheet().clone();
    let uv: Vec<[f64; 2]> = sheet.uv_m().collect();
    let [a, b] = sheet.size_m;
    let [h_u, h_v] = sheet.spacing_m();
    let whole = Facet { corners_m: vec![[0.0, 0.0], [a, 0.0], [a, b], [0.0, b]] };
    let mut open = vec![(whole, (0..uv.len()).collect::<Vec<usize>>())];
    let mut facets = Vec::new();
    while let Some((piece, members)) = open.pop() {
        let room = facets.len() + open.len() + 1 < FACETS_MAX;
        let cut = if room { best_cut(&uv, labels, &members) } else { None };
        let parts = cut.and_then(|line| Some((line, piece.cut(&line, 0.5 * h_u.min(h_v))?)));
        match parts {
            Some((line, [left, right])) => {
                let (on_left, on_right) = members.iter().partition(|n| line.side_m(uv[**n]) > 0.0);
                open.push((right, on_right));
                open.push((left, on_left));
            }
            None => facets.push(piece),
        }
    }
    let from: Vec<usize> = facets.iter().map(|facet| folds.facet_at(center(facet))).collect();
    folds.retile(facets, &from);
}

/// The line that parts the labels of a piece best; `None` where it is one cluster or none does.
fn best_cut(uv: &[[f64; 2]], labels: &[u8], members: &[usize]) -> Option<Line> {
    let mut counts = [0usize; 256];
    members.iter().for_each(|n| counts[usize::from(labels[*n])] += 1);
    let most = counts.iter().max().copied().unwrap_or(0);
    if most as f64 >= PURE * members.len() as f64 {
        return None;
    }
    let present: Vec<u8> = (0..=255).filter(|l| counts[usize::from(*l)] > 0).collect();
    let mut best: Option<(f64, Line)> = None;
    for (k, a) in present.iter().enumerate() {
        for b in &present[k + 1..] {
            for line in lines_between(uv, labels, members, *a, *b) {
                let wrong = wrong_share(uv, labels, members, &line);
                if wrong < best.as_ref().map_or(WRONG_MAX, |(share, _)| *share) {
                    best = Some((wrong, line));
                }
            }
        }
    }
    best.map(|(_, line)| line)
}

/// Lines between two clusters, by Fisher's discriminant and by their border.
fn lines_between(
    uv: &[[f64; 2]],
    labels: &[u8],
    members: &[usize],
    a: u8,
    b: u8,
) -> impl Iterator<Item = Line> {
    let mut means = [[0.0; 2]; 2];
    let mut within = [0.0; 3];
    let of = |label: u8| members.iter().filter(move |n| labels[**n] == label).map(|n| uv[*n]);
    for (mean, label) in means.iter_mut().zip([a, b]) {
        let count = of(label).count() as f64;
        *mean = of(label).fold([0.0; 2], |m, p| [m[0] + p[0] / count, m[1] + p[1] / count]);
        for p in of(label) {
            let d = [p[0] - mean[0], p[1] - mean[1]];
            within = [within[0] + d[0] * d[0], within[1] + d[0] * d[1], within[2] + d[1] * d[1]];
        }
    }
    let gap = [means[1][0] - means[0][0], means[1][1] - means[0][1]];
    let det = within[0] * within[2] - within[1] * within[1];
    let fisher = [
        (within[2] * gap[0] - within[1] * gap[1]) / det,
        (within[0] * gap[1] - within[1] * gap[0]) / det,
    ];
    let normals = [fisher, gap];
    normals.into_iter().filter_map(move |normal| {
        let length = normal[0].hypot(normal[1]);
        if !(length.is_finite() && length > 1e-9) {
            return None;
        }
        let n = normal.map(|c| c / length);
        let across = |p: [f64; 2]| p[0] * n[0] + p[1] * n[1];
        let middle = (across(means[0]) + across(means[1])) / 2.0;
        Some(Line { point_m: [n[0] * middle, n[1] * middle], direction: [-n[1], n[0]] })
    })
}

/// Share of the nodes that lie on the side where their cluster has its minority.
fn wrong_share(uv: &[[f64; 2]], labels: &[u8], members: &[usize], line: &Line) -> f64 {
    let mut counts = [[0usize; 2]; 256];
    for n in members {
        counts[usize::from(labels[*n])][usize::from(line.side_m(uv[*n]) > 0.0)] += 1;
    }
    let wrong: usize = counts.iter().map(|[left, right]| left.min(right)).sum();
    let sides = [0, 1].map(|side| counts.iter().map(|c| c[side]).sum::<usize>());
    if sides.contains(&0) { 1.0 } else { wrong as f64 / members.len() as f64 }
}

fn center(facet: &Facet) -> [f64; 2] {
    let count = facet.corners_m.len() as f64;
    [0, 1].map(|k| facet.corners_m.iter().map(|c| c[k]).sum::<f64>() / count)
}
