//! Figures of one step and of a whole run, as they are written to JSON.

use serde::{Deserialize, Serialize};

use crate::scores::order::LayerOrder;
use crate::scores::{mean, percentile};

/// Milliseconds that each stage computed in a step.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct StageMs {
    /// Reading or rendering the frames; not part of a step's time.
    pub capture: f64,
    /// Segmentation of all cameras.
    pub segment: f64,
    /// Registration.
    pub register: f64,
    /// Simulation.
    pub simulate: f64,
}

impl StageMs {
    /// A step's time: segment + register + simulate.
    pub fn step(&self) -> f64 {
        self.segment + self.register + self.simulate
    }
}

/// Figures of one step. Lengths in millimetres unless the name says otherwise.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct StepScore {
    /// Number of the frame set, from 0.
    pub step: u64,
    /// `searching`, `tracking`, `coasting` or `lost`, as the tracker says.
    pub tracking: String,
    /// Whether a pose was taken over at once in this step.
    pub reset: bool,
    /// Observed points.
    pub points: usize,
    /// Eq. (5): mean distance from observed points to the nearest node.
    pub e_mm: Option<f64>,
    /// Mean distance from observed points to the model's surface.
    pub surface_mm: Option<f64>,
    /// Mean relative change of the edges' lengths, percent.
    pub strain_percent: Option<f64>,
    /// Largest relative change of an edge's length, percent.
    pub strain_percent_max: Option<f64>,
    /// Mean chord of the grid lines along u and v, metres.
    pub extent_m: Option<[f64; 2]>,
    /// Distance of the visible nodes from their plane, root mean square.
    pub planarity_mm_rms: Option<f64>,
    /// Median distance from the seen contour to the projected border, pixels.
    pub outline_px_median: Option<f64>,
    /// Distance of the nodes from the truth, mean.
    pub vertex_error_mm_mean: Option<f64>,
    /// … 95th percentile.
    pub vertex_error_mm_p95: Option<f64>,
    /// … largest.
    pub vertex_error_mm_max: Option<f64>,
    /// How far the sheet is off as a whole: mean over the nodes of tracked minus true place, world
    /// frame.
    pub offset_mm: Option<[f64; 3]>,
    /// [`StepScore::vertex_error_mm_mean`] of the sheet moved rigidly onto the truth: what is wrong
    /// with its shape, and not with where the cameras are taken to stand.
    pub shape_error_mm: Option<f64>,
    /// E of the true pose against the same cloud.
    pub e_at_truth_mm: Option<f64>,
    /// Mean of both ways between sheet and cloud: [`StepScore::surface_mm`], and from each node
    /// that can be seen to its nearest observed point.
    pub chamfer_mm: Option<f64>,
    /// [`StepScore::vertex_error_mm_mean`] of the nodes that some camera can see.
    pub vertex_error_visible_mm: Option<f64>,
    /// … and of those that the sheet itself hides from every camera.
    pub vertex_error_hidden_mm: Option<f64>,
    /// … and by the number of layers that lie on top of the node: 0, 1, 2, and 3 or more.
    pub vertex_error_by_layer_mm: [Option<f64>; 4],
    /// Pairs of a mesh edge and a triangle of the tracked sheet that cross.
    pub self_intersections: Option<usize>,
    /// Nodes and the layers near them, and which lie on the wrong side.
    pub layer_order: Option<LayerOrder>,
    /// Mean turn of the grid lines where the true sheet is flat, degrees.
    pub wrinkle_deg: Option<f64>,
    /// Mean error of the fold angle at the true creases, degrees.
    pub crease_angle_error_deg: Option<f64>,
    /// Mean error of the creases' place in the sheet, millimetres.
    pub crease_position_error_mm: Option<f64>,
    /// Milliseconds per stage.
    pub ms: StageMs,
    /// FNV-1a of the node positions' bits: equal states, equal hashes.
    pub state_hash: String,
}

