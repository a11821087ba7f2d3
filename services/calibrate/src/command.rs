//! `orime calibrate`: a set's cameras found anew, as a calibration file, figures and pictures.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use orime_calibration::{Calibration, CameraEntry, DepthEntry, doubts};
use orime_capture::{CaptureConfig, CaptureParams, FrameSource};
use orime_geometry::{RgbdCamera, SheetGrid, SheetParams};
use orime_markers::{Detector, DetectorParams, Dictionary};
use orime_runtime::SetFile;

use crate::agreement::left_out;
use crate::fit::{Fit, FitError, fit};
use crate::observe::{Observations, observe};
use crate::pictures;
use crate::report::Report;

/// Finds where the cameras of a set stand and how their depth errs, from markers.
///
/// The set's `[capture.calibration]` says which markers: `dictionary`, `marker_m` (side of the
/// black square), `target` ("rigid": a board or cube moved through the views; "free": markers
/// lying about). Writes DIR/calibration.toml, DIR/report.md and pictures; name the file in
/// `[capture.calibration] file` of the set to use it.
#[derive(Debug, Parser)]
#[command(
    name = "orime calibrate",
    bin_name = "orime calibrate",
    after_help = "\
Examples:
  orime calibrate tests/sets/three_cameras.toml --out out/calibration --json out/figures.json
  orime calibrate my_set.toml --out out/kalibr --import camchain.yaml

Exit status: 0 calibrated, 1 what was seen does not suffice, 2 wrong usage or set file, 3 nothing
can be written."
)]
pub struct Arguments {
    /// The set file.
    pub set: PathBuf,
    /// Folder for the calibration file, the report and its pictures.
    #[arg(long)]
    pub out: PathBuf,
    /// Write the figures into this JSON file, too.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Take the calibration from Kalibr's camchain or ROS's camera_info instead of markers.
    #[arg(long, value_name = "YAML")]
    pub import: Option<PathBuf>,
}

/// Why nothing was calibrated.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// Wrong usage, set file or source.
    #[error("{0}")]
    Usage(String),
    /// What was seen does not suffice.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// Nothing can be written.
    #[error("writing `{path}`: {message}; is the disk full, may you write there?")]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// Why not.
        message: String,
    },
}

