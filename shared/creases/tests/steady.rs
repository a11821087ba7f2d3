//! A step that changes nothing allocates nothing.

use orime_creases::trial::{Noise, Scene, SceneKind};
use orime_creases::{CreaseFinder, CreaseMode, CreaseParams};
use orime_geometry::SheetGrid;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: everything is passed on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller keeps the contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the block came from `alloc` above.
        unsafe { System.dealloc(block, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn quiet_steps_allocate_nothing() {
    let sheet = SheetGrid::new([0.15; 2], [25; 2]);
    let sure = vec![1.0; sheet.len()];
    let scene = Scene::new(SceneKind::SecondHalf, &sheet, 1).unwrap();
    for mode in [CreaseMode::Lines, CreaseMode::Paper] {
        let config = CreaseParams { mode, ..Default::default() }.check().unwrap();
        let mut finder = CreaseFinder::new(&config, &sheet);
        let mut noise = Noise::new(&sheet, 2e-3, 0.5, 1);
        let (mut quiet, mut changed) = (0, 0);
        for (step, exact_m) in scene.positions_m.iter().enumerate() {
            let seen_m = noise.add(exact_m);
            let before = COUNT.with(Cell::get);
            if finder.step(&seen_m, &sure) {
                changed += 1;
            } else {
                quiet += 1;
                assert_eq!(COUNT.with(Cell::get), before, "{mode:?}, step {step}");
            }
            let before = COUNT.with(Cell::get);
            finder.folds_mut().observe(&seen_m);
            assert_eq!(COUNT.with(Cell::get), before, "observing after step {step}");
        }
        assert!(quiet > 50 && changed > 0, "{mode:?}: {quiet} quiet steps, {changed} changes");
    }
}
