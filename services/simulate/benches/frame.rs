//! What a frame costs: `cargo bench -p orime-simulate --no-default-features --features gpu --bench
//! frame`.
//!
//! Per size of the sheet: links, microseconds a frame (the least of many), nanoseconds and cycles
//! of the time stamp counter a link and substep; then how stretch falls with substeps, and what
//! that costs, beside a plain loop over the same links. `-- --sizes` and `-- --stretch` print one
//! of these alone.
//! `-- --frames N NODES [EFFECT,...]` runs N frames of one size and nothing else, for
//! callgrind (`tests/effect_costs`) and `perf stat`; effects beyond the links and track are named
//! but have nothing to do.

mod plain;

use orime_geometry::SheetGrid;
use orime_simulate::{
    AirDragParams, Backend, Batch, BendParams, Effect, Pulls, SimulateParams, Simulator,
    TrackParams,
};
use plain::Plain;
use std::time::Instant;

const SUBSTEPS: u32 = 20;
const FRAME_S: f64 = 1.0 / 60.0;
const SIDE_M: f64 = 0.21;
const DRAG_PER_S: f64 = 3.0;
/// Frames that a sheet hangs.
const FRAMES_HUNG: usize = 240;

/// Links 1–4, inextensible, hung by two corners.
fn hung(effects: &[Effect], nodes: usize, substeps: u32) -> (Simulator, SheetGrid, Vec<f32>) {
    let params = SimulateParams {
        substeps,
        substep_motion_m: 0.0,
        effects: effects.to_vec(),
        bend: BendParams { reach: 4, compliance_m_per_n: 0.0, ..BendParams::default() },
        track: TrackParams {
            frequency_hz: 10_000.0,
            acceleration_max_m_per_s2: 1e6,
            ..TrackParams::default()
        },
        air_drag: AirDragParams { per_s: DRAG_PER_S },
        ..SimulateParams::default()
    };
    let sheet = SheetGrid::new([SIDE_M; 2], [nodes, nodes]);
    let config = params.check().expect("the bench's own parameters are good");
    let simulator = Simulator::new(&config, &sheet, 0.08, None);
    let mut confidence = vec![0.0; sheet.len()];
    confidence[0] = 1.0;
    confidence[nodes - 1] = 1.0;
    (simulator, sheet, confidence)
}

const LINKS: [Effect; 5] =
    [Effect::Stretch, Effect::Shear, Effect::Bend, Effect::Gravity, Effect::Track];

fn links(simulator: &Simulator) -> usize {
    [Effect::Stretch, Effect::Shear, Effect::Bend].map(|e| simulator.links(e)[0]).iter().sum()
}

fn ticks() -> u64 {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: reading the counter has no effect.
    unsafe {
        std::arch::x86_64::_rdtsc()
    }
    #[cfg(not(target_arch = "x86_64"))]
    0
}

/// Least microseconds and ticks of a frame.
fn least(effects: &[Effect], nodes: usize) -> (usize, f64, f64) {
    let (mut simulator, sheet, confidence) = hung(effects, nodes, SUBSTEPS);
    let targets = sheet.flat_m();
    let (mut least_s, mut least_ticks) = (f64::INFINITY, u64::MAX);
    for _ in 0..(200_000 / (nodes * nodes)).clamp(30, 400) {
        let (start, from) = (Instant::now(), ticks());
        simulator.step(FRAME_S, &targets, &confidence, false);
        least_ticks = least_ticks.min(ticks() - from);
        least_s = least_s.min(start.elapsed().as_secs_f64());
    }
    (links(&simulator), least_s * 1e6, least_ticks as f64)
}

fn strain_max(x: &[[f32; 3]], sheet: &SheetGrid) -> f64 {
    let strain = |([a, b], rest): ([u32; 2], f64)| {
        let (a, b) = (x[a as usize], x[b as usize]);
        let squared: f64 = (0..3).map(|k| f64::from(b[k] - a[k]).powi(2)).sum();
        (squared.sqrt() / rest - 1.0).abs()
    };
    sheet.edges().into_iter().map(strain).fold(0.0, f64::max)
}

