//! From frame to frame: predict, register, judge, and find the sheet again where it was lost.

mod marked;

use crate::bias::DepthBias;
use crate::cloud::Cloud;
use crate::features::Fusion;
use crate::first_pose;
use crate::params::{RegisterConfig, RegisterMode, RegisterParams};
use crate::refine::Refinement;
use crate::rig::{Rig, Word};
use crate::score::Score;
use crate::track::{Effort, Termination, TrackReport, Tracker};
use nalgebra::Vector3;
use orime_creases::Folds;
use orime_geometry::{Edgel, Feature, ObservedPoint, RgbdCamera, SheetGrid};

/// Σ p from which on a point is surely the sheet's.
const SURE: f32 = 0.3;
/// Weight of a piece of contour beside a point's, where cameras are refined: anything from 0.5 to 6
/// serves, without contour nothing tells what lies along the sheet.
const CONTOUR: f64 = 2.0;

/// Whether the sheet is being followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Tracking {
    /// No pose yet: no first cloud, or nothing in it that fits the sheet.
    #[default]
    Searching = 0,
    /// Following.
    Tracking = 1,
    /// Nothing to register against in this step: the simulator carries on alone.
    Coasting = 2,
    /// The pose does not explain what is seen, or the sheet would have to stretch for it, and no
    /// other was found.
    Lost = 3,
}

/// What the cameras saw of the sheet in one step.
#[derive(Debug, Clone, Copy, Default)]
pub struct Observation<'a> {
    /// Surface points of all cameras, world frame.
    pub cloud: &'a [ObservedPoint],
    /// Contour elements of all cameras.
    pub edgels: &'a [Edgel],
    /// Recognised points of a printed sheet, of all cameras.
    pub features: &'a [Feature],
    /// The cameras that `edgels` were seen by; without them the contour is not used.
    pub cameras: &'a [RgbdCamera],
    /// What is known of the sheet's folds; `None`: a sheet without creases.
    pub folds: Option<&'a Folds>,
}

/// What registering one step gave.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RegisterReport {
    /// Whether the sheet is being followed.
    pub tracking: Tracking,
    /// Whether the targets are a new pose for *every* node, to be taken over at once.
    pub reset: bool,
    /// Whether that pose is the sheet's as it was folded, elsewhere: its folds are to be kept.
    pub moved: bool,
    /// Iterations of expectation maximisation.
    pub iterations: u32,
    /// Standard deviation of the mixture at the end, metres.
    pub sigma_m: f32,
    /// Share of the observed points that the model explains.
    pub inlier_ratio: f32,
    /// Observed points that were not finite.
    pub points_rejected: u32,
    /// Farthest that a camera's correction moves what it sees, metres; 0 without `refine_cameras`.
    pub camera_shift_m: f32,
    /// Why the iterations ended.
    pub termination: Termination,
}

/// A pose must beat the current one by this much to replace it: a jump is never taken for noise.
const BETTER_BY: f64 = 0.1;

/// Share of the points that a pose explains from which it may be the sheet's.
const HALF: f64 = 0.5;

/// The sheet as it was expected when it was last followed.
#[derive(Debug, Clone, Default)]
struct Followed {
    nodes_m: Vec<[f32; 3]>,
    facets: usize,
}

impl Followed {
    /// A folded sheet where the cloud is, unless its folds are forgotten.
    fn elsewhere(&self, cloud: &[ObservedPoint], facets: usize) -> Option<Vec<[f32; 3]>> {
        let is_folded = self.facets > 1 && self.facets == facets;
        is_folded.then(|| first_pose::folded_pose(cloud, &self.nodes_m)).flatten()
    }
}

/// Registers the sheet to one cloud after the other.
#[derive(Debug, Clone)]
pub struct Registrar {
    params: RegisterParams,
    effort: Effort,
    /// The grid that targets are for.
    handed: SheetGrid,
    /// The grid that is registered: `handed`, or its refinement.
    sheet: SheetGrid,
    refinement: Option<Refinement>,
    template_m: Option<Vec<[f32; 3]>>,
    tracker: Tracker,
    fusion: Fusion,
    cloud: Cloud,
    bias: DepthBias,
    rig: Rig,
    words: Vec<Word>,
    points: Vec<ObservedPoint>,
    nodes_m: Vec<[f32; 3]>,
    followed: Followed,
    has_pose: bool,
    /// Share of the contour that the border has lately explained.
    outlined_usual: f64,
    /// Mean strain that the sheet has lately had where it was expected.
    strain_usual: f64,
}

