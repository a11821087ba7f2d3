//! Cases that make Coherent Point Drift fall over.

use super::play::{distance_m, rms_m};
use super::{Outcome, Random, outcome};
use orime_geometry::nalgebra::Point3;
use orime_geometry::{ObservedPoint, SheetGrid, Surface};
use orime_register::textbook::{TextbookParams, register as textbook};
use orime_register::{Observation, RegisterParams, RegisterReport, Registrar};

/// A gently bent sheet and what one camera sees of it.
struct Seen {
    sheet: SheetGrid,
    truth_m: Vec<[f32; 3]>,
    cloud: Vec<ObservedPoint>,
}

fn point(position_m: [f32; 3]) -> ObservedPoint {
    ObservedPoint { position_m, normal: [0.0, 0.0, 1.0], camera: 0, pixels: 4.0 }
}

fn bent(size_m: f64, seed: u64) -> Seen {
    let sheet = SheetGrid::new([size_m; 2], [25, 25]);
    let mut random = Random(seed);
    let at = |[u, v]: [f64; 2]| {
        let z = 0.06 * size_m * (5.0 * u / size_m).sin();
        [u - size_m / 2.0, v - size_m / 2.0, z].map(|c| c as f32)
    };
    let truth_m = sheet.uv_m().map(at).collect();
    let mut any = || 0.5 + 0.5 * random.symmetric();
    let cloud = (0..2000).map(|_| point(at([size_m * any(), size_m * any()]))).collect();
    Seen { sheet, truth_m, cloud }
}

/// Registers a cloud to a prediction that is 2 % of the sheet off; report, targets, confidences.
fn follow(seen: &Seen, cloud: &[ObservedPoint]) -> (RegisterReport, Vec<[f32; 3]>, Vec<f32>) {
    let config = RegisterParams::default().check().expect("the defaults pass");
    let mut registrar = Registrar::new(&config, &seen.sheet, None);
    registrar.assume_pose();
    let shift = 0.02 * seen.sheet.size_m[0] as f32;
    let predicted: Vec<[f32; 3]> =
        seen.truth_m.iter().map(|p| [p[0], p[1], p[2] + shift]).collect();
    let mut targets = predicted.clone();
    let mut confidence = vec![0.0; targets.len()];
    let observed = Observation { cloud, ..Observation::default() };
    let report = registrar.register(&observed, Some(&predicted), &mut targets, &mut confidence);
    (report, targets, confidence)
}

fn are_finite(targets: &[[f32; 3]], confidence: &[f32]) -> bool {
    targets.iter().flatten().chain(confidence).all(|c| c.is_finite())
}

/// Mean distance of the truth to the targets' surface, metres.
fn off_m(seen: &Seen, targets: &[[f32; 3]]) -> f64 {
    let triangles = seen.sheet.triangles();
    let surface = Surface::new(targets, &triangles);
    let sum: f64 = seen.truth_m.iter().map(|p| f64::from(surface.distance_m(*p))).sum();
    sum / seen.truth_m.len() as f64
}

/// Case 23: points that are NaN or infinite.
pub fn not_finite(seed: u64) -> Vec<Outcome> {
    let seen = bent(0.15, seed);
    let mut cloud = seen.cloud.clone();
    for (k, bad) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
        cloud.insert(10 * k, point([bad, 0.0, 0.0]));
        cloud.push(point([0.0, 0.0, bad]));
    }
    let (report, targets, confidence) = follow(&seen, &cloud);
    let (_, clean, _) = follow(&seen, &seen.cloud);
    let off = rms_m(&targets, &clean, |_| true);
    let passed = are_finite(&targets, &confidence) && report.points_rejected == 6 && off < 2e-4;
    let measured = format!("{} rejected, {:.3} mm from without", report.points_rejected, 1e3 * off);
    let criterion = "6 rejected and counted, targets as without them within 0.2 mm";
    vec![outcome(23, "NaN and infinite points", criterion, measured, passed)]
}

/// Case 24: no points at all.
pub fn empty(seed: u64) -> Vec<Outcome> {
    let seen = bent(0.15, seed);
    let (report, targets, confidence) = follow(&seen, &[]);
    let silent = confidence.iter().all(|c| *c == 0.0);
    let passed = are_finite(&targets, &confidence) && silent;
    let measured = format!("{:?}, no target {silent}", report.tracking);
    vec![outcome(24, "empty cloud", "a status, and no targets", measured, passed)]
}

/// Case 25: everything far away.
pub fn far_away(seed: u64) -> Vec<Outcome> {
    let seen = bent(0.15, seed);
    let away = |p: &ObservedPoint| {
        let [x, y, z] = p.position_m;
        point([x + 1.0, y, z])
    };
    let cloud: Vec<ObservedPoint> = seen.cloud.iter().map(away).collect();
    let (report, targets, confidence) = follow(&seen, &cloud);
    let moved = targets
        .iter()
        .zip(&seen.truth_m)
        .zip(&confidence)
        .filter(|(_, c)| **c > 0.0)
        .map(|((a, b), _)| distance_m(*a, *b))
        .fold(0.0, f64::max);
    // A fresh pose on the far cloud is a reset, said as one; pulling half way there is not.
    let between = moved > 0.02 && !report.reset;
    let passed = are_finite(&targets, &confidence) && !between;
    let measured = format!(
        "{:?}, reset {}, targets {:.1} mm away",
        report.tracking,
        report.reset,
        1e3 * moved
    );
    let criterion = "finite; stays, or takes a new pose and says so";
    vec![outcome(25, "cloud 1 m away", criterion, measured, passed)]
}

