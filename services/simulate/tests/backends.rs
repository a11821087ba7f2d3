//! The choice of a backend, and a whole fold on each.

#![cfg(feature = "gpu")]

use orime_creases::{Folds, Line};
use orime_geometry::SheetGrid;
use orime_simulate::{Backend, Batch, Effect, GpuError, Pulls, SimulateParams, Simulator};
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

/// Folds a sheet and returns it, or says loudly that there is no adapter.
fn fold_on(backend: Backend) -> Option<Simulator> {
    let mut params = SimulateParams { backend, ..SimulateParams::default() };
    params.effects.retain(|effect| *effect != Effect::SelfContact);
    params.effects.push(Effect::Table);
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
    let mut folds = Folds::flat(&sheet());
    folds.split(0, &Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
    for frame in 1..=40 {
        if frame == 10 {
            simulator.set_folds(&folds);
        }
        simulator.step(1.0 / 30.0, &folded(0.05 * f64::from(frame)), &sure, false);
    }
    Some(simulator)
}

#[test]
fn a_fold_is_the_same_on_every_backend() {
    let Some(cpu) = fold_on(Backend::Cpu) else { panic!("the CPU is always there") };
    for backend in [Backend::Auto, Backend::Gpu] {
        let Some(other) = fold_on(backend) else { return };
        let apart = cpu.positions_m().iter().flatten().zip(other.positions_m().iter().flatten());
        let apart_m = apart.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart_m < 1e-4, "{backend:?}: {apart_m} m");
    }
}

#[test]
fn what_the_graphics_processor_cannot_do_is_refused_before_it_starts() {
    let mut params = SimulateParams { backend: Backend::Gpu, ..SimulateParams::default() };
    assert!(params.check().is_ok());
    params.effects.push(Effect::Crease);
    let problems = params.check().unwrap_err();
    assert!(problems[0].to_string().contains("crease"), "{problems:?}");
    params.backend = Backend::Auto;
    assert!(params.check().is_ok());
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
