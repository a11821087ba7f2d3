//! Runs over several seeds, and what they must reach.

use super::noise::Noise;
use super::scene::{Scene, SceneKind};
use super::score::{Score, score};
use crate::finder::CreaseFinder;
use crate::params::CreaseConfig;
use orime_geometry::SheetGrid;
use orime_origami::FoldError;

/// The side that noise and goals are stated for, metres.
const SIDE_M: f64 = 0.15;
/// Share of the noise's variance that neighbours do not share.
const WHITE_SHARE: f64 = 0.5;
/// Most labels that may change in a step.
const FLIPS_MAX: f64 = 0.0005;

/// Several runs of one kind of scene with one noise.
#[derive(Debug, Clone)]
pub struct Summary {
    /// What happens.
    pub kind: SceneKind,
    /// Noise per coordinate, metres.
    pub sigma_m: f64,
    /// Side of the sheet, metres.
    pub side_m: f64,
    /// Rigid parts at the end.
    pub facets: usize,
    /// One per seed.
    pub scores: Vec<Score>,
}

/// What a summary must reach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goals {
    /// Fold angle at which every crease must be found, in nine of ten runs, degrees.
    pub found_deg: f64,
    /// Mean error of the final lines, degrees and metres.
    pub line: (f64, f64),
}

impl Summary {
    /// Runs a scene once per seed. Seeds of `Random` and `Wave` scenes choose the scene, too.
    pub fn run(
        kind: fn(u64) -> SceneKind,
        config: &CreaseConfig,
        sheet: &SheetGrid,
        sigma_m: f64,
        seeds: impl Iterator<Item = u64>,
    ) -> Result<Self, FoldError> {
        let side_m = sheet.size_m[0];
        let (mut scores, mut facets) = (Vec::new(), 1);
        for seed in seeds {
            let scene = Scene::new(kind(seed), sheet, 1)?;
            facets = scene.facets;
            let mut noise = Noise::new(sheet, sigma_m, WHITE_SHARE, seed);
            let mut finder = CreaseFinder::new(config, sheet);
            scores.push(score(&scene, &mut finder, &mut noise, |_, _| 1.0));
        }
        Ok(Self { kind: kind(0), sigma_m, side_m, facets, scores })
    }

    /// Fold angle at which the last of a group's creases was found: median, ninth of ten, worst,
    /// degrees; infinite where it never was.
    pub fn found_deg(&self, group: usize) -> [f64; 3] {
        let found = |score: &Score| score.found_deg[group].unwrap_or(f64::INFINITY);
        let mut all: Vec<f64> = self.scores.iter().map(found).collect();
        all.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let place = (share * all.len() as f64).ceil() as usize;
            all[place.clamp(1, all.len()) - 1]
        };
        [at(0.5), at(0.9), at(1.0)]
    }

    /// Groups of creases that fold together.
    pub fn groups(&self) -> usize {
        self.scores.first().map_or(0, |score| score.found_deg.len())
    }

    /// Mean of a figure over the runs.
    pub fn mean(&self, figure: impl Fn(&Score) -> f64) -> f64 {
        self.scores.iter().map(figure).sum::<f64>() / self.scores.len() as f64
    }

    /// Runs whose facets are not the true ones at the end, or that ever had more than that.
    pub fn wrong_facets(&self) -> usize {
        self.scores.iter().filter(|score| score.facets != [self.facets; 2]).count()
    }

    /// What must be reached at this noise; `None` where nothing is asked.
    ///
    /// Source: `../shared/design/creases.md`, "What to reach", which is for 2 and 4 mm.
    pub fn goals(&self) -> Option<Goals> {
        let relative = self.sigma_m / self.side_m * SIDE_M;
        let strong = match relative {
            s if (s - 2e-3).abs() < 1e-6 => 0,
            s if (s - 4e-3).abs() < 1e-6 => 1,
            _ => return None,
        };
        let found_deg = match self.kind {
            SceneKind::Diagonal | SceneKind::Book | SceneKind::Oblique | SceneKind::Random(_) => {
                [40.0, 60.0]
            }
            SceneKind::SecondHalf | SceneKind::Squash => [50.0, 80.0],
            SceneKind::Accordion => [60.0, 85.0],
            SceneKind::Blintz => [90.0, 120.0],
            SceneKind::Wave(_) => [f64::INFINITY; 2],
            SceneKind::SquareBase | SceneKind::BlintzInTurn | SceneKind::SoftFold => return None,
        };
        let line = [(0.4, 0.4e-3), (0.8, 0.6e-3)][strong];
        let scale = self.side_m / SIDE_M;
        Some(Goals { found_deg: found_deg[strong], line: (line.0, line.1 * scale) })
    }

    /// What misses the goals; empty where all are reached or nothing is asked.
    pub fn misses(&self) -> Vec<String> {
        let Some(goals) = self.goals() else { return Vec::new() };
        let mut misses = Vec::new();
        let wrong = self.wrong_facets();
        if wrong > 0 {
            misses.push(format!("wrong facets in {wrong} of {} runs", self.scores.len()));
        }
        for group in 0..self.groups() {
            let [_, nine_of_ten, _] = self.found_deg(group);
            if nine_of_ten > goals.found_deg {
                misses.push(format!(
                    "crease {group} found by {nine_of_ten:.0} instead of {:.0} degrees",
                    goals.found_deg
                ));
            }
        }
        let flips = self.mean(|score| score.flips);
        if flips >= FLIPS_MAX {
            misses.push(format!("{:.3} % of labels flip in a step", 100.0 * flips));
        }
        let line = [self.mean(|score| score.line_deg), self.mean(|score| score.line_m)];
        if self.groups() > 0 && !(line[0] <= goals.line.0 && line[1] <= goals.line.1) {
            misses.push(format!("line off by {:.2} degrees, {:.2} mm", line[0], 1e3 * line[1]));
        }
        misses
    }
}
