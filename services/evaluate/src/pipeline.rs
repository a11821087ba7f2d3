//! The four stages in one process, in lockstep: what the service set computes, without processes.

use orime_capture::FrameSource;
use orime_geometry::{
    Edgel, Feature, ObservedPoint, RgbdCamera, RgbdFrame, RgbdFrameMut, SheetGrid,
};
use orime_register::{Observation, RegisterConfig, RegisterReport, Registrar, Tracking};
use orime_segment::{ObservedMut, SegmentConfig, SegmentReport, Segmenter};
use orime_simulate::{SimulateConfig, Simulator};
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
    simulator: Simulator,
    finder: orime_creases::CreaseFinder,
    sheet: SheetGrid,
    points: Vec<ObservedPoint>,
    edgels: Vec<Edgel>,
    features: Vec<Feature>,
    report: SegmentReport,
    targets_m: Vec<[f32; 3]>,
    confidence: Vec<f32>,
    /// Where the nodes are expected in the next step, metres.
    predicted_m: Vec<[f32; 3]>,
    truth_m: Vec<[f32; 3]>,
    has_truth: bool,
    has_pose: bool,
    exposure_before_ns: Option<u64>,
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
            simulator: Simulator::new(&config.simulate, &sheet, config.density_kg_per_m2, template),
            finder: orime_creases::CreaseFinder::new(
                &orime_creases::CreaseParams::default().check().unwrap(),
                &sheet,
            ),
            points: vec![none; points],
            edgels: vec![no_edgel; edgels],
            features: vec![no_feature; FEATURES_MAX],
            report: SegmentReport::default(),
            targets_m: vec![[0.0; 3]; sheet.len()],
            confidence: vec![0.0; sheet.len()],
            predicted_m: Vec::with_capacity(sheet.len()),
            truth_m: vec![[0.0; 3]; sheet.len()],
            has_truth: false,
            has_pose: false,
            exposure_before_ns: None,
            cameras,
            source,
            sheet,
        }
    }

    /// Number of frame sets, or `None` for an endless source.
    pub fn steps(&self) -> Option<u64> {
        self.source.steps()
    }

    /// Runs one step from pixels to state.
    pub fn step(&mut self, step: u64) -> StepResult {
        let mut ms = StageMs::default();
        let frame_errors = timed(&mut ms.capture, || self.capture(step));
        timed(&mut ms.segment, || self.segment());
        let register = timed(&mut ms.register, || self.register());
        timed(&mut ms.simulate, || self.simulate(step, &register));
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
        let predicted = self.has_pose.then_some(self.predicted_m.as_slice());
        let observed = Observation {
            cloud: &self.points[..self.report.points],
            edgels: &self.edgels[..self.report.edgels],
            features: &self.features[..self.report.features],
            cameras: &self.cameras,
            folds: Some(self.simulator.folds()),
        };
        self.registrar.register(&observed, predicted, &mut self.targets_m, &mut self.confidence)
    }

    fn simulate(&mut self, step: u64, register: &RegisterReport) {
        let exposure_ns = self.source.exposure_ns(step, 0);
        let dt_s = orime_simulate::frame_s(self.exposure_before_ns, exposure_ns);
        self.exposure_before_ns = Some(exposure_ns);
        self.has_pose |= register.reset;
        if self.has_pose {
            if std::env::var("ORIME_PLAN").is_ok() {
                oracle(&mut self.simulator, step);
            } else if std::env::var("ORIME_NOFOLD").is_err() {
                if register.reset {
                    self.finder.reset();
                }
                if self.finder.step(&self.targets_m, &self.confidence)
                    && std::env::var("ORIME_DBG").is_ok()
                {
                    eprintln!("step {step}: {} facets", self.finder.folds().facets().len());
                    for c in self.finder.folds().creases() {
                        eprintln!(
                            "   {:?} {:.1} {:.1}  {:.1} {:.1}",
                            c.facets,
                            c.ends_m[0][0] * 1e3,
                            c.ends_m[0][1] * 1e3,
                            c.ends_m[1][0] * 1e3,
                            c.ends_m[1][1] * 1e3
                        );
                    }
                }
                if std::env::var("ORIME_DBG").is_ok() && step % 4 == 0 {
                    let folds = self.finder.folds();
                    for f in 0..folds.facets().len() {
                        let m = folds.members(f);
                        let c: f32 = m.iter().map(|n| self.confidence[*n as usize]).sum::<f32>()
                            / m.len() as f32;
                        let near: Vec<u32> = m
                            .iter()
                            .copied()
                            .filter(|n| self.confidence[*n as usize] > 0.3)
                            .collect();
                        eprintln!(
                            "dbg {step} facet {f} conf {c:.2} residual {:.2} seen {:.2} state {:.2}",
                            1e3 * folds.frame(f, &self.targets_m).residual_m,
                            1e3 * orime_creases::FacetFrame::fit(
                                &self.sheet,
                                &near,
                                &self.targets_m
                            )
                            .residual_m,
                            1e3 * folds.frame(f, self.simulator.positions_m()).residual_m
                        );
                    }
                }
                self.simulator.set_folds(self.finder.folds());
            }
            self.simulator.step(dt_s, &self.targets_m, &self.confidence, register.reset);
            self.predicted_m.clear();
            self.predicted_m.extend_from_slice(self.simulator.predict(dt_s));
        }
    }

    /// The sheet's nodes; empty before the first pose.
    pub fn nodes_m(&self) -> &[[f32; 3]] {
        if self.has_pose { self.simulator.positions_m() } else { &[] }
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

fn timed<T>(ms: &mut f64, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    *ms = start.elapsed().as_secs_f64() * 1e3;
    result
}

fn oracle(simulator: &mut Simulator, step: u64) {
    use orime_creases::Line;
    let Ok(plan) = std::env::var("ORIME_PLAN") else { return };
    let l = 0.15;
    let (a, b) = (Line::through([0.0, 0.0], [l, l]), Line::through([l, 0.0], [0.0, l]));
    let (c, d) =
        (Line::through([l / 2.0, 0.0], [l / 2.0, l]), Line::through([0.0, l / 2.0], [l, l / 2.0]));
    let lines = if plan == "0" { [a, b, c, d] } else { [b, a, d, c] };
    let h = [[0.0, 0.0], [l, l], [0.0, l], [l, 0.0], [l / 2.0, l / 2.0]];
    let _ = h;
    let mut folds = simulator.folds().clone();
    for (k, (line, at)) in lines.iter().zip([10, 115, 203, 203]).enumerate() {
        if step == at {
            // M, M' lie on the half with A; N, N' later.
            let n = folds.facets().len();
            for f in 0..n {
                let _ = k;
                folds.split(f, line);
            }
        }
    }
    simulator.set_folds(&folds);
}