/// Paper does not stretch: where the expected sheet keeps more mean strain than this, its layers
/// are where contact and targets both pull at them, and the pose is wrong. In runs that follow the
/// square base it stays below 0.014, in those that lost it above 0.023 (`docs/results.md`).
const STRAIN_LOST: f64 = 0.02;
/// Share of the usual strain that is kept from frame to frame.
const STRAIN_KEPT: f64 = 0.8;

/// Where less of the seen contour lies on the sheet's border or creases, the sheet is not where it
/// is said to be. In runs that follow the square base 99 of 100 steps keep 0.95 or more of it; in
/// those that lose it in its turn-over it stays below 0.9 (`docs/results.md`).
const OUTLINE_LOST: f64 = 0.9;
/// Of fewer elements of the contour nothing is concluded.
const EDGELS_MIN: usize = 50;

/// A drop of that share by more than this within a step is a jump, not a fold.
const OUTLINE_DROP: f64 = 0.2;

impl Registrar {
    /// A registrar that has no pose yet. `template_m`: node positions to start from, where the
    /// sheet does not start flat.
    pub fn new(
        config: &RegisterConfig,
        sheet: &SheetGrid,
        template_m: Option<Vec<[f32; 3]>>,
    ) -> Self {
        assert!(
            template_m.as_ref().is_none_or(|template| template.len() == sheet.len()),
            "one template position per node"
        );
        let handed = sheet.clone();
        let refinement = match config.params.mode {
            RegisterMode::Cpd => Refinement::of(&handed),
            RegisterMode::Markers => None,
        };
        let sheet = refinement.as_ref().map_or(&handed, Refinement::sheet);
        let template_m = match &refinement {
            Some(refined) => template_m.map(|template| refined.refined_m(&template)),
            None => template_m,
        };
        let flat = sheet.flat_m();
        let rest = template_m.as_deref().unwrap_or(&flat);
        Self {
            effort: Effort::full(&config.params),
            params: config.params.clone(),
            tracker: Tracker::new(&config.params, sheet, rest),
            fusion: Fusion::new(&config.params, sheet, rest),
            sheet: sheet.clone(),
            handed,
            refinement,
            template_m,
            cloud: Cloud::default(),
            bias: DepthBias::default(),
            rig: Rig::default(),
            words: Vec::new(),
            points: Vec::new(),
            nodes_m: flat,
            followed: Followed::default(),
            has_pose: false,
            outlined_usual: 0.0,
            strain_usual: 0.0,
        }
    }

    /// Takes the first `predicted_m` for a pose, instead of finding one in the first cloud.
    pub fn assume_pose(&mut self) {
        self.has_pose = true;
    }

    /// Registers one observation. `predicted_m` is where the simulator expects the nodes (`None`
    /// before the first pose); `targets_m` and `confidence` (one per node of the sheet) are
    /// written: confidence 0 means that the node has no target.
    pub fn register(
        &mut self,
        observed: &Observation<'_>,
        predicted_m: Option<&[[f32; 3]]>,
        targets_m: &mut [[f32; 3]],
        confidence: &mut [f32],
    ) -> RegisterReport {
        self.register_within(observed, predicted_m, targets_m, confidence, &|| false)
    }

    /// How much work goes into a frame as the parameters say.
    pub fn full_effort(&self) -> Effort {
        Effort::full(&self.params)
    }

    /// How much work is to go into the frames from now on.
    pub fn set_effort(&mut self, effort: Effort) {
        self.effort = effort;
    }

    /// As [`Registrar::register`], but hands over what there is once `is_late` says so; it is
    /// asked after every iteration.
    pub fn register_within(
        &mut self,
        observed: &Observation<'_>,
        predicted_m: Option<&[[f32; 3]]>,
        targets_m: &mut [[f32; 3]],
        confidence: &mut [f32],
        is_late: &dyn Fn() -> bool,
    ) -> RegisterReport {
        if self.params.mode == RegisterMode::Markers {
            return self.register_marked(observed, predicted_m, targets_m, confidence);
        }
        let report = match self.refinement.take() {
            None => self.register_cloud(observed, predicted_m, targets_m, confidence, is_late),
            Some(mut refined) => {
                if let Some(folds) = observed.folds {
                    refined.refold(folds);
                }
                let predicted_m = predicted_m.filter(|x| x.len() == confidence.len());
                let predicted_m = predicted_m.map(|x| refined.refined_m(x));
                let folds = observed.folds.map(|_| &refined.fine_folds);
                let observed = Observation { folds, ..*observed };
                let report = self.register_cloud(
                    &observed,
                    predicted_m.as_deref(),
                    &mut refined.targets_m,
                    &mut refined.confidence,
                    is_late,
                );
                confidence.fill(0.0);
                if report.iterations > 0 {
                    refined.hand_back(targets_m, confidence);
                }
                self.refinement = Some(refined);
                report
            }
        };
        if !report.reset && !self.params.targets_everywhere {
            self.keep_controls(confidence);
        }
        report
    }