/// Figures of a whole run: means over the steps that have them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Steps scored.
    pub steps: u64,
    /// Steps in which the sheet was not followed: the tracker says `searching` or `lost`, or the
    /// truth says that the mean vertex error exceeds 8 mm.
    pub lost_steps: u64,
    /// Of these, steps that the tracker took for tracked.
    pub lost_steps_unnoticed: u64,
    /// Steps without observation, in which the simulator carried on alone.
    pub coasting_steps: u64,
    /// Times a pose was taken over at once: the first pose and each jump.
    pub resets: u64,
    /// Mean of [`StepScore::e_mm`].
    pub e_mm_mean: Option<f64>,
    /// What E is on a perfectly tracked sheet.
    pub e_floor_mm: f64,
    /// Mean of [`StepScore::surface_mm`].
    pub surface_mm_mean: Option<f64>,
    /// Mean of [`StepScore::strain_percent`].
    pub strain_percent_mean: Option<f64>,
    /// Largest strain of any edge in any step, percent.
    pub strain_percent_max: Option<f64>,
    /// Mean and range over the steps of the chord along u, metres.
    pub width_m: Option<Range>,
    /// Mean and range over the steps of the chord along v, metres.
    pub length_m: Option<Range>,
    /// Mean and range of [`StepScore::planarity_mm_rms`].
    pub planarity_mm_rms: Option<Range>,
    /// Mean and range of [`StepScore::outline_px_median`].
    pub outline_px_median: Option<Range>,
    /// Mean over steps and nodes of the distance to the truth.
    pub vertex_error_mm_mean: Option<f64>,
    /// Mean over the steps of the 95th percentile.
    pub vertex_error_mm_p95: Option<f64>,
    /// Largest of any node in any step.
    pub vertex_error_mm_max: Option<f64>,
    /// Mean of [`StepScore::offset_mm`].
    pub offset_mm_mean: [Option<f64>; 3],
    /// Mean of [`StepScore::shape_error_mm`].
    pub shape_error_mm_mean: Option<f64>,
    /// Mean of [`StepScore::e_at_truth_mm`].
    pub e_at_truth_mm_mean: Option<f64>,
    /// Mean of [`StepScore::chamfer_mm`].
    pub chamfer_mm_mean: Option<f64>,
    /// Mean of [`StepScore::vertex_error_visible_mm`].
    pub vertex_error_visible_mm_mean: Option<f64>,
    /// Mean of [`StepScore::vertex_error_hidden_mm`].
    pub vertex_error_hidden_mm_mean: Option<f64>,
    /// Mean of [`StepScore::vertex_error_by_layer_mm`].
    pub vertex_error_by_layer_mm_mean: [Option<f64>; 4],
    /// Steps in which the sheet passes through itself.
    pub self_intersecting_steps: u64,
    /// [`StepScore::layer_order`] of the last step that has one.
    pub layer_order_end: Option<LayerOrder>,
    /// Mean of [`StepScore::wrinkle_deg`].
    pub wrinkle_deg_mean: Option<f64>,
    /// Mean of [`StepScore::crease_angle_error_deg`].
    pub crease_angle_error_deg_mean: Option<f64>,
    /// Mean of [`StepScore::crease_position_error_mm`].
    pub crease_position_error_mm_mean: Option<f64>,
    /// Runs of lost steps, and whether and after how many steps the sheet was found again.
    pub losses: Vec<Loss>,
    /// Median time of a step (segment + register + simulate).
    pub ms_per_step_p50: Option<f64>,
    /// 99th percentile.
    pub ms_per_step_p99: Option<f64>,
    /// Median per stage.
    pub ms_p50: StageMs,
    /// FNV-1a over the steps' hashes: equal runs, equal hashes.
    pub states_hash: String,
}

/// A run of lost steps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Loss {
    /// First lost step.
    pub step: u64,
    /// Steps until the sheet was followed again, or until the end.
    pub steps: u64,
    /// Whether it was followed again.
    pub recovered: bool,
}

/// Mean, smallest and largest of a figure over the steps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// Mean.
    pub mean: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

/// A step whose mean vertex error exceeds this is lost, whatever the tracker says, millimetres.
pub const LOST_MM: f64 = 8.0;

