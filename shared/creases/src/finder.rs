//! The one entry: positions in, facets and creases out.

use crate::folds::Folds;
use crate::lines::LineFinder;
use crate::paper::{ClusterFit, Clustering};
use crate::params::{CreaseConfig, CreaseMode};
use orime_geometry::SheetGrid;

/// Finds creases online, one step after the other.
#[derive(Debug, Clone)]
pub struct CreaseFinder {
    folds: Folds,
    method: Method,
}

#[derive(Debug, Clone)]
enum Method {
    Off,
    Lines(Box<LineFinder>),
    Paper(Box<Clustering>),
}

/// Targets with at most this confidence are of nodes that nobody saw: they hold hidden layers
/// beside what is seen of the sheet, and say nothing of creases.
pub const UNSEEN_CONFIDENCE: f32 = 0.1;

impl CreaseFinder {
    /// A finder for a sheet without creases.
    pub fn new(config: &CreaseConfig, sheet: &SheetGrid) -> Self {
        let method = match config.params.mode {
            CreaseMode::Off => Method::Off,
            CreaseMode::Lines => Method::Lines(Box::new(LineFinder::new(config, sheet))),
            CreaseMode::Paper => {
                Method::Paper(Box::new(Clustering::new(&config.params.paper, sheet)))
            }
        };
        Self { folds: Folds::flat(sheet), method }
    }

    /// Takes in where the nodes were seen (world frame, metres) and how surely (0 hidden, 1 seen);
    /// true where facets or creases changed. Nodes that are missing or not finite count as hidden.
    ///
    /// Angles and layer order are not touched: [`Folds::observe`] takes them from what is trusted
    /// most, which targets are not.
    pub fn step(&mut self, positions_m: &[[f32; 3]], confidence: &[f32]) -> bool {
        match &mut self.method {
            Method::Off => false,
            Method::Lines(lines) => lines.step(&mut self.folds, positions_m, confidence),
            Method::Paper(paper) => paper.step(&mut self.folds, positions_m, confidence),
        }
    }

    /// Lines that are about to be folded from now on, beside those of the config: two material
    /// points each, metres. Creases that are known stay; only mode `lines` heeds a plan.
    pub fn set_plan(&mut self, lines: &[[[f64; 2]; 2]]) {
        if let Method::Lines(finder) = &mut self.method {
            finder.set_plan(lines);
        }
    }

    /// The facets and creases.
    pub fn folds(&self) -> &Folds {
        &self.folds
    }

    /// The same, for [`Folds::observe`] and [`Folds::set_order`]; facets must not be split here.
    pub fn folds_mut(&mut self) -> &mut Folds {
        &mut self.folds
    }

    /// The facet or, in the paper's mode, the cluster of every node.
    pub fn clusters(&self) -> &[u8] {
        match &self.method {
            Method::Off | Method::Lines(_) => self.folds.facet_of_node(),
            Method::Paper(paper) => &paper.labels,
        }
    }

    /// The paper's mode: how well each cluster fits; empty in the others.
    pub fn cluster_fits(&self) -> &[ClusterFit] {
        match &self.method {
            Method::Off | Method::Lines(_) => &[],
            Method::Paper(paper) => &paper.fits,
        }
    }

    /// Forgets all creases.
    pub fn reset(&mut self) {
        self.folds = Folds::flat(&self.folds.sheet().clone());
        match &mut self.method {
            Method::Off => {}
            Method::Lines(lines) => lines.reset(&self.folds),
            Method::Paper(paper) => paper.reset(),
        }
    }
}
