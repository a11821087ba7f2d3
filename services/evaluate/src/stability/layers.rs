//! Cases in which the sheet meets itself or the table.

use super::play::{FRAME_S, Played, Scene, params, play};
use super::shapes::{between, crumpled, halved, line_at, pleated, pressed, square};
use super::{Outcome, Random, outcome};
use orime_geometry::SheetGrid;
use orime_simulate::{Effect, SimulateParams};

/// Seeds of the crumple.
const CRUMPLES: u64 = 20;
/// Most that an edge may be longer than at rest.
const STRETCH_MAX: f64 = 0.05;

type Targets<'a> = Box<dyn Fn(usize) -> (Vec<[f32; 3]>, Vec<f32>) + 'a>;

/// All nodes pulled alike.
fn everywhere<'a>(shape: impl Fn(f64) -> Vec<[f32; 3]> + 'a) -> Targets<'a> {
    Box::new(move |frame| {
        let targets_m = shape((frame + 1) as f64 * FRAME_S);
        let confidence = vec![1.0; targets_m.len()];
        (targets_m, confidence)
    })
}

/// The same scene with and without contact: the second has to cross.
fn with_and_without<'a>(make: impl Fn() -> Scene<'a>) -> [Played; 2] {
    let on = play(&make());
    let off = play(&Scene { contact: Box::new(|_| false), ..make() });
    [on, off]
}

/// Case, name, criterion and what holds beyond "no crossing, right order".
fn judge(
    case: u32,
    name: String,
    criterion: &str,
    [on, off]: &[Played; 2],
    also: impl Fn(&Played) -> bool,
) -> Outcome {
    let crosses_without = off.crossing.len() + off.flipped > 0;
    let passed = crosses_without && on.crossing.is_empty() && on.flipped == 0 && also(on);
    let without = format!("{} cross, {} flipped", off.crossing.len(), off.flipped);
    let measured = format!("{}; without contact {without}", on.figures());
    outcome(case, name, criterion, measured, passed)
}

const SETTLED: &str = "0 crossings, order kept, stretch < 5 %, end < 1 mm/s; crosses without";

fn is_settled(played: &Played) -> bool {
    played.stretch < STRETCH_MAX && played.speed_end_m_s < 1e-3
}

fn folded(
    sheet: &SheetGrid,
    thickness_m: f64,
    folds: usize,
    frames: usize,
) -> impl Fn() -> Scene<'static> {
    let (half, quarter) = (line_at(sheet, 0.5), line_at(sheet, 0.25));
    // The third fold meets both halves of the first.
    let (us, vs) = match folds {
        1 => (vec![half], vec![]),
        2 => (vec![half], vec![half]),
        _ => (vec![quarter, half, 2.0 * half - quarter], vec![half]),
    };
    let (sheet, facets) = (sheet.clone(), between(sheet, &us, &vs));
    move || {
        let shape = sheet.clone();
        Scene {
            sheet: sheet.clone(),
            facets: facets.clone(),
            thickness_m,
            frames,
            params: params(),
            mobility: Vec::new(),
            start_m: None,
            targets: everywhere(move |time_s| halved(&shape, folds, time_s, 1.0)),
            contact: Box::new(|_| true),
            ordered_frames: usize::MAX,
        }
    }
}

/// Nodes along a side and thickness, metres, of the stacks.
const SIZES: [(usize, f64); 2] = [(25, 1e-4), (25, 3e-4)];

/// A stack in these sizes.
fn stacks(
    name: &str,
    criterion: &str,
    sizes: &[(usize, f64)],
    make: impl Fn(&SheetGrid, f64) -> Scene<'static>,
    also: impl Fn(&Played) -> bool,
) -> Vec<Outcome> {
    let one = |(nodes, thickness_m): &(usize, f64)| {
        let played = with_and_without(|| make(&square(*nodes), *thickness_m));
        let name = format!("{name}, {nodes}×{nodes}, {} mm", 1e3 * thickness_m);
        judge(10, name, criterion, &played, &also)
    };
    sizes.iter().map(one).collect()
}

