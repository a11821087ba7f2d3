//! A million substeps of the square base, folded and unfolded again and again:
//! `cargo bench -p orime-simulate --no-default-features --bench endless`, some minutes. `-- 100000`
//! makes so many substeps.
//!
//! Targets are exact poses with smooth noise, new in every frame, 580 frames forth and 580 back,
//! then 60 frames flat and without noise. What is printed per loop: the kinetic energy's mean and
//! maximum over the loop (metres from state to state), the strain of the grid's edges (root mean
//! square over the loop's frames, largest), and at its end, flat and at rest, the strain that is
//! left, the distance to the exact pose, facets, how far the ends of creases are from where they
//! were after the second loop, and resident memory. Fails where anything is not finite, or the last
//! loop exceeds the second one by more than the limits below.

use orime_geometry::SheetGrid;
use orime_origami::{Sequence, Sheet};
use orime_simulate::{SheetModel, SimulateParams};
use std::process::ExitCode;

const FRAME_S: f64 = 1.0 / 30.0;
const SIDE_M: f64 = 0.15;
const DENSITY_KG_M2: f64 = 0.08;
const SUBSTEPS: u64 = 1_000_000;
/// Frames from flat to the square base, and of rest on either end of a loop.
const FRAMES: usize = 580;
const REST: usize = 60;
/// Noise of the targets: amplitude of a wave, metres.
const NOISE_M: f64 = 2e-4;

/// What the last loop may have more than the second: shares of energies and strains, and for what
/// is next to nothing anyway, strain, metres and bytes.
const GROWTH_MAX: f64 = 0.05;
const REST_STRAIN_MAX: f64 = 1e-4;
const REST_M_MAX: f64 = 2e-5;
const CREASES_M_MAX: f64 = 1e-3;
const MEMORY_BYTES_MAX: u64 = 1 << 20;

/// A loop's figures.
#[derive(Debug, Clone, Copy, Default)]
struct Figures {
    kinetic_j: f64,
    kinetic_max_j: f64,
    strain: f64,
    strain_max: f64,
    rest_strain: f64,
    rest_m: f64,
    facets: usize,
    creases_m: f64,
    memory_bytes: u64,
}

/// SplitMix64, −1 to 1.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

struct Scene {
    grid: SheetGrid,
    sequence: Sequence,
    model: SheetModel,
    edges: Vec<([u32; 2], f64)>,
    before_m: Vec<[f32; 3]>,
    seed: u64,
    substeps: u64,
    is_finite: bool,
}

impl Scene {
    fn new() -> Self {
        let grid = SheetGrid::new([SIDE_M; 2], [25; 2]);
        let config = SimulateParams::default().check().expect("the defaults are good");
        let model = SheetModel::new(&config, &grid, DENSITY_KG_M2, None);
        let sheet = Sheet { size_m: [SIDE_M; 2], thickness_m: 1e-4 };
        Self {
            sequence: Sequence::square_base(sheet).expect("the sheet is square"),
            edges: grid.edges(),
            before_m: Vec::new(),
            seed: 1,
            substeps: 0,
            is_finite: true,
            model,
            grid,
        }
    }

    /// Where the nodes are at a share of the sequence.
    fn exact_m(&self, progress: f64) -> Vec<[f32; 3]> {
        let pose = self.sequence.pose(progress);
        let position = |uv| self.sequence.position_m(&pose, uv).coords.cast::<f32>().into();
        self.grid.uv_m().map(position).collect()
    }

    fn step(&mut self, progress: f64, noise_m: f64) -> [f64; 2] {
        let mut targets_m = self.exact_m(progress);
        for axis in 0..3 {
            let [ku, kv, phase] = [(); 3].map(|()| random(&mut self.seed));
            for (target, [u, v]) in targets_m.iter_mut().zip(self.grid.uv_m()) {
                let wave = std::f64::consts::TAU / 0.05 * (ku * u + kv * v);
                target[axis] += (noise_m * (wave + std::f64::consts::PI * phase).sin()) as f32;
            }
        }
        let confidence = vec![1.0; self.grid.len()];
        let is_first = self.before_m.is_empty();
        let report = self.model.step(FRAME_S, &targets_m, &confidence, is_first);
        self.substeps += u64::from(report.simulate.substeps);
        let now_m = self.model.positions_m();
        self.is_finite &= now_m.iter().flatten().all(|c| c.is_finite());
        let node_kg = DENSITY_KG_M2 * SIDE_M * SIDE_M / self.grid.len() as f64;
        let moved = now_m.iter().zip(&self.before_m).map(|(a, b)| distance_m(*a, *b).powi(2));
        let kinetic_j = 0.5 * node_kg * moved.sum::<f64>() / (FRAME_S * FRAME_S);
        let strain = self.strain();
        self.before_m.clear();
        self.before_m.extend_from_slice(self.model.positions_m());
        [kinetic_j, strain]
    }

