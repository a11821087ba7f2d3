//! `orime-evaluate cpd`: textbook Coherent Point Drift on two point files.

use super::points::read_table;
use anyhow::Context;
use orime_geometry::nalgebra::Point3;
use orime_register::textbook::{TextbookParams, register};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Register two point files by textbook Coherent Point Drift.
#[derive(Debug, clap::Args)]
pub struct CpdArguments {
    /// Model points, one per line: x y [z], separated by commas or blanks.
    #[arg(long, value_name = "FILE")]
    source: PathBuf,
    /// Observed points, in the same form.
    #[arg(long, value_name = "FILE")]
    target: PathBuf,
    /// Where to write the moved model points.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Width of the Gaussian kernel, in the data's unit.
    #[arg(long, default_value_t = 2.0)]
    beta: f64,
    /// Trade-off between fit and coherence (pycpd's alpha).
    #[arg(long, default_value_t = 2.0)]
    lambda: f64,
    /// Weight of the outlier distribution, 0 to below 1.
    #[arg(long, default_value_t = 0.0)]
    outlier_weight: f64,
    /// Most iterations.
    #[arg(long, default_value_t = 100)]
    iterations: u32,
    /// Stop once the variance changes by no more than this.
    #[arg(long, default_value_t = 0.001)]
    tolerance: f64,
    /// Print the result as one JSON line.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &CpdArguments) -> anyhow::Result<()> {
    anyhow::ensure!(
        (0.0..1.0).contains(&arguments.outlier_weight),
        "--outlier-weight {}: must be 0 to below 1",
        arguments.outlier_weight
    );
    anyhow::ensure!(
        arguments.beta > 0.0 && arguments.lambda > 0.0,
        "--beta and --lambda: must be positive"
    );
    let (model, observed) = (read_points(&arguments.source)?, read_points(&arguments.target)?);
    let params = TextbookParams {
        beta: arguments.beta,
        lambda: arguments.lambda,
        outlier_weight: arguments.outlier_weight,
        variance: None,
        iterations_max: arguments.iterations,
        tolerance: arguments.tolerance,
    };
    let start = Instant::now();
    let result = register(&observed, &model, &params)?;
    let ms = start.elapsed().as_secs_f64() * 1e3;
    if let Some(path) = &arguments.out {
        let mut text = String::new();
        for p in &result.moved {
            writeln!(text, "{},{},{}", p.x, p.y, p.z)?;
        }
        std::fs::write(path, text).with_context(|| format!("writing `{}`", path.display()))?;
    }
    if arguments.json {
        let line = serde_json::json!({
            "ms": ms,
            "iterations": result.iterations,
            "converged": result.converged,
            "variance": result.variance,
        });
        println!("{line}");
    } else {
        println!(
            "{} iterations, {}, variance {:.6e}, {ms:.1} ms",
            result.iterations,
            if result.converged { "converged" } else { "not converged" },
            result.variance
        );
    }
    Ok(())
}

/// Reads points; two columns get z = 0.
fn read_points(path: &Path) -> anyhow::Result<Vec<Point3<f64>>> {
    let point = |row: Vec<f64>| Point3::new(row[0], row[1], row.get(2).copied().unwrap_or(0.0));
    Ok(read_table(path, 2..=3)?.into_iter().map(point).collect())
}
