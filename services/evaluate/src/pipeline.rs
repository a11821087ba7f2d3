//! The four stages in one process, in lockstep: what the service set computes, without processes.

use orime_capture::{FrameSource, Gripper, PlannedFold};
use orime_creases::Folds;
use orime_geometry::{
    Edgel, Feature, ObservedPoint, RgbdCamera, RgbdFrame, RgbdFrameMut, SheetGrid,
};
use orime_register::{Observation, RegisterConfig, RegisterReport, Registrar, Tracking};
use orime_segment::{ObservedMut, SegmentConfig, SegmentReport, Segmenter};
use orime_simulate::{
    Grip, ModelReport, NewPose, PlanLog, PlannedLine, SheetModel, SimulateConfig,
};
use std::time::Instant;

use crate::summary::StageMs;

/// Everything that one set is made of, checked.
#[derive(Debug, Clone)]
pub struct PipelineConfig {
    /// The sheet.
    pub sheet: SheetGrid,
    /// Mass per area, kg/m².
    pub density_kg_per_m2: f64,
    /// Template node positions, where the sheet does not start flat.
    pub template_m: Option<Vec<[f32; 3]>>,
    /// Segmentation.
    pub segment: SegmentConfig,
    /// Registration.
    pub register: RegisterConfig,
    /// Simulation.
    pub simulate: SimulateConfig,
    /// Most points and edgels of a frame set, as in the service set's messages.
    pub capacity: [usize; 2],
}

/// Most features of a frame set, as in the service set's messages.
const FEATURES_MAX: usize = 1024;

struct FrameBuffer {
    color_rgb: Vec<u8>,
    depth_units: Vec<u16>,
    is_good: bool,
}

/// The stages, the source and their buffers.
pub struct Pipeline {
    source: Box<dyn FrameSource>,
    cameras: Vec<RgbdCamera>,
    frames: Vec<FrameBuffer>,
    segmenter: Segmenter,
    registrar: Registrar,
    model: SheetModel,
    model_report: ModelReport,
    sheet: SheetGrid,
    points: Vec<ObservedPoint>,
    edgels: Vec<Edgel>,
    features: Vec<Feature>,
    report: SegmentReport,
    targets_m: Vec<[f32; 3]>,
    confidence: Vec<f32>,
    held: Vec<Gripper>,
    grips: Vec<Grip>,
    plan: PlanLog,
    truth_m: Vec<[f32; 3]>,
    has_truth: bool,
    has_pose: bool,
    exposure_before_ns: Option<u64>,
    clock: Option<fn() -> f64>,
}

/// What one step of the pipeline gave; everything else is read from the pipeline.
#[derive(Debug, Clone)]
pub struct StepResult {
    /// What registration said.
    pub register: RegisterReport,
    /// Milliseconds per stage.
    pub ms: StageMs,
    /// Frames that could not be read, with the reason.
    pub frame_errors: Vec<String>,
}

/// The tracker's own word for its state, as it stands in scores.
pub fn tracking_name(tracking: Tracking) -> &'static str {
    match tracking {
        Tracking::Searching => "searching",
        Tracking::Tracking => "tracking",
        Tracking::Coasting => "coasting",
        Tracking::Lost => "lost",
    }
}

impl Pipeline {
    /// The stages over `source`.
    pub fn new(source: Box<dyn FrameSource>, config: &PipelineConfig) -> Self {
        let cameras = source.cameras().to_vec();
        let sheet = config.sheet.clone();
        let frame = |camera: &RgbdCamera| FrameBuffer {
            color_rgb: vec![0; 3 * camera.color.pixels()],
            depth_units: vec![0; camera.depth.pixels()],
            is_good: false,
        };
        let [points, edgels] = config.capacity;
        let none = ObservedPoint { position_m: [0.0; 3], normal: [0.0; 3], camera: 0, pixels: 0.0 };
        let no_edgel = Edgel { position_px: [0.0; 2], normal: [0.0; 2], camera: 0, kind: 0 };
        let no_feature = Feature { position_m: [0.0; 3], node: 0, camera: 0, pixels: 0.0 };
        let template = config.template_m.as_deref();
        Self {
            frames: cameras.iter().map(frame).collect(),
            segmenter: Segmenter::new(&config.segment, &cameras, &sheet),
            registrar: Registrar::new(&config.register, &sheet, config.template_m.clone()),
            model: SheetModel::new(&config.simulate, &sheet, config.density_kg_per_m2, template),
            model_report: ModelReport::default(),
            points: vec![none; points],
            edgels: vec![no_edgel; edgels],
            features: vec![no_feature; FEATURES_MAX],
            report: SegmentReport::default(),
            targets_m: vec![[0.0; 3]; sheet.len()],
            confidence: vec![0.0; sheet.len()],
            held: Vec::new(),
            grips: Vec::new(),
            plan: told_plan(source.as_ref(), &sheet),
            truth_m: vec![[0.0; 3]; sheet.len()],
            has_truth: false,
            has_pose: false,
            exposure_before_ns: None,
            clock: None,
            cameras,
            source,
            sheet,
        }
    }

    /// Takes the stages' times from this clock, seconds, instead of the time on the wall.
    pub fn timed_by(self, clock: fn() -> f64) -> Self {
        Self { clock: Some(clock), ..self }
    }

    /// Number of frame sets, or `None` for an endless source.
    pub fn steps(&self) -> Option<u64> {
        self.source.steps()
    }

