//! A layer that nobody sees keeps the prediction as a weak target; the layer before it does not.

mod below;

use below::camera;
use orime_geometry::{ObservedPoint, SheetGrid};
use orime_register::{Observation, RegisterParams, Registrar};

const GAP_M: f32 = 0.004;

/// A sheet folded in two along u = 75 mm; the part of small u is nearer to the camera.
fn folded(sheet: &SheetGrid) -> Vec<[f32; 3]> {
    let at = |[u, v]: [f64; 2]| {
        let gap = if u > 0.075 { GAP_M } else { 0.0 };
        [u.min(0.15 - u) as f32 - 0.04, v as f32 - 0.075, gap]
    };
    sheet.uv_m().map(at).collect()
}

/// Confidence per node where the near layer alone gave points, 0.5 mm behind the prediction.
fn confidence(unseen_confidence: f64) -> (SheetGrid, Vec<f32>) {
    let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
    let params = RegisterParams { unseen_confidence, ..RegisterParams::default() };
    let config = params.check().expect("it is a good value");
    let mut registrar = Registrar::new(&config, &sheet, None);
    registrar.assume_pose();
    let predicted = folded(&sheet);
    let near = predicted.iter().filter(|x| x[2] == 0.0);
    let cloud: Vec<ObservedPoint> = near
        .flat_map(|x| [-1.0, 1.0].map(|side| [x[0] + side * 0.001, x[1], 0.0005]))
        .map(|position_m| ObservedPoint {
            position_m,
            normal: [0.0, 0.0, -1.0],
            camera: 0,
            pixels: 4.0,
        })
        .collect();
    let cameras = [camera()];
    let observed = Observation { cloud: &cloud, cameras: &cameras, ..Observation::default() };
    let (mut targets, mut confidence) = (predicted.clone(), vec![0.0; predicted.len()]);
    registrar.register(&observed, Some(&predicted), &mut targets, &mut confidence);
    (sheet, confidence)
}

#[test]
fn hidden_nodes_have_the_confidence_that_was_asked_for() {
    for asked in [0.0, 0.05, RegisterParams::default().unseen_confidence] {
        let (sheet, confidence) = confidence(asked);
        // Away from the crease and from the border, where a camera sees past the near layer.
        let inner = |[u, v]: &[f64; 2]| {
            (0.03..0.12).contains(v) && !(0.055..0.095).contains(u) && (0.02..0.13).contains(u)
        };
        let mut counts = [0, 0];
        for (uv, own) in sheet.uv_m().zip(confidence).filter(|(uv, _)| inner(uv)) {
            let is_hidden = uv[0] > 0.075;
            counts[usize::from(is_hidden)] += 1;
            let as_wanted = if is_hidden { own == asked as f32 } else { own > 0.5 };
            assert!(as_wanted, "{own} at {uv:?} with {asked}");
        }
        assert!(counts.iter().all(|count| *count > 50), "{counts:?}");
    }
}
