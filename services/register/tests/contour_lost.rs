//! A sheet whose contour is seen where it has no border is lost, and said to be.

mod below;

use below::camera;
use orime_geometry::{Edgel, ObservedPoint, SheetGrid};
use orime_register::{Observation, RegisterParams, Registrar, Tracking};

/// The outline of the flat sheet; its side towards +u is seen `inward_px` inside of it.
fn contour(inward_px: f32) -> Vec<Edgel> {
    let half = 90.0; // 0.075 m · 600 px / 0.5 m
    let along = (-44..=44).map(|k| 2.0 * k as f32);
    let edgel = |(at, normal): ([f32; 2], [f32; 2])| Edgel {
        position_px: [320.0 + at[0], 240.0 + at[1]],
        normal,
        camera: 0,
        kind: 0,
    };
    along
        .flat_map(|s| {
            [
                ([half - inward_px, s], [1.0, 0.0]),
                ([-half, s], [-1.0, 0.0]),
                ([s, half], [0.0, 1.0]),
                ([s, -half], [0.0, -1.0]),
            ]
        })
        .map(edgel)
        .collect()
}

#[test]
fn a_side_seen_elsewhere_is_a_loss() {
    let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
    let config = RegisterParams::default().check().expect("the defaults are valid");
    let mut registrar = Registrar::new(&config, &sheet, None);
    registrar.assume_pose();
    let predicted = sheet.flat_m();
    let cloud: Vec<ObservedPoint> = SheetGrid::new([0.15, 0.15], [60, 60])
        .flat_m()
        .into_iter()
        .map(|position_m| ObservedPoint {
            position_m,
            normal: [0.0, 0.0, -1.0],
            camera: 0,
            pixels: 4.0,
        })
        .collect();
    let cameras = [camera()];
    let mut see = |inward_px: f32| {
        let edgels = contour(inward_px);
        let observed = Observation {
            cloud: &cloud,
            edgels: &edgels,
            cameras: &cameras,
            ..Observation::default()
        };
        let (mut targets, mut confidence) = (predicted.clone(), vec![0.0; predicted.len()]);
        registrar.register(&observed, Some(&predicted), &mut targets, &mut confidence).tracking
    };
    assert_eq!([0.0; 4].map(&mut see), [Tracking::Tracking; 4]);
    // A quarter of the contour is 42 mm away from any border; the points still fit.
    assert_eq!(see(50.0), Tracking::Lost);
    assert_eq!(see(0.0), Tracking::Tracking);
}