/// Case 26: model and cloud are the same points.
pub fn model_equals_cloud(seed: u64) -> Vec<Outcome> {
    let seen = bent(0.15, seed);
    let cloud: Vec<ObservedPoint> = seen.truth_m.iter().map(|p| point(*p)).collect();
    let config = RegisterParams::default().check().expect("the defaults pass");
    let mut registrar = Registrar::new(&config, &seen.sheet, None);
    registrar.assume_pose();
    let mut targets = seen.truth_m.clone();
    let mut confidence = vec![0.0; targets.len()];
    for _ in 0..20 {
        let predicted = targets.clone();
        let observed = Observation { cloud: &cloud, ..Observation::default() };
        registrar.register(&observed, Some(&predicted), &mut targets, &mut confidence);
    }
    let off = rms_m(&targets, &seen.truth_m, |_| true);
    let passed = are_finite(&targets, &confidence) && off < 1e-3;
    let measured = format!("{:.3} mm after 20 frames", 1e3 * off);
    vec![outcome(26, "model = cloud", "drifts < 1 mm in 20 frames", measured, passed)]
}

/// Case 27: one point, and all points on one place.
pub fn coincident_points(seed: u64) -> Vec<Outcome> {
    let seen = bent(0.15, seed);
    let each = |(name, count): (&str, usize)| {
        let cloud = vec![point(seen.truth_m[312]); count];
        let (report, targets, confidence) = follow(&seen, &cloud);
        let moved = targets.iter().zip(&seen.truth_m).map(|(a, b)| distance_m(*a, *b));
        let moved = moved.fold(0.0, f64::max);
        let passed = are_finite(&targets, &confidence) && moved < 0.02;
        let measured = format!("{:?}, moved {:.2} mm", report.tracking, 1e3 * moved);
        outcome(27, name, "finite, no node more than 20 mm from its place", measured, passed)
    };
    [("one point", 1), ("2000 points on one place", 2000)].map(each).to_vec()
}

/// Case 28: a cloud without noise for long drives σ² towards 0.
pub fn variance(seed: u64) -> Vec<Outcome> {
    let seen = bent(0.15, seed);
    let points = |x: &[[f32; 3]]| -> Vec<Point3<f64>> {
        x.iter()
            .map(|p| Point3::from(p.map(f64::from)) + Point3::new(0.0, 0.0, 1e3).coords)
            .collect()
    };
    let observed = points(&seen.truth_m);
    let params =
        TextbookParams { iterations_max: 150, tolerance: 0.0, ..TextbookParams::default() };
    let words = match textbook(&observed, &observed, &params) {
        Ok(result) => {
            let finite = result.moved.iter().all(|p| p.coords.iter().all(|c| c.is_finite()));
            (finite && result.variance >= 0.0, format!("variance {:.1e}", result.variance))
        }
        Err(error) => (true, format!("refused: {error}")),
    };
    let (report, targets, confidence) = follow(&seen, &seen.cloud);
    let passed = words.0 && are_finite(&targets, &confidence) && report.sigma_m > 0.0;
    let measured = format!("textbook {}; tracker σ {:.2} mm", words.1, 1e3 * report.sigma_m);
    let criterion = "σ² stays positive and everything finite, 1 km from the origin";
    vec![outcome(28, "σ² by cancellation", criterion, measured, passed)]
}

/// Case 29: nodes on one place, so that the kernel is singular.
pub fn duplicate_nodes(seed: u64) -> Vec<Outcome> {
    let mut seen = bent(0.15, seed);
    let place = seen.truth_m[312];
    for k in [286, 287, 288, 311, 313, 336, 337, 338] {
        seen.truth_m[k] = place;
    }
    let (report, targets, confidence) = follow(&seen, &seen.cloud);
    let passed = are_finite(&targets, &confidence) && off_m(&seen, &targets) < 2e-3;
    let measured = format!("{:?}, {:.2} mm off", report.tracking, 1e3 * off_m(&seen, &targets));
    vec![outcome(29, "nine nodes on one place", "finite, within 2 mm", measured, passed)]
}

/// Case 30: the same sheet a third and three times as large.
pub fn scale(seed: u64) -> Vec<Outcome> {
    let each = |size_m: f64| {
        let seen = bent(size_m, seed);
        let (report, targets, confidence) = follow(&seen, &seen.cloud);
        let off = off_m(&seen, &targets) / size_m;
        let passed = are_finite(&targets, &confidence) && off < 5e-3;
        let measured = format!("{:?}, {:.2} % of the side off", report.tracking, 100.0 * off);
        outcome(30, format!("a sheet of {size_m} m"), "within 0.5 % of its side", measured, passed)
    };
    [0.05, 0.15, 0.45].map(each).to_vec()
}