/// Runs the command with the words after `orime calibrate`. `orime` itself takes a `--json` that
/// comes before all others (`has_json`), and leaves its file among the words.
pub fn command(words: &[OsString], has_json: bool) -> ExitCode {
    let [name, json] = ["orime calibrate", "--json"].map(OsString::from);
    let head = std::iter::once(&name).chain(has_json.then_some(&json));
    let arguments = match Arguments::try_parse_from(head.chain(words)) {
        Ok(arguments) => arguments,
        Err(error) => {
            // Whoever reads only the head of the help has closed the pipe: that is no failure.
            let _ = error.print();
            return ExitCode::from(error.exit_code() as u8);
        }
    };
    match run(&arguments) {
        Ok(text) => {
            println!("{text}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("orime calibrate: {error}");
            ExitCode::from(match error {
                CommandError::Fit(_) => 1,
                CommandError::Usage(_) => 2,
                CommandError::Write { .. } => 3,
            })
        }
    }
}

/// Calibrates; what to print.
pub fn run(arguments: &Arguments) -> Result<String, CommandError> {
    let (config, sheet) = load(&arguments.set)?;
    let mut source = open(&config, &sheet)?;
    make_folder(&arguments.out)?;
    if let Some(yaml) = &arguments.import {
        return import(arguments, yaml, source.as_ref());
    }
    let seen = look(&config, source.as_mut())?;
    let kind = config.calibration.target;
    let found = fit(&seen, kind, |_| true)?;
    let pairs = left_out(&seen, kind)?;
    let (calibration, cameras) = calibrated(&seen.cameras, &found);
    let report = Report::new(&arguments.set, &seen, &found, pairs, doubts(&cameras));
    let comment = format!(
        "Calibration of {} camera(s) by `orime calibrate {}`: {} frame sets, {} markers seen.\n\
         Name this file in `[capture.calibration] file` of the set.",
        cameras.len(),
        arguments.set.display(),
        seen.steps,
        seen.views.len()
    );
    let drawn = pictures::draw(source.as_mut(), &seen, &cameras, &found, &arguments.out)?;
    let file = arguments.out.join("calibration.toml");
    write(&file, &calibration.to_text(&comment))?;
    write(&arguments.out.join("report.md"), &report.markdown(&drawn))?;
    if let Some(json) = &arguments.json {
        if let Some(folder) = json.parent().filter(|folder| *folder != Path::new("")) {
            make_folder(folder)?;
        }
        write(json, &report.json())?;
    }
    Ok(format!("{}\ncalibration: {}", report.text(), file.display()))
}

fn import(
    arguments: &Arguments,
    yaml: &Path,
    source: &dyn FrameSource,
) -> Result<String, CommandError> {
    let usage = |error: orime_calibration::CalibrationError| CommandError::Usage(error.to_string());
    let mut cameras = source.cameras().to_vec();
    let calibration = Calibration::load(yaml, &cameras).map_err(usage)?;
    calibration.apply(yaml, &mut cameras).map_err(usage)?;
    let file = arguments.out.join("calibration.toml");
    write(&file, &calibration.to_text(&format!("Imported from {}.", yaml.display())))?;
    let warnings: String =
        doubts(&cameras).iter().map(|doubt| format!("warning: {doubt}\n")).collect();
    Ok(format!("{warnings}calibration: {}", file.display()))
}

fn load(path: &Path) -> Result<(CaptureConfig, SheetGrid), CommandError> {
    let usage = |error: orime_runtime::SetError| CommandError::Usage(error.to_string());
    let set = SetFile::load(path).map_err(usage)?;
    let sheet = set.checked("sheet", SheetParams::check).map_err(usage)?;
    let mut config = set.checked("capture", CaptureParams::check).map_err(usage)?;
    // What is to be found must not be in the way.
    config.calibration.file = None;
    Ok((config, sheet))
}

fn open(config: &CaptureConfig, sheet: &SheetGrid) -> Result<Box<dyn FrameSource>, CommandError> {
    orime_capture::open(config, sheet).map_err(|error| CommandError::Usage(error.to_string()))
}

/// Finds the markers of the set's dictionary in its frame sets.
fn look(
    config: &CaptureConfig,
    source: &mut dyn FrameSource,
) -> Result<Observations, CommandError> {
    let target = &config.calibration;
    if target.dictionary.is_empty() {
        return Err(CommandError::Usage(
            "the set does not say which markers to look for: add `[capture.calibration]` with \
             `dictionary = \"DICT_4X4_50\"` (or yours) and `marker_m = …`"
                .to_owned(),
        ));
    }
    let usage = |message: String| {
        CommandError::Usage(format!("`capture.calibration.dictionary`: {message}"))
    };
    let dictionary =
        Dictionary::predefined(&target.dictionary).map_err(|e| usage(e.to_string()))?;
    let detector = DetectorParams::default().check().map_err(|p| usage(format!("{p:?}")))?;
    let mut detector = Detector::new(&detector, dictionary);
    let seen = observe(source, &mut detector, target.marker_m, target.frames_max);
    if seen.views.is_empty() {
        let dictionary = target.dictionary.clone();
        return Err(FitError::NoMarker { dictionary, steps: seen.steps }.into());
    }
    Ok(seen)
}

/// The calibration file, and the cameras with it.
fn calibrated(cameras: &[RgbdCamera], found: &Fit) -> (Calibration, Vec<RgbdCamera>) {
    let world_from_first = cameras[0].world_from_color;
    let mut new = cameras.to_vec();
    let mut calibration = Calibration::default();
    for (k, camera) in new.iter_mut().enumerate() {
        camera.world_from_color = world_from_first * found.first_from_camera[k];
        calibration.camera.push(CameraEntry {
            name: camera.name.clone(),
            world_from_color: Some((&camera.world_from_color).into()),
            color_lens: None,
            depth: found.depth[k].map(|d| DepthEntry { bias_m: d.bias_m, scale: d.scale }),
        });
    }
    (calibration, new)
}

fn make_folder(path: &Path) -> Result<(), CommandError> {
    std::fs::create_dir_all(path)
        .map_err(|error| CommandError::Write { path: path.to_owned(), message: error.to_string() })
}

fn write(path: &Path, text: &str) -> Result<(), CommandError> {
    std::fs::write(path, text)
        .map_err(|error| CommandError::Write { path: path.to_owned(), message: error.to_string() })
}
