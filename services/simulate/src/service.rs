//! simulate as a process: advances the sheet by each set of targets and publishes its state.
//!
//! Grippers are looked at when targets come, and never waited for: in lockstep capture has sent
//! theirs before the frames that the targets were made of. So are plans of what will be folded.

use crate::between::{Between, Due};
use orime_geometry::{SheetGrid, SheetParams};
use orime_messages::{
    FoldPlan, FoldsMeta, GripperMeta, Grippers, Header, PlanLineMeta, RegisterFigures, SheetState,
    Targets,
};
use orime_runtime::{
    Aside, Pace, Publisher, Received, Recorder, Resume, Service, Subscription, Work, channel,
    now_ns,
};
use orime_simulate::{
    Effect, Effects, Grip, GripLog, NewPose, PlanLog, PlannedLine, SheetModel, SimulateParams,
    Simulator, frame_s,
};
use std::time::Duration;

/// Number of a sheet that is followed, as register says it.
const TRACKING: u32 = 1;
/// … and of a step without anything to register against.
const COASTING: u32 = 2;

/// The simulate process.
pub struct Simulate {
    model: SheetModel,
    sheet: SheetGrid,
    pace: Pace,
    /// What the scene names.
    effects: Effects,
    targets: Subscription<Targets>,
    /// Only where the scene names them.
    grippers: Option<(Aside<Grippers>, GripLog)>,
    plans: Aside<FoldPlan>,
    plan: PlanLog,
    states: Publisher<SheetState>,
    /// Only where states between frames are asked for, and in realtime.
    predictions: Option<Publisher<SheetState>>,
    between: Between,
    /// Header and figures of the newest state.
    newest: Option<(Header, RegisterFigures)>,
    recorder: Recorder,
    header: Header,
    exposure_before_ns: Option<u64>,
    has_pose: bool,
    /// Whether the first good targets are a pose to go on from.
    takes_over: bool,
    /// Where a restarted process goes on.
    resume: Option<Resume>,
    /// The end of a stream that has come already.
    ended: Option<Header>,
}

impl Simulate {
    /// Opens this stage's channels and says that it is ready.
    pub fn open(service: &Service) -> anyhow::Result<Self> {
        let config = service.config("simulate", SimulateParams::check)?;
        let simulate: SimulateParams = service.section("simulate")?;
        let listens = simulate.effects.contains(&Effect::Grippers);
        let grippers = listens.then(|| service.aside(&channel::GRIPPER)).transpose()?;
        let params: SheetParams = service.section("sheet")?;
        let sheet = service.config("sheet", SheetParams::check)?;
        let rest_m = orime_recording::template::load(&params, &sheet)?;
        let density = params.density_kg_per_m2;
        let mut model = SheetModel::new(&config, &sheet, density, rest_m.as_deref());
        choose_backend(model.simulator_mut())?;
        let per_frame = simulate.predict.per_frame;
        let is_between = per_frame > 0 && service.set().pace == Pace::Realtime;
        let simulate = Self {
            plans: service.aside(&channel::PLAN)?,
            plan: PlanLog::new(),
            predictions: is_between.then(|| service.publish(&channel::PREDICTION)).transpose()?,
            between: Between::new(if is_between { per_frame } else { 0 }),
            newest: None,
            model,
            pace: service.set().pace,
            effects: simulate.effects.iter().copied().collect(),
            targets: service.subscribe(&channel::TARGETS)?,
            grippers: grippers.map(|grippers| (grippers, GripLog::new(&config))),
            states: service.publish(&channel::STATE)?,
            recorder: service.recorder()?,
            header: service.header(),
            exposure_before_ns: None,
            has_pose: false,
            takes_over: service.resume().is_some(),
            resume: service.resume(),
            ended: service.ended_input(),
            sheet,
        };
        service.ready()?;
        Ok(simulate)
    }

    /// Advances the sheet until the stream of targets ends.
    pub fn run(mut self) -> anyhow::Result<()> {
        if !self.answer_for_predecessor()? {
            return Ok(());
        }
        while self.ended.is_none() {
            let Some(targets) = self.next_targets()? else { return Ok(()) };
            if targets.header.is_end() {
                self.ended = Some(targets.header);
            } else if !self.publish_state(&targets)? {
                return Ok(());
            }
        }
        if let Some(last) = self.ended {
            self.states.send_end(&last)?;
            self.recorder.ended(&last, self.targets.drops())?;
        }
        Ok(())
    }

