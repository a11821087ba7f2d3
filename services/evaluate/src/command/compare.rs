//! `orime-evaluate compare`: the same set in several settings, side by side, and the paper's table.

use anyhow::Context;
use orime_evaluate::picture::{Plot, Series};
use orime_evaluate::summary::{StepScore, Summary};
use orime_runtime::SetFile;
use serde::Serialize;
use std::path::{Path, PathBuf};

use super::judged::{Run, judged};
use super::variant::Variant;

/// Track one set in several settings and compare them; the paper's three series by default.
#[derive(Debug, clap::Args)]
#[command(after_help = VARIANTS)]
pub struct CompareArguments {
    /// The set file.
    set: PathBuf,
    /// Variants, separated by commas.
    #[arg(long, value_name = "A,B,…", default_value = "aruco,cpd,cpd_clustering,orime")]
    variants: String,
    /// Folder for compare.json, table.md, and the plots e_mm and vertex_error_mm (SVG and PNG).
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Stop after this many steps.
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Print the comparison as JSON.
    #[arg(long)]
    json: bool,
}

const VARIANTS: &str = "\
Variants:
  aruco           features of a printed sheet alone, as the paper's first series
  cpd             Coherent Point Drift without fold lines, as its second
  cpd_clustering  … with fold lines found by its clustering, as its third
  orime           the set as it stands
  NAME:KEY=VALUE;KEY=VALUE
                  any other: keys of the set file that are set differently

A variant that this version cannot run is listed as missing, with the reason.

Example:
  orime-evaluate compare deploy/sets/half_fold.toml --out out/compare \\
      --variants 'cpd,no_contour:register.outline_weight=0'";

/// What became of one variant.
#[derive(Debug, Serialize)]
struct Outcome {
    variant: String,
    /// Why it did not run.
    missing: Option<String>,
    summary: Option<Summary>,
    #[serde(skip)]
    steps: Vec<StepScore>,
}

/// Runs the command.
pub fn run(arguments: &CompareArguments) -> anyhow::Result<()> {
    let variants = Variant::parse_all(&arguments.variants)?;
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("making the folder `{}`", arguments.out.display()))?;
    let text = std::fs::read_to_string(&arguments.set)
        .with_context(|| format!("reading set file `{}`", arguments.set.display()))?;
    let mut outcomes = Vec::new();
    for (k, variant) in variants.iter().enumerate() {
        eprintln!("variant {}/{}: {}", k + 1, variants.len(), variant.name);
        outcomes.push(outcome(arguments, &text, variant)?);
    }
    plots(arguments, &outcomes)?;
    let table = table(&arguments.set, &outcomes);
    std::fs::write(arguments.out.join("table.md"), &table)?;
    let json = serde_json::to_string_pretty(&outcomes)?;
    std::fs::write(arguments.out.join("compare.json"), format!("{json}\n"))?;
    println!("{}", if arguments.json { &json } else { &table });
    Ok(())
}

fn outcome(arguments: &CompareArguments, text: &str, variant: &Variant) -> anyhow::Result<Outcome> {
    let mut outcome =
        Outcome { variant: variant.name.clone(), missing: None, summary: None, steps: Vec::new() };
    if let Some(reason) = variant.missing {
        outcome.missing = Some(reason.to_owned());
        return Ok(outcome);
    }
    let set = SetFile::parse(&arguments.set, variant.apply(text)?)
        .with_context(|| format!("variant `{}`", variant.name))?;
    let run = Run { limit: arguments.steps, clock: None, goes_on: &mut |_, _| true };
    let judge = judged(&set, run).with_context(|| format!("variant `{}`", variant.name))?;
    if let Some(judge) = judge {
        outcome.summary = Some(judge.summary());
        outcome.steps = judge.steps().to_vec();
    }
    Ok(outcome)
}

fn plots(arguments: &CompareArguments, outcomes: &[Outcome]) -> anyhow::Result<()> {
    type Figure = fn(&StepScore) -> Option<f64>;
    let figures: [(&str, &str, Figure); 2] = [
        ("e_mm", "E (Eq. 5) [mm]", |s| s.e_mm),
        ("vertex_error_mm", "true vertex error, mean [mm]", |s| s.vertex_error_mm_mean),
    ];
    for (name, label, figure) in figures {
        let line = |name: &str, steps: &[StepScore], figure: Figure, is_reference| Series {
            name: name.to_owned(),
            points: steps.iter().map(|s| (s.step as f64, figure(s))).collect(),
            is_reference,
        };
        let mut series: Vec<Series> = outcomes
            .iter()
            .filter(|outcome| !outcome.steps.is_empty())
            .map(|outcome| line(&outcome.variant, &outcome.steps, figure, false))
            .collect();
        if let Some(first) = outcomes.iter().find(|o| name == "e_mm" && !o.steps.is_empty()) {
            let at_truth = format!("E at the truth ({})", first.variant);
            series.push(line(&at_truth, &first.steps, |s| s.e_at_truth_mm, true));
        }
        let plot = Plot {
            title: format!("{}: {label}", arguments.set.display()),
            x_label: "step".to_owned(),
            y_label: label.to_owned(),
            series,
        };
        plot.save(&arguments.out.join(name))
            .with_context(|| format!("writing the plot {name} to `{}`", arguments.out.display()))?;
    }
    Ok(())
}

/// Series, mean E in millimetres and seconds per step in the paper, on its own scene.
const PAPER: [(&str, f64, f64); 3] =
    [("aruco", 3.86, 0.22), ("cpd", 5.26, 0.24), ("cpd_clustering", 5.05, 0.24)];

fn table(set: &Path, outcomes: &[Outcome]) -> String {
    let number =
        |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.2}"));
    let mut lines = vec![
        format!("`{}`; lengths in mm, means over all steps.\n", set.display()),
        "| variant | E | E at truth | vertex error (p95, max) | strain % | wrinkles ° | \
         passes through itself | lost | s/step | paper: E | paper: s/step |"
            .to_owned(),
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |".to_owned(),
    ];
    for outcome in outcomes {
        let paper = PAPER.iter().find(|(name, ..)| *name == outcome.variant);
        let paper = paper.map_or_else(
            || "– | –".to_owned(),
            |(_, e_mm, seconds)| format!("{e_mm:.2} | {seconds:.2}"),
        );
        let ours = match (&outcome.summary, &outcome.missing) {
            (Some(s), _) => format!(
                "{} | {} | {} ({}, {}) | {} | {} | {} | {} of {} | {}",
                number(s.e_mm_mean),
                number(s.e_at_truth_mm_mean),
                number(s.vertex_error_mm_mean),
                number(s.vertex_error_mm_p95),
                number(s.vertex_error_mm_max),
                number(s.strain_percent_mean),
                number(s.wrinkle_deg_mean),
                s.self_intersecting_steps,
                s.lost_steps,
                s.steps,
                s.ms_per_step_p50.map_or("–".to_owned(), |ms| format!("{:.3}", ms / 1e3)),
            ),
            (None, reason) => {
                let reason = reason.as_deref().unwrap_or("did not run");
                format!("*missing: {reason}* | | | | | | | ")
            }
        };
        lines.push(format!("| {} | {ours} | {paper} |", outcome.variant));
    }
    lines.push(
        "\nThe paper's figures are of its own scene: real paper, five real cameras, an i9-14900KF \
         with an RTX 4090; its E has no truth beside it. Ours are rendered, on this machine's CPU: \
         the two E columns show the same quantity on different data, not a race."
            .to_owned(),
    );
    lines.join("\n")
}
