//! Fold plans on their channel, and states between frames.

use orime_messages::{FoldPlan, Header, Message, PLAN_LINES_MAX, PlanLineMeta, SheetState, Stage};
use orime_runtime::{Guest, RunEntry, Stop, channel};
use orime_tests::{RunningSet, Scratch, run};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::fs;

/// The judge's hash of all states of a set in lockstep, the same as in one process.
fn states_hash(test: &str, text: &str) -> String {
    let scratch = Scratch::new(test);
    let (set, json) = (scratch.path("set.toml"), scratch.path("out.json"));
    fs::write(&set, text).unwrap();
    let mut running = RunningSet::start(&format!("{test}-set"), Some(&set));
    let ended = running.wait();
    assert_eq!(ended.code, 0, "{}{}", ended.stdout, ended.stderr);
    let output = run("orime-evaluate", &["track", &set, "--json", &json]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let hash = |path: &std::path::Path| {
        let value: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
        value["states_hash"].as_str().unwrap().to_owned()
    };
    let [set, process] = [hash(&running.out("summary.json")), hash(json.as_ref())];
    assert_eq!(set, process, "the set and one process");
    set
}

#[test]
fn a_plan_reaches_the_simulator_of_both_alike_and_predictions_leave_lockstep_alone() {
    // Along no landmark: what is found there is never quite what was planned.
    let scene = |rendered: &str, simulate: &str| {
        format!(
            "[capture]\nsource = \"rendered\"\nfps = 0\n[capture.rendered]\nsteps = 40\n\
             fold_angle_deg = 67\nfold_point = [0.42, 0.56]\n{rendered}\n\
             [simulate.predict]\n{simulate}\n"
        )
    };
    let without = states_hash("plan-without", &scene("", ""));
    let with = states_hash("plan-with", &scene("fold_plan = true", ""));
    assert_ne!(without, with, "a planned crease lies where it was planned");
    let between = states_hash("plan-between", &scene("", "per_frame = 3"));
    assert_eq!(without, between, "there is nothing between frames in lockstep");
}

/// A rendered set in realtime that never ends, and a guest of it.
fn running(test: &str, rendered: &str) -> (Scratch, RunningSet, Guest) {
    let scratch = Scratch::new(test);
    let path = scratch.path("endless.toml");
    let text = format!(
        "pace = \"realtime\"\n[capture]\nsource = \"rendered\"\nrepeat = true\nfps = 5\n\
         [capture.rendered]\nsize_px = [320, 240]\n{rendered}\n[simulate.predict]\nper_frame = 3\n"
    );
    fs::write(&path, text).unwrap();
    let mut set = RunningSet::start(&format!("{test}-set"), Some(&path));
    let found = set.wait_until(|run| !run["stages"].as_array().unwrap().is_empty());
    let entry: RunEntry = serde_json::from_value(found).unwrap();
    let guest = Guest::attach_to(&entry, Stop::new()).unwrap();
    (scratch, set, guest)
}

fn stop(set: &mut RunningSet) {
    kill_process(Pid::from_raw(set.pid() as i32).unwrap(), Signal::TERM).unwrap();
    let ended = set.wait();
    assert_eq!(ended.code, 0, "{}{}", ended.stdout, ended.stderr);
}

#[test]
fn states_between_frames_are_marked_and_lie_between_them() {
    let (_scratch, mut set, guest) = running("between", "");
    let mut states = guest.subscribe::<SheetState>(&channel::STATE).unwrap();
    let mut between = guest.subscribe::<SheetState>(&channel::PREDICTION).unwrap();
    let mut per_step = std::collections::BTreeMap::<u64, Vec<u64>>::new();
    while per_step.len() < 6 {
        let message = between.next().unwrap().unwrap();
        let header = *Message::header(&*message);
        assert!(header.is_prediction() && !header.is_end(), "{header:?}");
        assert_eq!((header.stage, message.has_pose), (Stage::Simulate as u32, 1));
        let finite = message.positions_m().iter().flatten().all(|x| x.is_finite());
        assert!(finite && message.positions_m().len() == 625);
        per_step.entry(header.step).or_default().push(header.exposure_ns);
    }
    let mut seen = 0;
    while seen < 6 {
        let state = states.next().unwrap().unwrap();
        let header = *Message::header(&*state);
        assert!(!header.is_prediction(), "{header:?}");
        let Some(exposures) = per_step.get(&header.step) else {
            assert!(header.step < 10_000, "the steps of the predictions are among the states");
            seen += usize::from(header.step > *per_step.keys().last().unwrap());
            continue;
        };
        let all = std::iter::once(&header.exposure_ns).chain(exposures).collect::<Vec<_>>();
        assert!(all.windows(2).all(|pair| pair[0] < pair[1]), "{all:?}");
        assert!(exposures.len() <= 3, "{exposures:?}");
        seen += 1;
    }
    drop((states, between, guest));
    stop(&mut set);
}

#[test]
fn a_robot_publishes_its_plan_and_nonsense_is_left_out() {
    let (_scratch, mut set, guest) = running("robot", "");
    let mut plans = guest.publish::<FoldPlan>(&channel::PLAN).unwrap();
    let lineage = Header { exposure_ns: 0, ..guest.header() };
    let middle = [[0.075, 0.0], [0.075, 0.15]];
    for (n_lines, ends_uv_m) in [(1, middle), (1, [[f64::NAN; 2]; 2]), (u32::MAX, middle)] {
        let line = PlanLineMeta { ends_uv_m, valid_from_ns: 0 };
        let sent = plans.send_with(&lineage, |plan| {
            plan.n_lines = n_lines;
            plan.lines = [line; PLAN_LINES_MAX];
        });
        assert!(sent.unwrap().is_some());
    }
    let log = || {
        let text = fs::read_to_string(set.out("logs/simulate.log")).unwrap_or_default();
        text.matches("a fold plan makes no sense").count()
    };
    orime_tests::wait_for("two plans that are left out", || log() == 2);
    let mut states = guest.subscribe::<SheetState>(&channel::STATE).unwrap();
    assert!(states.next().unwrap().is_some(), "the set goes on");
    drop((states, plans, guest));
    stop(&mut set);
}
