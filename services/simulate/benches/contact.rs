//! What contact costs: `cargo bench -p orime-simulate --no-default-features --bench contact`.
//!
//! Per scene and size of the sheet: milliseconds of processor time a frame (median, maximum) with
//! contact and without, and what contact adds; then how that grows, as an exponent of the number
//! of nodes. The targets are exact folds with smooth noise, new in every frame, so that nothing
//! settles for good. `-- SCENE NODES` plays one scene of one size, for `perf`. The last column is a
//! hash over all positions with contact: what only makes contact faster leaves it as it is.

use orime_geometry::SheetGrid;
use orime_origami::{FoldLine, Sequence, Sheet, Timing};
use orime_simulate::{Effect, SheetModel, SimulateParams};
use rustix::time::{ClockId, clock_gettime};

const FRAME_S: f64 = 1.0 / 30.0;
const SIDE_M: f64 = 0.15;
const THICKNESS_M: f64 = 1e-4;
const SIZES: [usize; 5] = [25, 36, 50, 71, 100];
/// Frames that are timed, at the pose that a scene ends in.
const TIMED: usize = 60;
/// Noise of the targets: amplitude of a wave, metres, and waves per coordinate.
const NOISE_M: f64 = 2e-4;
const WAVES: usize = 3;

/// A fold and where in it a scene ends.
#[derive(Clone, Copy)]
struct Scene {
    name: &'static str,
    /// Frames up to the pose that is timed.
    frames: usize,
    /// Share of the sequence that is played.
    progress: f64,
    make: fn() -> Sequence,
    plan: &'static [[[f64; 2]; 2]],
}

const HALF: [[f64; 2]; 2] = [[0.075, 0.0], [0.075, 0.15]];
const SCENES: [Scene; 3] = [
    Scene { name: "idle", frames: 60, progress: 0.4, make: half_fold, plan: &[HALF] },
    Scene { name: "half_fold", frames: 90, progress: 1.0, make: half_fold, plan: &[HALF] },
    Scene {
        name: "square_base",
        frames: 290,
        progress: 1.0,
        make: square_base,
        plan: &[
            [[0.0, 0.0], [0.15, 0.15]],
            [[0.15, 0.0], [0.0, 0.15]],
            HALF,
            [[0.0, 0.075], [0.15, 0.075]],
        ],
    },
];

fn sheet() -> Sheet {
    Sheet { size_m: [SIDE_M; 2], thickness_m: THICKNESS_M }
}

fn half_fold() -> Sequence {
    Sequence::half_fold(sheet(), FoldLine::book([SIDE_M; 2]), Timing::default())
        .expect("the line crosses the sheet")
}

fn square_base() -> Sequence {
    Sequence::square_base(sheet()).expect("the sheet is square")
}

/// This thread's processor time, seconds: other work on the machine does not count.
fn thread_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// SplitMix64, −1 to 1.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Adds waves over the sheet, another set for every frame.
fn disturb(grid: &SheetGrid, targets_m: &mut [[f32; 3]], seed: &mut u64) {
    for axis in 0..3 {
        for _ in 0..WAVES {
            let [ku, kv] = [(); 2].map(|()| random(seed) * std::f64::consts::TAU / 0.05);
            let phase = random(seed) * std::f64::consts::PI;
            for (target, [u, v]) in targets_m.iter_mut().zip(grid.uv_m()) {
                target[axis] += (NOISE_M * (ku * u + kv * v + phase).sin()) as f32;
            }
        }
    }
}

/// Milliseconds a frame at the end of a scene, with contact and without.
struct Played {
    on_ms: Vec<f64>,
    off_ms: Vec<f64>,
    /// Contacts of the last frame.
    constraints: u32,
    /// FNV-1a over the bits of all states and predictions with contact.
    hash: u64,
}

fn hash_on(mut hash: u64, positions_m: &[[f32; 3]]) -> u64 {
    for c in positions_m.iter().flatten() {
        hash = (hash ^ u64::from(c.to_bits())).wrapping_mul(0x0100_0000_01b3);
    }
    hash
}