    /// In lockstep register waits for one state per targets, and those that the process before
    /// this one had in hand are lost: says that there is no pose. `false` if asked to stop.
    fn answer_for_predecessor(&mut self) -> anyhow::Result<bool> {
        let Some(resume) = self.resume.filter(|_| self.pace == Pace::Lockstep) else {
            return Ok(true);
        };
        let step = resume.asked.max(resume.published).unwrap_or(0);
        let lineage = Header { step, ..self.header };
        let size_m = self.sheet.size_m;
        let nodes = self.sheet.nodes.map(|nodes| nodes as u32);
        let sent = self.states.send_with(&lineage, |state| {
            // The first message of this process: what is not written here is 0.
            state.figures.tracking = COASTING;
            (state.n_nodes, state.has_pose, state.targets_rejected) = (0, 0, 0);
            (state.nodes, state.size_m) = (nodes, size_m);
        })?;
        Ok(sent.is_some())
    }

    fn next_targets(&mut self) -> anyhow::Result<Option<Received<Targets>>> {
        while let Some(due) = self.between.next() {
            // One instant at a time: what is late is given up.
            let wait = Duration::from_nanos(due.at_ns.saturating_sub(now_ns()));
            if let Some(targets) = self.targets.newest_within(wait)? {
                return Ok(Some(targets));
            }
            self.between.take();
            self.publish_prediction(due)?;
        }
        // Register, if it is restarted, goes on from the newest state: nobody sends one meanwhile.
        let states = &self.states;
        let greet = || states.greet();
        Ok(match self.pace {
            Pace::Lockstep => self.targets.next_with(greet)?,
            Pace::Realtime => self.targets.newest_with(greet)?,
        })
    }

    /// Takes over what holds the sheet at an instant.
    fn hear_grippers(&mut self, exposure_ns: u64) -> anyhow::Result<()> {
        let Some((grippers, log)) = &mut self.grippers else { return Ok(()) };
        while let Some(message) = grippers.try_next()? {
            let holding = message.grippers().iter().filter(|gripper| gripper.is_holding == 1);
            let grip = |gripper: &GripperMeta| Grip {
                uv_m: gripper.grasped_uv_m,
                position_m: gripper.world_from_gripper.translation_m,
            };
            if !message.header.is_end() {
                log.note(message.header.exposure_ns, holding.map(grip));
            }
        }
        self.model.set_grips(log.at(exposure_ns));
        Ok(())
    }

    /// Publishes where the sheet is expected between two frames, on a channel of its own.
    fn publish_prediction(&mut self, due: Due) -> anyhow::Result<()> {
        let (Some(predictions), Some((newest, figures))) = (&mut self.predictions, self.newest)
        else {
            return Ok(());
        };
        let (model, sheet) = (&mut self.model, &self.sheet);
        let lineage = Header { exposure_ns: due.exposure_ns, ..newest };
        predictions.send_prediction(&lineage, |state| {
            state.figures = figures;
            state.n_nodes = sheet.len() as u32;
            (state.has_pose, state.targets_rejected) = (1, 0);
            state.nodes = sheet.nodes.map(|nodes| nodes as u32);
            state.size_m = sheet.size_m;
            state.folds.set(model.folds());
            state.predicted_m[..sheet.len()].copy_from_slice(model.predicted_for_cameras_m());
            state.camera_offset_m = model.camera_offset_m();
            state.positions_m[..sheet.len()].copy_from_slice(model.expect_m(due.ahead_s));
        })?;
        Ok(())
    }

    /// Takes over what is planned at an instant.
    fn hear_plans(&mut self, exposure_ns: u64) -> anyhow::Result<()> {
        while let Some(message) = self.plans.try_next()? {
            if message.header.is_end() {
                continue;
            }
            let line = |line: &PlanLineMeta| PlannedLine {
                ends_uv_m: line.ends_uv_m,
                valid_from_ns: line.valid_from_ns,
            };
            let lines = message.lines().map(|lines| lines.iter().map(line).collect::<Vec<_>>());
            let from_ns = message.header.exposure_ns;
            if !lines.is_some_and(|lines| self.plan.note(from_ns, &lines, &self.sheet)) {
                let n_lines = message.n_lines;
                tracing::warn!(n_lines, "a fold plan makes no sense and is left out");
            }
        }
        self.model.set_plan(self.plan.at(exposure_ns));
        Ok(())
    }

