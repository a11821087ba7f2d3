//! All of it together, as a pass of a substep.

use crate::generic::{GenericContact, GenericReport, NetReport};
use crate::params::ContactConfig;
use crate::project::{ContactReport, FacetContact};
use orime_creases::Folds;
use orime_geometry::SheetGrid;

/// Contact by layer order where there are facets, generic contact where there are none, and the
/// net under both.
#[derive(Debug)]
pub struct SelfContact {
    table_m: Option<f64>,
    facets: FacetContact,
    generic: GenericContact,
    mobility: Vec<f32>,
    /// Whether every contact between facets kept its gap when the last pass that held was done.
    settled: bool,
}

/// What a pass did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassReport {
    /// Contact by layer order.
    pub facets: ContactReport,
    /// Contact without facets.
    pub generic: GenericReport,
    /// Whether the pass may stand. Not where it began with every layer in its place and cannot part
    /// them again: then the substep has to be taken back.
    pub holds: bool,
}

impl SelfContact {
    /// For a sheet of this grid.
    pub fn new(config: &ContactConfig, sheet: &SheetGrid) -> Self {
        Self {
            table_m: config.params.table_m,
            facets: FacetContact::new(config, sheet),
            generic: GenericContact::new(config, sheet),
            mobility: vec![1.0; sheet.len()],
            settled: false,
        }
    }

    /// Inverse masses, relative to each other; 0 holds a node. All 1 at first.
    pub fn set_mobility(&mut self, mobility: &[f32]) {
        self.facets.set_mobility(mobility);
        self.generic.set_mobility(mobility);
        self.mobility.copy_from_slice(mobility);
    }

    /// Parts what touches; `from_m` is where the substep began. Metres, one per node. Call it in
    /// every substep: a correction of what has gathered over several becomes a kick.
    pub fn project(
        &mut self,
        from_m: &[[f32; 3]],
        x_m: &mut [[f32; 3]],
        folds: &Folds,
    ) -> PassReport {
        let facets = self.facets.project(x_m, folds);
        let mut generic = GenericReport::default();
        if folds.facets().len() == 1 {
            self.generic.begin_step(from_m);
            generic = self.generic.project(x_m);
        }
        if let Some(table_m) = self.table_m {
            for (x, _) in x_m.iter_mut().zip(&self.mobility).filter(|(_, m)| **m > 0.0) {
                x[2] = x[2].max(table_m as f32);
            }
        }
        let holds = facets.settled || !self.settled;
        self.settled = facets.settled || self.settled && !holds;
        PassReport { facets, generic, holds }
    }

    /// Casts the net over the way from `from_m`, which may lie several substeps back: what crosses
    /// goes back as far as it must. A sheet of one facet must not meet itself on that way either;
    /// between facets their order sees to that. What begins tangled has no net.
    pub fn truncate(
        &mut self,
        from_m: &[[f32; 3]],
        x_m: &mut [[f32; 3]],
        folds: &Folds,
    ) -> NetReport {
        if folds.facets().len() > 1 {
            self.generic.catch(from_m, x_m)
        } else {
            self.generic.truncate(from_m, x_m)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ContactParams;
    use orime_creases::Line;

    /// The sheet folded along u = 0.075, its upper half this far above the lower one.
    fn book(sheet: &SheetGrid, above_m: f64) -> Vec<[f32; 3]> {
        let fold = |[u, v]: [f64; 2]| {
            let over = (u - 0.075f64).max(0.0);
            let z = above_m * (over / 0.01).min(1.0);
            [(u.min(0.075) - over) as f32, v as f32, z as f32]
        };
        sheet.uv_m().map(fold).collect()
    }

    #[test]
    fn a_pass_holds_unless_it_tangles_what_was_in_order() {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let mut folds = Folds::flat(&sheet);
        folds.split(0, &Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
        folds.observe(&book(&sheet, 0.02));
        let mut contact = SelfContact::new(&ContactParams::default().check().unwrap(), &sheet);
        // Nothing moves: what is tangled stays so.
        contact.set_mobility(&vec![0.0; sheet.len()]);
        let mut pass = |above_m: f64| {
            let mut x = book(&sheet, above_m);
            let from = x.clone();
            contact.project(&from, &mut x, &folds)
        };
        let tangled = pass(-1e-3);
        assert!(!tangled.facets.settled && tangled.holds, "it began like that: {tangled:?}");
        assert!(pass(1e-3).facets.settled);
        assert!(!pass(-1e-3).holds && !pass(-1e-3).holds, "it was in order before");
        assert!(pass(1e-3).holds);
    }
}