    fn register_cloud(
        &mut self,
        observed: &Observation<'_>,
        predicted_m: Option<&[[f32; 3]]>,
        targets_m: &mut [[f32; 3]],
        confidence: &mut [f32],
        is_late: &dyn Fn() -> bool,
    ) -> RegisterReport {
        let mut report =
            RegisterReport { points_rejected: self.accept(observed.cloud), ..Default::default() };
        confidence.fill(0.0);
        if self.points.len() < self.params.points_min {
            report.tracking = if self.has_pose { Tracking::Coasting } else { Tracking::Searching };
            return report;
        }
        self.look_at(observed);
        if self.params.refine_cameras {
            report.camera_shift_m = self.rig.shift_m(&self.points);
        }
        let known = predicted_m.filter(|x| self.has_pose && x.len() == self.sheet.len());
        let mut tracked = known.map(|state| self.track(state, confidence, is_late));
        let explained_min = self.params.explained_min;
        let outlined_min = self.outlined_usual - OUTLINE_DROP;
        let explains =
            |score: &Score| score.explained >= explained_min && score.outlined >= outlined_min;
        if !tracked.as_ref().is_some_and(|(_, score)| explains(score)) {
            let facets = observed.folds.map_or(1, |folds| folds.facets().len());
            self.try_other_poses(known, facets, &mut tracked, &mut report);
        }
        let Some((fit, score)) = tracked else {
            report.tracking = Tracking::Searching;
            return report;
        };
        self.has_pose = true;
        let keep = if report.reset { 0.0 } else { 0.8 };
        if report.reset {
            self.strain_usual = 0.0;
        }
        self.outlined_usual = keep * self.outlined_usual + (1.0 - keep) * score.outlined;
        report.termination = fit.termination;
        report.iterations = fit.iterations;
        report.sigma_m = fit.sigma_m;
        report.inlier_ratio = fit.inlier_ratio;
        let astray = !report.reset && score.edgels > EDGELS_MIN && score.outlined < OUTLINE_LOST;
        report.tracking = if fit.iterations == 0 || self.strain_usual > STRAIN_LOST || astray {
            Tracking::Lost
        } else if explains(&score) || score.explained >= HALF {
            Tracking::Tracking
        } else {
            Tracking::Lost
        };
        if let (Tracking::Tracking, false, Some(known)) = (report.tracking, report.reset, known) {
            self.followed.facets = observed.folds.map_or(1, |folds| folds.facets().len());
            self.followed.nodes_m.clear();
            self.followed.nodes_m.extend_from_slice(known);
        }
        if fit.iterations > 0 {
            targets_m[..self.nodes_m.len()].copy_from_slice(&self.nodes_m);
            if report.reset || !self.params.visibility {
                confidence.fill(1.0);
            }
        } else {
            confidence.fill(0.0);
        }
        report
    }

    /// Hands the tracker what was seen.
    fn look_at(&mut self, observed: &Observation<'_>) {
        if let Some(folds) = observed.folds {
            self.tracker.refold(folds);
        }
        self.rig.fit_to(observed.cameras);
        if self.params.refine_cameras {
            self.rig.correct(&mut self.points);
        }
        self.bias.fit_to(observed.cameras);
        let bias = &mut self.bias;
        let points = self.points.iter().map(|p| (bias.corrected(p), p.camera));
        self.cloud.fill(points, self.tracker.cell_m());
        self.tracker.outline.fill(observed.edgels, self.rig.cameras());
    }

    /// Goes on from where the nodes are expected.
    fn track(
        &mut self,
        expected_m: &[[f32; 3]],
        confidence: &mut [f32],
        is_late: &dyn Fn() -> bool,
    ) -> (TrackReport, Score) {
        self.nodes_m.clear();
        self.nodes_m.extend_from_slice(expected_m);
        if self.params.visibility {
            self.tracker.judge_visibility(self.rig.cameras(), &self.nodes_m);
        }
        let strain = f64::from(self.tracker.strain(&self.nodes_m));
        self.strain_usual = STRAIN_KEPT * self.strain_usual + (1.0 - STRAIN_KEPT) * strain;
        let iterations_max = self.effort.iterations_max;
        let fit = self.tracker.track(&self.cloud, &mut self.nodes_m, iterations_max, is_late);
        if self.params.visibility {
            self.tracker.confidence(confidence);
        }
        if fit.iterations > 0 {
            self.learn_cameras(&fit);
        }
        (fit, self.score())
    }

