//! `orime-evaluate track`: the whole pipeline in this process.

use anyhow::Context;
use orime_evaluate::judge::{Judge, StepInput};
use orime_evaluate::picture::PanelInput;
use orime_evaluate::pipeline::{Pipeline, StepResult, tracking_name};
use std::io::{IsTerminal, Write};
use std::path::PathBuf;

use super::output::{self, Pictures};

/// Run the stages of a set in this process, in lockstep, and score every step.
#[derive(Debug, clap::Args)]
pub struct TrackArguments {
    /// The set file.
    set: PathBuf,
    /// Write the figures of the run and of every step to this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the figures of every step to this file.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write pictures into this folder.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// A picture every N steps; 0 makes about sixteen.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pictures_every: u64,
    /// Pictures at these steps instead, for example the paper's 100,200,225,268,345,460,580.
    #[arg(long, value_name = "N,N,…", value_delimiter = ',', conflicts_with = "pictures_every")]
    pictures_at: Vec<u64>,
    /// Camera whose image is shown in the pictures, from 0.
    #[arg(long, value_name = "K", default_value_t = 0)]
    camera: usize,
    /// Stop after this many steps.
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
}

/// Runs the command.
pub fn run(arguments: &TrackArguments) -> anyhow::Result<()> {
    let (source, config) = super::set::load(&arguments.set)?;
    let mut pipeline = Pipeline::new(source, &config);
    let mut judge = Judge::new(&config.sheet, config.template_m.as_deref());
    let steps = super::judged::steps(arguments.steps, &pipeline)?;
    let mut pictures = match &arguments.pictures {
        Some(directory) => {
            let cameras = pipeline.cameras().len();
            anyhow::ensure!(
                arguments.camera < cameras,
                "--camera {}: the set has cameras 0 to {}",
                arguments.camera,
                cameras - 1
            );
            let pictures =
                Pictures::new(directory, arguments.pictures_every, steps, arguments.camera)?;
            Some(pictures.at(&arguments.pictures_at))
        }
        None => None,
    };
    let live = std::io::stderr().is_terminal();
    for step in 0..steps {
        let result = pipeline.step(step);
        for error in &result.frame_errors {
            eprintln!("step {step}: {error}");
        }
        score(&pipeline, step, &result, &mut judge, &mut pictures)?;
        if live {
            eprint!("\rstep {}/{steps}", step + 1);
            std::io::stderr().flush()?;
        }
    }
    if live {
        eprintln!();
    }
    report(arguments, &judge, &pictures)
}

/// A step of the pipeline as the judge sees it.
pub fn step_input<'a>(pipeline: &'a Pipeline, step: u64, result: &StepResult) -> StepInput<'a> {
    StepInput {
        step,
        tracking: tracking_name(result.register.tracking),
        reset: result.register.reset,
        nodes_m: pipeline.nodes_m(),
        cloud: pipeline.cloud(),
        edgels: pipeline.edgels(),
        cameras: pipeline.cameras(),
        truth_m: pipeline.truth_m(),
        ms: result.ms,
    }
}

fn score(
    pipeline: &Pipeline,
    step: u64,
    result: &StepResult,
    judge: &mut Judge,
    pictures: &mut Option<Pictures>,
) -> anyhow::Result<()> {
    let sheet = judge.sheet().clone();
    let score = judge.score(&step_input(pipeline, step, result));
    if let Some(pictures) = pictures.as_mut().filter(|pictures| pictures.wants(step)) {
        pictures.write(&PanelInput {
            score,
            sheet: &sheet,
            nodes_m: pipeline.nodes_m(),
            folds: pipeline.folds(),
            clusters: pipeline.clusters(),
            cloud: pipeline.cloud(),
            edgels: pipeline.edgels(),
            camera: &pipeline.cameras()[pictures.camera],
            camera_index: pictures.camera,
            color_rgb: pipeline.color_rgb(pictures.camera),
        })?;
    }
    Ok(())
}

fn report(
    arguments: &TrackArguments,
    judge: &Judge,
    pictures: &Option<Pictures>,
) -> anyhow::Result<()> {
    let name = arguments.set.display().to_string();
    println!("{}", output::table(&name, &judge.summary()));
    if let Some(path) = &arguments.json {
        output::write_json(path, &name, judge)?;
        println!("wrote {}", path.display());
    }
    if let Some(path) = &arguments.csv {
        output::write_csv(path, judge.steps())?;
        println!("wrote {}", path.display());
    }
    if let Some(pictures) = pictures {
        let (count, directory) = pictures.written();
        println!("wrote {count} pictures to {}", directory.display());
    }
    std::io::stdout().flush().context("writing to standard output")
}
