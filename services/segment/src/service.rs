//! segment as a process: gathers frame sets and publishes their clouds.

use orime_geometry::{RgbdCamera, RgbdFrame, SheetGrid, SheetParams};
use orime_messages::{CameraMeta, Drops, Header, ObservedCloud};
use orime_runtime::{
    FrameSubscription, Pace, Publisher, ReceivedFrame, Recorder, Service, Work, channel, now_ns,
};
use orime_segment::{ObservedMut, SegmentConfig, SegmentParams, Segmenter};

/// The segment process.
pub struct Segment {
    config: SegmentConfig,
    sheet: SheetGrid,
    pace: Pace,
    frames: FrameSubscription,
    clouds: Publisher<ObservedCloud>,
    recorder: Recorder,
    gathering: Gathering,
    /// Last header of the stream, once it was seen.
    ended: Option<Header>,
}

/// Frames of the one set that is not complete yet.
#[derive(Default)]
struct Gathering {
    frames: Vec<ReceivedFrame>,
    unmatched: u64,
    superseded: u64,
}

impl Segment {
    /// Opens this stage's channels and says that it is ready.
    pub fn open(service: &Service) -> anyhow::Result<Self> {
        let config = service.config("segment", SegmentParams::check)?;
        let sheet = service.config("sheet", SheetParams::check)?;
        config.check_sheet(&sheet).map_err(|problem| {
            anyhow::anyhow!("`segment.markers` is \"sheet\", but `sheet`: {problem}")
        })?;
        let segment = Self {
            config,
            sheet,
            pace: service.set().pace,
            frames: service.subscribe_frames()?,
            clouds: service.publish(&channel::CLOUD)?,
            recorder: service.recorder()?,
            gathering: Gathering::default(),
            ended: service.ended_input(),
        };
        service.ready()?;
        Ok(segment)
    }

    /// Segments frame sets until their stream ends.
    pub fn run(mut self) -> anyhow::Result<()> {
        let mut known: Option<(Vec<CameraMeta>, Segmenter)> = None;
        while let Some(set) = self.next_set()? {
            let calibrations = || set.iter().map(|frame| &frame.meta().calibration);
            // Another source may have taken the first one's place: other cameras, all is new.
            if known.as_ref().is_some_and(|(before, _)| !before.iter().eq(calibrations())) {
                known = None;
            }
            let (_, segmenter) = known.get_or_insert_with(|| {
                let cameras: Vec<RgbdCamera> = calibrations().map(Into::into).collect();
                let segmenter = Segmenter::new(&self.config, &cameras, &self.sheet);
                (calibrations().copied().collect(), segmenter)
            });
            if !self.publish_cloud(segmenter, &set)? {
                break;
            }
        }
        if let Some(last) = self.ended {
            self.clouds.send_end(&last)?;
            self.recorder.ended(&last, self.drops())?;
        }
        Ok(())
    }

    /// The next frame set, in realtime the newest one; `None` at the end or if asked to stop.
    fn next_set(&mut self) -> anyhow::Result<Option<Vec<ReceivedFrame>>> {
        let mut newest: Option<Vec<ReceivedFrame>> = None;
        while self.ended.is_none() {
            let frame = match (&newest, self.pace) {
                (None, _) => self.frames.next()?,
                (Some(_), Pace::Lockstep) => None,
                (Some(_), Pace::Realtime) => self.frames.try_next()?,
            };
            let Some(frame) = frame else { break };
            if frame.meta().header.is_end() {
                self.ended = Some(frame.meta().header);
                self.gathering.give_up();
                break;
            }
            self.record_taken(&frame)?;
            if let Some(set) = self.gathering.add(frame)
                && let Some(older) = newest.replace(set)
            {
                self.gathering.superseded += older.len() as u64;
            }
        }
        Ok(newest)
    }

    fn record_taken(&mut self, frame: &ReceivedFrame) -> anyhow::Result<()> {
        let meta = frame.meta();
        let work = Work {
            camera: Some(meta.camera),
            upstream_publish_ns: meta.header.publish_ns,
            take_ns: frame.take_ns,
            status: meta.status,
            frame_copies: meta.copies,
            bytes: meta.extent().total_bytes() as u64,
            ..Work::default()
        };
        let drops = self.drops();
        Ok(self.recorder.taken(&meta.header, work, drops)?)
    }

