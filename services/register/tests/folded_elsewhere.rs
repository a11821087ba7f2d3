//! A folded sheet that lies elsewhere when it is seen again is found there, as it was folded.

use nalgebra::{Isometry3, Point3, Vector3};
use orime_creases::{Folds, Line};
use orime_geometry::{ObservedPoint, SheetGrid, nalgebra};
use orime_register::{Observation, RegisterParams, RegisterReport, Registrar, Tracking};

/// The sheet folded by 110° along u = 90 mm.
fn folded(sheet: &SheetGrid) -> Vec<[f32; 3]> {
    let (sin, cos) = 110f64.to_radians().sin_cos();
    let at = |[u, v]: [f64; 2]| {
        let over = (u - 0.09).max(0.0);
        [u.min(0.09) + over * cos, v, over * sin].map(|c| c as f32)
    };
    sheet.uv_m().map(at).collect()
}

fn moved(x: &[[f32; 3]], motion: &Isometry3<f64>) -> Vec<[f32; 3]> {
    x.iter().map(|p| (motion * Point3::from(*p).cast::<f64>()).cast::<f32>().into()).collect()
}

fn folds(sheet: &SheetGrid) -> Folds {
    let mut folds = Folds::flat(sheet);
    folds.split(0, &Line::through([0.09, 0.0], [0.09, 0.15])).unwrap();
    folds.observe(&folded(sheet));
    folds
}

/// Follows the sheet for a step and shows it elsewhere in the next one: what is made of that.
fn found(motion: &Isometry3<f64>, known: &Folds, then: &Folds) -> (RegisterReport, f64) {
    let sheet = known.sheet().clone();
    let config = RegisterParams::default().check().unwrap();
    let mut registrar = Registrar::new(&config, &sheet, None);
    registrar.assume_pose();
    let before = folded(&sheet);
    let dense = SheetGrid::new(sheet.size_m, [49, 49]);
    let mut see = |motion: &Isometry3<f64>, folds: &Folds| {
        let seen = moved(&folded(&dense), motion);
        let points = seen.into_iter().zip(dense.uv_m()).map(|(position_m, [u, _])| {
            let normal = if u < 0.09 { Vector3::z() } else { Vector3::new(-0.94, 0.0, -0.34) };
            let normal = (motion.rotation * normal).cast::<f32>().into();
            ObservedPoint { position_m, normal, camera: 0, pixels: 4.0 }
        });
        let cloud: Vec<ObservedPoint> = points.collect();
        let observed = Observation { cloud: &cloud, folds: Some(folds), ..Default::default() };
        let (mut targets, mut confidence) = (before.clone(), vec![0.0; before.len()]);
        let report = registrar.register(&observed, Some(&before), &mut targets, &mut confidence);
        (report, targets)
    };
    let (report, _) = see(&Isometry3::identity(), known);
    assert_eq!((report.tracking, report.reset), (Tracking::Tracking, false));
    let (report, targets) = see(motion, then);
    let truth = moved(&before, motion);
    let apart_m = |(a, b): (&[f32; 3], &[f32; 3])| {
        (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
    };
    let worst_m = targets.iter().zip(&truth).map(apart_m).fold(0.0, f64::max);
    (report, worst_m)
}

#[test]
fn as_it_was_folded() {
    let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
    let folds = folds(&sheet);
    for (way, turn) in
        [([0.08, 0.05, 0.0], 0.3), ([-0.1, 0.02, 0.03], 0.7), ([0.0, 0.2, 0.1], -0.6)]
    {
        let motion = Isometry3::new(way.into(), Vector3::new(0.1, -0.05, turn));
        let (report, worst_m) = found(&motion, &folds, &folds);
        assert!(report.reset && report.moved, "{way:?}: {report:?}");
        assert!(worst_m < 2e-3, "{way:?}: {worst_m} m");
    }
}

#[test]
fn not_where_its_folds_are_forgotten() {
    let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
    let motion = Isometry3::translation(0.08, 0.05, 0.0);
    let (report, _) = found(&motion, &folds(&sheet), &Folds::flat(&sheet));
    assert!(!report.moved, "{report:?}");
}
