//! Whatever a solver is given, its state stays finite and near.

use orime_geometry::SheetGrid;
use orime_simulate::{Effect, Grip, SimulateParams, Simulator};
use proptest::prelude::*;

fn simulator() -> (Simulator, Vec<[f32; 3]>) {
    let sheet = SheetGrid::new([0.1, 0.08], [7, 6]);
    let mut params = SimulateParams::default();
    params.effects.extend([Effect::Table, Effect::Gravity, Effect::Crease]);
    let config = params.check().unwrap();
    (Simulator::new(&config, &sheet, 0.08, None), sheet.flat_m())
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 64,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn any_target_trust_and_frame_length_leave_it_finite(
        spoilt in prop::collection::vec((0usize..42, 0usize..3, prop::num::f32::ANY), 0..6),
        trust in prop::collection::vec((0usize..42, prop::num::f32::ANY), 0..6),
        lengths_s in prop::collection::vec(prop::num::f64::ANY, 1..6),
        resets in prop::collection::vec(any::<bool>(), 6),
    ) {
        let (mut simulator, mut targets) = simulator();
        let mut confidence = vec![1.0; targets.len()];
        for (node, axis, value) in spoilt {
            // What is finite may be far away: a target there is a target.
            targets[node][axis] = if value.is_finite() { value.clamp(-1.0, 1.0) } else { value };
        }
        for (node, value) in trust {
            confidence[node] = value;
        }
        for (dt_s, reset) in lengths_s.into_iter().zip(resets) {
            simulator.step(dt_s, &targets, &confidence, reset);
            prop_assert!(simulator.positions_m().iter().flatten().all(|c| c.abs() < 10.0));
        }
    }

    #[test]
    fn any_grip_and_mass_is_taken_or_refused(
        uv_m in prop::array::uniform2(prop::num::f64::ANY),
        at_m in prop::array::uniform3(-0.3..0.3f64),
        mut masses in prop::collection::vec(prop::num::f32::ANY, 42),
        kind in 0..3,
    ) {
        // Any number is hardly ever 42 usable ones.
        match kind {
            0 => masses.iter_mut().for_each(|m| *m = 1e-6 + (m.abs() % 2.0).min(2.0)),
            1 => masses.iter_mut().for_each(|m| *m = f32::from_bits(m.to_bits() & 0x7f_ffff)),
            _ => {}
        }
        let (mut simulator, targets) = simulator();
        simulator.set_grips(&[Grip { uv_m, position_m: at_m }]);
        let usable = masses.iter().all(|m| *m == 0.0 || (1e-6..=1e6).contains(m));
        prop_assert_eq!(simulator.set_inverse_masses(&masses), usable);
        for _ in 0..3 {
            simulator.step(1.0 / 30.0, &targets, &vec![0.5; targets.len()], false);
        }
        prop_assert!(simulator.positions_m().iter().flatten().all(|c| c.is_finite()));
    }
}