/// Milliseconds a frame of 64 sheets and of a large one, on the CPU and, if there is one, the
/// graphics processor.
fn backends() {
    println!("backends, {SUBSTEPS} substeps; least of some frames, ms");
    let config = |nodes: usize, backend: Backend| {
        let (effects, bend) = (
            LINKS.to_vec(),
            BendParams { reach: 4, compliance_m_per_n: 0.0, ..BendParams::default() },
        );
        let params =
            SimulateParams { backend, effects, bend, substep_motion_m: 0.0, ..Default::default() };
        let sheet = SheetGrid::new([0.21, 0.21], [nodes, nodes]);
        let config = params.check().expect("the bench's own parameters are good");
        let held: Vec<f32> = (0..sheet.len()).map(|n| f32::from(u8::from(n < 2))).collect();
        (Simulator::new(&config, &sheet, 0.08, None), sheet.flat_m(), held)
    };
    let (simulator, flat, held) = config(25, Backend::Cpu);
    let pulls = vec![Pulls { targets_m: &flat, confidence: &held }; 64];
    let mut batch = Batch::new(vec![simulator; 64]);
    let run = |batch: &mut Batch| {
        let frame = |_| {
            let start = Instant::now();
            batch.step(FRAME_S, &pulls);
            start.elapsed().as_secs_f64() * 1e3
        };
        (0..8).map(frame).fold(f64::INFINITY, f64::min)
    };
    println!("  64 sheets of 25²  CPU, all cores: {:.2}", run(&mut batch));
    match batch.to_gpu() {
        Ok(Some(adapter)) => println!("  64 sheets of 25²  {adapter}: {:.2}", run(&mut batch)),
        Ok(None) => println!("  64 sheets of 25²  not alike"),
        Err(error) => println!("  64 sheets of 25²  {error}"),
    }
    for backend in [Backend::Cpu, Backend::Gpu] {
        let (mut simulator, flat, held) = config(100, backend);
        let start = Instant::now();
        let chosen = simulator.choose_backend(&mut || start.elapsed().as_secs_f64());
        let name = match chosen {
            Ok(chosen) => chosen.adapter.unwrap_or_else(|| "CPU, one core".to_owned()),
            Err(error) => {
                println!("  one of 100²       {error}");
                continue;
            }
        };
        let frame = |_| {
            let start = Instant::now();
            simulator.step(FRAME_S, &flat, &held, false);
            start.elapsed().as_secs_f64() * 1e3
        };
        let least_ms = (0..8).map(frame).fold(f64::INFINITY, f64::min);
        println!("  one of 100²       {name}: {least_ms:.2}");
    }
}

/// Frames of a sheet that hangs above a table, with effects that are named and idle.
fn frames(arguments: &[String]) {
    let number = |k: usize| arguments.get(k).and_then(|n| n.parse().ok()).unwrap_or(25);
    let mut params = SimulateParams {
        effects: vec![Effect::Stretch, Effect::Shear, Effect::Bend, Effect::Track],
        bend: BendParams { reach: 4, compliance_m_per_n: 0.0, ..BendParams::default() },
        air_drag: AirDragParams { per_s: 0.0 },
        ..SimulateParams::default()
    };
    params.gravity.acceleration_m_per_s2 = 0.0;
    params.damping.time_s = 0.0;
    params.table.height_m = -1.0;
    let named = arguments.get(2).map_or("", String::as_str);
    for name in named.split(',').filter(|name| !name.is_empty()) {
        let effect = Effect::ALL.into_iter().find(|effect| effect.name() == name);
        params.effects.push(effect.unwrap_or_else(|| panic!("no effect is named `{name}`")));
    }
    let sheet = SheetGrid::new([0.21, 0.21], [number(1), number(1)]);
    let config = params.check().expect("the bench's own parameters are good");
    let mut simulator = Simulator::new(&config, &sheet, 0.08, None);
    let mut targets = sheet.flat_m();
    let confidence = vec![1.0; sheet.len()];
    for frame in 0..number(0) {
        targets[0][2] = 1e-3 * (frame % 7) as f32;
        simulator.step(FRAME_S, &targets, &confidence, false);
    }
    println!("{} frames of {} links", number(0), links(&simulator));
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let Some(at) = arguments.iter().position(|argument| argument == "--frames") {
        return frames(&arguments[at + 1..]);
    }
    if let Some(at) = arguments.iter().position(|argument| argument == "--hung") {
        let substeps = arguments.get(at + 1).and_then(|n| n.parse().ok()).unwrap_or(SUBSTEPS);
        let ([worst, _], least_s, median_s) = hung_in(substeps, 60);
        let [least_ms, median_ms] = [least_s, median_s].map(|seconds| seconds * 1e3);
        println!(
            "{:34} least {least_ms:9.3} ms  median {median_ms:9.3} ms  stretch {:9.2} %",
            "orime-simulate, links 1-4",
            1e2 * worst
        );
        return;
    }
    if arguments.iter().any(|argument| argument == "--stretch") {
        return stretches();
    }
    sizes();
    if !arguments.iter().any(|argument| argument == "--sizes") {
        backends();
        stretches();
    }
}