    /// Publishes the state after one set of targets; `false` if asked to stop while waiting.
    fn publish_state(&mut self, targets: &Received<Targets>) -> anyhow::Result<bool> {
        let dt_s = frame_s(self.exposure_before_ns, targets.header.exposure_ns);
        self.exposure_before_ns = Some(targets.header.exposure_ns);
        self.hear_grippers(targets.header.exposure_ns)?;
        self.hear_plans(targets.header.exposure_ns)?;
        // Targets of a sheet that is followed are a pose, where there is none to move towards it.
        let is_pose = targets.figures.tracking == TRACKING;
        let takes_over = self.takes_over && is_pose;
        let pose = match targets.figures.reset {
            2 if self.has_pose => NewPose::Moved,
            0 if !takes_over => NewPose::None,
            _ => NewPose::Fresh,
        };
        let reset = pose != NewPose::None;
        self.takes_over &= !reset;
        self.has_pose |= reset;
        let (model, sheet, has_pose) = (&mut self.model, &self.sheet, self.has_pose);
        let mut work = Work {
            upstream_publish_ns: targets.header.publish_ns,
            take_ns: targets.take_ns,
            status: targets.figures.tracking,
            bytes: (sheet.len() * 24 + size_of::<FoldsMeta>()) as u64,
            effects: self.effects.bits(),
            ..Work::default()
        };
        let sent = self.states.send_with(&targets.header, |state| {
            work.start_ns = now_ns();
            state.targets_rejected = 0;
            // Before the first pose there is nothing to simulate, but the loop goes on.
            if has_pose {
                let (targets_m, confidence) = (targets.targets_m(), targets.confidence());
                let report = model.step_from(dt_s, targets_m, confidence, pose);
                state.targets_rejected = report.simulate.targets_rejected;
                work.effects_asleep = report.slept.bits();
            }
            state.figures = targets.figures;
            state.n_nodes = sheet.len() as u32;
            state.has_pose = u32::from(has_pose);
            state.nodes = sheet.nodes.map(|nodes| nodes as u32);
            state.size_m = sheet.size_m;
            state.folds.set(model.folds());
            state.positions_m[..sheet.len()].copy_from_slice(model.positions_m());
            state.predicted_m[..sheet.len()].copy_from_slice(model.predicted_for_cameras_m());
            state.camera_offset_m = model.camera_offset_m();
            work.end_ns = now_ns();
        })?;
        let Some(sent) = sent else { return Ok(false) };
        self.newest = has_pose.then_some((sent.header, targets.figures));
        if has_pose {
            self.between.begin(sent.header.exposure_ns, sent.header.publish_ns, dt_s);
        }
        self.recorder.published(&sent.header, work, self.targets.drops())?;
        Ok(true)
    }
}

/// Decides where the substeps run, and says so unless the scene asks for the CPU.
#[cfg(feature = "gpu")]
fn choose_backend(simulator: &mut Simulator) -> anyhow::Result<()> {
    let start = std::time::Instant::now();
    let chosen = simulator.choose_backend(&mut || start.elapsed().as_secs_f64())?;
    let [cpu_us, gpu_us] = chosen.frame_s.map(|seconds| seconds * 1e6);
    match (&chosen.adapter, &chosen.refused) {
        (Some(adapter), _) => tracing::info!(adapter, cpu_us, gpu_us, "simulates on the GPU"),
        (None, Some(why)) => tracing::info!(why, "simulates on the CPU"),
        (None, None) if cpu_us.is_finite() => {
            tracing::info!(cpu_us, gpu_us, "simulates on the CPU");
        }
        (None, None) => {}
    }
    Ok(())
}

/// Without the feature there is only the CPU.
#[cfg(not(feature = "gpu"))]
fn choose_backend(simulator: &mut Simulator) -> anyhow::Result<()> {
    anyhow::ensure!(
        !simulator.wants_gpu(),
        "`simulate.backend` is \"gpu\", but this program was built without the feature `gpu`"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_records_bits_are_the_effects_numbers() {
        for effect in Effect::ALL {
            let bits = Effects::from_iter([effect]).bits();
            assert_eq!(bits.count_ones(), 1);
            assert_eq!(orime_messages::EFFECTS[bits.trailing_zeros() as usize], effect.name());
        }
        assert_eq!(orime_messages::EFFECTS.len(), Effect::ALL.len());
    }
}
