//! `orime effects`: what each effect of a scene is made of and what it costs.
//!
//! The scene's sheet is folded in half by targets over a number of frames, held by a gripper if
//! grippers are named, and every pass is timed. Microseconds are medians over the frames in which
//! the effect was awake; the clock's own time is measured and taken off.

use std::io::Write;
use std::path::Path;
use std::time::Instant;

use orime_creases::{Folds, Line};
use orime_geometry::{SheetGrid, SheetParams};
use orime_runtime::SetFile;
use orime_simulate::{
    Effect, FRAME_S_NOMINAL, Grip, Part, Pulls, SimulateParams, Simulator, Taking,
};
use serde::Serialize;

use crate::exit::{Exit, Failure};

/// Frames of the fold.
const FRAMES: usize = 60;
/// Angle that is folded, radians.
const FOLD_RAD: f64 = 2.5;

/// One line of the table.
#[derive(Debug, Serialize)]
struct Row {
    /// The effect, or `inertia`.
    effect: &'static str,
    /// Passes over nodes, links or facets in a substep.
    passes: usize,
    /// Links.
    links: usize,
    /// Colours of links.
    colours: usize,
    /// Bytes that it takes.
    bytes: usize,
    /// Frames in which it slept.
    slept_frames: usize,
    /// Median microseconds of a frame in which it was awake.
    us_per_frame: f64,
}

/// The whole table.
#[derive(Debug, Serialize)]
struct Table {
    scene: String,
    nodes: [usize; 2],
    frames: usize,
    substeps: u32,
    rows: Vec<Row>,
    us_per_frame: f64,
}

/// Measures a scene and prints the table.
pub fn effects(scene: &Path, json: bool) -> Result<Exit, Failure> {
    let usage = |error: &dyn std::fmt::Display| Failure::usage(error.to_string());
    let set = SetFile::load(scene).map_err(|error| usage(&error))?;
    let sheet_params: SheetParams = set.section("sheet").map_err(|error| usage(&error))?;
    let sheet = set.checked("sheet", SheetParams::check).map_err(|error| usage(&error))?;
    let params: SimulateParams = set.section("simulate").map_err(|error| usage(&error))?;
    let config = set.checked("simulate", SimulateParams::check).map_err(|error| usage(&error))?;
    let simulator = Simulator::new(&config, &sheet, sheet_params.density_kg_per_m2, None);
    let table = measure(simulator, &sheet, &params, &set.name);
    let text = if json {
        serde_json::to_string_pretty(&table).map_err(|error| Failure::machine(error.to_string()))?
    } else {
        print(&table)
    };
    // Whoever reads only the head of it has closed the pipe: that is no failure.
    let _ = writeln!(std::io::stdout(), "{text}");
    Ok(Exit::Good)
}

/// Time and calls of every part in one frame.
#[derive(Debug, Clone, Default)]
struct Frame {
    us: Vec<f64>,
    calls: Vec<usize>,
    slept: Vec<bool>,
    substeps: u32,
}

fn measure(
    mut simulator: Simulator,
    sheet: &SheetGrid,
    params: &SimulateParams,
    name: &str,
) -> Table {
    let clock_us = clock_us();
    let sure = vec![1.0; sheet.len()];
    simulator.step(FRAME_S_NOMINAL, &folded(sheet, 0.0), &sure, true);
    let mut folds = Folds::flat(sheet);
    let [a, b] = sheet.size_m;
    folds.split(0, &Line::through([a / 2.0, 0.0], [a / 2.0, b]));
    let mut frames = Vec::with_capacity(FRAMES);
    for frame in 1..=FRAMES {
        let angle_rad = FOLD_RAD * frame as f64 / FRAMES as f64;
        let targets_m = folded(sheet, angle_rad);
        if frame == FRAMES / 6 {
            simulator.set_folds(&folds);
        }
        let held = sheet.index(sheet.nodes[0] - 1, sheet.nodes[1] / 2);
        let uv_m = [a, (sheet.nodes[1] / 2) as f64 * sheet.spacing_m()[1]];
        simulator.set_grips(&[Grip { uv_m, position_m: targets_m[held].map(f64::from) }]);
        let pulls = Pulls { targets_m: &targets_m, confidence: &sure };
        frames.push(timed_step(&mut simulator, pulls, clock_us));
    }
    let parts = parts();
    let rows = (0..parts.len())
        .filter(|k| named(parts[*k], params))
        .map(|k| row(k, parts[k], &simulator, &frames))
        .collect::<Vec<_>>();
    let total = frames.iter().map(|frame| frame.us.iter().sum()).collect();
    let substeps = frames.iter().map(|frame| frame.substeps).max().unwrap_or(0);
    let (scene, nodes) = (name.to_owned(), sheet.nodes);
    Table { scene, nodes, frames: FRAMES, substeps, rows, us_per_frame: median(total) }
}

