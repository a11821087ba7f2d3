//! `orime-evaluate creases`: both crease finders on exact folds with noise, side by side.

use anyhow::Context;
use orime_creases::trial::{SceneKind, Summary};
use orime_creases::{CreaseMode, CreaseParams};
use orime_geometry::SheetGrid;
use serde_json::json;
use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

/// Find creases in exact folds with noise, by both methods, against their goals.
///
/// Half of the noise's variance is white, half smooth in space and time. Prints, per scene and
/// noise: the fold angle at which each group of creases was found (median, nine of ten, worst
/// run), the facets at the end, the labels that change in a step, the error of the final lines,
/// and the time of a step. Goals are those of a 25 × 25 sheet.
#[derive(Debug, clap::Args)]
pub struct CreasesArguments {
    /// Runs of each scene; waves and random folds are another one in each run.
    #[arg(long, default_value_t = 5)]
    seeds: u64,
    /// First seed; fresh ones by default, which the output names.
    #[arg(long)]
    first_seed: Option<u64>,
    /// Noise per coordinate for a sheet of 0.15 m, millimetres; scales with the sheet.
    #[arg(long, value_delimiter = ',', default_value = "0,2,4")]
    sigma_mm: Vec<f64>,
    /// Side of the sheet, metres.
    #[arg(long, default_value_t = 0.15)]
    side_m: f64,
    /// Nodes along each side.
    #[arg(long, default_value_t = 25)]
    nodes: usize,
    /// Only scenes whose name contains this.
    #[arg(long)]
    scene: Option<String>,
    /// Parameters: a TOML file with the keys of the creases' section; `mode` is ignored.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Where to write all figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

type Kind = fn(u64) -> SceneKind;

/// Scenes by name; seeds choose those that are random.
const SCENES: [(&str, Kind); 12] = [
    ("half fold, diagonal", |_| SceneKind::Diagonal),
    ("half fold, book", |_| SceneKind::Book),
    ("half fold, oblique", |_| SceneKind::Oblique),
    ("fold, random line", SceneKind::Random),
    ("second half fold", |_| SceneKind::SecondHalf),
    ("squash", |_| SceneKind::Squash),
    ("square base", |_| SceneKind::SquareBase),
    ("accordion, 6 panels", |_| SceneKind::Accordion),
    ("blintz, four at once", |_| SceneKind::Blintz),
    ("blintz, in turn", |_| SceneKind::BlintzInTurn),
    ("wave, R >= 3h", SceneKind::Wave),
    ("soft fold", |_| SceneKind::SoftFold),
];

/// Runs the command.
pub fn run(arguments: &CreasesArguments) -> anyhow::Result<()> {
    anyhow::ensure!(arguments.seeds >= 1, "--seeds {}: at least 1", arguments.seeds);
    anyhow::ensure!(
        arguments.sigma_mm.iter().all(|s| (0.0..=50.0).contains(s)),
        "--sigma-mm {:?}: each must be 0 to 50 mm",
        arguments.sigma_mm
    );
    anyhow::ensure!(
        (0.01..=5.0).contains(&arguments.side_m) && (9..=64).contains(&arguments.nodes),
        "--side-m must be 0.01 to 5, --nodes 9 to 64"
    );
    let sheet = SheetGrid::new([arguments.side_m; 2], [arguments.nodes; 2]);
    let first_seed = arguments.first_seed.unwrap_or_else(fresh_seed);
    println!("seeds from {first_seed}; angles: median/nine of ten/worst run, degrees");
    let params = read_params(arguments)?;
    let (mut rows, mut misses) = (Vec::new(), Vec::new());
    for (name, kind) in SCENES {
        if arguments.scene.as_ref().is_some_and(|part| !name.contains(part.as_str())) {
            continue;
        }
        for sigma_mm in &arguments.sigma_mm {
            for (mode, label) in [(CreaseMode::Paper, "paper"), (CreaseMode::Lines, "lines")] {
                let config = CreaseParams { mode, ..params.clone() }.check().map_err(|p| {
                    let all: Vec<String> = p.iter().map(ToString::to_string).collect();
                    anyhow::anyhow!("--params: {}", all.join("; "))
                })?;
                let sigma_m = sigma_mm * 1e-3 * arguments.side_m / 0.15;
                let seeds = first_seed..first_seed + arguments.seeds;
                let summary = Summary::run(kind, &config, &sheet, sigma_m, seeds)?;
                println!("{}", row(name, *sigma_mm, label, &summary));
                rows.push(figures(name, *sigma_mm, label, &summary));
                if mode == CreaseMode::Lines {
                    let missed = summary.misses().into_iter();
                    misses.extend(missed.map(|m| format!("{name}, {sigma_mm} mm: {m}")));
                }
            }
        }
    }
    println!("\ngoals of the lines: {}", if misses.is_empty() { "all reached" } else { "missed" });
    misses.iter().for_each(|miss| println!("  {miss}"));
    if let Some(path) = &arguments.json {
        let all = json!({ "first_seed": first_seed, "rows": rows, "misses": misses });
        std::fs::write(path, format!("{all:#}\n"))
            .with_context(|| format!("writing `{}`", path.display()))?;
    }
    Ok(())
}

fn read_params(arguments: &CreasesArguments) -> anyhow::Result<CreaseParams> {
    let Some(path) = &arguments.params else { return Ok(CreaseParams::default()) };
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("reading parameters from `{}`", path.display()))?;
    toml::from_str(&text).with_context(|| format!("`{}`", path.display()))
}

