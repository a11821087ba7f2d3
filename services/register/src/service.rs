//! register as a process: waits for the state that its prediction needs, publishes targets.

use orime_geometry::{RgbdCamera, SheetParams};
use orime_messages::{Drops, ObservedCloud, RegisterFigures, SheetState, Targets};
use orime_register::{Observation, RegisterParams, RegisterReport, Registrar};
use orime_runtime::{
    Pace, Publisher, Received, Recorder, Service, Subscription, Work, channel, now_ns,
};

/// The register process.
pub struct Register {
    registrar: Registrar,
    n_nodes: usize,
    pace: Pace,
    clouds: Subscription<ObservedCloud>,
    states: Subscription<SheetState>,
    targets: Publisher<Targets>,
    recorder: Recorder,
    /// The newest state; in lockstep that of the step before.
    state: Option<Received<SheetState>>,
    /// The cameras, once a cloud has told them.
    cameras: Vec<RgbdCamera>,
}

impl Register {
    /// Opens this stage's channels and says that it is ready.
    pub fn open(service: &Service) -> anyhow::Result<Self> {
        let config = service.config("register", RegisterParams::check)?;
        let params: SheetParams = service.section("sheet")?;
        let sheet = service.config("sheet", SheetParams::check)?;
        let template_m = orime_recording::template::load(&params, &sheet)?;
        let register = Self {
            registrar: Registrar::new(&config, &sheet, template_m),
            n_nodes: sheet.len(),
            pace: service.set().pace,
            clouds: service.subscribe(&channel::CLOUD)?,
            states: service.subscribe(&channel::STATE)?,
            targets: service.publish(&channel::TARGETS)?,
            recorder: service.recorder()?,
            state: None,
            cameras: Vec::new(),
        };
        service.ready()?;
        Ok(register)
    }

    /// Registers clouds until their stream ends.
    pub fn run(mut self) -> anyhow::Result<()> {
        let mut first = true;
        while let Some(cloud) = self.next_cloud()? {
            if cloud.header.is_end() {
                self.targets.send_end(&cloud.header)?;
                self.recorder.ended(&cloud.header, self.clouds.drops())?;
                break;
            }
            if !self.take_state(first)? || !self.publish_targets(&cloud)? {
                break;
            }
            first = false;
        }
        Ok(())
    }

    fn next_cloud(&mut self) -> anyhow::Result<Option<Received<ObservedCloud>>> {
        Ok(match self.pace {
            Pace::Lockstep => self.clouds.next()?,
            Pace::Realtime => self.clouds.newest()?,
        })
    }

    /// Has the state that the prediction starts from; `false` if asked to stop.
    ///
    /// In lockstep each published step gives exactly one state, and the next step needs it.
    fn take_state(&mut self, first: bool) -> anyhow::Result<bool> {
        if self.pace == Pace::Realtime {
            if let Some(state) = self.states.try_newest()? {
                self.state = Some(state);
            }
        } else if !first {
            self.state = None;
            self.state = self.states.next()?;
            return Ok(self.state.is_some());
        }
        Ok(true)
    }

    /// Publishes the targets for one cloud; `false` if asked to stop while waiting.
    fn publish_targets(&mut self, cloud: &Received<ObservedCloud>) -> anyhow::Result<bool> {
        if self.cameras.len() != cloud.cameras().len() {
            self.cameras = cloud.cameras().iter().map(RgbdCamera::from).collect();
        }
        let observed = Observation {
            cloud: cloud.points(),
            edgels: cloud.edgels(),
            features: cloud.features(),
            cameras: &self.cameras,
            folds: None,
        };
        let registrar = &mut self.registrar;
        let predicted_m = self
            .state
            .as_deref()
            .filter(|state| state.has_pose != 0 && !state.header.is_end())
            .map(SheetState::positions_m);
        let n_nodes = self.n_nodes;
        let mut work = Work {
            upstream_publish_ns: cloud.header.publish_ns,
            take_ns: cloud.take_ns,
            bytes: (n_nodes * 16) as u64,
            ..Work::default()
        };
        let sent = self.targets.send_with(&cloud.header, |targets| {
            work.start_ns = now_ns();
            targets.n_nodes = n_nodes as u32;
            // What an earlier message left there is no target.
            targets.targets_m[..n_nodes].fill([0.0; 3]);
            targets.confidence[..n_nodes].fill(0.0);
            let report = registrar.register(
                &observed,
                predicted_m,
                &mut targets.targets_m[..n_nodes],
                &mut targets.confidence[..n_nodes],
            );
            targets.figures = figures(&report);
            work.end_ns = now_ns();
            work.status = report.tracking as u32;
        })?;
        let Some(sent) = sent else { return Ok(false) };
        let drops = self.drops();
        self.recorder.published(&sent.header, work, drops)?;
        Ok(true)
    }

    /// Clouds that were lost; states are not, for only the newest is ever wanted.
    fn drops(&self) -> Drops {
        self.clouds.drops()
    }
}

fn figures(report: &RegisterReport) -> RegisterFigures {
    RegisterFigures {
        tracking: report.tracking as u32,
        reset: u32::from(report.reset),
        iterations: report.iterations,
        sigma_m: report.sigma_m,
        inlier_ratio: report.inlier_ratio,
        points_rejected: report.points_rejected,
    }
}