    /// Root mean square of the edges' strains.
    fn strain(&self) -> f64 {
        let x = self.model.positions_m();
        let strain = |([a, b], rest_m): &([u32; 2], f64)| {
            (distance_m(x[*a as usize], x[*b as usize]) / rest_m - 1.0).powi(2)
        };
        (self.edges.iter().map(strain).sum::<f64>() / self.edges.len() as f64).sqrt()
    }

    /// Forth, back, and rest.
    fn play(&mut self) -> Figures {
        let mut figures = Figures::default();
        let there = (0..=FRAMES).map(|frame| frame as f64 / FRAMES as f64);
        let back = there.clone().rev();
        for progress in there.chain(back) {
            let [kinetic_j, strain] = self.step(progress, NOISE_M);
            figures.kinetic_j += kinetic_j / (2 * FRAMES + 2) as f64;
            figures.kinetic_max_j = figures.kinetic_max_j.max(kinetic_j);
            figures.strain += strain / (2 * FRAMES + 2) as f64;
            figures.strain_max = figures.strain_max.max(strain);
        }
        for _ in 0..REST {
            self.step(0.0, 0.0);
        }
        let exact_m = self.exact_m(0.0);
        let apart = self.model.positions_m().iter().zip(&exact_m);
        let apart2: f64 = apart.map(|(a, b)| distance_m(*a, *b).powi(2)).sum();
        figures.rest_m = (apart2 / self.grid.len() as f64).sqrt();
        figures.rest_strain = self.strain();
        figures.facets = self.model.folds().facets().len();
        figures.memory_bytes = resident_bytes();
        figures
    }

    fn creases_m(&self) -> Vec<[[f64; 2]; 2]> {
        self.model.folds().creases().iter().map(|crease| crease.ends_m).collect()
    }
}

fn distance_m(a: [f32; 3], b: [f32; 3]) -> f64 {
    (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

fn resident_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kib = line.and_then(|rest| rest.trim().strip_suffix(" kB"));
    1024 * kib.and_then(|kib| kib.parse::<u64>().ok()).unwrap_or(0)
}

/// How far the farthest end of a crease is from the nearest one of the others.
fn apart_m(ends: &[[[f64; 2]; 2]], others: &[[[f64; 2]; 2]]) -> f64 {
    let points = |ends: &[[[f64; 2]; 2]]| ends.concat();
    let nearest = |p: &[f64; 2]| {
        let each = points(others).into_iter().map(|q| (p[0] - q[0]).hypot(p[1] - q[1]));
        each.fold(f64::INFINITY, f64::min)
    };
    points(ends).iter().map(nearest).fold(0.0, f64::max)
}

fn failures(second: &Figures, last: &Figures) -> Vec<String> {
    let mut failures = Vec::new();
    let mut most = |name: &str, last: f64, limit: f64| {
        let holds = last <= limit; // NaN fails.
        if !holds {
            failures.push(format!("{name}: {last:.4e}, at most {limit:.4e}"));
        }
    };
    let grown = |value: f64| value * (1.0 + GROWTH_MAX);
    most("kinetic energy, J", last.kinetic_j, grown(second.kinetic_j));
    most("strain", last.strain, grown(second.strain));
    most("strain at rest", last.rest_strain, second.rest_strain + REST_STRAIN_MAX);
    most("off the exact pose at rest, m", last.rest_m, second.rest_m + REST_M_MAX);
    most("creases moved, m", last.creases_m, CREASES_M_MAX);
    most("facets", last.facets as f64, second.facets as f64);
    let memory = (second.memory_bytes + MEMORY_BYTES_MAX) as f64;
    most("resident bytes", last.memory_bytes as f64, memory);
    failures
}

fn main() -> ExitCode {
    let wanted = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(SUBSTEPS);
    let mut scene = Scene::new();
    let (mut loops, mut creases_m) = (Vec::<Figures>::new(), Vec::new());
    println!(
        "loop  substeps  kinetic µJ (max)   strain % (max)  at rest: strain %  off µm  facets  \
         creases µm  memory MiB"
    );
    while scene.substeps < wanted || loops.len() < 3 {
        let mut figures = scene.play();
        if loops.len() < 2 {
            creases_m = scene.creases_m();
        }
        figures.creases_m = apart_m(&scene.creases_m(), &creases_m);
        loops.push(figures);
        println!(
            "{:4}  {:8}  {:8.3} ({:6.1})  {:6.3} ({:5.2})  {:16.5}  {:6.2}  {:6}  {:10.1}  {:10.2}",
            loops.len(),
            scene.substeps,
            1e6 * figures.kinetic_j,
            1e6 * figures.kinetic_max_j,
            1e2 * figures.strain,
            1e2 * figures.strain_max,
            1e2 * figures.rest_strain,
            1e6 * figures.rest_m,
            figures.facets,
            1e6 * figures.creases_m,
            figures.memory_bytes as f64 / f64::from(1 << 20),
        );
    }
    let mut failures = failures(&loops[1], &loops[loops.len() - 1]);
    if !scene.is_finite {
        failures.push("positions that are not finite".to_owned());
    }
    failures.iter().for_each(|failure| println!("FAILED  {failure}"));
    println!("{} substeps, {} failures", scene.substeps, failures.len());
    if failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
