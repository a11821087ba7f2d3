//! `orime-evaluate watch`: the judge beside a running set.

use anyhow::Context;
use orime_creases::Folds;
use orime_evaluate::judge::{Judge, StepInput};
use orime_evaluate::latency::{LatencyFigures, Timing};
use orime_evaluate::picture::PanelInput;
use orime_evaluate::summary::StageMs;
use orime_geometry::RgbdCamera;
use orime_messages::{
    CameraMeta, ObservedCloud, RecordKind, SheetState, Stage, StageRecord, Truth,
};
use orime_runtime::{
    FrameSubscription, Pace, Received, ReceivedFrame, Service, SetFile, Stop, Subscription, channel,
};
use std::collections::{BTreeMap, VecDeque};
use std::io::Write;
use std::path::PathBuf;

use super::output::{self, Pictures};

/// Score a running service set from outside (started by `orime up`).
///
/// Prints one JSON line per step, and writes summary.json, steps.csv, latency.json and
/// pictures at the end.
#[derive(Debug, clap::Args)]
pub struct WatchArguments {
    /// The set file.
    set: PathBuf,
    /// Folder for summary.json, steps.csv, latency.json and pictures/.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A picture every N steps; 0 makes about sixteen of a recording, 100 apart if endless.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pictures_every: u64,
}

/// Images that are kept for pictures until their state arrives.
const IMAGES_MAX: usize = 64;

struct Watch {
    judge: Judge,
    pace: Pace,
    stop: Stop,
    states: Subscription<SheetState>,
    /// Facets of the last picture.
    folds: Folds,
    clouds: Subscription<ObservedCloud>,
    truths: Subscription<Truth>,
    frames: FrameSubscription,
    records: Subscription<StageRecord>,
    times: BTreeMap<u64, StageMs>,
    timings: Vec<Timing>,
    pictures: Pictures,
    /// As their last frames told them.
    cameras: Vec<Option<CameraMeta>>,
    /// Step and colour image of the pictured camera.
    images: VecDeque<(u64, Vec<u8>)>,
    cloud: Option<Received<ObservedCloud>>,
    truth: Option<Received<Truth>>,
    frame: Option<ReceivedFrame>,
}

/// Runs the command.
pub fn run(arguments: &WatchArguments) -> anyhow::Result<()> {
    let service = Service::start_with(Stage::Judge, &arguments.set)?;
    let mut watch = Watch::open(&service, arguments)?;
    service.ready()?;
    let mut has_ended = service.ended_input().is_some();
    while !has_ended && let Some(state) = watch.next_state()? {
        has_ended = state.header.is_end();
        if has_ended {
            break;
        }
        // A simulate that was restarted begins with a state of no sheet at all.
        if state.n_nodes > 0 {
            watch.score(&state)?;
        }
        watch.timings.push(Timing {
            latency_ms: state.header.publish_ns.saturating_sub(state.header.arrival_ns) as f64
                * 1e-6,
            effort: state.figures.effort,
            cut_short: state.figures.cut_short != 0,
        });
        watch.take_times()?;
    }
    watch.take_times()?;
    watch.judge.set_times(&watch.times);
    let name = arguments.set.display().to_string();
    output::write_json(&arguments.out.join("summary.json"), &name, &watch.judge)?;
    output::write_csv(&arguments.out.join("steps.csv"), watch.judge.steps())?;
    eprintln!("{}", output::table(&name, &watch.judge.summary()));
    if let Some(figures) = LatencyFigures::of(&watch.timings, service.set().budget_ms) {
        let path = arguments.out.join("latency.json");
        let text = serde_json::to_string_pretty(&figures)? + "\n";
        std::fs::write(&path, text).with_context(|| format!("writing `{}`", path.display()))?;
        eprintln!("{figures}");
    }
    Ok(())
}

impl Watch {
    fn open(service: &Service, arguments: &WatchArguments) -> anyhow::Result<Self> {
        let set: &SetFile = service.set();
        let config = super::set::pipeline(set)?;
        let capture = set.checked("capture", orime_capture::CaptureParams::check)?;
        // The recording is opened only to learn how long it is.
        let steps = orime_capture::open(&capture, &config.sheet)?.steps();
        let folder = arguments.out.join("pictures");
        let pictures = Pictures::new(&folder, arguments.pictures_every, steps.unwrap_or(1600), 0)?;
        Ok(Self {
            judge: Judge::new(&config.sheet, config.template_m.as_deref()),
            pace: set.pace,
            stop: service.stop().clone(),
            states: service.subscribe(&channel::STATE)?,
            folds: Folds::flat(&config.sheet),
            clouds: service.subscribe(&channel::CLOUD)?,
            truths: service.subscribe(&channel::TRUTH)?,
            frames: service.subscribe_frames()?,
            records: service.subscribe(&channel::RECORD)?,
            times: BTreeMap::new(),
            timings: Vec::new(),
            pictures,
            cameras: Vec::new(),
            images: VecDeque::new(),
            cloud: None,
            truth: None,
            frame: None,
        })
    }

