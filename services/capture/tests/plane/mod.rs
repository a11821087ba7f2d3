//! How noisy a plane's depth is: strength and correlation, for rendered and real frames alike.

use std::path::{Path, PathBuf};

use orime_capture::{CaptureParams, FaultPreset, RenderedParams, SourceKind, ViewParams, open};
use orime_geometry::{RgbdFrameMut, SheetGrid};

/// Longest lag of the correlation, pixels.
const LAG_MAX: usize = 16;

/// A rectangle of depth of one surface.
pub struct Patch {
    /// Mean depth, metres.
    mean_m: f64,
    /// What a quadratic leaves, metres.
    residual_m: Vec<f64>,
    width: usize,
}

/// Mean depth of all patches, metres.
pub fn distance_m(patches: &[Patch]) -> f64 {
    patches.iter().map(|patch| patch.mean_m).sum::<f64>() / patches.len() as f64
}

/// What a plane shows.
pub struct Figures {
    /// Standard deviation after a quadratic is taken away, metres.
    pub sigma_m: f64,
    /// Correlation along rows at 0 to [`LAG_MAX`] pixels.
    pub correlation: [f64; LAG_MAX + 1],
    /// Where the correlation falls to 1/e, pixels.
    pub length_px: f64,
}

/// Patches of `frames` frames of a table that a D415 with all real faults sees at `z_m`.
pub fn rendered(z_m: f64, frames: u64) -> Vec<Patch> {
    let view = ViewParams {
        name: "above".into(),
        model: orime_capture::Model::D415,
        eye_m: [0.0, 0.0, z_m],
        look_at_m: [0.0, 0.0, 0.0],
    };
    let rendered = RenderedParams {
        views: vec![view],
        faults: FaultPreset::Real,
        // Out of the way, and no holes in the patches.
        sheet_center_m: [0.6, 0.6],
        fault: orime_capture::FaultParams {
            hole_rate: Some(0.0),
            ..orime_capture::FaultParams::default()
        },
        ..RenderedParams::default()
    };
    let params = CaptureParams { rendered, ..CaptureParams::default() };
    let sheet = SheetGrid::new([0.15, 0.15], [5, 5]);
    let mut source = open(&params.check().unwrap(), &sheet).unwrap();
    let about = source.cameras()[0].clone();
    let width = about.depth.width as usize;
    let mut patches = Vec::new();
    for step in 0..frames {
        let mut rgb = vec![0; 3 * about.color.pixels()];
        let mut units = vec![0; about.depth.pixels()];
        let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut units };
        source.read(step, 0, frame).unwrap();
        for at in [[60, 60], [400, 60], [60, 330], [400, 330], [240, 200]] {
            let patch = patch(&units, width, at, [120, 90], about.depth_m_per_unit);
            patches.push(patch.expect("the table has no holes"));
        }
    }
    patches
}

/// Flat patches of `paper_desk` under `$ORIME_DATA` (or `../shared/data`), which a real Xtion saw,
/// or `None` after saying that it is not there.
pub fn real() -> Option<Vec<Patch>> {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let data = std::env::var_os("ORIME_DATA")
        .map_or_else(|| repository.join("../shared/data"), PathBuf::from);
    if !data.join("paper_desk").is_dir() {
        eprintln!("paper_desk: SKIPPED, not found under {}", data.display());
        return None;
    }
    let mut params = CaptureParams { source: SourceKind::Folder, ..CaptureParams::default() };
    let layout = repository.join("tests/sets/layouts/paper_desk.toml");
    params.folder.layout = layout.to_string_lossy().into_owned();
    params.folder.data_dir = Some(data.to_string_lossy().into_owned());
    let sheet = SheetGrid::new([0.21, 0.297], [5, 5]);
    let mut source = open(&params.check().unwrap(), &sheet).unwrap();
    let about = source.cameras()[0].clone();
    let size_px = [about.depth.width as usize, about.depth.height as usize];
    let mut patches = Vec::new();
    for step in 0..source.steps().unwrap() {
        let mut rgb = vec![0; 3 * about.color.pixels()];
        let mut units = vec![0; about.depth.pixels()];
        let frame = RgbdFrameMut { color_rgb: &mut rgb, depth_units: &mut units };
        source.read(step, 0, frame).unwrap();
        patches.extend(flat(&units, size_px, about.depth_m_per_unit));
    }
    Some(patches)
}

