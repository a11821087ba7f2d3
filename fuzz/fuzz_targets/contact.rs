//! Any numbers as positions: contact returns, and finite positions stay finite.
#![no_main]

use libfuzzer_sys::fuzz_target;
use orime_contact::{ContactParams, SelfContact};
use orime_creases::{Folds, Line};
use orime_geometry::SheetGrid;

/// Nodes along a side.
const SIDE: usize = 5;

fuzz_target!(|bytes: &[u8]| {
    let sheet = SheetGrid::new([0.1, 0.1], [SIDE, SIDE]);
    let mut folds = Folds::flat(&sheet);
    if bytes.len() % 2 == 1 {
        let _ = folds.split(0, &Line::through([0.05, 0.0], [0.05, 0.1]));
    }
    let numbers: Vec<f32> = orime_fuzz::numbers(bytes).collect();
    let x_m: Vec<[f32; 3]> = numbers.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    let [Some(from_m), Some(to_m)] =
        [0, 1].map(|k| x_m.get(k * sheet.len()..(k + 1) * sheet.len()))
    else {
        return;
    };
    // What the solver hands over is finite, and no farther away than its origin follows.
    if !from_m.iter().chain(to_m).flatten().all(|c| c.abs() < 100.0) {
        return;
    }
    let config = ContactParams::default().check().expect("defaults pass");
    let mut contact = SelfContact::new(&config, &sheet);
    folds.observe(from_m);
    let mut x_m = to_m.to_vec();
    contact.project(from_m, &mut x_m, &folds);
    contact.truncate(from_m, &mut x_m, &folds);
    assert!(x_m.iter().flatten().all(|c| c.is_finite()));
});
