//! Cases that befall cameras: the whole pipeline over a rendered fold whose frames are spoilt.

use super::{Outcome, outcome};
use crate::pipeline::{Pipeline, PipelineConfig};
use crate::scores::surface_m;
use orime_capture::{CaptureParams, FrameError, FrameReport, FrameSource, open};
use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid, SheetParams};
use orime_register::{RegisterParams, Tracking};
use orime_segment::SegmentParams;
use orime_simulate::SimulateParams;

/// Frames of a run; those from the first to the second are spoilt.
const STEPS: u64 = 60;
const SPOILT: std::ops::Range<u64> = 25..35;
/// A sheet is found again if its truth lies this near to its surface in the end, metres.
const FOUND_M: f64 = 3e-3;

type Spoil = fn(&RgbdCamera, u64, RgbdFrameMut<'_>);

/// Passes frames on, spoilt for a while.
struct Spoilt {
    inner: Box<dyn FrameSource>,
    spoil: Spoil,
    during: std::ops::Range<u64>,
    /// Exposure time of a step instead of the source's own, nanoseconds.
    clock: Option<fn(u64) -> u64>,
}

impl FrameSource for Spoilt {
    fn cameras(&self) -> &[RgbdCamera] {
        self.inner.cameras()
    }

    fn steps(&self) -> Option<u64> {
        self.inner.steps()
    }

    fn exposure_ns(&self, step: u64, camera: usize) -> u64 {
        self.clock.map_or_else(|| self.inner.exposure_ns(step, camera), |clock| clock(step))
    }

    fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<FrameReport, FrameError> {
        let RgbdFrameMut { color_rgb, depth_units } = frame;
        let whole = RgbdFrameMut { color_rgb: &mut *color_rgb, depth_units: &mut *depth_units };
        let report = self.inner.read(step, camera, whole)?;
        if self.during.contains(&step) {
            let lens = &self.inner.cameras()[camera];
            (self.spoil)(lens, step, RgbdFrameMut { color_rgb, depth_units });
        }
        Ok(report)
    }

    fn truth_m(&self, step: u64, sheet: &SheetGrid, nodes_m: &mut [[f32; 3]]) -> bool {
        self.inner.truth_m(step, sheet, nodes_m)
    }
}

fn config(sheet: &SheetGrid) -> PipelineConfig {
    PipelineConfig {
        sheet: sheet.clone(),
        density_kg_per_m2: SheetParams::default().density_kg_per_m2,
        template_m: None,
        segment: SegmentParams::default().check().expect("the defaults pass"),
        register: RegisterParams::default().check().expect("the defaults pass"),
        simulate: SimulateParams::default().check().expect("the defaults pass"),
        capacity: [20_000, 20_000],
    }
}

/// How a run went.
struct Run {
    finite: bool,
    /// Steps that were tracked, of those spoilt and of those after.
    tracked: [usize; 2],
    /// Distance of the truth from the surface before the spoilt steps and in the end, metres.
    off_m: [f64; 2],
    worst_m: f64,
}

fn run(spoil: Spoil, during: std::ops::Range<u64>, clock: Option<fn(u64) -> u64>) -> Run {
    let sheet = SheetParams::default().check().expect("the defaults pass");
    let mut capture = CaptureParams::default();
    capture.rendered.size_px = [320, 240];
    let capture = capture.check().expect("the defaults pass");
    let inner = open(&capture, &sheet).expect("a rendered scene opens");
    let source = Spoilt { inner, spoil, during: during.clone(), clock };
    let mut pipeline = Pipeline::new(Box::new(source), &config(&sheet));
    let triangles = sheet.triangles();
    let mut run = Run { finite: true, tracked: [0; 2], off_m: [f64::INFINITY; 2], worst_m: 0.0 };
    for step in 0..STEPS {
        let result = pipeline.step(step);
        let nodes = pipeline.nodes_m();
        run.finite &= nodes.iter().flatten().all(|c| c.is_finite());
        let tracked = usize::from(result.register.tracking == Tracking::Tracking);
        run.tracked[0] += tracked * usize::from(during.contains(&step));
        run.tracked[1] += tracked * usize::from(step >= during.end);
        let truth = pipeline.truth_m().unwrap_or_default();
        let off_m = if nodes.is_empty() { None } else { surface_m(truth, nodes, &triangles) };
        let off_m = off_m.unwrap_or(f64::INFINITY);
        run.off_m[usize::from(step >= during.start)] = off_m;
        if step >= during.start && off_m.is_finite() {
            run.worst_m = run.worst_m.max(off_m);
        }
    }
    run
}

/// Runs a case: finite throughout, and found again in the end.
fn check(case: u32, name: &str, run: &Run, also: bool, word: &str) -> Outcome {
    let criterion = format!("finite, within 3 mm of the truth's surface again{word}");
    let measured = format!(
        "finite {}, {:.2} mm off before, {:.2} in the end (worst {:.1}); tracked {} of the spoilt, \
         {} of the {} after",
        run.finite,
        1e3 * run.off_m[0],
        1e3 * run.off_m[1],
        1e3 * run.worst_m,
        run.tracked[0],
        run.tracked[1],
        STEPS - SPOILT.end,
    );
    let passed = run.finite && run.off_m[1] < FOUND_M && also;
    outcome(case, name, &criterion, measured, passed)
}

fn nothing_claimed(case: u32, name: &str, spoil: Spoil) -> Vec<Outcome> {
    let run = run(spoil, SPOILT, None);
    let word = "; not called tracked while nothing is seen";
    vec![check(case, name, &run, run.tracked[0] == 0, word)]
}

fn found_again(case: u32, name: &str, spoil: Spoil) -> Vec<Outcome> {
    vec![check(case, name, &run(spoil, SPOILT, None), true, "")]
}

/// Case 31: black images without depth, as with a cap on the lens.
pub fn black(_seed: u64) -> Vec<Outcome> {
    nothing_claimed(31, "all black", |_, _, frame| {
        frame.color_rgb.fill(0);
        frame.depth_units.fill(0);
    })
}

/// Case 32: white images, depth as it is.
pub fn white(_seed: u64) -> Vec<Outcome> {
    found_again(32, "all white", |_, _, frame| frame.color_rgb.fill(255))
}

/// Case 33: bright light: colours run into saturation.
pub fn saturated(_seed: u64) -> Vec<Outcome> {
    found_again(33, "saturated colours", |_, _, frame| {
        frame.color_rgb.iter_mut().for_each(|c| *c = c.saturating_mul(4));
    })
}

/// Case 34: colours without depth.
pub fn no_depth(_seed: u64) -> Vec<Outcome> {
    nothing_claimed(34, "no depth", |_, _, frame| frame.depth_units.fill(0))
}

/// Case 35: depth in one pixel.
pub fn one_pixel(_seed: u64) -> Vec<Outcome> {
    nothing_claimed(35, "one depth pixel", |lens, _, frame| {
        let middle = frame.depth_units.len() / 2 + lens.depth.width as usize / 2;
        let keep = frame.depth_units[middle];
        frame.depth_units.fill(0);
        frame.depth_units[middle] = keep.max(500);
    })
}

/// Case 36: a second sheet: the image's left part is seen twice.
pub fn two_sheets(_seed: u64) -> Vec<Outcome> {
    found_again(36, "two sheets", |lens, _, frame| {
        let (width, third) = (lens.color.width as usize, lens.color.width as usize / 3);
        for row in frame.color_rgb.chunks_exact_mut(3 * width) {
            row.copy_within(3 * third..6 * third, 0);
        }
        let (width, third) = (lens.depth.width as usize, lens.depth.width as usize / 3);
        for row in frame.depth_units.chunks_exact_mut(width) {
            row.copy_within(third..2 * third, 0);
        }
    })
}

/// Case 37: the sheet is gone: its colour and its depth become the table's.
pub fn gone_and_back(_seed: u64) -> Vec<Outcome> {
    nothing_claimed(37, "sheet gone and back", |_, _, frame| {
        // The first pixel shows no sheet: the whole image does not.
        let color: [u8; 3] = [frame.color_rgb[0], frame.color_rgb[1], frame.color_rgb[2]];
        frame.color_rgb.chunks_exact_mut(3).for_each(|pixel| pixel.copy_from_slice(&color));
        let depth = frame.depth_units[0];
        frame.depth_units.fill(depth);
    })
}

/// Case 38: exposure times that go back, stand still and jump.
pub fn out_of_order(_seed: u64) -> Vec<Outcome> {
    let clock = |step: u64| {
        let usual = 1_000_000_000 + step * 33_333_333;
        match step % 5 {
            2 => usual - 100_000_000,
            3 => 0,
            4 => usual + 3_600_000_000_000,
            _ => usual,
        }
    };
    let run = run(|_, _, _| (), SPOILT, Some(clock));
    vec![check(38, "time stamps out of order", &run, true, "")]
}

/// Case 39: one camera is pushed: its image shifts by 12 pixels for a while.
pub fn moving_camera(_seed: u64) -> Vec<Outcome> {
    found_again(39, "a camera that moves", |lens, _, frame| {
        if lens.name.ends_with('0') || lens.name.is_empty() {
            return;
        }
        let shift = 12;
        let width = 3 * lens.color.width as usize;
        for row in frame.color_rgb.chunks_exact_mut(width) {
            row.copy_within(..width - 3 * shift, 3 * shift);
        }
        let width = lens.depth.width as usize;
        for row in frame.depth_units.chunks_exact_mut(width) {
            row.copy_within(..width - shift, shift);
        }
    })
}