/// Case 10: a half fold whose targets lie in each other.
pub fn two_layers(_seed: u64) -> Vec<Outcome> {
    let sizes = [SIZES[0], SIZES[1], (50, 1e-4)];
    let make = |sheet: &SheetGrid, thickness_m| folded(sheet, thickness_m, 1, 70)();
    stacks("2 layers", SETTLED, &sizes, make, is_settled)
}

/// Case 10: two half folds.
pub fn four_layers(_seed: u64) -> Vec<Outcome> {
    let make = |sheet: &SheetGrid, thickness_m| folded(sheet, thickness_m, 2, 100)();
    stacks("4 layers", SETTLED, &SIZES, make, is_settled)
}

/// Case 10: eight pleats.
pub fn pleats(_seed: u64) -> Vec<Outcome> {
    let make = |sheet: &SheetGrid, thickness_m| {
        let lines: Vec<f64> = (1..8).map(|k| f64::from(k) * sheet.size_m[0] / 8.0).collect();
        let shape = sheet.clone();
        Scene {
            facets: between(sheet, &lines, &[]),
            targets: everywhere(move |time_s| pleated(&shape, time_s)),
            ..folded(sheet, thickness_m, 1, 80)()
        }
    };
    stacks("8 pleats", SETTLED, &SIZES, make, is_settled)
}

/// Case 10: three half folds.
pub fn eight_layers(_seed: u64) -> Vec<Outcome> {
    let stopped = |played: &Played| played.stopped.is_some() && played.speed_end_m_s < 1e-3;
    let closed = |played: &Played| played.error_end_m < 2e-3 || stopped(played);
    let also = |played: &Played| played.stretch < STRETCH_MAX && closed(played);
    let criterion = "0 crossings, order kept, stretch < 5 %, closed within 2 mm or stopped (below \
        1 mm/s) and said so; crosses without";
    let make = |sheet: &SheetGrid, thickness_m| folded(sheet, thickness_m, 3, 140)();
    stacks("8 layers by three half folds", criterion, &SIZES, make, also)
}

/// The free edge is pulled onto or through the lower half, which is held.
fn pressing<'a>(
    share: impl Fn(usize) -> f64 + Copy + 'a,
    below_m: f64,
    frames: usize,
) -> Scene<'a> {
    let sheet = square(25);
    let half = line_at(&sheet, 0.5);
    let mut params = params();
    params.effects.push(Effect::Gravity);
    let held = |[u, _]: [f64; 2]| if u < half - 0.01 { 0.0 } else { 1.0 };
    let edge: Vec<f32> =
        sheet.uv_m().map(|[u, _]| if u > sheet.size_m[0] - 1e-9 { 1.0 } else { 0.0 }).collect();
    let shape = sheet.clone();
    Scene {
        facets: between(&sheet, &[half], &[]),
        thickness_m: 1e-4,
        frames,
        params,
        mobility: sheet.uv_m().map(held).collect(),
        start_m: None,
        targets: Box::new(move |frame| (pressed(&shape, share(frame), below_m), edge.clone())),
        contact: Box::new(|_| true),
        ordered_frames: 15,
        sheet,
    }
}

/// Case 7: the target jumps from one side of the lower layer to the other and back.
pub fn teleport(_seed: u64) -> Vec<Outcome> {
    let share = |frame: usize| match frame {
        0..15 => (frame + 1) as f64 * FRAME_S,
        15..45 if (frame / 5).is_multiple_of(2) => 0.3 / std::f64::consts::PI,
        _ => 1.15,
    };
    let played = with_and_without(|| pressing(share, 0.0, 90));
    vec![judge(7, "teleport through a layer".into(), SETTLED, &played, is_settled)]
}

/// Case 11: the target goes 10 mm through the lower layer.
pub fn press(_seed: u64) -> Vec<Outcome> {
    let share = |frame: usize| ((frame + 1) as f64 * FRAME_S).min(1.0);
    let played = with_and_without(|| pressing(share, 0.010, 75));
    vec![judge(11, "press 10 mm through a layer".into(), SETTLED, &played, is_settled)]
}

