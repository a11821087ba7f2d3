//! From a set file to the stages' configurations.

use anyhow::Context;
use orime_capture::{CaptureParams, FrameSource};
use orime_evaluate::pipeline::PipelineConfig;
use orime_geometry::SheetParams;
use orime_messages::{EDGELS_MAX, POINTS_MAX};
use orime_register::{RegisterMode, RegisterParams};
use orime_runtime::SetFile;
use orime_segment::SegmentParams;
use orime_simulate::{Backend, SimulateParams};
use std::path::Path;

/// The source and the configurations of a set file.
pub fn load(path: &Path) -> anyhow::Result<(Box<dyn FrameSource>, PipelineConfig)> {
    open(&SetFile::load(path)?)
}

/// The source and the configurations of a set.
pub fn open(set: &SetFile) -> anyhow::Result<(Box<dyn FrameSource>, PipelineConfig)> {
    let config = pipeline(set)?;
    let capture = set.checked("capture", CaptureParams::check)?;
    let source = orime_capture::open(&capture, &config.sheet)
        .with_context(|| format!("opening the source of `{}`", set.path.display()))?;
    Ok((source, config))
}

/// The stages' configurations.
pub fn pipeline(set: &SetFile) -> anyhow::Result<PipelineConfig> {
    let params: SheetParams = set.section("sheet")?;
    let sheet = set.checked("sheet", SheetParams::check)?;
    let segment = set.checked("segment", SegmentParams::check)?;
    let register: RegisterParams = set.section("register")?;
    segment
        .check_sheet(&sheet)
        .map_err(|problem| anyhow::anyhow!("`sheet.{}` {}", problem.key, problem.message))?;
    anyhow::ensure!(
        register.mode != RegisterMode::Markers || segment.finds_markers(),
        "`register.mode = \"markers\"` needs `segment.markers = \"sheet\"`"
    );
    let simulate: SimulateParams = set.section("simulate")?;
    anyhow::ensure!(
        simulate.backend != Backend::Gpu,
        "`simulate.backend` is \"gpu\", but orime-evaluate runs its stages on the CPU: take \
         \"cpu\", or start the set with `orime up`"
    );
    Ok(PipelineConfig {
        density_kg_per_m2: params.density_kg_per_m2,
        template_m: orime_recording::template::load(&params, &sheet)?,
        segment,
        register: set.checked("register", RegisterParams::check)?,
        simulate: set.checked("simulate", SimulateParams::check)?,
        capacity: [POINTS_MAX, EDGELS_MAX],
        sheet,
    })
}
