//! Where the cameras' world lies in the robot's, learnt from the grippers.
//!
//! Calibrated cameras stand some tenths of a millimetre, or a few millimetres, beside where they
//! are said to; what is common to all of them nothing in their images shows. A gripper whose pose
//! the robot knows does: the material point that it holds lies where it is held, and the facet that
//! the point belongs to, fitted to its targets away from the gripper, says where the cameras see
//! it. The mean of the difference over many steps moves all targets.

use crate::grips::Grip;
use orime_creases::{FacetFrame, Folds};
use orime_geometry::nalgebra::Vector3;

/// Nodes that are trusted less than this do not tell where a facet is.
const SEEN: f32 = 0.3;
/// Fewest such nodes of a facet that do.
const SEEN_MIN: usize = 12;
/// A facet whose targets lie farther from a plane than this tells nothing, metres (r.m.s.).
const RESIDUAL_MAX_M: f64 = 1.5e-3;
/// A difference beyond this is no calibration's: the sheet has slipped, metres.
const DIFFERENCE_MAX_M: f64 = 0.01;
/// Words on grips that the mean reaches back to.
const WORDS: f64 = 60.0;
/// Words that speak for cameras which stand as they are calibrated: the first of a gripper are
/// heard with caution.
const WORDS_BEFORE: f64 = 10.0;

/// What was learnt.
#[derive(Debug, Clone, Default)]
pub(crate) struct Alignment {
    offset_m: Vector3<f64>,
    words: f64,
    seen: Vec<u32>,
}

impl Alignment {
    /// How far what the cameras see is to be moved, world frame, metres.
    pub fn offset_m(&self) -> [f32; 3] {
        self.offset_m.cast::<f32>().into()
    }

    /// Learns from targets as the cameras see them and what holds the sheet at that instant.
    pub fn learn(
        &mut self,
        grips: &[Grip],
        folds: &Folds,
        targets_m: &[[f32; 3]],
        confidence: &[f32],
    ) {
        if targets_m.len() != folds.sheet().len() || confidence.len() != targets_m.len() {
            return;
        }
        for grip in grips.iter().filter(|grip| grip.is_on(folds.sheet())) {
            let facet = folds.facet_at(grip.uv_m);
            self.seen.clear();
            let members = folds.members(facet).iter().copied();
            self.seen.extend(members.filter(|n| confidence[*n as usize] > SEEN));
            if self.seen.len() < SEEN_MIN {
                continue;
            }
            let frame = FacetFrame::fit(folds.sheet(), &self.seen, targets_m);
            let seen_m = frame.position_m(grip.uv_m).coords;
            let difference = Vector3::from(grip.position_m) - seen_m;
            let is_sound = frame.residual_m < RESIDUAL_MAX_M
                && (difference - self.offset_m).norm() < DIFFERENCE_MAX_M;
            if !is_sound {
                continue;
            }
            self.words = (self.words + 1.0).min(WORDS);
            self.offset_m += (difference - self.offset_m) / (self.words + WORDS_BEFORE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use orime_geometry::SheetGrid;

    const OFF_M: [f32; 3] = [0.002, -0.001, 0.0005];

    fn sheet() -> SheetGrid {
        SheetGrid::new([0.15, 0.15], [25, 25])
    }

    /// The flat sheet as cameras see it that stand `OFF_M` beside where they are said to.
    fn seen_m() -> Vec<[f32; 3]> {
        let seen = |[u, v]: [f64; 2]| [u as f32 - OFF_M[0], v as f32 - OFF_M[1], -OFF_M[2]];
        sheet().uv_m().map(seen).collect()
    }

    fn held(x: f64) -> [Grip; 1] {
        [Grip { uv_m: [0.15, 0.15], position_m: [x, 0.15, 0.0] }]
    }

    fn learnt(grips: &[Grip], targets_m: &[[f32; 3]], confidence: f32) -> [f32; 3] {
        let (mut alignment, folds) = (Alignment::default(), Folds::flat(&sheet()));
        for _ in 0..400 {
            alignment.learn(grips, &folds, targets_m, &vec![confidence; targets_m.len()]);
        }
        alignment.offset_m()
    }

    #[test]
    fn what_all_cameras_share_is_found_by_what_is_held() {
        let found = learnt(&held(0.15), &seen_m(), 1.0);
        for (found, off) in found.iter().zip(OFF_M) {
            assert!((found - off).abs() < 2e-5, "{found} for {off}");
        }
        // The first word moves it by a part only.
        let (mut alignment, folds) = (Alignment::default(), Folds::flat(&sheet()));
        alignment.learn(&held(0.15), &folds, &seen_m(), &[1.0; 625]);
        assert!(alignment.offset_m()[0] < 0.1 * OFF_M[0]);
    }

    #[test]
    fn a_sheet_that_slipped_or_is_hidden_or_bent_teaches_nothing() {
        assert_eq!(learnt(&held(0.17), &seen_m(), 1.0), [0.0; 3], "slipped");
        assert_eq!(learnt(&held(0.15), &seen_m(), 0.1), [0.0; 3], "hidden");
        assert_eq!(learnt(&held(0.15), &seen_m()[..7], 1.0), [0.0; 3], "short");
        assert_eq!(learnt(&held(f64::NAN), &seen_m(), 1.0), [0.0; 3], "no place");
        let bent: Vec<[f32; 3]> =
            seen_m().into_iter().map(|[x, y, _]| [x, y, 0.01 * (40.0 * x).sin()]).collect();
        assert_eq!(learnt(&held(0.15), &bent, 1.0), [0.0; 3], "bent");
        let broken = vec![[f32::NAN; 3]; 625];
        assert_eq!(learnt(&held(0.15), &broken, 1.0), [0.0; 3], "not finite");
    }
}
