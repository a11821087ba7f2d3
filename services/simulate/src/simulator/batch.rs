//! Many sheets at once.

use super::{Pulls, SimulateReport, Simulator, Taking, clamped_s};
use rayon::prelude::*;

/// Sheets that are advanced together: on all cores, a sheet being one task, so that results do
/// not depend on their number; or on the graphics processor, a workgroup a sheet.
#[derive(Debug)]
pub struct Batch {
    sheets: Vec<Simulator>,
    #[cfg(feature = "gpu")]
    graphics: Option<super::graphics::Graphics>,
    /// The facets that the graphics processor was told of.
    #[cfg(feature = "gpu")]
    facets: Vec<orime_creases::Facet>,
}

impl Batch {
    /// These sheets, on the CPU.
    pub fn new(sheets: Vec<Simulator>) -> Self {
        Self {
            sheets,
            #[cfg(feature = "gpu")]
            graphics: None,
            #[cfg(feature = "gpu")]
            facets: Vec::new(),
        }
    }

    /// The sheets.
    pub fn sheets(&self) -> &[Simulator] {
        &self.sheets
    }

    /// The sheets, for grips, folds and resets.
    pub fn sheets_mut(&mut self) -> &mut [Simulator] {
        &mut self.sheets
    }

    /// Takes all sheets to the graphics processor from now on and names it. They must have the
    /// same links and facets, and the same settings; from the first frame on in which they have
    /// not, all is done here.
    #[cfg(feature = "gpu")]
    pub fn to_gpu(&mut self) -> Result<Option<String>, crate::GpuError> {
        self.graphics = None;
        if let Some(first) = self.sheets.first() {
            let (path, count) = (crate::Path::OneWorkgroup, self.sheets.len() as u32);
            let graphics = super::graphics::Graphics::new(&first.solver, path, count)?;
            if self.sheets.iter().all(|sheet| graphics.fits(&sheet.solver)) {
                let adapter = graphics.adapter().to_owned();
                self.graphics = Some(graphics);
                self.facets = first.folds().facets().to_vec();
                return Ok(Some(adapter));
            }
        }
        Ok(None)
    }

    /// Advances every sheet by `dt_s` towards its targets, see [`Simulator::step`].
    pub fn step(&mut self, dt_s: f64, pulls: &[Pulls<'_>]) -> Vec<SimulateReport> {
        assert_eq!(pulls.len(), self.sheets.len(), "targets for every sheet");
        #[cfg(feature = "gpu")]
        if let Some(reports) = self.step_on_gpu(clamped_s(dt_s), pulls) {
            return reports;
        }
        let dt_s = clamped_s(dt_s);
        let each = self.sheets.par_iter_mut().zip(pulls);
        each.map(|(sheet, pulls)| sheet.step_with(dt_s, *pulls, false, &mut Taking::default()))
            .collect()
    }

    /// The whole batch on the graphics processor, or `None` where it cannot do this frame.
    #[cfg(feature = "gpu")]
    fn step_on_gpu(&mut self, dt_s: f64, pulls: &[Pulls<'_>]) -> Option<Vec<SimulateReport>> {
        use super::graphics::can_do;
        if self.sheets.iter().any(|sheet| sheet.folds.facets() != self.facets) {
            self.graphics = None;
        }
        let graphics = self.graphics.as_mut()?;
        let mut reports = vec![SimulateReport::default(); self.sheets.len()];
        let prepare = |((sheet, pulls), report): ((&mut Simulator, &Pulls<'_>), &mut _)| {
            sheet.recenter();
            sheet.accept_targets(*pulls, report);
            sheet.substeps(dt_s)
        };
        let substeps =
            self.sheets.par_iter_mut().zip(pulls).zip(&mut reports).map(prepare).max()?;
        let begin = |(sheet, report): (&mut Simulator, &mut SimulateReport)| {
            report.substeps = substeps;
            let rates = sheet.begin(dt_s, report);
            (can_do(&sheet.solver, &rates, false), rates)
        };
        let all: Vec<_> = self.sheets.par_iter_mut().zip(&mut reports).map(begin).collect();
        let first = all.first()?.1;
        // One frame for all: a table that sheets see at different heights is not one.
        let alike = all.iter().all(|(can, rates)| *can && *rates == first)
            && graphics.alike(self.sheets.iter().map(|sheet| &sheet.solver), &first);
        let mut solvers: Vec<_> = self.sheets.iter_mut().map(|sheet| &mut sheet.solver).collect();
        if !alike || graphics.advance(&mut solvers, &first, substeps).is_err() {
            self.graphics = None;
            return None;
        }
        self.sheets.par_iter_mut().for_each(|sheet| sheet.finish(dt_s));
        Some(reports)
    }
}