/// Patches of an image that are whole and as good as flat: the others show edges or bent things.
fn flat(units: &[u16], [width, height]: [usize; 2], m_per_unit: f64) -> Vec<Patch> {
    let size = [60, 48];
    let corners = (0..=height - size[1]).step_by(size[1]);
    let corners = corners.flat_map(|y| (0..=width - size[0]).step_by(size[0]).map(move |x| [x, y]));
    let patches = corners.filter_map(|at| patch(units, width, at, size, m_per_unit));
    patches.filter(|patch| patch.residual_m.iter().all(|r| r.abs() < 0.004)).collect()
}

/// The patch with its first pixel at `at`; `None` where it has holes.
fn patch(
    units: &[u16],
    width: usize,
    at: [usize; 2],
    size: [usize; 2],
    m_per_unit: f64,
) -> Option<Patch> {
    let mut depths_m = Vec::with_capacity(size[0] * size[1]);
    for y in at[1]..at[1] + size[1] {
        let row = &units[y * width + at[0]..y * width + at[0] + size[0]];
        if row.contains(&0) {
            return None;
        }
        depths_m.extend(row.iter().map(|raw| f64::from(*raw) * m_per_unit));
    }
    let mean_m = depths_m.iter().sum::<f64>() / depths_m.len() as f64;
    let residual_m = without_quadratic(&depths_m, size);
    Some(Patch { mean_m, residual_m, width: size[0] })
}

/// Takes away the best a + bx + cy + dx² + exy + fy² (by Gram and Schmidt on the grid).
fn without_quadratic(values: &[f64], [width, height]: [usize; 2]) -> Vec<f64> {
    let at = |k: usize| {
        let x = 2.0 * (k % width) as f64 / (width - 1) as f64 - 1.0;
        let y = 2.0 * (k / width) as f64 / (height - 1) as f64 - 1.0;
        [1.0, x, y, x * x, x * y, y * y]
    };
    let mut left = values.to_vec();
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    for term in 0..6 {
        let mut column: Vec<f64> = (0..values.len()).map(|k| at(k)[term]).collect();
        for other in &basis {
            let share = dot(&column, other);
            column.iter_mut().zip(other).for_each(|(c, o)| *c -= share * o);
        }
        let norm = dot(&column, &column).sqrt();
        column.iter_mut().for_each(|c| *c /= norm);
        let share = dot(&left, &column);
        left.iter_mut().zip(&column).for_each(|(l, c)| *l -= share * c);
        basis.push(column);
    }
    left
}

/// Strength and correlation over all patches.
pub fn measure(patches: &[Patch]) -> Figures {
    let mut products = [0.0; LAG_MAX + 1];
    let mut counts = [0.0; LAG_MAX + 1];
    for patch in patches {
        for row in patch.residual_m.chunks_exact(patch.width) {
            for lag in 0..=LAG_MAX {
                let pairs = row.iter().zip(&row[lag..]);
                products[lag] += pairs.map(|(a, b)| a * b).sum::<f64>();
                counts[lag] += (row.len() - lag) as f64;
            }
        }
    }
    let variance = products[0] / counts[0];
    let correlation: [f64; LAG_MAX + 1] =
        std::array::from_fn(|lag| products[lag] / counts[lag] / variance);
    let threshold = (-1.0f64).exp();
    let after = correlation.iter().position(|c| *c < threshold);
    let length_px = after.map_or(f64::INFINITY, |k| {
        let (before, after) = (correlation[k - 1], correlation[k]);
        (k - 1) as f64 + (before - threshold) / (before - after)
    });
    Figures { sigma_m: variance.sqrt(), correlation, length_px }
}
