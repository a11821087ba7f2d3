//! Any numbers as targets, confidences, masses and times: the state stays finite.
#![no_main]

use libfuzzer_sys::fuzz_target;
use orime_geometry::SheetGrid;
use orime_simulate::{SheetModel, SimulateParams};

/// Nodes along a side.
const SIDE: usize = 5;
/// Steps at most.
const STEPS_MAX: usize = 8;

fuzz_target!(|bytes: &[u8]| {
    let sheet = SheetGrid::new([0.1, 0.1], [SIDE, SIDE]);
    let config = SimulateParams::default().check().expect("defaults pass");
    let mut model = SheetModel::new(&config, &sheet, 0.08, None);
    let per_step = 4 * sheet.len() + 1;
    let numbers: Vec<f32> = orime_fuzz::numbers(bytes).collect();
    for (step, numbers) in numbers.chunks(per_step).take(STEPS_MAX).enumerate() {
        let (dt_s, numbers) = (f64::from(numbers[0]), &numbers[1..]);
        let targets_m: Vec<[f32; 3]> =
            numbers.chunks_exact(4).map(|four| [four[0], four[1], four[2]]).collect();
        let confidence: Vec<f32> = numbers.chunks_exact(4).map(|four| four[3]).collect();
        let _ = model.simulator_mut().set_inverse_masses(&confidence);
        model.step(dt_s, &targets_m, &confidence, step == 0);
        let all = model.positions_m().iter().chain(model.predicted_m());
        assert!(all.flatten().all(|c| c.is_finite()), "the state is not finite at step {step}");
    }
});