fn crumple_scene(seed: u64) -> Scene<'static> {
    let sheet = square(25);
    let mut random = Random(seed);
    let shapes: Vec<Vec<[f32; 3]>> = (0..4).map(|_| crumpled(&sheet, &mut random)).collect();
    let confidence = vec![1.0; sheet.len()];
    Scene {
        facets: Vec::new(),
        thickness_m: 1e-4,
        frames: 48,
        params: params(),
        mobility: Vec::new(),
        start_m: None,
        targets: Box::new(move |frame| (shapes[(frame / 8).min(3)].clone(), confidence.clone())),
        contact: Box::new(|_| true),
        ordered_frames: usize::MAX,
        sheet,
    }
}

/// Case 12: conflicting targets crumple the sheet.
pub fn crumple(seed: u64) -> Vec<Outcome> {
    let criterion = "0 crossings, crosses without; stretch < 10 % is the goal";
    let run = |k: u64| {
        let played = with_and_without(|| crumple_scene(seed.wrapping_mul(1000) + k));
        judge(12, format!("crumple, seed {seed}.{k}"), criterion, &played, |_| true)
    };
    (0..CRUMPLES).map(run).collect()
}

/// Case 18: contact works, stops while the sheet crosses itself, and works again.
pub fn on_off_on(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let make = folded(&sheet, 1e-4, 1, 120);
    let shape = sheet.clone();
    // Targets that tremble keep the simulator awake.
    let targets = Box::new(move |frame: usize| {
        let mut targets_m = halved(&shape, 1, (frame + 1) as f64 * FRAME_S, 1.0);
        targets_m.iter_mut().for_each(|p| p[1] += 1e-5 * (frame % 2) as f32);
        let confidence = vec![1.0; targets_m.len()];
        (targets_m, confidence)
    });
    let contact = Box::new(|frame: usize| !(35..60).contains(&frame));
    let played = play(&Scene { targets, contact, ..make() });
    let bad = |range: std::ops::Range<usize>| {
        let all = played.crossing.iter().chain(&played.flipped_in);
        all.filter(|frame| range.contains(*frame)).count()
    };
    let (before, during, after) = (bad(0..35), bad(35..60), bad(65..120));
    let passed = before == 0 && during > 0 && after == 0;
    let criterion = "0 crossings or flips before, some while off, 0 from 5 frames after";
    let measured =
        format!("{before} before, {during} while off, {after} after; {}", played.figures());
    vec![outcome(18, "contact on, off, on", criterion, measured, passed)]
}

/// Case 20: a tilted sheet, folded in half, falls onto the table at 5 m/s.
pub fn slam(_seed: u64) -> Vec<Outcome> {
    let sheet = square(25);
    let (shape, half) = (sheet.clone(), line_at(&sheet, 0.5));
    let (sin, cos) = 0.5f64.sin_cos();
    let start: Vec<[f32; 3]> = halved(&sheet, 1, 0.9, 1.0)
        .iter()
        .map(|p| {
            let [x, y, z] = p.map(f64::from);
            [(x * cos - z * sin) as f32, y as f32, (1.30 + x * sin + z * cos) as f32]
        })
        .collect();
    let effects = vec![
        Effect::Stretch,
        Effect::Shear,
        Effect::Bend,
        Effect::Damping,
        Effect::Facets,
        Effect::Gravity,
        Effect::Table,
        Effect::SelfContact,
    ];
    let make = || Scene {
        sheet: sheet.clone(),
        facets: between(&shape, &[half], &[]),
        thickness_m: 1e-4,
        frames: 60,
        params: SimulateParams { effects: effects.clone(), ..params() },
        mobility: Vec::new(),
        start_m: Some(start.clone()),
        targets: Box::new(|_| (start.clone(), vec![0.0; sheet.len()])),
        contact: Box::new(|_| true),
        ordered_frames: usize::MAX,
    };
    let [on, off] = with_and_without(make);
    let low_m = on.end_m.iter().map(|p| p[2]).fold(f32::INFINITY, f32::min);
    let passed = on.crossing.is_empty()
        && !off.crossing.is_empty()
        && low_m >= -1e-6
        && on.stretch < STRETCH_MAX;
    let criterion = "0 crossings, nothing below the table, stretch < 5 %; crosses without";
    let measured = format!(
        "lowest {:.3} mm; {}; without contact {} cross",
        1e3 * low_m,
        on.figures(),
        off.crossing.len()
    );
    vec![outcome(20, "slammed on the table at 5 m/s", criterion, measured, passed)]
}
