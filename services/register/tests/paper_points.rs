//! Real bent paper: material points of one frame are found in a later one, whose rows are shuffled.
//!
//! 301 points, 8 frames between, 29 mm of motion on average. Public CPD with its defaults
//! (β = 2 mm: every point for itself) gets to 6.1 mm; a kernel as wide as paper is stiff does it.

use nalgebra::Point3;
use orime_register::textbook::{TextbookParams, register};
use std::path::PathBuf;

/// Frames, each the same points in the same order, metres.
fn frames() -> Option<Vec<Vec<Point3<f64>>>> {
    let data = std::env::var_os("ORIME_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let Ok(folder) = std::fs::read_dir(data.join("paper_points")) else {
        eprintln!("SKIPPED: no `paper_points` under `{}`; set ORIME_DATA", data.display());
        return None;
    };
    let mut paths: Vec<PathBuf> = folder.map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "csv"));
    paths.sort();
    let point = |line: &str| {
        let mut numbers = line.split(',').map(|mm| mm.parse::<f64>().unwrap() / 1e3);
        Point3::from([(); 3].map(|()| numbers.next().unwrap()))
    };
    let frame = |path: &PathBuf| {
        std::fs::read_to_string(path).unwrap().lines().skip(1).map(point).collect()
    };
    Some(paths.iter().map(frame).collect())
}

#[test]
fn bent_paper_is_followed_over_eight_frames() {
    let Some(frames) = frames() else { return };
    assert_eq!(frames.len(), 23);
    let params = TextbookParams {
        beta: 0.1,
        lambda: 20.0,
        outlier_weight: 0.05,
        tolerance: 1e-10,
        ..TextbookParams::default()
    };
    let (mut errors_mm, mut matched, mut moved_mm) = (Vec::new(), 0, Vec::new());
    for pair in frames.windows(2) {
        let n = pair[0].len();
        // A step that shares no factor with 301 = 7 · 43 visits every row.
        let shuffled: Vec<Point3<f64>> = (0..n).map(|k| pair[1][(k * 130 + 17) % n]).collect();
        let found = register(&shuffled, &pair[0], &params).unwrap().moved;
        for (row, found) in found.iter().enumerate() {
            let error = |other: &Point3<f64>| (found - other).norm();
            errors_mm.push(1e3 * error(&pair[1][row]));
            moved_mm.push(1e3 * (pair[0][row] - pair[1][row]).norm());
            let nearest = (0..n).min_by(|a, b| error(&pair[1][*a]).total_cmp(&error(&pair[1][*b])));
            matched += usize::from(nearest == Some(row));
        }
    }
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
    let share = matched as f64 / errors_mm.len() as f64;
    eprintln!(
        "moved {:.1} mm, error {:.2} mm, {share:.3} matched",
        mean(&moved_mm),
        mean(&errors_mm)
    );
    assert!(mean(&moved_mm) > 25.0, "there is something to follow");
    assert!(mean(&errors_mm) <= 3.0 && share >= 0.9, "{:.2} mm, {share:.3}", mean(&errors_mm));
}
