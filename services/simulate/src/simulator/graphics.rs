//! A simulator whose substeps run on the graphics processor.

use super::{Pulls, Simulator};
use crate::contact::Part;
use crate::gpu::{Frame, GpuError, Model, Path, Piece, Sheets};
use crate::params::Backend;
use crate::solver::{Rates, Solver};

/// Nodes from which on a sheet is cut into dispatches of its own.
const APART_NODES: u32 = 2048;
/// Frames that a backend is measured over; the first warms it up.
const MEASURED_FRAMES: usize = 8;

/// What runs elsewhere.
#[derive(Debug, Clone)]
pub(super) struct Graphics {
    sheets: Sheets,
    model: Model,
}

/// Which backend was chosen, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    /// The adapter, or `None` for the CPU.
    pub adapter: Option<String>,
    /// Measured seconds a frame on CPU and graphics processor; NaN where not measured.
    pub frame_s: [f64; 2],
    /// What kept the graphics processor from being used, if anything.
    pub refused: Option<String>,
}

impl Graphics {
    /// Room for that many sheets like this one.
    pub(super) fn new(solver: &Solver, path: Path, sheets: u32) -> Result<Self, GpuError> {
        let model = Model::new(solver);
        let sheets = Sheets::new(&model, sheets, path)?;
        Ok(Self { sheets, model })
    }

    /// Whether a sheet has the links and facets that these have.
    pub(super) fn fits(&self, solver: &Solver) -> bool {
        self.model == Model::new(solver)
    }

    /// Whether a frame is the same for all of these: not their state, but what acts on them.
    pub(super) fn alike<'a>(
        &self,
        mut solvers: impl Iterator<Item = &'a Solver>,
        rates: &Rates,
    ) -> bool {
        let frame = |solver: &Solver| Frame {
            anchors: 0,
            first_substep: solver.substeps % 2,
            ..self.model.frame(solver, rates, 1)
        };
        let first = solvers.next().map(frame);
        solvers.all(|solver| Some(frame(solver)) == first)
    }

    /// The adapter's name.
    pub(super) fn adapter(&self) -> &str {
        self.sheets.adapter()
    }

    /// All substeps of a frame, of all sheets.
    pub(super) fn advance(
        &mut self,
        solvers: &mut [&mut Solver],
        rates: &Rates,
        substeps: u32,
    ) -> Result<(), GpuError> {
        let Some(first) = solvers.first() else { return Ok(()) };
        let mut frame = self.model.frame(first, rates, substeps);
        frame.anchors =
            solvers.iter().map(|solver| solver.anchors.len()).fold(0, usize::max) as u32;
        if frame.anchors > 0 {
            self.wake_grippers()?;
        }
        for (sheet, solver) in solvers.iter().enumerate() {
            self.sheets.traffic.fill(sheet, solver);
        }
        self.sheets.step(&frame)?;
        for (sheet, solver) in solvers.iter_mut().enumerate() {
            self.sheets.traffic.give_back(sheet, solver);
            solver.substeps = solver.substeps.wrapping_add(substeps);
        }
        Ok(())
    }

    /// Nothing is made for grippers before the first one holds.
    fn wake_grippers(&mut self) -> Result<(), GpuError> {
        if !self.model.pieces.contains(Piece::Grippers) {
            let mut model = self.model.clone();
            model.pieces.insert(Piece::Grippers);
            self.renew(model)?;
        }
        Ok(())
    }

    fn renew(&mut self, model: Model) -> Result<(), GpuError> {
        self.sheets = self.sheets.renewed(&model)?;
        self.model = model;
        Ok(())
    }
}

/// Whether the graphics processor can do all that is awake; `touches`: a caller takes part with
/// contact, whose lists grow and shrink from substep to substep in the caller's hands.
pub(super) fn can_do(solver: &Solver, rates: &Rates, touches: bool) -> bool {
    !(touches && solver.has_contact && rates.contact_awake)
}

impl Simulator {
    /// Chooses where the substeps run, as the scene asks: `auto` measures both on the sheet as it
    /// is, with the caller's clock (seconds). No adapter is an error only where the scene asks
    /// for `gpu`.
    pub fn choose_backend(&mut self, now_s: &mut dyn FnMut() -> f64) -> Result<Chosen, GpuError> {
        let mut chosen = Chosen { adapter: None, frame_s: [f64::NAN; 2], refused: None };
        self.graphics = None;
        if self.params.backend == Backend::Cpu {
            return Ok(chosen);
        }
        let path =
            if self.world.len() as u32 >= APART_NODES { Path::Apart } else { Path::OneWorkgroup };
        let graphics = match Graphics::new(&self.solver, path, 1) {
            Ok(graphics) => graphics,
            Err(error) if self.params.backend == Backend::Auto => {
                chosen.refused = Some(error.to_string());
                return Ok(chosen);
            }
            Err(error) => return Err(error),
        };
        let adapter = graphics.adapter().to_owned();
        if self.params.backend == Backend::Auto {
            let mut trial = self.clone();
            let on_cpu = trial.measured_s(now_s);
            trial = self.clone();
            trial.graphics = Some(Box::new(graphics.clone()));
            chosen.frame_s = [on_cpu, trial.measured_s(now_s)];
            if chosen.frame_s[0] <= chosen.frame_s[1] || trial.graphics.is_none() {
                return Ok(chosen);
            }
        }
        self.graphics = Some(Box::new(graphics));
        chosen.adapter = Some(adapter);
        Ok(chosen)
    }

    /// Least seconds of a frame that pulls the sheet a little.
    fn measured_s(&mut self, now_s: &mut dyn FnMut() -> f64) -> f64 {
        let targets_m: Vec<[f32; 3]> =
            self.world.iter().map(|x| [x[0], x[1], x[2] + 1e-3]).collect();
        let confidence = vec![1.0; targets_m.len()];
        let pulls = Pulls { targets_m: &targets_m, confidence: &confidence };
        let mut least_s = f64::INFINITY;
        for frame in 0..=MEASURED_FRAMES {
            let start_s = now_s();
            self.step_with(super::FRAME_S_NOMINAL, pulls, false, &mut Default::default());
            if frame > 0 {
                least_s = least_s.min(now_s() - start_s);
            }
        }
        least_s
    }

    /// Runs the frame's substeps on the graphics processor, if it was chosen and can do all that
    /// is awake; says whether it did. A processor that fails is not asked again.
    pub(super) fn advance_on_gpu(
        &mut self,
        rates: &Rates,
        substeps: u32,
        touches: bool,
        watch: &mut Option<&mut (dyn FnMut(Part) + '_)>,
    ) -> bool {
        let Some(graphics) = &mut self.graphics else { return false };
        let solver = &mut self.solver;
        if !can_do(solver, rates, touches) {
            return false;
        }
        let result = graphics.advance(&mut [solver], rates, substeps);
        if result.is_err() {
            self.graphics = None;
        } else if let Some(watch) = watch {
            watch(Part::Inertia);
        }
        result.is_ok()
    }

    /// Tells the graphics processor of new links and facets.
    pub(super) fn renew_graphics(&mut self) {
        let Some(graphics) = &mut self.graphics else { return };
        let mut model = Model::new(&self.solver);
        if graphics.model.pieces.contains(Piece::Grippers) {
            model.pieces.insert(Piece::Grippers);
        }
        if graphics.renew(model).is_err() {
            self.graphics = None;
        }
    }
}
