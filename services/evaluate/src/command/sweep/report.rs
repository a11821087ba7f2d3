//! What a sweep writes: tables, CSV, JSON and pictures.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::Context;
use orime_evaluate::picture::{Landmark, knob_plots, over_time};
use orime_evaluate::sweep::{Cost, Growth, Row, Setting, costs, growth, settings};
use serde::Serialize;

use super::knobs::{APART, Knob};

/// The paper's three series, on its own scene: E, which is no vertex error, and seconds per step.
const PAPER: Landmark =
    Landmark { name: String::new(), step_ms: [220.0, 240.0], error_mm: Some([3.86, 5.26]) };

/// Everything that a sweep knows.
#[derive(Debug, Serialize)]
pub struct Report<'a> {
    set: String,
    commit: Option<String>,
    clock: &'a str,
    runs_done: usize,
    runs_planned: usize,
    paper_loop_step_ms: Option<f64>,
    settings: Vec<Setting>,
    costs: Vec<Cost>,
    growths: Vec<Growth>,
    rows: &'a [Row],
}

/// What a report is made from.
pub struct Input<'a> {
    /// The set file.
    pub set: &'a Path,
    /// What the times are.
    pub clock: &'a str,
    /// Finished runs.
    pub rows: &'a [Row],
    /// Runs that were asked for.
    pub planned: usize,
    /// Every knob.
    pub knobs: &'a [Knob],
    /// Time of the paper's loop here.
    pub paper_loop_step_ms: Option<f64>,
}

/// Writes `runs.csv`, `settings.csv`, `front.md`, `error_over_time` and `knobs` (SVG and PNG), and
/// gives the table and the report.
pub fn write<'a>(folder: &Path, input: &Input<'a>) -> anyhow::Result<(String, Report<'a>)> {
    let settings = settings(input.rows, &APART);
    let report = Report {
        set: input.set.display().to_string(),
        commit: commit(),
        clock: input.clock,
        runs_done: input.rows.len(),
        runs_planned: input.planned,
        paper_loop_step_ms: input.paper_loop_step_ms,
        costs: costs(&settings),
        growths: input
            .knobs
            .iter()
            .filter_map(|knob| growth(knob.name, &knob.own, &settings))
            .collect(),
        settings,
        rows: input.rows,
    };
    let table = table(&report);
    let file = |name: &str, text: &str| {
        let path = folder.join(name);
        fs::write(&path, text).with_context(|| format!("writing `{}`", path.display()))
    };
    file("runs.csv", &runs_csv(input.rows)?)?;
    file("settings.csv", &settings_csv(&report.settings)?)?;
    file("front.md", &table)?;
    let name = "paper: E 3.9 to 5.3 mm (other scene)".to_owned();
    let mut landmarks = vec![Landmark { name, ..PAPER }];
    landmarks.extend(input.paper_loop_step_ms.map(|ms| Landmark {
        name: format!("paper_loop.py here: {ms:.0} ms"),
        step_ms: [ms, ms],
        error_mm: None,
    }));
    let stem = input.set.file_stem().unwrap_or_default().to_string_lossy();
    let title =
        format!("{stem}: what accuracy costs ({} of {} runs)", input.rows.len(), input.planned);
    let named: Vec<(String, Vec<String>, String)> = input
        .knobs
        .iter()
        .map(|knob| (knob.name.to_owned(), knob.values.clone(), knob.own.clone()))
        .filter(|(_, _, own)| !own.is_empty())
        .collect();
    let title_knobs = format!("{stem}: one knob at a time; large: the set's own");
    for (name, sketch) in [
        ("error_over_time", over_time(&title, &report.settings, &APART, &landmarks)),
        ("knobs", knob_plots(&title_knobs, &named, &report.settings)),
    ] {
        let stem = folder.join(name);
        sketch.save(&stem).with_context(|| format!("drawing `{}`", stem.display()))?;
    }
    Ok((table, report))
}

/// The tree's commit, where there is one.
fn commit() -> Option<String> {
    let mut git = std::process::Command::new("git");
    let output = git.args(["describe", "--always", "--dirty"]).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    (output.status.success() && !text.trim().is_empty()).then(|| text.trim().to_owned())
}