    fn next_state(&mut self) -> anyhow::Result<Option<Received<SheetState>>> {
        let Self { pace, states, stop, clouds, truths, frames, cloud, truth, frame, .. } = self;
        // What belongs to states that died with a stage would be waited for for ever, and those
        // who wait for its memory too.
        let idle = || {
            if *pace == Pace::Lockstep && stop.take_release() {
                (*cloud, *truth, *frame) = (None, None, None);
                while let Ok(Some(_)) = clouds.try_next() {}
                while let Ok(Some(_)) = truths.try_next() {}
                while let Ok(Some(_)) = frames.try_next() {}
            }
        };
        Ok(match pace {
            Pace::Lockstep => states.next_with(idle)?,
            Pace::Realtime => states.newest_with(idle)?,
        })
    }

    /// Takes what belongs to `step` or before; what is newer waits.
    fn catch_up(&mut self, step: u64) -> anyhow::Result<()> {
        while self.cloud.as_ref().is_none_or(|c| c.header.step < step && !c.header.is_end()) {
            let Some(cloud) = self.clouds.try_next()? else { break };
            self.cloud = Some(cloud);
        }
        while self.truth.as_ref().is_none_or(|t| t.header.step < step && !t.header.is_end()) {
            let Some(truth) = self.truths.try_next()? else { break };
            self.truth = Some(truth);
        }
        loop {
            if self.frame.is_none() {
                self.frame = self.frames.try_next()?;
            }
            let Some(frame) = self.frame.take_if(|f| f.meta().header.step <= step) else { break };
            self.take_frame(&frame);
        }
        Ok(())
    }

    /// Learns the camera, and keeps the image if there will be a picture of it.
    fn take_frame(&mut self, frame: &ReceivedFrame) {
        let meta = frame.meta();
        if meta.header.is_end() {
            return;
        }
        let camera = meta.camera as usize;
        self.cameras.resize(self.cameras.len().max(meta.n_cameras as usize), None);
        self.cameras[camera] = Some(meta.calibration);
        if camera == self.pictures.camera && self.pictures.wants(meta.header.step) {
            if let Some(view) = frame.view() {
                self.images.push_back((meta.header.step, view.color_rgb.to_vec()));
            }
            if self.images.len() > IMAGES_MAX {
                self.images.pop_front();
            }
        }
    }

    /// Takes what the stages recorded of their work. Records of a step come before its state and
    /// after it, so they are gathered by step and given to the judge at the end.
    fn take_times(&mut self) -> anyhow::Result<()> {
        while let Some(record) = self.records.try_next()? {
            if record.kind() != Some(RecordKind::Published) {
                continue;
            }
            let ms = record.end_ns.saturating_sub(record.start_ns) as f64 * 1e-6;
            let times = self.times.entry(record.header.step).or_default();
            match Stage::from_number(record.header.stage) {
                Some(Stage::Capture) => times.capture += ms,
                Some(Stage::Segment) => times.segment += ms,
                Some(Stage::Register) => times.register += ms,
                Some(Stage::Simulate) => times.simulate += ms,
                _ => {}
            }
        }
        Ok(())
    }

    fn score(&mut self, state: &Received<SheetState>) -> anyhow::Result<()> {
        let step = state.header.step;
        self.catch_up(step)?;
        let known = self.cameras.iter().map(|camera| camera.as_ref().map(RgbdCamera::from));
        let cameras: Option<Vec<RgbdCamera>> = known.collect();
        let cameras = cameras.unwrap_or_default();
        let is_now = |found: u64, is_end: bool| found == step && !is_end;
        let cloud = self.cloud.as_deref().filter(|c| is_now(c.header.step, c.header.is_end()));
        let truth = self.truth.as_deref().filter(|t| is_now(t.header.step, t.header.is_end()));
        let points = cloud.map_or(&[][..], ObservedCloud::points);
        let edgels = cloud.map_or(&[][..], ObservedCloud::edgels);
        let nodes_m = if state.has_pose != 0 { state.positions_m() } else { &[] };
        let sheet = self.judge.sheet().clone();
        let score = self.judge.score(&StepInput {
            step,
            tracking: tracking_name(state.figures.tracking),
            reset: state.figures.reset != 0,
            nodes_m,
            cloud: points,
            edgels,
            cameras: &cameras,
            truth_m: truth.map(Truth::positions_m).filter(|t| !t.is_empty()),
            // The stages' records bring the times, see `take_times`.
            ms: StageMs::default(),
        });
        let line = serde_json::json!({
            "step": step,
            "tracking": score.tracking,
            "e_mm": score.e_mm,
            "vertex_error_mm": score.vertex_error_mm_mean,
        });
        let mut out = std::io::stdout().lock();
        writeln!(out, "{line}").and_then(|()| out.flush()).context("writing a line per step")?;
        drop(out);
        let pictured = self.pictures.camera;
        if self.pictures.wants(step) && pictured < cameras.len() {
            let image = self.images.iter().find(|(found, _)| *found == step);
            state.folds.update(&mut self.folds);
            self.pictures.write(&PanelInput {
                score,
                sheet: &sheet,
                nodes_m,
                folds: &self.folds,
                clusters: &[],
                cloud: points,
                edgels,
                camera: &cameras[pictured],
                camera_index: pictured,
                color_rgb: image.map(|(_, rgb)| rgb.as_slice()),
            })?;
        }
        self.images.retain(|(found, _)| *found > step);
        Ok(())
    }
}

fn tracking_name(tracking: u32) -> &'static str {
    match tracking {
        1 => "tracking",
        2 => "coasting",
        3 => "lost",
        _ => "searching",
    }
}
