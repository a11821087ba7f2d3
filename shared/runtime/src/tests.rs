//! Channels between two members of a run, each with its own node as in two processes.

use std::time::Duration;

use orime_geometry::nalgebra::Isometry3;
use orime_geometry::{CameraModel, RgbdCamera};
use orime_messages::{FrameStatus, Header, SheetState, Stage, StageRecord, Truth};

use crate::link::Mode;
use crate::*;

/// A run of its own; cleaned when the test ends, however it ends.
struct Run(RunId);

impl Run {
    fn new() -> Self {
        Self(RunId::new())
    }

    fn join(&self, stage: Stage, pace: Pace) -> Link {
        let identity =
            Identity { run: self.0, pace, cameras: 1, stage, incarnation: now_ns(), resume: None };
        Link::join(identity, Stop::new()).unwrap()
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        clean(self.0).unwrap();
        assert_eq!(shared_memory_of(self.0).unwrap(), Vec::<std::path::PathBuf>::new());
        assert!(!self.0.ipc_dir().exists());
    }
}

fn step(link: &Link, step: u64) -> Header {
    Header { step, ..link.header() }
}

#[test]
fn lockstep_loses_nothing_over_500_messages_to_a_slow_reader() {
    let run = Run::new();
    let reader = run.join(Stage::Register, Pace::Lockstep);
    let mut states = Subscription::new(&reader, &channel::STATE, Mode::OpenOrCreate).unwrap();
    let writer = run.join(Stage::Simulate, Pace::Lockstep);
    let thread = std::thread::spawn(move || {
        let mut states = Publisher::new(&writer, &channel::STATE).unwrap();
        writer.reserve_memory().unwrap();
        for k in 0..500 {
            let lineage = step(&writer, k);
            let sent = states
                .send_with(&lineage, |state| {
                    state.n_nodes = 1;
                    state.positions_m[0] = [k as f32; 3];
                })
                .unwrap()
                .unwrap();
            assert_eq!(sent.header.sequence, k);
        }
        states.send_end(&step(&writer, 500)).unwrap();
        // The last messages are in this publisher's memory: it stays until they were read.
        std::thread::sleep(Duration::from_millis(300));
    });
    let mut read = 0;
    while let Some(state) = states.next().unwrap() {
        if state.header.is_end() {
            break;
        }
        assert_eq!((state.header.step, state.header.sequence), (read, read));
        assert_eq!(state.positions_m(), [[read as f32; 3]]);
        assert!(state.header.publish_ns <= state.take_ns);
        read += 1;
        if read % 50 == 0 {
            std::thread::sleep(Duration::from_millis(10));
        }
    }
    assert_eq!((read, states.drops().total()), (500, 0));
    thread.join().unwrap();
}

#[test]
fn realtime_keeps_the_newest_and_counts_every_loss() {
    let run = Run::new();
    let reader = run.join(Stage::Register, Pace::Realtime);
    let mut states = Subscription::new(&reader, &channel::STATE, Mode::OpenOrCreate).unwrap();
    let writer = run.join(Stage::Simulate, Pace::Realtime);
    let mut publisher = Publisher::new(&writer, &channel::STATE).unwrap();
    for k in 0..200 {
        publisher.send_with(&step(&writer, k), |state: &mut SheetState| state.n_nodes = 0).unwrap();
    }
    std::thread::sleep(Duration::from_millis(200));
    let newest = states.newest().unwrap().unwrap();
    assert_eq!(newest.header.step, 199);
    assert_eq!(states.drops().total(), 199, "{:?}", states.drops());
}

#[test]
fn an_overflow_that_nobody_reports_is_found_in_the_sequence() {
    let run = Run::new();
    let reader = run.join(Stage::Judge, Pace::Lockstep);
    let writer = run.join(Stage::Capture, Pace::Lockstep);
    let mut publisher = Publisher::<StageRecord>::new(&writer, &channel::RECORD).unwrap();
    let mut records = Subscription::new(&reader, &channel::RECORD, Mode::OpenOrCreate).unwrap();
    // Nobody works them off: the inbox takes a few, shared memory 513, the rest is lost.
    for k in 0..1000 {
        publisher.send_with(&step(&writer, k), |_| ()).unwrap();
    }
    let mut read = 0;
    let give_up = now_ns() + 5_000_000_000;
    while read + records.drops().overflow < 1000 && now_ns() < give_up {
        read += u64::from(records.try_next().unwrap().is_some());
        std::thread::sleep(Duration::from_micros(200));
    }
    assert!(records.drops().overflow > 300, "{:?}", records.drops());
    assert_eq!(read + records.drops().overflow, 1000);
}

