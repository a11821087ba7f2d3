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
}

impl SelfContact {
    /// For a sheet of this grid.
    pub fn new(config: &ContactConfig, sheet: &SheetGrid) -> Self {
        Self {
            table_m: config.params.table_m,
            facets: FacetContact::new(config, sheet),
            generic: GenericContact::new(config, sheet),
            mobility: vec![1.0; sheet.len()],
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
    ) -> (ContactReport, GenericReport) {
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
        (facets, generic)
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
        if folds.facets().len() > 1 && self.generic.is_free(x_m) {
            return NetReport { armed: true, pairs: 0, blended: 0, share: 1.0 };
        }
        self.generic.truncate(from_m, x_m)
    }
}
