//! A sheet that bends as a thin plate: strips that stick out and hang under their weight.

use orime_geometry::SheetGrid;
use orime_simulate::{
    AirDragParams, BendKind, BendParams, Effect, GravityParams, SimulateParams, Simulator,
};

const DENSITY_KG_PER_M2: f64 = 0.08;
const GRAVITY_M_PER_S2: f64 = 9.81;
const LENGTH_M: f64 = 0.05;

/// How deep the end of a strip hangs that is clamped at its other end, metres.
fn sag_m(rigidity_n_m: f64, nodes: [usize; 2], along: usize) -> f64 {
    let mut size_m = [0.02; 2];
    size_m[along] = LENGTH_M;
    let sheet = SheetGrid::new(size_m, nodes);
    let params = SimulateParams {
        effects: vec![
            Effect::Stretch,
            Effect::Shear,
            Effect::Bend,
            Effect::Gravity,
            Effect::AirDrag,
        ],
        bend: BendParams { kind: BendKind::Hinge, rigidity_n_m, ..BendParams::default() },
        gravity: GravityParams { acceleration_m_per_s2: GRAVITY_M_PER_S2 },
        air_drag: AirDragParams { per_s: 20.0 },
        substeps: 300,
        ..SimulateParams::default()
    };
    let config = params.check().unwrap();
    let mut simulator = Simulator::new(&config, &sheet, DENSITY_KG_PER_M2, None);
    // Two rows are held: a place, and a slope.
    let row = |n: usize| if along == 0 { n / nodes[1] } else { n % nodes[1] };
    let masses: Vec<f32> = (0..sheet.len()).map(|n| f32::from(u8::from(row(n) > 1))).collect();
    assert!(simulator.set_inverse_masses(&masses));
    let (flat, free) = (sheet.flat_m(), vec![0.0; sheet.len()]);
    for _ in 0..120 {
        simulator.step(1.0 / 60.0, &flat, &free, false);
    }
    -f64::from(simulator.positions_m()[sheet.len() - 1][2])
}

#[test]
fn a_stiff_strip_hangs_as_beams_do_along_u_and_v() {
    // w = q L⁴ / 8D with the masses in ten rows h apart, of which the second holds the slope:
    // w = q h⁴ / D · Σ j² (j + 1) / 2, for a bend that is small beside the length.
    let rigidity_n_m = 2e-4;
    let q_n_per_m2 = DENSITY_KG_PER_M2 * GRAVITY_M_PER_S2;
    let sum: f64 = (1..=9).map(f64::from).map(|j| j * j * (j + 1.0) / 2.0).sum();
    let beam_m = q_n_per_m2 * (LENGTH_M / 10.0).powi(4) / rigidity_n_m * sum;
    for (along, nodes) in [[11, 5], [5, 11]].into_iter().enumerate() {
        let ratio = sag_m(rigidity_n_m, nodes, along) / beam_m;
        assert!(0.95 < ratio && ratio < 1.05, "along axis {along}: {ratio} times {beam_m} m");
    }
}

#[test]
fn the_more_rigid_the_less_a_strip_hangs_down() {
    let [cloth_m, paper_m, card_m] = [1e-6, 2e-4, 2e-3].map(|d| sag_m(d, [11, 5], 0));
    assert!(cloth_m > 0.03, "cloth hangs down: {cloth_m} m");
    assert!(paper_m < 0.2 * cloth_m && card_m < 0.3 * paper_m, "{cloth_m} {paper_m} {card_m} m");
}

#[test]
fn a_hinge_makes_no_skip_links() {
    let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
    let links = |kind: BendKind| {
        let bend = BendParams { kind, ..BendParams::default() };
        let params = SimulateParams { bend, ..SimulateParams::default() };
        let simulator = Simulator::new(&params.check().unwrap(), &sheet, 0.08, None);
        [Effect::Stretch, Effect::Shear, Effect::Bend].map(|effect| simulator.links(effect))
    };
    let [skip, hinge] = [BendKind::Links, BendKind::Hinge].map(links);
    assert_eq!(skip[..2], hinge[..2]);
    assert_eq!(skip[2], [2 * 23 * 25 + 2 * 23 * 23, 8]);
    assert_eq!(hinge[2], [2 * 23 * 25 + 24 * 24, 10]);
}