/// Another seed every second.
fn fresh_seed() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |t| t.as_secs() % 1_000_000_000)
}

/// One line of the table.
fn row(name: &str, sigma_mm: f64, mode: &str, summary: &Summary) -> String {
    let angle = |deg: f64| if deg.is_finite() { format!("{deg:.0}") } else { "never".into() };
    let group = |g| summary.found_deg(g).map(angle).join("/");
    let angles: Vec<String> = (0..summary.groups()).map(group).collect();
    let mut ends: Vec<usize> = summary.scores.iter().map(|s| s.facets[0]).collect();
    ends.sort_unstable();
    ends.dedup();
    let ends: Vec<String> = ends.iter().map(ToString::to_string).collect();
    let line = if summary.groups() == 0 {
        "-".to_owned()
    } else {
        let [deg, m] = [summary.mean(|s| s.line_deg), summary.mean(|s| s.line_m)];
        format!("{deg:.2} deg {:.2} mm", 1e3 * m)
    };
    format!(
        "{name:22} {sigma_mm:>3} mm {mode:5} | {:52} | facets {} of {} ({} wrong) | {line:16} | \
         flips {:6.3} % | {:.2} ms",
        angles.join("  "),
        ends.join(","),
        summary.facets,
        summary.wrong_facets(),
        100.0 * summary.mean(|s| s.flips),
        summary.mean(|s| s.step_ms[0]),
    )
}

/// The same as JSON, with every run.
fn figures(name: &str, sigma_mm: f64, mode: &str, summary: &Summary) -> serde_json::Value {
    let runs: Vec<serde_json::Value> = summary
        .scores
        .iter()
        .map(|score| {
            json!({
                "found_deg": score.found_deg,
                "facets_end": score.facets[0],
                "facets_most": score.facets[1],
                "flips": score.flips,
                "line_deg": score.line_deg,
                "line_mm": 1e3 * score.line_m,
                "step_ms_mean": score.step_ms[0],
                "step_ms_most": score.step_ms[1],
                "changes": score.changes,
            })
        })
        .collect();
    json!({
        "scene": name,
        "sigma_mm": sigma_mm,
        "mode": mode,
        "facets": summary.facets,
        "misses": summary.misses(),
        "runs": runs,
    })
}
