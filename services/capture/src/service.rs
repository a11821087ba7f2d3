//! capture as a process: paces the source and publishes its frames, and what it knows of the truth
//! and of the grippers.

use std::time::Duration;

use orime_capture::{
    Advance, CaptureParams, FrameError, FrameReport, FrameSource, Gripper, Losses, PlannedFold,
};
use orime_geometry::{RgbdFrameMut, SheetGrid, SheetParams};
use orime_messages::{
    Drops, FoldPlan, FrameExtent, FrameStatus, GRIPPERS_MAX, GripperMeta, Grippers, Header,
    PLAN_LINES_MAX, PlanLineMeta, Truth,
};
use orime_runtime::{
    Beginning, FramePublisher, FrameWritten, Publisher, Recorder, Stop, Work, channel, now_ns,
};

/// Longest sleep before capture looks whether it shall end.
const STOP_POLL: Duration = Duration::from_millis(20);

/// The capture process.
pub struct Capture {
    source: Box<dyn FrameSource>,
    sheet: SheetGrid,
    period_ns: u64,
    /// The first frame set to publish: a restarted capture goes on with the one that is missing.
    first_step: u64,
    /// The step that is the source's first: not 0 where it took the place of another source.
    source_began: u64,
    frames: FramePublisher,
    truths: Publisher<Truth>,
    /// Absent where the source tells no grippers: the channel is a robot's then.
    grippers: Option<Publisher<Grippers>>,
    /// Absent where the source tells no plan: the channel is a robot's then.
    plans: Option<Publisher<FoldPlan>>,
    plan: Vec<PlannedFold>,
    /// The grippers of the step at hand.
    held: Vec<Gripper>,
    recorder: Recorder,
    header: Header,
    drops: Drops,
    /// As last looked at.
    losses: Losses,
    /// Frames that their sets went without.
    missing: u64,
    stop: Stop,
}

impl Capture {
    /// Opens the set's source and this stage's channels, and says that it is ready. A source takes
    /// its time, so it is opened before the run is joined where its predecessor does not hold it.
    pub fn open(beginning: Beginning) -> anyhow::Result<Self> {
        let sheet = beginning.config("sheet", SheetParams::check)?;
        let config = beginning.config("capture", CaptureParams::check)?;
        let open = || orime_capture::open(&config, &sheet);
        let early = if config.is_device() { None } else { Some(open()?) };
        let service = beginning.join()?;
        let source = early.map_or_else(open, Ok)?;
        let tells = source.tells_grippers();
        let plan = source.fold_plan();
        let planned = !plan.is_empty();
        let capture = Self {
            grippers: tells.then(|| service.publish(&channel::GRIPPER)).transpose()?,
            plans: planned.then(|| service.publish(&channel::PLAN)).transpose()?,
            plan,
            held: Vec::with_capacity(GRIPPERS_MAX),
            frames: service.publish_frames(source.cameras())?,
            truths: service.publish(&channel::TRUTH)?,
            recorder: service.recorder()?,
            period_ns: config.period_s.map_or(0, |period_s| (period_s * 1e9) as u64),
            first_step: service.resume().map_or(0, |resume| resume.next_set),
            source_began: service.resume().map_or(0, |resume| resume.source_began),
            header: service.header(),
            drops: Drops::default(),
            losses: Losses::default(),
            missing: 0,
            stop: service.stop().clone(),
            source,
            sheet,
        };
        service.ready()?;
        Ok(capture)
    }

    /// Publishes until the source ends or somebody asks to stop; then the end of the stream.
    pub fn run(mut self) -> anyhow::Result<()> {
        let mut step = self.first_step;
        if !self.publish_plan(step)? {
            return Ok(());
        }
        let begin_ns = now_ns().saturating_sub(step * self.period_ns);
        while !self.stop.requested() {
            self.wait_until(begin_ns + step * self.period_ns);
            match self.source.advance(self.of_source(step)) {
                Advance::Waiting => continue,
                Advance::Ended => break,
                Advance::Ready => {}
            }
            self.count_losses();
            if self.stop.requested() || !self.publish_set(step)? {
                break;
            }
            step += 1;
        }
        self.count_losses();
        if self.stop.is_handover() {
            return Ok(());
        }
        let last = Header { step, ..self.header };
        self.truths.send_end(&last)?;
        if let Some(grippers) = &mut self.grippers {
            grippers.send_end(&last)?;
        }
        if let Some(plans) = &mut self.plans {
            plans.send_end(&last)?;
        }
        self.frames.send_end(&last)?;
        self.recorder.ended(&last, self.drops)?;
        tracing::info!(steps = step, unreadable = self.drops.rejected, "end of capture");
        Ok(())
    }

    /// The source's own number of a step.
    fn of_source(&self, step: u64) -> u64 {
        step.saturating_sub(self.source_began)
    }

    /// Takes what the source lost into the counts, and says when a camera went or came.
    fn count_losses(&mut self) {
        let losses = self.source.losses();
        self.drops.unmatched = losses.unmatched + self.missing;
        self.drops.superseded = losses.superseded;
        if losses.stalls != self.losses.stalls || losses.returns != self.losses.returns {
            let (stalls, returns) = (losses.stalls, losses.returns);
            tracing::warn!(stalls, returns, "a camera stopped or came back");
        }
        self.losses = losses;
    }

