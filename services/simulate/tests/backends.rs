//! The choice of a backend, and a whole fold on each.

#![cfg(feature = "gpu")]

use orime_creases::{Folds, Line};
use orime_geometry::SheetGrid;
use orime_simulate::{
    Backend, Batch, BendKind, ContactPass, CreaseKind, DampingKind, Effect, GpuError, Grip, Part,
    Pulls, SimulateParams, Simulator, Taking,
};
use std::time::Instant;

fn sheet() -> SheetGrid {
    SheetGrid::new([0.15; 2], [25, 25])
}

fn folded(angle_rad: f64) -> Vec<[f32; 3]> {
    let fold = |[u, v]: [f64; 2]| {
        let over = (u - 0.075).max(0.0);
        let x = u.min(0.075) + over * angle_rad.cos();
        [x as f32, v as f32, (over * angle_rad.sin()) as f32]
    };
    sheet().uv_m().map(fold).collect()
}

/// What a scene has beside links, facets and the table.
type Adds = fn(&mut SimulateParams);

/// One per kind of effect.
const SCENES: [(&str, Adds); 6] = [
    ("nothing", |_| {}),
    ("hinges that yield", |params| params.effects.push(Effect::Crease)),
    ("the paper's plasticity", |params| {
        params.effects.push(Effect::Crease);
        params.crease.kind = CreaseKind::Paper;
    }),
    ("plasticity everywhere", |params| {
        params.effects.push(Effect::Crease);
        params.crease.kind = CreaseKind::Everywhere;
    }),
    ("a plate", |params| params.bend.kind = BendKind::Hinge),
    ("the paper's damping", |params| params.damping.kind = DampingKind::Paper),
];

/// Folds a sheet and returns it, or says loudly that there is no adapter. A gripper holds it for a
/// while, and one facet gives way.
fn fold_on(backend: Backend, adds: Adds) -> Option<Simulator> {
    let mut params = SimulateParams { backend, ..SimulateParams::default() };
    params.effects.push(Effect::Table);
    adds(&mut params);
    let mut simulator = Simulator::new(&params.check().unwrap(), &sheet(), 0.08, None);
    let start = Instant::now();
    match simulator.choose_backend(&mut || start.elapsed().as_secs_f64()) {
        Ok(chosen) => {
            let is_gpu = chosen.adapter.is_some();
            match backend {
                Backend::Cpu => assert!(!is_gpu && chosen.frame_s[0].is_nan()),
                Backend::Gpu => assert!(is_gpu),
                // Measured, not guessed, or there is nothing to measure.
                Backend::Auto => {
                    let [cpu_s, gpu_s] = chosen.frame_s;
                    assert!(chosen.refused.is_some() || is_gpu == (gpu_s < cpu_s));
                }
            }
        }
        Err(GpuError::NoAdapter(why)) if backend == Backend::Gpu => {
            eprintln!("SKIPPED, NOTHING WAS COMPARED: no Vulkan adapter ({why})");
            return None;
        }
        Err(error) => panic!("{error}"),
    }
    let sure = vec![1.0; sheet().len()];
    simulator.step(1.0 / 30.0, &folded(0.0), &sure, true);
    // Every third node has a target: the others follow by what acts.
    let some: Vec<f32> = (0..sheet().len()).map(|n| f32::from(n % 3 == 0)).collect();
    let mut folds = Folds::flat(&sheet());
    folds.split(0, &Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
    for frame in 1..=40 {
        if frame == 10 {
            simulator.set_folds(&folds);
        }
        if frame == 12 {
            simulator.set_facet_shares(&[0.8, 0.5]);
        }
        let (targets_m, held) = (folded(0.05 * f64::from(frame)), (15..30).contains(&frame));
        let corner = targets_m[sheet().len() - 1].map(|c| f64::from(c) + 1e-3);
        let grip = Grip { uv_m: [0.15, 0.15], position_m: corner };
        simulator.set_grips(if held { std::slice::from_ref(&grip) } else { &[] });
        // Where a caller's contact takes part, the frame is made here: state goes to and fro.
        let mut contact = |_: ContactPass<'_>| {};
        let takes_part = frame > 20 && frame % 3 == 0;
        let mut passes = 0;
        let mut watch = |_: Part| passes += 1;
        let mut taking = Taking { contact: None, watch: Some(&mut watch) };
        if takes_part {
            taking.contact = Some(&mut contact);
        }
        let pulls = Pulls { targets_m: &targets_m, confidence: &some };
        let report = simulator.step_with(1.0 / 30.0, pulls, false, &mut taking);
        let bends = !report.slept.contains(Effect::SelfContact);
        // What is done elsewhere is seen as one pass, whatever it was.
        let elsewhere = backend == Backend::Gpu && !(takes_part && bends);
        assert!(backend == Backend::Auto || (passes == 1) == elsewhere, "frame {frame}");
    }
    Some(simulator)
}

#[test]
fn a_fold_is_the_same_on_every_backend() {
    for (scene, adds) in SCENES {
        let Some(cpu) = fold_on(Backend::Cpu, adds) else { panic!("the CPU is always there") };
        // The choice is the same for all.
        let backends =
            if scene == "nothing" { &[Backend::Auto, Backend::Gpu][..] } else { &[Backend::Gpu] };
        for backend in backends.iter().copied() {
            let Some(other) = fold_on(backend, adds) else { return };
            let [a, b] = [&cpu, &other].map(Simulator::positions_m);
            let apart = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs());
            let apart_m = apart.fold(0.0, f32::max);
            assert!(apart_m < 1e-4, "{scene}, {backend:?}: {apart_m} m");
            let [a, b] = [&cpu, &other].map(|simulator| simulator.folds().creases()[0].angle_rad);
            assert!((a - b).abs() < 1e-3, "{scene}, {backend:?}: folded by {b}, on the CPU {a}");
        }
    }
}