    /// Learns what the cameras err by from what they see beside where the sheet was registered.
    fn learn_cameras(&mut self, fit: &TrackReport) {
        if !self.params.learn_depth_bias && !self.params.refine_cameras {
            return;
        }
        let (answers, weight) = self.tracker.answers(&self.cloud, fit);
        if self.params.learn_depth_bias {
            self.bias.learn(&self.cloud, answers, weight);
        }
        if self.params.refine_cameras {
            self.words.clear();
            let (cloud, points) = (&self.cloud, &self.points);
            self.words.extend(answers.iter().filter_map(|answer| {
                let normal = Vector3::from(points[cloud.source(answer.point)].normal);
                let way_m = -normal.dot(&Vector3::from(answer.away_m)) / answer.mass;
                (answer.mass > SURE && normal != Vector3::zeros()).then(|| Word {
                    camera: cloud.cameras[answer.point],
                    at_m: Vector3::from(cloud.points_m[answer.point]).cast(),
                    normal: normal.cast(),
                    way_m: f64::from(way_m),
                    weight: f64::from(answer.mass),
                })
            }));
            let outline = &self.tracker.outline;
            self.words.extend(outline.rows.iter().map(|row| Word {
                camera: row.camera,
                at_m: Vector3::from(outline.positions_m[row.sample]).cast(),
                normal: row.normal,
                way_m: -row.way_m,
                weight: CONTOUR * row.huber,
            }));
            self.rig.learn(&self.words);
        }
    }

    /// Takes over the finite points, thinned to the limit; returns how many were not finite.
    fn accept(&mut self, cloud: &[ObservedPoint]) -> u32 {
        let finite = |p: &&ObservedPoint| p.position_m.iter().all(|c| c.is_finite());
        let count = cloud.iter().filter(finite).count();
        let step = count.div_ceil(self.effort.points_max).max(1);
        self.points.clear();
        self.points.extend(cloud.iter().filter(finite).step_by(step));
        (cloud.len() - count) as u32
    }

    fn score(&mut self) -> Score {
        self.tracker.mixture.place(&self.nodes_m);
        let side_m = self.tracker.side_m;
        let Tracker { mixture, outline, .. } = &mut self.tracker;
        Score::of(mixture, outline, &self.nodes_m, &self.cloud, side_m)
    }

    /// Looks for other poses, that of the folded sheet elsewhere and one in the cloud alone, and
    /// takes what explains clearly more.
    fn try_other_poses(
        &mut self,
        known: Option<&[[f32; 3]]>,
        facets: usize,
        tracked: &mut Option<(TrackReport, Score)>,
        report: &mut RegisterReport,
    ) {
        let mut taken = self.nodes_m.clone();
        // A folded sheet that is half explained where it is has not gone elsewhere: turned over it
        // may lie as well in the cloud.
        let is_half = tracked.as_ref().is_some_and(|(_, score)| score.explained >= HALF);
        for moved in [true, false] {
            let found = if moved {
                if is_half {
                    continue;
                }
                self.followed.elsewhere(&self.points, facets)
            } else {
                match &self.template_m {
                    Some(template) => first_pose::template_pose(&self.points, template),
                    None => first_pose::flat_pose(&self.points, &self.sheet, known),
                }
            };
            let Some(pose) = found.filter(|pose| first_pose::is_sane(pose, &self.points)) else {
                continue;
            };
            self.nodes_m.clone_from(&pose);
            self.tracker.forget();
            self.tracker.forget_visibility();
            // A pose that was lost is worth more than being in time.
            let iterations_max = self.params.iterations_max;
            let fit = self.tracker.track(&self.cloud, &mut self.nodes_m, iterations_max, &|| false);
            let score = self.score();
            let is_clearly_better = match tracked {
                Some((_, current)) => score.value() > current.value() + BETTER_BY,
                None => score.explained >= HALF,
            };
            if is_clearly_better && fit.iterations > 0 {
                *tracked = Some((fit, score));
                (report.reset, report.moved) = (true, moved);
                // As it was folded its layers are apart.
                taken.clone_from(if moved { &pose } else { &self.nodes_m });
            }
        }
        self.nodes_m = taken;
    }

    /// Takes the target from every node that is no control point.
    fn keep_controls(&self, confidence: &mut [f32]) {
        let controls = self.params.controls(&self.handed);
        let [rows, columns] = [0, 1].map(|axis| {
            let (nodes, controls) = (self.handed.nodes[axis], controls[axis]);
            let nearest = |k: usize| (k * (nodes - 1) + (controls - 1) / 2) / (controls - 1);
            let mut is_control = vec![false; nodes];
            (0..controls).for_each(|k| is_control[nearest(k)] = true);
            is_control
        });
        for (i, row) in rows.into_iter().enumerate() {
            for (j, column) in columns.iter().enumerate() {
                if !(row && *column) {
                    confidence[self.handed.index(i, j)] = 0.0;
                }
            }
        }
    }
}