impl Summary {
    /// Sums the steps up. `e_floor_mm`: see [`crate::scores::e_floor_m`].
    pub fn of(steps: &[StepScore], e_floor_mm: f64) -> Self {
        let average = |figure: fn(&StepScore) -> Option<f64>| mean(steps.iter().filter_map(figure));
        let largest = |figure: fn(&StepScore) -> Option<f64>| {
            steps.iter().filter_map(figure).max_by(f64::total_cmp)
        };
        let times = |figure: fn(&StepScore) -> f64, share: f64| {
            let mut values: Vec<f64> = steps.iter().map(figure).collect();
            values.sort_by(f64::total_cmp);
            percentile(&values, share)
        };
        let gone = |s: &&StepScore| s.says_lost();
        let off = |s: &&StepScore| s.is_off();
        let median = |figure| times(figure, 0.5).unwrap_or_default();
        Self {
            steps: steps.len() as u64,
            lost_steps: steps.iter().filter(|s| gone(s) || off(s)).count() as u64,
            lost_steps_unnoticed: steps.iter().filter(|s| !gone(s) && off(s)).count() as u64,
            coasting_steps: steps.iter().filter(|s| s.tracking == "coasting").count() as u64,
            resets: steps.iter().filter(|s| s.reset).count() as u64,
            e_mm_mean: average(|s| s.e_mm),
            e_floor_mm,
            surface_mm_mean: average(|s| s.surface_mm),
            strain_percent_mean: average(|s| s.strain_percent),
            strain_percent_max: largest(|s| s.strain_percent_max),
            width_m: range(steps, |s| s.extent_m.map(|e| e[0])),
            length_m: range(steps, |s| s.extent_m.map(|e| e[1])),
            planarity_mm_rms: range(steps, |s| s.planarity_mm_rms),
            outline_px_median: range(steps, |s| s.outline_px_median),
            vertex_error_mm_mean: average(|s| s.vertex_error_mm_mean),
            vertex_error_mm_p95: average(|s| s.vertex_error_mm_p95),
            vertex_error_mm_max: largest(|s| s.vertex_error_mm_max),
            offset_mm_mean: [
                average(|s| s.offset_mm.map(|offset| offset[0])),
                average(|s| s.offset_mm.map(|offset| offset[1])),
                average(|s| s.offset_mm.map(|offset| offset[2])),
            ],
            shape_error_mm_mean: average(|s| s.shape_error_mm),
            e_at_truth_mm_mean: average(|s| s.e_at_truth_mm),
            chamfer_mm_mean: average(|s| s.chamfer_mm),
            vertex_error_visible_mm_mean: average(|s| s.vertex_error_visible_mm),
            vertex_error_hidden_mm_mean: average(|s| s.vertex_error_hidden_mm),
            vertex_error_by_layer_mm_mean: [
                average(|s| s.vertex_error_by_layer_mm[0]),
                average(|s| s.vertex_error_by_layer_mm[1]),
                average(|s| s.vertex_error_by_layer_mm[2]),
                average(|s| s.vertex_error_by_layer_mm[3]),
            ],
            self_intersecting_steps: steps
                .iter()
                .filter(|s| s.self_intersections.is_some_and(|n| n > 0))
                .count() as u64,
            layer_order_end: steps.iter().rev().find_map(|s| s.layer_order),
            wrinkle_deg_mean: average(|s| s.wrinkle_deg),
            crease_angle_error_deg_mean: average(|s| s.crease_angle_error_deg),
            crease_position_error_mm_mean: average(|s| s.crease_position_error_mm),
            losses: losses(steps),
            ms_per_step_p50: times(|s| s.ms.step(), 0.5),
            ms_per_step_p99: times(|s| s.ms.step(), 0.99),
            ms_p50: StageMs {
                capture: median(|s| s.ms.capture),
                segment: median(|s| s.ms.segment),
                register: median(|s| s.ms.register),
                simulate: median(|s| s.ms.simulate),
            },
            states_hash: format!("{:016x}", fnv1a(steps.iter().flat_map(|s| s.state_hash.bytes()))),
        }
    }
}

impl StepScore {
    /// Whether the tracker says that it does not follow the sheet.
    fn says_lost(&self) -> bool {
        self.tracking == "searching" || self.tracking == "lost"
    }

    /// Whether the truth says so.
    fn is_off(&self) -> bool {
        self.vertex_error_mm_mean.is_some_and(|error| error > LOST_MM)
    }
}

/// Runs of lost steps.
fn losses(steps: &[StepScore]) -> Vec<Loss> {
    let mut losses: Vec<Loss> = Vec::new();
    let mut open = false;
    for step in steps {
        let lost = step.says_lost() || step.is_off();
        match losses.last_mut() {
            Some(loss) if open => {
                loss.recovered = !lost;
                loss.steps += u64::from(lost);
            }
            _ if lost => losses.push(Loss { step: step.step, steps: 1, recovered: false }),
            _ => {}
        }
        open = lost;
    }
    losses
}

fn range(steps: &[StepScore], figure: fn(&StepScore) -> Option<f64>) -> Option<Range> {
    let values: Vec<f64> = steps.iter().filter_map(figure).collect();
    Some(Range {
        mean: mean(values.iter().copied())?,
        min: values.iter().copied().fold(f64::INFINITY, f64::min),
        max: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    })
}

/// FNV-1a, 64 bits (Fowler, Noll, Vo).
pub fn fnv1a(bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(tracking: &str, error_mm: Option<f64>, ms: f64) -> StepScore {
        StepScore {
            tracking: tracking.into(),
            vertex_error_mm_mean: error_mm,
            ms: StageMs { register: ms, ..StageMs::default() },
            ..StepScore::default()
        }
    }

    #[test]
    fn lost_steps_are_counted_whoever_says_so() {
        let steps = [
            step("searching", None, 1.0),
            step("tracking", Some(1.0), 2.0),
            step("tracking", Some(9.0), 3.0),
            step("lost", Some(20.0), 4.0),
            step("coasting", Some(2.0), 5.0),
        ];
        let summary = Summary::of(&steps, 2.4);
        assert_eq!((summary.lost_steps, summary.lost_steps_unnoticed), (3, 1));
        assert_eq!((summary.coasting_steps, summary.steps), (1, 5));
        assert_eq!(summary.vertex_error_mm_mean, Some(8.0));
        assert_eq!((summary.ms_per_step_p50, summary.ms_per_step_p99), (Some(3.0), Some(5.0)));
        assert_eq!(summary.e_mm_mean, None);
        // Step numbers are all 0 here: lost at once, found in the second, lost in the third.
        let found: Vec<(u64, bool)> =
            summary.losses.iter().map(|loss| (loss.steps, loss.recovered)).collect();
        assert_eq!(found, [(1, true), (2, true)]);
    }

    #[test]
    fn fnv1a_has_its_published_value() {
        assert_eq!(fnv1a(b"foobar".iter().copied()), 0x8594_4171_f739_67e8);
    }
}