fn row(k: usize, part: Part, simulator: &Simulator, frames: &[Frame]) -> Row {
    let (effect, name) = match part {
        Part::Inertia => (None, "inertia"),
        Part::Of(effect) => (Some(effect), effect.name()),
    };
    let [links, colours] = effect.map_or([0, 0], |effect| simulator.links(effect));
    let awake = || frames.iter().filter(|frame| !frame.slept[k]);
    let passes = awake().map(|frame| frame.calls[k] / frame.substeps.max(1) as usize).max();
    Row {
        effect: name,
        passes: passes.unwrap_or(0),
        links,
        colours,
        bytes: simulator.bytes(effect),
        slept_frames: frames.len() - awake().count(),
        us_per_frame: median(awake().map(|frame| frame.us[k]).collect()),
    }
}

fn parts() -> Vec<Part> {
    std::iter::once(Part::Inertia).chain(Effect::ALL.map(Part::Of)).collect()
}

fn named(part: Part, params: &SimulateParams) -> bool {
    match part {
        Part::Inertia => true,
        Part::Of(effect) => params.effects.contains(&effect),
    }
}

fn timed_step(simulator: &mut Simulator, pulls: Pulls<'_>, clock_us: f64) -> Frame {
    let parts = parts();
    let mut frame = Frame {
        us: vec![0.0; parts.len()],
        calls: vec![0; parts.len()],
        slept: vec![false; parts.len()],
        substeps: 0,
    };
    let mut last = Instant::now();
    let mut watch = |part: Part| {
        let now = Instant::now();
        let spent_us = (now - last).as_secs_f64() * 1e6 - clock_us;
        if let Some(k) = parts.iter().position(|known| *known == part) {
            frame.us[k] += spent_us.max(0.0);
            frame.calls[k] += 1;
        }
        last = Instant::now();
    };
    let mut contact = |_: orime_simulate::ContactPass<'_>| {};
    let mut taking = Taking { contact: Some(&mut contact), watch: Some(&mut watch) };
    let report = simulator.step_with(FRAME_S_NOMINAL, pulls, false, &mut taking);
    frame.substeps = report.substeps;
    for (slept, part) in frame.slept.iter_mut().zip(&parts) {
        *slept = matches!(part, Part::Of(effect) if report.slept.contains(*effect));
    }
    frame
}

/// What reading the clock takes, microseconds: the least of many.
fn clock_us() -> f64 {
    let pair = |_| {
        let start = Instant::now();
        (Instant::now() - start).as_secs_f64() * 1e6
    };
    (0..1000).map(pair).fold(f64::INFINITY, f64::min)
}

/// The sheet in half, the part of large u turned up by an angle, just above z = 0.
fn folded(sheet: &SheetGrid, angle_rad: f64) -> Vec<[f32; 3]> {
    let middle = sheet.size_m[0] / 2.0;
    let place = |[u, v]: [f64; 2]| {
        let over = (u - middle).max(0.0);
        let x = u.min(middle) + over * angle_rad.cos();
        [x as f32, v as f32, (over * angle_rad.sin()) as f32 + 1e-4]
    };
    sheet.uv_m().map(place).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

fn print(table: &Table) -> String {
    let [n_u, n_v] = table.nodes;
    let mut text = format!(
        "{}: {n_u} × {n_v} nodes, {} frames of a half fold, up to {} substeps a frame\n\n\
         effect         passes   links  colours     bytes  slept frames  µs/frame\n",
        table.scene, table.frames, table.substeps
    );
    for row in &table.rows {
        text += &format!(
            "{:<13}  {:6}  {:6}  {:7}  {:8}  {:12}  {:8.1}\n",
            row.effect,
            row.passes,
            row.links,
            row.colours,
            row.bytes,
            row.slept_frames,
            row.us_per_frame
        );
    }
    text + &format!("all{:>65.1}", table.us_per_frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_named_is_in_the_table_and_nothing_else() {
        let effects = vec![Effect::Stretch, Effect::Facets, Effect::Track, Effect::SelfContact];
        let params = SimulateParams { effects, ..SimulateParams::default() };
        let sheet = SheetGrid::new([0.15; 2], [25, 25]);
        let config = params.check().unwrap();
        let simulator = Simulator::new(&config, &sheet, 0.08, None);
        let table = measure(simulator, &sheet, &params, "scene");
        let names: Vec<&str> = table.rows.iter().map(|row| row.effect).collect();
        assert_eq!(names, ["inertia", "track", "stretch", "facets", "self_contact"]);
        let [inertia, track, stretch, facets, _] = &table.rows[..] else { panic!() };
        assert_eq!((stretch.links, stretch.colours, stretch.passes), (2 * 25 * 24, 4, 4));
        assert_eq!((inertia.passes, track.passes, facets.passes), (2, 1, 1));
        // Before the crease is known there is one facet, and nothing to hold.
        assert_eq!(facets.slept_frames, FRAMES / 6 - 1);
        assert!(
            table.rows.iter().all(|row| row.effect == "self_contact" || row.us_per_frame > 0.0)
        );
        assert!(stretch.bytes > 0 && inertia.bytes > 0);
        assert!(print(&table).contains("stretch"));
    }
}