fn model(scene: &Scene, grid: &SheetGrid, contact: bool) -> SheetModel {
    let mut params = SimulateParams::default();
    params.folds.plan = scene.plan.to_vec();
    if !contact {
        params.effects.retain(|effect| *effect != Effect::SelfContact);
    }
    let config = params.check().expect("the bench's own parameters are good");
    SheetModel::new(&config, grid, 0.08, None)
}

/// Both side by side, so that what else slows the machine slows both.
fn play(scene: &Scene, nodes: usize) -> Played {
    let grid = SheetGrid::new([SIDE_M; 2], [nodes; 2]);
    let mut models = [true, false].map(|contact| model(scene, &grid, contact));
    let sequence = (scene.make)();
    let mut pose = sequence.pose(0.0);
    let confidence = vec![1.0; grid.len()];
    let (mut seed, mut ms, mut constraints) = (1, [Vec::new(), Vec::new()], 0);
    let mut hash = 0xcbf2_9ce4_8422_2325;
    for frame in 0..scene.frames + TIMED {
        let share = (frame as f64 / scene.frames as f64).min(1.0);
        sequence.update(&mut pose, scene.progress * share);
        let position = |uv| sequence.position_m(&pose, uv).coords.cast::<f32>().into();
        let mut targets: Vec<[f32; 3]> = grid.uv_m().map(position).collect();
        disturb(&grid, &mut targets, &mut seed);
        for (k, model) in models.iter_mut().enumerate() {
            let start = thread_s();
            let report = model.step(FRAME_S, &targets, &confidence, frame == 0);
            if frame >= scene.frames {
                ms[k].push((thread_s() - start) * 1e3);
            }
            constraints = constraints.max(report.contact.constraints);
        }
        hash = hash_on(hash_on(hash, models[0].positions_m()), models[0].predicted_m());
    }
    let facets = models[0].folds().facets().len();
    assert!(facets > 1, "{}: {facets} facets", scene.name);
    let [on_ms, off_ms] = ms;
    Played { on_ms, off_ms, constraints, hash }
}

/// Median and greatest.
fn spread(mut ms: Vec<f64>) -> [f64; 2] {
    ms.sort_by(f64::total_cmp);
    [ms[ms.len() / 2], ms[ms.len() - 1]]
}

/// Prints a line; the median of what contact costs, milliseconds.
fn measure(scene: &Scene, nodes: usize) -> f64 {
    let Played { on_ms, off_ms, constraints, hash } = play(scene, nodes);
    let each = on_ms.iter().zip(&off_ms).map(|(on, off)| on - off).collect();
    let ([on, max], [off, _], [contact, _]) = (spread(on_ms), spread(off_ms), spread(each));
    println!(
        "{:12} {nodes:4}²  {on:8.2}  {max:8.2}  {off:8.2}  {contact:8.3}  {:6.1} %  \
         {constraints:7}  {hash:016x}",
        scene.name,
        1e2 * contact / off,
    );
    contact
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let named = SCENES.iter().find(|scene| arguments.iter().any(|a| a == scene.name));
    println!(
        "scene        nodes   with p50       max   without   contact  of frame  contacts  hash"
    );
    if let Some(scene) = named {
        let sizes: Vec<usize> = arguments.iter().filter_map(|a| a.parse().ok()).collect();
        for nodes in sizes {
            measure(scene, nodes);
        }
        return;
    }
    for scene in &SCENES {
        let costs = SIZES.map(|nodes| (nodes, measure(scene, nodes)));
        for pair in costs.windows(2) {
            let [(n, a), (m, b)] = [pair[0], pair[1]];
            let exponent = (b / a).ln() / (2.0 * (m as f64 / n as f64).ln());
            println!("{:12} {n:4}² to {m}²: exponent {exponent:.2} of the nodes", scene.name);
        }
    }
}