/// What a frame costs by the size of the sheet.
fn sizes() {
    println!("links 1-4, {SUBSTEPS} substeps, one core; least of many frames");
    println!("  nodes   links  damped  us/frame  ns/link  ticks/link  us/link-scaled-to-25");
    let mut at_25 = 0.0;
    for nodes in [13, 25, 36, 50, 71, 100] {
        for damped in [false, true] {
            let mut effects = LINKS.to_vec();
            if damped {
                effects.push(Effect::Damping);
            }
            let (links, us, ticks) = least(&effects, nodes);
            let each = links as f64 * f64::from(SUBSTEPS);
            if nodes == 25 && !damped {
                at_25 = us / links as f64;
            }
            let scaled = if at_25 > 0.0 { us / links as f64 / at_25 } else { f64::NAN };
            println!(
                "{nodes:4}²  {links:6}  {damped:6}  {us:8.1}  {:7.3}  {:10.2}  {scaled:8.2}",
                us * 1e3 / each,
                ticks / each
            );
        }
    }
}

/// How stretch falls with substeps, here and in a plain loop over the links.
fn stretches() {
    println!(
        "25x25 hung by two corners, {FRAMES_HUNG} frames of 1/60 s (design/simulate.md, fact 1)"
    );
    println!("  substeps  largest stretch %  settled %  us/frame  plain: largest %  settled %");
    for substeps in [5, 10, 20, 40, 80, 160] {
        let ([worst, settled], least_s, _) = hung_in(substeps, FRAMES_HUNG);
        let plain = plainly_hung(substeps);
        let [worst, settled, plain_worst, plain_settled] =
            [worst, settled, plain[0], plain[1]].map(|strain| strain * 1e2);
        println!(
            "  {substeps:8}  {worst:17.3}  {settled:9.3}  {:8.1}  {plain_worst:16.3}  \
             {plain_settled:9.3}",
            least_s * 1e6
        );
    }
}

/// Largest and last stretch of the plain loop's sheet.
fn plainly_hung(substeps: u32) -> [f64; 2] {
    let mut sheet = Plain::hung(SIDE_M as f32, 25);
    let grid = SheetGrid::new([SIDE_M; 2], [25; 2]);
    let (mut worst, mut last) = (0f64, 0.0);
    for _ in 0..FRAMES_HUNG {
        sheet.frame(FRAME_S as f32, substeps, DRAG_PER_S as f32);
        last = strain_max(sheet.positions_m(), &grid);
        worst = worst.max(last);
    }
    [worst, last]
}

/// Largest and last stretch of a sheet that is pinned by two corners, least and median seconds a
/// frame.
fn hung_in(substeps: u32, frames: usize) -> ([f64; 2], f64, f64) {
    let effects = [&LINKS[..4], &[Effect::AirDrag]].concat();
    let (mut simulator, sheet, held) = hung(&effects, 25, substeps);
    let targets = sheet.flat_m();
    let masses: Vec<f32> = held.iter().map(|held| 1.0 - held).collect();
    assert!(simulator.set_inverse_masses(&masses), "the bench's own masses are good");
    let confidence = vec![0.0; sheet.len()];
    let (mut worst, mut times) = (0f64, Vec::new());
    for _ in 0..frames {
        let start = Instant::now();
        simulator.step(FRAME_S, &targets, &confidence, false);
        times.push(start.elapsed().as_secs_f64());
        worst = worst.max(strain_max(simulator.positions_m(), &sheet));
    }
    times.sort_by(f64::total_cmp);
    let settled = strain_max(simulator.positions_m(), &sheet);
    ([worst, settled], times[0], times[times.len() / 2])
}
