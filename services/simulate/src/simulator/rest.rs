//! What proves an effect, or all of them, idle.

use super::{Pulls, Simulator};

/// A frame that moves no node further than this changes nothing, metres.
const STILL_M: f32 = 1e-6;
/// Frames in a row that must have changed nothing before the sheet sleeps.
const STILL_FRAMES: u32 = 3;

/// Whether the sheet is at rest, and what it rests under.
#[derive(Debug, Clone, Default)]
pub(super) struct Rest {
    still_frames: u32,
    dt_s: f64,
    targets_m: Vec<[f32; 3]>,
    confidence: Vec<f32>,
}

impl Rest {
    /// The sheet may move again.
    pub fn wake(&mut self) {
        self.still_frames = 0;
    }

    /// Notes how far the frame moved any node.
    pub fn note(&mut self, moved_m: f32) {
        self.still_frames = if moved_m < STILL_M { self.still_frames + 1 } else { 0 };
    }

    /// Whether nothing has moved for some frames and nothing new pulls: the same frame again
    /// would change nothing.
    pub fn sleeps(&mut self, dt_s: f64, pulls: Pulls<'_>) -> bool {
        if self.still_frames == 0 {
            return false;
        }
        // Targets without trust may change as they like.
        let counts = pulls.confidence.iter().any(|trust| *trust != 0.0);
        let known: (&[[f32; 3]], &[f32]) = (&self.targets_m, &self.confidence);
        let same = if counts {
            dt_s == self.dt_s && known == (pulls.targets_m, pulls.confidence)
        } else {
            dt_s == self.dt_s && self.confidence.is_empty()
        };
        if !same {
            self.dt_s = dt_s;
            self.targets_m.clear();
            self.confidence.clear();
            if counts {
                self.targets_m.extend_from_slice(pulls.targets_m);
                self.confidence.extend_from_slice(pulls.confidence);
            }
            self.still_frames = 0;
        }
        self.still_frames >= STILL_FRAMES
    }
}

impl Simulator {
    /// Whether a node may come as low as the table in this frame.
    pub(super) fn table_is_near(&self, table_m: f32, frame_s: f32) -> bool {
        // Links and facets do not throw a node further than a spacing below all of that.
        let spacing_m = self.folds.sheet().spacing_m().into_iter().fold(0.0, f64::max) as f32;
        self.solver.lowest_m(frame_s) < table_m + spacing_m
    }

    /// Whether every node lies so near to one flat, unstretched sheet that no two parts can touch,
    /// and no target is so far away that this could change within a frame.
    pub(super) fn is_flat(&self) -> bool {
        let spacing_m = self.folds.sheet().spacing_m().into_iter().fold(f64::INFINITY, f64::min);
        let apart_m = 0.25 * spacing_m as f32;
        self.solver.unflat_m() < apart_m && self.target_distance_m() < apart_m
    }

    /// Largest distance between a node and its target, metres.
    fn target_distance_m(&self) -> f32 {
        let Some(targets) = self.solver.targets.as_ref().filter(|t| t.count > 0) else {
            return 0.0;
        };
        let confidence = targets.confidence.rows();
        let pulled = self.solver.layout.places().filter(|place| confidence[*place] > 0.0);
        let squared_m2 = pulled.map(|place| {
            let way = |k: usize| targets.at_m[k].rows()[place] - self.solver.x[k].rows()[place];
            (0..3).map(|k| way(k) * way(k)).sum::<f32>()
        });
        squared_m2.fold(0.0, f32::max).sqrt()
    }
}