    /// Runs one step from pixels to state.
    pub fn step(&mut self, step: u64) -> StepResult {
        let mut ms = StageMs::default();
        let clock = self.clock;
        let frame_errors = timed(clock, &mut ms.capture, || self.capture(step));
        timed(clock, &mut ms.segment, || self.segment());
        let register = timed(clock, &mut ms.register, || self.register());
        timed(clock, &mut ms.simulate, || self.simulate(step, &register));
        StepResult { register, ms, frame_errors }
    }

    fn capture(&mut self, step: u64) -> Vec<String> {
        let mut errors = Vec::new();
        for (camera, buffer) in self.frames.iter_mut().enumerate() {
            let frame = RgbdFrameMut {
                color_rgb: &mut buffer.color_rgb,
                depth_units: &mut buffer.depth_units,
            };
            let read = self.source.read(step, camera, frame);
            buffer.is_good = read.is_ok();
            errors.extend(read.err().map(|error| error.to_string()));
        }
        self.source.grippers(step, &mut self.held);
        self.has_truth = self.source.truth_m(step, &self.sheet, &mut self.truth_m);
        errors
    }

    fn segment(&mut self) {
        let frames: Vec<Option<RgbdFrame<'_>>> = self
            .frames
            .iter()
            .map(|buffer| {
                buffer.is_good.then_some(RgbdFrame {
                    color_rgb: &buffer.color_rgb,
                    depth_units: &buffer.depth_units,
                })
            })
            .collect();
        let out = ObservedMut {
            points: &mut self.points,
            edgels: &mut self.edgels,
            features: &mut self.features,
        };
        self.report = self.segmenter.segment(&frames, out);
    }

    fn register(&mut self) -> RegisterReport {
        let predicted = self.has_pose.then(|| self.model.predicted_for_cameras_m());
        let observed = Observation {
            cloud: &self.points[..self.report.points],
            edgels: &self.edgels[..self.report.edgels],
            features: &self.features[..self.report.features],
            cameras: &self.cameras,
            folds: Some(self.model.folds()),
        };
        self.registrar.register(&observed, predicted, &mut self.targets_m, &mut self.confidence)
    }

    fn simulate(&mut self, step: u64, register: &RegisterReport) {
        let exposure_ns = self.source.exposure_ns(step, 0);
        let dt_s = orime_simulate::frame_s(self.exposure_before_ns, exposure_ns);
        self.exposure_before_ns = Some(exposure_ns);
        let grip = |gripper: &Gripper| Grip {
            uv_m: gripper.uv_m,
            position_m: gripper.world_from_gripper.translation.vector.into(),
        };
        self.grips.clear();
        self.grips.extend(self.held.iter().map(grip));
        self.model.set_grips(&self.grips);
        self.model.set_plan(self.plan.at(exposure_ns));
        self.has_pose |= register.reset;
        if self.has_pose {
            let (targets_m, confidence) = (&self.targets_m, &self.confidence);
            let pose = match (register.reset, register.moved) {
                (true, true) => NewPose::Moved,
                (true, false) => NewPose::Fresh,
                (false, _) => NewPose::None,
            };
            self.model_report = self.model.step_from(dt_s, targets_m, confidence, pose);
        }
    }

    /// The sheet's nodes; empty before the first pose.
    pub fn nodes_m(&self) -> &[[f32; 3]] {
        if self.has_pose { self.model.positions_m() } else { &[] }
    }

    /// Facets, creases and layer order as the tracker has them.
    pub fn folds(&self) -> &Folds {
        self.model.folds()
    }

    /// The facet or, in the paper's mode, the cluster of every node.
    pub fn clusters(&self) -> &[u8] {
        self.model.clusters()
    }

    /// What the simulation of the last step did.
    pub fn model_report(&self) -> &ModelReport {
        &self.model_report
    }

    /// The observed cloud of the last step.
    pub fn cloud(&self) -> &[ObservedPoint] {
        &self.points[..self.report.points]
    }

    /// The contour of the last step.
    pub fn edgels(&self) -> &[Edgel] {
        &self.edgels[..self.report.edgels]
    }

    /// The recognised points of the last step.
    pub fn features(&self) -> &[Feature] {
        &self.features[..self.report.features]
    }

    /// The cameras.
    pub fn cameras(&self) -> &[RgbdCamera] {
        &self.cameras
    }

    /// Colour image of a camera in the last step, `r, g, b` bytes; `None` if it could not be read.
    pub fn color_rgb(&self, camera: usize) -> Option<&[u8]> {
        self.frames.get(camera).filter(|f| f.is_good).map(|f| f.color_rgb.as_slice())
    }

    /// Where the nodes truly are, if the source knows.
    pub fn truth_m(&self) -> Option<&[[f32; 3]]> {
        self.has_truth.then_some(self.truth_m.as_slice())
    }
}

/// What the source tells of folds to come.
fn told_plan(source: &dyn FrameSource, sheet: &SheetGrid) -> PlanLog {
    let line = |fold: &PlannedFold| PlannedLine {
        ends_uv_m: fold.ends_uv_m,
        valid_from_ns: fold.valid_from_ns,
    };
    let mut log = PlanLog::new();
    let lines: Vec<PlannedLine> = source.fold_plan().iter().map(line).collect();
    log.note(source.exposure_ns(0, 0), &lines, sheet);
    log
}

fn timed<T>(clock: Option<fn() -> f64>, ms: &mut f64, work: impl FnOnce() -> T) -> T {
    let (start, told_s) = (Instant::now(), clock.map(|clock| clock()));
    let result = work();
    let elapsed_s = match (clock, told_s) {
        (Some(clock), Some(told_s)) => clock() - told_s,
        _ => start.elapsed().as_secs_f64(),
    };
    *ms = elapsed_s * 1e3;
    result
}
