//! `orime-evaluate register`: one registration of a sheet to a cloud, from files.

use anyhow::Context;
use orime_geometry::{ObservedPoint, SheetGrid};
use orime_register::{
    Observation, RegisterParams, RegisterReport, Registrar, Termination, Tracking,
};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::points::read_rows;

/// Register a sheet to a cloud, once, from files.
#[derive(Debug, clap::Args)]
#[command(after_help = HELP)]
pub struct RegisterArguments {
    /// Material coordinates of the sheet's nodes: a full grid, row by row, v fastest.
    #[arg(long, value_name = "FILE")]
    uv: PathBuf,
    /// Where the nodes are expected: x, y, z per line, in the same order.
    #[arg(long, value_name = "FILE")]
    seed: PathBuf,
    /// Observed points: x, y, z per line.
    #[arg(long, value_name = "FILE")]
    cloud: PathBuf,
    /// Where to write the registered nodes, in the order of the seed.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// How to register.
    #[arg(long, value_enum, default_value_t = Mode::Track)]
    mode: Mode,
    /// A set file whose [register] section is used instead of the defaults.
    #[arg(long, value_name = "SET")]
    set: Option<PathBuf>,
    /// Register so many times from the same start, for the median time.
    #[arg(long, value_name = "N", default_value_t = 1)]
    repeat: usize,
    /// Print the result as one JSON line.
    #[arg(long)]
    json: bool,
}

const HELP: &str = "\
All files are CSV in metres, without a header.

Example:
  orime-evaluate register --uv uv.csv --seed seed.csv --cloud cloud.csv --out nodes.csv \\
      --repeat 20 --json";

/// Ways to register.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Mode {
    /// As in a running set.
    Track,
    /// As in a running set with less work: fewer points, iterations and components.
    Fast,
}

impl Mode {
    fn apply(self, params: &mut RegisterParams) {
        if self == Mode::Fast {
            params.points_max = 700;
            params.iterations_max = 4;
            params.virtual_spacing = 0.045;
            params.isometry_sweeps = 5;
        }
    }
}

