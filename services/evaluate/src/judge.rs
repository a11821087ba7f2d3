//! The judge: scores steps as they come, beside the set or in one process with it.

use std::collections::BTreeMap;

use orime_geometry::{Edgel, ObservedPoint, RgbdCamera, SheetGrid};

use crate::scores::{self, bending, folded, order};
use crate::summary::{StageMs, StepScore, Summary, fnv1a};

/// Most points that E, surface distance and planarity are computed from; more are thinned evenly.
const POINTS_MAX: usize = 2500;

/// One step as the judge sees it.
#[derive(Debug, Clone, Copy)]
pub struct StepInput<'a> {
    /// Number of the frame set.
    pub step: u64,
    /// What the tracker says: `searching`, `tracking`, `coasting`, `lost`.
    pub tracking: &'a str,
    /// Whether a pose was taken over at once.
    pub reset: bool,
    /// The sheet's nodes, world frame, metres; empty before the first pose.
    pub nodes_m: &'a [[f32; 3]],
    /// The observed cloud of the same step.
    pub cloud: &'a [ObservedPoint],
    /// The contour of the same step.
    pub edgels: &'a [Edgel],
    /// The cameras.
    pub cameras: &'a [RgbdCamera],
    /// Where the nodes truly are, if the source knows; the tracker never sees it.
    pub truth_m: Option<&'a [[f32; 3]]>,
    /// Milliseconds per stage.
    pub ms: StageMs,
}

/// Scores one run.
#[derive(Debug)]
pub struct Judge {
    sheet: SheetGrid,
    triangles: Vec<[u32; 3]>,
    edges: Vec<([u32; 2], f64)>,
    /// Which of the turns that nobody can tell apart the tracker chose; fixed at the first pose.
    turn: Option<Vec<usize>>,
    steps: Vec<StepScore>,
}

impl Judge {
    /// `rest_m`: rest shape of the sheet where it is not a flat rectangle.
    pub fn new(sheet: &SheetGrid, rest_m: Option<&[[f32; 3]]>) -> Self {
        let mut edges = sheet.edges();
        if let Some(rest) = rest_m {
            for ([a, b], length_m) in &mut edges {
                let (a, b) = (rest[*a as usize], rest[*b as usize]);
                let squared: f64 = (0..3).map(|k| f64::from(b[k] - a[k]).powi(2)).sum();
                *length_m = squared.sqrt();
            }
        }
        let triangles = sheet.triangles();
        Self { sheet: sheet.clone(), triangles, edges, turn: None, steps: Vec::new() }
    }

    /// The sheet being judged.
    pub fn sheet(&self) -> &SheetGrid {
        &self.sheet
    }

    /// Scores one step and remembers it.
    pub fn score(&mut self, input: &StepInput<'_>) -> &StepScore {
        let thin = input.cloud.len().div_ceil(POINTS_MAX).max(1);
        let cloud: Vec<[f32; 3]> = input.cloud.iter().step_by(thin).map(|p| p.position_m).collect();
        let mut score = StepScore {
            step: input.step,
            tracking: input.tracking.to_owned(),
            reset: input.reset,
            points: input.cloud.len(),
            ms: input.ms,
            state_hash: format!("{:016x}", fnv1a(bits(input.nodes_m))),
            ..StepScore::default()
        };
        if input.nodes_m.len() == self.sheet.len() {
            self.score_pose(input, &cloud, &mut score);
        }
        self.steps.push(score);
        &self.steps[self.steps.len() - 1]
    }

    fn score_pose(&mut self, input: &StepInput<'_>, cloud: &[[f32; 3]], score: &mut StepScore) {
        let mm = |metres: f64| metres * 1e3;
        let nodes = input.nodes_m;
        score.e_mm = scores::e_m(cloud, nodes).map(mm);
        score.surface_mm = scores::surface_m(cloud, nodes, &self.triangles).map(mm);
        let (strain, strain_max) = scores::strain(nodes, &self.edges);
        score.strain_percent = Some(strain * 100.0);
        score.strain_percent_max = Some(strain_max * 100.0);
        score.extent_m = Some(scores::extent_m(nodes, &self.sheet));
        score.planarity_mm_rms = scores::planarity_m(nodes, cloud, &self.sheet).map(mm);
        score.outline_px_median =
            scores::outline_px(nodes, input.edgels, input.cameras, &self.sheet);
        score.self_intersections = Some(folded::self_intersections(nodes, &self.triangles));
        let Some(truth) = input.truth_m.filter(|truth| truth.len() == nodes.len()) else { return };
        let turn = self.turn.get_or_insert_with(|| best_turn(&self.sheet, nodes, truth));
        let turned: Vec<[f32; 3]> = turn.iter().map(|n| nodes[*n]).collect();
        let errors = scores::vertex_errors_m(&turned, truth);
        score.vertex_error_mm_mean = scores::mean(errors.iter().copied()).map(mm);
        score.vertex_error_mm_p95 = scores::percentile(&errors, 0.95).map(mm);
        score.vertex_error_mm_max = errors.last().copied().map(mm);
        score.offset_mm = scores::offset_m(&turned, truth).map(|offset| offset.map(mm));
        score.shape_error_mm = scores::shape_error_m(&turned, truth).map(mm);
        score.e_at_truth_mm = scores::e_m(cloud, truth).map(mm);
        score.layer_order = Some(order::layer_order(&turned, truth, &self.sheet));
        score.wrinkle_deg = bending::wrinkle_deg(&turned, truth, &self.sheet);
        if let Some(errors) = bending::crease_errors(&turned, truth, &self.sheet) {
            score.crease_angle_error_deg = Some(errors.angle_deg);
            score.crease_position_error_mm = Some(mm(errors.position_m));
        }
        self.score_layers(&turned, truth, input.cameras, cloud, score);
    }