    /// Publishes the cloud of one set; `false` if asked to stop while waiting.
    fn publish_cloud(
        &mut self,
        segmenter: &mut Segmenter,
        set: &[ReceivedFrame],
    ) -> anyhow::Result<bool> {
        let views: Vec<Option<RgbdFrame<'_>>> = set.iter().map(ReceivedFrame::view).collect();
        let lineage = lineage(set);
        let mut work = Work::default();
        let sent = self.clouds.send_with(&lineage, |cloud| {
            work.start_ns = now_ns();
            let out = ObservedMut {
                points: &mut cloud.points,
                edgels: &mut cloud.edgels,
                features: &mut cloud.features,
            };
            let report = segmenter.segment(&views, out);
            cloud.n_points = report.points as u32;
            cloud.n_edgels = report.edgels as u32;
            cloud.n_features = report.features as u32;
            cloud.features_left_out = report.features_left_out;
            cloud.cameras_without_sheet = report.cameras_without_sheet;
            cloud.cameras_without_frame = report.cameras_without_frame;
            cloud.points_left_out = report.points_left_out;
            cloud.n_cameras = set.len() as u32;
            for (camera, frame) in cloud.cameras.iter_mut().zip(set) {
                *camera = frame.meta().calibration;
            }
            work.end_ns = now_ns();
            work.status = report.cameras_without_frame;
            work.bytes = cloud_bytes(cloud);
        })?;
        let Some(sent) = sent else { return Ok(false) };
        let newest = set.iter().max_by_key(|frame| frame.take_ns);
        work.upstream_publish_ns = newest.map_or(0, |frame| frame.meta().header.publish_ns);
        work.take_ns = newest.map_or(0, |frame| frame.take_ns);
        work.frame_copies = set.iter().map(|frame| frame.meta().copies).sum();
        let drops = self.drops();
        self.recorder.published(&sent.header, work, drops)?;
        Ok(true)
    }

    fn drops(&self) -> Drops {
        let mut drops = self.frames.drops();
        drops.unmatched += self.gathering.unmatched;
        drops.superseded += self.gathering.superseded;
        drops
    }
}

impl Gathering {
    /// Adds a frame; gives the set that it completes, ordered by camera.
    ///
    /// Capture publishes set after set, so a frame of another step means that the set that was
    /// being gathered will never be complete.
    fn add(&mut self, frame: ReceivedFrame) -> Option<Vec<ReceivedFrame>> {
        let Header { step, incarnation, .. } = frame.meta().header;
        let n_cameras = frame.meta().n_cameras as usize;
        // A capture that was restarted publishes the set again that it did not finish.
        let is_other = |header: Header| header.step != step || header.incarnation != incarnation;
        if self.frames.first().is_some_and(|first| is_other(first.meta().header)) {
            self.give_up();
        }
        self.frames.push(frame);
        if self.frames.len() < n_cameras {
            return None;
        }
        let mut set = std::mem::take(&mut self.frames);
        set.sort_by_key(|frame| frame.meta().camera);
        Some(set)
    }

    /// Gives up the set that is not complete.
    fn give_up(&mut self) {
        self.unmatched += self.frames.len() as u64;
        self.frames.clear();
    }
}

/// A cloud is valid at the instant of its first camera's frame, and was possible from the moment
/// that its last frame was there.
fn lineage(set: &[ReceivedFrame]) -> Header {
    let first = set[0].meta().header;
    let arrival_ns = set.iter().map(|frame| frame.meta().header.arrival_ns).max();
    Header { arrival_ns: arrival_ns.unwrap_or(first.arrival_ns), ..first }
}

/// Bytes of the used parts of a cloud.
fn cloud_bytes(cloud: &ObservedCloud) -> u64 {
    let features = size_of_val(cloud.features());
    (size_of_val(cloud.points()) + size_of_val(cloud.edgels()) + features) as u64
}