fn table(report: &Report<'_>) -> String {
    let commit = report.commit.as_deref().unwrap_or("unknown");
    let mut lines = vec![
        format!(
            "`{}`, {} of {} runs, commit {commit}, time: {}.\n",
            report.set, report.runs_done, report.runs_planned, report.clock
        ),
        "What each millimetre costs: settings than which no other is both faster and more \
         accurate.\n"
            .to_owned(),
        "| # | setting | ms/step | true vertex error, mm (seeds) | lost % | ms per mm won |"
            .to_owned(),
        "| --- | --- | --- | --- | --- | --- |".to_owned(),
    ];
    for (k, cost) in report.costs.iter().enumerate() {
        let error = cost.vertex_error_mm;
        lines.push(format!(
            "| {} | {} | {:.1} | {:.2} ({:.2} to {:.2}) | {:.0} | {} |",
            k + 1,
            cost.setting,
            cost.step_ms,
            error.mean,
            error.min,
            error.max,
            cost.lost_percent,
            cost.ms_per_mm.map_or("–".to_owned(), |price| format!("{price:.0}"))
        ));
    }
    lines.push(
        "\nAll settings. Times: the least of the seeds' medians, per stage too, for other work on \
         the machine only ever adds; 99th percentile: the largest.\n\n\
         | setting | error (p95) mm | E mm | strain % | crosses itself | lost | ms p50 (p99) | \
         segment, register, simulate |\n| --- | --- | --- | --- | --- | --- | --- | --- |"
            .to_owned(),
    );
    for s in &report.settings {
        lines.push(format!(
            "| {} | {:.2} ({:.2}) | {:.2} | {:.2} | {} | {} of {} | {:.1} ({:.1}) | {:.1}, {:.1}, \
             {:.1} |",
            s.name(),
            s.vertex_error_mm.mean,
            s.vertex_error_mm_p95,
            s.e_mm,
            s.strain_percent,
            s.self_intersecting_steps,
            s.lost_steps,
            s.steps,
            s.step_ms.min,
            s.step_ms_p99,
            s.stage_ms.segment,
            s.stage_ms.register,
            s.stage_ms.simulate,
        ));
    }
    lines.extend(growth_lines(&report.growths));
    lines.join("\n") + "\n"
}

fn growth_lines(growths: &[Growth]) -> Vec<String> {
    if growths.is_empty() {
        return Vec::new();
    }
    let head = "\nHow time grows: `e` of time ~ value^e through all values (between the two \
                largest).\n\n\
                | knob | from, to | segment | register | simulate | step |\n\
                | --- | --- | --- | --- | --- | --- |";
    let line = |growth: &Growth| {
        let (all, upper) = (&growth.overall, &growth.upper);
        let pair = |all: f64, upper: f64| format!("{all:.2} ({upper:.2})");
        format!(
            "| {} | {}, {} | {} | {} | {} | {} |",
            growth.knob,
            growth.range[0],
            growth.range[1],
            pair(all.segment, upper.segment),
            pair(all.register, upper.register),
            pair(all.simulate, upper.simulate),
            pair(all.step, upper.step)
        )
    };
    std::iter::once(head.to_owned()).chain(growths.iter().map(line)).collect()
}

fn number(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| format!("{value:.4}"))
}

fn runs_csv(rows: &[Row]) -> anyhow::Result<String> {
    let mut text = String::from(
        "key,knob,value,seed,steps,vertex_error_mm_mean,vertex_error_mm_p95,e_mm_mean,\
         e_at_truth_mm_mean,strain_percent_mean,self_intersecting_steps,lost_steps,\
         lost_steps_unnoticed,step_ms_p50,step_ms_p99,segment_ms_p50,segment_ms_p99,\
         register_ms_p50,register_ms_p99,simulate_ms_p50,simulate_ms_p99,capture_ms_p50,\
         states_hash\n",
    );
    for row in rows {
        let f = &row.figures;
        write!(text, "{},\"{}\",\"{}\",{},{}", row.key, row.knob, row.value, row.seed, f.steps)?;
        for figure in [
            f.vertex_error_mm_mean,
            f.vertex_error_mm_p95,
            f.e_mm_mean,
            f.e_at_truth_mm_mean,
            f.strain_percent_mean,
        ] {
            write!(text, ",{}", number(figure))?;
        }
        let lost = (f.self_intersecting_steps, f.lost_steps, f.lost_steps_unnoticed);
        write!(text, ",{},{},{}", lost.0, lost.1, lost.2)?;
        let (mid, high) = (f.stage_ms_p50, f.stage_ms_p99);
        for ms in [
            f.step_ms_p50,
            f.step_ms_p99,
            mid.segment,
            high.segment,
            mid.register,
            high.register,
            mid.simulate,
            high.simulate,
            mid.capture,
        ] {
            write!(text, ",{ms:.3}")?;
        }
        writeln!(text, ",{}", f.states_hash)?;
    }
    Ok(text)
}

fn settings_csv(settings: &[Setting]) -> anyhow::Result<String> {
    let mut text = String::from(
        "knob,value,seeds,steps,vertex_error_mm_mean,vertex_error_mm_min,vertex_error_mm_max,\
         vertex_error_mm_p95,e_mm,strain_percent,self_intersecting_steps,lost_steps,step_ms_p50,\
         step_ms_p99,segment_ms,register_ms,simulate_ms,on_front\n",
    );
    for s in settings {
        writeln!(
            text,
            "\"{}\",\"{}\",{},{},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{},{},{:.3},{:.3},{:.3},{:.3},\
             {:.3},{}",
            s.knob,
            s.value,
            s.seeds,
            s.steps,
            s.vertex_error_mm.mean,
            s.vertex_error_mm.min,
            s.vertex_error_mm.max,
            s.vertex_error_mm_p95,
            s.e_mm,
            s.strain_percent,
            s.self_intersecting_steps,
            s.lost_steps,
            s.step_ms.min,
            s.step_ms_p99,
            s.stage_ms.segment,
            s.stage_ms.register,
            s.stage_ms.simulate,
            s.on_front,
        )?;
    }
    Ok(text)
}