    /// Splits the errors by what the truth hides and stacks.
    fn score_layers(
        &self,
        nodes_m: &[[f32; 3]],
        truth_m: &[[f32; 3]],
        cameras: &[RgbdCamera],
        cloud: &[[f32; 3]],
        score: &mut StepScore,
    ) {
        let seen = folded::visible(truth_m, &self.triangles, cameras);
        let layers = folded::layers_above(truth_m, &self.triangles);
        let errors_mm: Vec<f64> = nodes_m
            .iter()
            .zip(truth_m)
            .map(|(a, b)| {
                let squared: f64 = (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum();
                squared.sqrt() * 1e3
            })
            .collect();
        let mean_of = |counts: &dyn Fn(usize) -> bool| {
            scores::mean((0..errors_mm.len()).filter(|k| counts(*k)).map(|k| errors_mm[k]))
        };
        if !cameras.is_empty() {
            score.vertex_error_visible_mm = mean_of(&|k| seen[k]);
            score.vertex_error_hidden_mm = mean_of(&|k| !seen[k]);
            let to_cloud = scores::nodes_to_cloud_m(nodes_m, cloud, |k| seen[k]);
            score.chamfer_mm =
                score.surface_mm.zip(to_cloud).map(|(there, back)| (there + back * 1e3) / 2.0);
        }
        for (layer, error) in score.vertex_error_by_layer_mm.iter_mut().enumerate() {
            *error = mean_of(&|k| layers[k].min(3) == layer as u32);
        }
    }

    /// Sets the times of steps that were scored before their times were known.
    pub fn set_times(&mut self, times: &BTreeMap<u64, StageMs>) {
        for score in &mut self.steps {
            if let Some(ms) = times.get(&score.step) {
                score.ms = *ms;
            }
        }
    }

    /// The steps so far.
    pub fn steps(&self) -> &[StepScore] {
        &self.steps
    }

    /// The figures of all steps so far.
    pub fn summary(&self) -> Summary {
        Summary::of(&self.steps, scores::e_floor_m(&self.sheet) * 1e3)
    }
}

/// The turn under which the tracked nodes are nearest to the truth.
fn best_turn(sheet: &SheetGrid, nodes_m: &[[f32; 3]], truth_m: &[[f32; 3]]) -> Vec<usize> {
    let error = |turn: &Vec<usize>| -> f64 {
        let turned: Vec<[f32; 3]> = turn.iter().map(|n| nodes_m[*n]).collect();
        scores::vertex_errors_m(&turned, truth_m).iter().sum()
    };
    let turns = sheet.turns();
    let best = turns.iter().min_by(|a, b| error(a).total_cmp(&error(b)));
    best.cloned().unwrap_or_else(|| (0..nodes_m.len()).collect())
}

fn bits(nodes_m: &[[f32; 3]]) -> impl Iterator<Item = u8> + '_ {
    nodes_m.iter().flatten().flat_map(|c| c.to_bits().to_le_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input<'a>(step: u64, nodes: &'a [[f32; 3]], truth: &'a [[f32; 3]]) -> StepInput<'a> {
        StepInput {
            step,
            tracking: "tracking",
            reset: false,
            nodes_m: nodes,
            cloud: &[],
            edgels: &[],
            cameras: &[],
            truth_m: Some(truth),
            ms: StageMs::default(),
        }
    }

    #[test]
    fn a_turned_sheet_is_right_but_a_turn_on_the_way_is_not() {
        let sheet = SheetGrid::new([0.15, 0.15], [5, 5]);
        let truth = sheet.flat_m();
        let turned =
            |k: usize| -> Vec<[f32; 3]> { sheet.turns()[k].iter().map(|n| truth[*n]).collect() };
        let mut judge = Judge::new(&sheet, None);
        let quarter = turned(2);
        assert!(judge.score(&input(0, &quarter, &truth)).vertex_error_mm_mean.unwrap() < 1e-6);
        // The labels are fixed from the first pose on.
        let half = turned(1);
        assert!(judge.score(&input(1, &half, &truth)).vertex_error_mm_mean.unwrap() > 50.0);
        assert_eq!(judge.summary().lost_steps_unnoticed, 1);
    }

    #[test]
    fn equal_states_have_equal_hashes_and_one_bit_changes_them() {
        let sheet = SheetGrid::new([0.15, 0.15], [5, 5]);
        let nodes = sheet.flat_m();
        let mut other = nodes.clone();
        other[3][1] = f32::from_bits(other[3][1].to_bits() ^ 1);
        let mut judge = Judge::new(&sheet, None);
        let hashes: Vec<String> = [&nodes, &nodes, &other]
            .into_iter()
            .map(|x| judge.score(&input(0, x, &nodes)).state_hash.clone())
            .collect();
        assert_eq!(hashes[0], hashes[1]);
        assert_ne!(hashes[0], hashes[2]);
    }
}