#[test]
fn a_frame_is_read_where_it_was_written() {
    let run = Run::new();
    let lens = CameraModel {
        width: 5,
        height: 3,
        fx_px: 4.0,
        fy_px: 4.0,
        cx_px: 2.0,
        cy_px: 1.0,
        distortion: [0.0; 5],
    };
    let camera = RgbdCamera {
        name: "left".to_owned(),
        color: lens.clone(),
        depth: lens,
        color_from_depth: Isometry3::identity(),
        world_from_color: Isometry3::translation(0.0, 0.0, 1.0),
        depth_m_per_unit: 0.001,
    };
    let cameras = [camera];
    let reader = run.join(Stage::Segment, Pace::Lockstep);
    let mut frames = FrameSubscription::new(&reader, Mode::OpenOrCreate).unwrap();
    let writer = run.join(Stage::Capture, Pace::Lockstep);
    let mut publisher = FramePublisher::new(&writer, &cameras).unwrap();
    for (k, status) in [FrameStatus::Ok, FrameStatus::Unreadable].into_iter().enumerate() {
        publisher
            .send_with(&step(&writer, k as u64), (0, &cameras[0]), 1, |frame| {
                frame.color_rgb.fill(7);
                frame.depth_units.fill(750);
                FrameWritten { status, copies: 0 }
            })
            .unwrap();
    }
    publisher.send_end(&step(&writer, 2)).unwrap();
    let frame = frames.next().unwrap().unwrap();
    assert_eq!(RgbdCamera::from(&frame.meta().calibration), cameras[0]);
    let view = frame.view().unwrap();
    assert!(view.fits(&cameras[0]));
    assert!(view.color_rgb.iter().all(|c| *c == 7) && view.depth_units.iter().all(|d| *d == 750));
    assert_eq!(view.depth_units.as_ptr() as usize % 64, 0);
    assert!(frames.next().unwrap().unwrap().view().is_none(), "unreadable frames have no pixels");
    assert!(frames.next().unwrap().unwrap().meta().header.is_end());
}

#[test]
fn a_stopped_publisher_does_not_wait_for_ever() {
    let run = Run::new();
    let reader = run.join(Stage::Judge, Pace::Lockstep);
    let _truth = Subscription::new(&reader, &channel::TRUTH, Mode::OpenOrCreate).unwrap();
    let writer = run.join(Stage::Judge, Pace::Lockstep);
    let mut publisher = Publisher::<Truth>::new(&writer, &channel::TRUTH).unwrap();
    writer.stop().request();
    // Nobody reads: the pool runs dry, and then the answer is `None`.
    let sent = (0..100)
        .take_while(|k| publisher.send_with(&step(&writer, *k), |_| ()).unwrap().is_some())
        .count();
    assert!((10..30).contains(&sent), "{sent}");
}

#[test]
fn a_channel_of_another_layout_is_refused() {
    let run = Run::new();
    let writer = run.join(Stage::Capture, Pace::Lockstep);
    let _truth = Publisher::<Truth>::new(&writer, &channel::TRUTH).unwrap();
    let other = channel::Channel { name: channel::TRUTH.name, ..channel::STATE };
    let error = Publisher::<SheetState>::new(&writer, &other).unwrap_err();
    assert!(error.to_string().contains("IncompatibleTypes"), "{error}");
}

#[test]
fn guests_need_a_run() {
    let error = Guest::attach(RunId::new(), Pace::Lockstep, false, Stop::new()).unwrap_err();
    assert!(error.to_string().contains("is not there"), "{error}");
}

#[test]
fn frames_take_the_memory_that_was_reckoned_with() {
    let run = Run::new();
    let lens = CameraModel {
        width: 320,
        height: 240,
        fx_px: 300.0,
        fy_px: 300.0,
        cx_px: 160.0,
        cy_px: 120.0,
        distortion: [0.0; 5],
    };
    let camera = RgbdCamera {
        name: "one".to_owned(),
        color: lens.clone(),
        depth: lens,
        color_from_depth: Isometry3::identity(),
        world_from_color: Isometry3::identity(),
        depth_m_per_unit: 0.001,
    };
    let writer = run.join(Stage::Capture, Pace::Realtime);
    let _frames = FramePublisher::new(&writer, std::slice::from_ref(&camera)).unwrap();
    let sizes =
        shared_memory_of(run.0).unwrap().into_iter().map(|path| path.metadata().unwrap().len());
    let (taken, reckoned) = (sizes.sum::<u64>(), needed_bytes(Pace::Realtime, 1, 384_000));
    assert!(taken < reckoned, "{taken} bytes, {reckoned} were reckoned with");
    assert!(taken > 384_000 * channel::FRAME.pool(Pace::Realtime, 1) as u64, "the pool is there");
}