#[test]
fn the_graphics_processor_does_every_effect() {
    for (scene, adds) in SCENES {
        let mut params = SimulateParams { backend: Backend::Gpu, ..SimulateParams::default() };
        adds(&mut params);
        assert!(params.check().is_ok(), "{scene}");
    }
}

#[test]
fn a_batch_is_its_sheets_one_by_one() {
    let config = SimulateParams::default().check().unwrap();
    let sheets = || -> Vec<Simulator> {
        (0..5).map(|_| Simulator::new(&config, &sheet(), 0.08, None)).collect()
    };
    let targets: Vec<Vec<[f32; 3]>> = (0..5).map(|k| folded(0.1 * f64::from(k))).collect();
    let sure = vec![1.0; sheet().len()];
    let pulls: Vec<Pulls<'_>> =
        targets.iter().map(|t| Pulls { targets_m: t, confidence: &sure }).collect();
    let mut alone = sheets();
    let (mut here, mut there) = (Batch::new(sheets()), Batch::new(sheets()));
    let there_is_one = match there.to_gpu() {
        Ok(adapter) => adapter.is_some(),
        Err(GpuError::NoAdapter(why)) => {
            eprintln!("SKIPPED, NOTHING WAS COMPARED: no Vulkan adapter ({why})");
            false
        }
        Err(error) => panic!("{error}"),
    };
    for _ in 0..10 {
        for (sheet, pulls) in alone.iter_mut().zip(&pulls) {
            sheet.step(1.0 / 30.0, pulls.targets_m, pulls.confidence, false);
        }
        here.step(1.0 / 30.0, &pulls);
        there.step(1.0 / 30.0, &pulls);
    }
    for (k, alone) in alone.iter().enumerate() {
        assert_eq!(here.sheets()[k].positions_m(), alone.positions_m(), "sheet {k}");
        let found = there.sheets()[k].positions_m().iter().flatten();
        let apart = found.zip(alone.positions_m().iter().flatten()).map(|(a, b)| (a - b).abs());
        let apart_m = apart.fold(0.0, f32::max);
        // All sheets of a batch on the graphics processor get the substeps of the fastest.
        assert!(apart_m < 2e-3, "sheet {k}: {apart_m} m");
        assert!(!there_is_one || apart_m > 0.0 || k == 0, "it was not done elsewhere");
    }
}

#[test]
fn sheets_of_unlike_settings_are_no_batch_for_the_graphics_processor() {
    let config = |time_s: f64| {
        let mut params = SimulateParams::default();
        params.damping.time_s = time_s;
        params.check().unwrap()
    };
    let sheets = || -> Vec<Simulator> {
        let each =
            [0.0005, 0.001].map(|time_s| Simulator::new(&config(time_s), &sheet(), 0.08, None));
        each.into_iter().collect()
    };
    let (targets_m, sure) = (folded(0.3), vec![1.0; sheet().len()]);
    let pulls = [Pulls { targets_m: &targets_m, confidence: &sure }; 2];
    let (mut alone, mut batch) = (sheets(), Batch::new(sheets()));
    if let Err(GpuError::NoAdapter(why)) = batch.to_gpu() {
        eprintln!("SKIPPED, NOTHING WAS COMPARED: no Vulkan adapter ({why})");
        return;
    }
    for _ in 0..3 {
        alone.iter_mut().for_each(|sheet| {
            sheet.step(1.0 / 30.0, &targets_m, &sure, false);
        });
        batch.step(1.0 / 30.0, &pulls);
    }
    for (alone, together) in alone.iter().zip(batch.sheets()) {
        assert_eq!(alone.positions_m(), together.positions_m());
    }
}