/// Runs the command.
pub fn run(arguments: &RegisterArguments) -> anyhow::Result<()> {
    let mut params = match &arguments.set {
        Some(path) => orime_runtime::SetFile::load(path)?.section("register")?,
        None => RegisterParams::default(),
    };
    arguments.mode.apply(&mut params);
    let config = params.check().map_err(|problems| {
        let list: Vec<String> = problems.iter().map(ToString::to_string).collect();
        anyhow::anyhow!("[register]: {}", list.join("; "))
    })?;
    let sheet = sheet(&arguments.uv)?;
    let seed: Vec<[f32; 3]> = read(&arguments.seed)?;
    anyhow::ensure!(
        seed.len() == sheet.len(),
        "`{}` has {} rows and `{}` has {}: one seed row per node is needed",
        arguments.seed.display(),
        seed.len(),
        arguments.uv.display(),
        sheet.len()
    );
    let cloud: Vec<ObservedPoint> = read(&arguments.cloud)?
        .into_iter()
        .map(|position_m| ObservedPoint { position_m, normal: [0.0; 3], camera: 0, pixels: 1.0 })
        .collect();
    let observed = Observation { cloud: &cloud, ..Observation::default() };

    let mut nodes = seed.clone();
    let mut confidence = vec![0.0; sheet.len()];
    let mut report = RegisterReport::default();
    let mut ms: Vec<f64> = Vec::new();
    let fresh = Registrar::new(&config, &sheet, None);
    for _ in 0..arguments.repeat.max(1) {
        let mut registrar = fresh.clone();
        registrar.assume_pose();
        nodes.clone_from(&seed);
        let start = Instant::now();
        report = registrar.register(&observed, Some(&seed), &mut nodes, &mut confidence);
        ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    // Nothing to register to leaves the seed.
    if report.iterations == 0 && !report.reset {
        nodes.clone_from(&seed);
    }
    write(&arguments.out, &nodes)?;
    ms.sort_by(f64::total_cmp);
    print(arguments, &report, ms[ms.len() / 2], strain_percent(&sheet, &nodes));
    Ok(())
}

fn print(arguments: &RegisterArguments, report: &RegisterReport, ms_p50: f64, strain: f64) {
    let termination = match (report.tracking, report.termination) {
        (Tracking::Lost, _) => "lost",
        (_, Termination::NothingObserved) => "nothing_observed",
        (_, Termination::Converged) => "converged",
        (_, Termination::IterationLimit) => "iteration_limit",
        (_, Termination::Deadline) => "deadline",
    };
    if arguments.json {
        let line = serde_json::json!({
            "ms_p50": ms_p50,
            "iterations": report.iterations,
            "termination": termination,
            "strain_percent": strain,
            "sigma_m": report.sigma_m,
            "inlier_ratio": report.inlier_ratio,
            "points_rejected": report.points_rejected,
        });
        println!("{line}");
    } else {
        println!(
            "{ms_p50:.2} ms (median of {}), {} iterations, {termination}, strain {strain:.2} %, \
             sigma {:.2} mm, {:.1} % of the points explained",
            arguments.repeat.max(1),
            report.iterations,
            1e3 * report.sigma_m,
            100.0 * report.inlier_ratio
        );
    }
}

/// The grid whose material coordinates the file lists.
fn sheet(path: &Path) -> anyhow::Result<SheetGrid> {
    let uv: Vec<[f64; 2]> = read_rows(path)?;
    let columns = uv.iter().take_while(|p| (p[0] - uv[0][0]).abs() < 1e-9).count();
    let rows = uv.len() / columns.max(1);
    anyhow::ensure!(
        columns >= 2 && rows >= 2 && rows * columns == uv.len(),
        "`{}` is no grid: {} rows, the first {columns} with the same u",
        path.display(),
        uv.len()
    );
    let last = uv[uv.len() - 1];
    let sheet = SheetGrid::new([last[0] - uv[0][0], last[1] - uv[0][1]], [rows, columns]);
    let off = |(row, (found, expected)): (usize, (&[f64; 2], [f64; 2]))| {
        let d = [found[0] - uv[0][0] - expected[0], found[1] - uv[0][1] - expected[1]];
        (d[0].hypot(d[1]) > 1e-5).then_some(row)
    };
    if let Some(row) = uv.iter().zip(sheet.uv_m()).enumerate().find_map(off) {
        anyhow::bail!(
            "`{}`, line {}: the nodes must be evenly spaced, v fastest",
            path.display(),
            row + 1
        );
    }
    Ok(sheet)
}

fn read(path: &Path) -> anyhow::Result<Vec<[f32; 3]>> {
    Ok(read_rows::<3>(path)?.into_iter().map(|row| row.map(|c| c as f32)).collect())
}

fn write(path: &Path, nodes: &[[f32; 3]]) -> anyhow::Result<()> {
    let mut text = String::new();
    for [x, y, z] in nodes {
        writeln!(text, "{x},{y},{z}")?;
    }
    std::fs::write(path, text).with_context(|| format!("writing `{}`", path.display()))
}

/// Mean relative change of the length of the links between neighbours, percent.
fn strain_percent(sheet: &SheetGrid, nodes: &[[f32; 3]]) -> f64 {
    let edges = sheet.edges();
    let strain = |([a, b], rest_m): &([u32; 2], f64)| {
        let (a, b) = (nodes[*a as usize], nodes[*b as usize]);
        let squared: f64 = (0..3).map(|k| f64::from(b[k] - a[k]).powi(2)).sum();
        (squared.sqrt() / rest_m - 1.0).abs()
    };
    100.0 * edges.iter().map(strain).sum::<f64>() / edges.len() as f64
}