    fn wait_until(&self, due_ns: u64) {
        while !self.stop.requested() {
            let Some(left_ns) = due_ns.checked_sub(now_ns()) else { return };
            std::thread::sleep(Duration::from_nanos(left_ns).min(STOP_POLL));
        }
    }

    /// Publishes one frame set, whole even if somebody asks to stop meanwhile; `false` if its
    /// consumers did not take it for long after that.
    fn publish_set(&mut self, step: u64) -> anyhow::Result<bool> {
        let n_cameras = self.source.cameras().len();
        let exposure_ns = self.source.exposure_ns(self.of_source(step), 0);
        // First, so that whoever has something that was made of the frames has the grippers too.
        if !self.publish_grippers(&Header { step, exposure_ns, ..self.header })? {
            return Ok(false);
        }
        for camera in 0..n_cameras {
            if !self.publish_frame(step, camera, n_cameras)? {
                return Ok(false);
            }
        }
        let lineage = Header { step, exposure_ns, arrival_ns: now_ns(), ..self.header };
        let (source, sheet, own) = (&self.source, &self.sheet, self.of_source(step));
        let sent = self.truths.send_with(&lineage, |truth| {
            let nodes_m = &mut truth.positions_m[..sheet.len()];
            let known = source.truth_m(own, sheet, nodes_m);
            truth.n_nodes = if known { sheet.len() as u32 } else { 0 };
        })?;
        Ok(sent.is_some())
    }

    /// Publishes which grippers hold the sheet; one message a step, also while none does.
    fn publish_grippers(&mut self, lineage: &Header) -> anyhow::Result<bool> {
        let own = self.of_source(lineage.step);
        let Some(publisher) = &mut self.grippers else { return Ok(true) };
        let lineage = &Header { arrival_ns: now_ns(), ..*lineage };
        self.source.grippers(own, &mut self.held);
        let held = &self.held;
        let sent = publisher.send_with(lineage, |message| {
            message.n_grippers = held.len().min(GRIPPERS_MAX) as u32;
            for (meta, gripper) in message.grippers.iter_mut().zip(held) {
                *meta = GripperMeta {
                    world_from_gripper: (&gripper.world_from_gripper).into(),
                    grasped_uv_m: gripper.uv_m,
                    is_holding: 1,
                    reserved: 0,
                };
            }
        })?;
        Ok(sent.is_some())
    }

    /// Publishes what will be folded, before the first frames; `false` if asked to stop meanwhile.
    fn publish_plan(&mut self, step: u64) -> anyhow::Result<bool> {
        let exposure_ns = self.source.exposure_ns(self.of_source(step), 0);
        let Some(publisher) = &mut self.plans else { return Ok(true) };
        let lineage = Header { step, exposure_ns, arrival_ns: now_ns(), ..self.header };
        let plan = &self.plan;
        let sent = publisher.send_with(&lineage, |message| {
            message.n_lines = plan.len().min(PLAN_LINES_MAX) as u32;
            for (meta, fold) in message.lines.iter_mut().zip(plan) {
                let PlannedFold { ends_uv_m, valid_from_ns } = *fold;
                *meta = PlanLineMeta { ends_uv_m, valid_from_ns };
            }
        })?;
        Ok(sent.is_some())
    }

    fn publish_frame(&mut self, step: u64, index: usize, n_cameras: usize) -> anyhow::Result<bool> {
        let own = self.of_source(step);
        let exposure_ns = self.source.exposure_ns(own, index);
        let lineage = Header { step, exposure_ns, ..self.header };
        // The calibration is copied out, for the source cannot be read and looked at at once.
        let camera = self.source.cameras()[index].clone();
        let (mut start_ns, mut unreadable) = (0, None);
        let source = &mut self.source;
        let read = |frame: RgbdFrameMut<'_>| {
            start_ns = now_ns();
            let result = source.read(own, index, frame);
            written(result, &mut unreadable)
        };
        let Some(sent) = self.frames.send_with(&lineage, (index, &camera), n_cameras, read)? else {
            return Ok(false);
        };
        match unreadable {
            None => {}
            // A camera that is gone was said to be, once.
            Some(FrameError::Missing) => self.missing += 1,
            Some(error) => {
                self.drops.rejected += 1;
                tracing::warn!(step, camera = camera.name, %error, "frame left out");
            }
        }
        let work = Work {
            camera: Some(index as u32),
            start_ns,
            take_ns: start_ns,
            end_ns: sent.header.arrival_ns,
            status: sent.written.status as u32,
            frame_copies: sent.written.copies,
            bytes: FrameExtent::of(&camera).total_bytes() as u64,
            ..Work::default()
        };
        self.recorder.published(&sent.header, work, self.drops)?;
        Ok(true)
    }
}

/// What to say of a frame; a frame that cannot be read is sent nevertheless, for its set.
fn written(
    result: Result<FrameReport, FrameError>,
    unreadable: &mut Option<FrameError>,
) -> FrameWritten {
    match result {
        Ok(report) => FrameWritten { status: FrameStatus::Ok, copies: report.copies },
        Err(error) => {
            *unreadable = Some(error);
            FrameWritten { status: FrameStatus::Unreadable, copies: 0 }
        }
    }
}
