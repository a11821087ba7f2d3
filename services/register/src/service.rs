//! register as a process: waits for the state that its prediction needs, publishes targets.

mod deadline;

use deadline::Planner;
use orime_creases::Folds;
use orime_geometry::{RgbdCamera, SheetParams};
use orime_messages::{
    CameraMeta, Drops, Header, ObservedCloud, RegisterFigures, SheetState, Targets,
};
use orime_register::{Observation, RegisterParams, RegisterReport, Registrar, Termination};
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
    /// The process that the newest state came from.
    simulate: Option<u64>,
    /// Step of the newest targets; in lockstep their state is due.
    due: Option<u64>,
    /// Whether the first state is a pose to go on from.
    takes_over: bool,
    /// The end of a stream that has come already.
    ended: Option<Header>,
    /// Facets and layer order of that state.
    folds: Folds,
    /// The cameras as the last cloud told them, and as registration takes them.
    told: Vec<CameraMeta>,
    cameras: Vec<RgbdCamera>,
    /// Where the set has a budget and the pace is real time.
    planner: Option<Planner>,
    /// Step of the newest targets, and when they were published.
    published: Option<(u64, u64)>,
}

impl Register {
    /// Opens this stage's channels and says that it is ready.
    pub fn open(service: &Service) -> anyhow::Result<Self> {
        let config = service.config("register", RegisterParams::check)?;
        let params: SheetParams = service.section("sheet")?;
        let sheet = service.config("sheet", SheetParams::check)?;
        let template_m = orime_recording::template::load(&params, &sheet)?;
        let registrar = Registrar::new(&config, &sheet, template_m);
        // In lockstep nothing is in a hurry, and results repeat.
        let budget_ms = service.set().budget_ms.filter(|_| service.set().pace == Pace::Realtime);
        let register = Self {
            planner: budget_ms.map(|ms| Planner::new(ms, registrar.full_effort())),
            published: None,
            registrar,
            n_nodes: sheet.len(),
            pace: service.set().pace,
            clouds: service.subscribe(&channel::CLOUD)?,
            states: service.subscribe(&channel::STATE)?,
            targets: service.publish(&channel::TARGETS)?,
            recorder: service.recorder()?,
            state: None,
            simulate: None,
            due: None,
            takes_over: service.resume().is_some(),
            ended: service.ended_input(),
            folds: Folds::flat(&sheet),
            told: Vec::new(),
            cameras: Vec::new(),
        };
        service.ready()?;
        Ok(register)
    }

    /// Registers clouds until their stream ends.
    pub fn run(mut self) -> anyhow::Result<()> {
        while self.ended.is_none() {
            let Some(cloud) = self.next_cloud()? else { return Ok(()) };
            if cloud.header.is_end() {
                self.ended = Some(cloud.header);
                break;
            }
            if !self.take_state()? || !self.publish_targets(&cloud)? {
                return Ok(());
            }
            self.due = Some(cloud.header.step);
        }
        if let Some(last) = self.ended {
            self.targets.send_end(&last)?;
            self.recorder.ended(&last, self.clouds.drops())?;
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
    fn take_state(&mut self) -> anyhow::Result<bool> {
        match (self.pace, self.due) {
            (Pace::Lockstep, Some(due)) => loop {
                let Some(state) = self.states.next()? else { return Ok(false) };
                // A simulate that was restarted may not know what it is asked: its first word is
                // an answer to anything.
                let Header { step, incarnation, .. } = state.header;
                let simulate = self.simulate.replace(incarnation);
                let is_due = step >= due || simulate.is_some_and(|other| other != incarnation);
                self.keep(state);
                if is_due {
                    break;
                }
            },
            // After a restart, the channel gives the newest state that there is.
            _ => {
                if let Some(state) = self.states.try_newest()? {
                    let of = self.published.filter(|(step, _)| *step == state.header.step);
                    if let (Some((_, at_ns)), Some(planner)) = (of, &mut self.planner) {
                        planner.simulated(state.header.publish_ns.saturating_sub(at_ns));
                    }
                    self.keep(state);
                }
            }
        }
        let known = self.state.as_ref().is_some_and(|state| state.has_pose != 0);
        if self.takes_over && known {
            self.registrar.assume_pose();
        }
        self.takes_over = false;
        Ok(true)
    }

    /// Keeps a state; one without a pose, from a simulate that was restarted, does not replace
    /// one with a pose.
    fn keep(&mut self, state: Received<SheetState>) {
        let is_end = state.header.is_end();
        if !is_end && (state.has_pose != 0 || self.state.is_none()) {
            self.state = Some(state);
        }
    }

    /// Publishes the targets for one cloud; `false` if asked to stop while waiting.
    fn publish_targets(&mut self, cloud: &Received<ObservedCloud>) -> anyhow::Result<bool> {
        // Another source may have taken the first one's place.
        if self.told != cloud.cameras() {
            self.told = cloud.cameras().to_vec();
            self.cameras = cloud.cameras().iter().map(RgbdCamera::from).collect();
        }
        if let Some(state) = &self.state {
            state.folds.update(&mut self.folds);
        }
        let observed = Observation {
            cloud: cloud.points(),
            edgels: cloud.edgels(),
            features: cloud.features(),
            cameras: &self.cameras,
            folds: Some(&self.folds),
        };
        let registrar = &mut self.registrar;
        let plan = self.planner.as_ref().map(|planner| {
            let plan = planner.plan(cloud.header.arrival_ns, now_ns());
            registrar.set_effort(plan.effort);
            plan
        });
        let is_late = || plan.is_some_and(|plan| now_ns() > plan.until_ns);
        let predicted_m = self
            .state
            .as_deref()
            .filter(|state| state.has_pose != 0 && !state.header.is_end())
            .map(SheetState::predicted_m);
        let n_nodes = self.n_nodes;
        let mut work = Work {
            upstream_publish_ns: cloud.header.publish_ns,
            take_ns: cloud.take_ns,
            bytes: (n_nodes * 16) as u64,
            ..Work::default()
        };
        let mut was_cut_short = false;
        let sent = self.targets.send_with(&cloud.header, |targets| {
            work.start_ns = now_ns();
            targets.n_nodes = n_nodes as u32;
            // What an earlier message left there is no target.
            targets.targets_m[..n_nodes].fill([0.0; 3]);
            targets.confidence[..n_nodes].fill(0.0);
            let report = registrar.register_within(
                &observed,
                predicted_m,
                &mut targets.targets_m[..n_nodes],
                &mut targets.confidence[..n_nodes],
                &is_late,
            );
            targets.figures = figures(&report);
            targets.figures.effort = plan.map_or(1.0, |plan| plan.share);
            work.end_ns = now_ns();
            work.status = report.tracking as u32;
            was_cut_short = report.termination == Termination::Deadline;
        })?;
        let Some(sent) = sent else { return Ok(false) };
        self.published = Some((sent.header.step, sent.header.publish_ns));
        if let (Some(planner), Some(plan), false) = (&mut self.planner, plan, was_cut_short) {
            planner.registered(&plan, work.end_ns - work.start_ns);
        }
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
        reset: u32::from(report.reset) + u32::from(report.moved),
        iterations: report.iterations,
        sigma_m: report.sigma_m,
        inlier_ratio: report.inlier_ratio,
        points_rejected: report.points_rejected,
        effort: 1.0,
        cut_short: u32::from(report.termination == Termination::Deadline),
    }
}
