//! Where the cameras' world lies in the robot's, learnt from the grippers and from the table.
//!
//! Calibrated cameras stand some tenths of a millimetre, or a few millimetres, beside where they
//! are said to; what is common to all of them nothing in their images shows. Two things that the
//! robot's world knows do. The material point that a gripper holds lies where it is held, and the
//! facet that the point belongs to, fitted to its targets away from the gripper, says where the
//! cameras see it. And what lies flat and undermost lies on the table, which tells of height
//! alone. The mean of the difference over many steps moves all targets.

use crate::grips::Grip;
use orime_creases::{FacetFrame, Folds};
use orime_geometry::nalgebra::Vector3;

/// Nodes that are trusted less than this do not tell where a facet is.
const SEEN: f32 = 0.3;
/// Fewest such nodes of a facet that do.
const SEEN_MIN: usize = 12;
/// A facet whose targets lie farther from a plane than this tells nothing, metres (r.m.s.).
const RESIDUAL_MAX_M: f64 = 0.5e-3;
/// … and tells nothing about the table, which is flat.
const FLAT_MAX_M: f64 = 0.7e-3;
/// Cosine of the angle to the table from which on a facet does not lie on it, about 2°.
const LEVEL_COSINE: f64 = 0.9994;
/// Facets this much higher than the lowest lie on others, metres.
const UNDERMOST_M: f64 = 0.5e-3;
/// A difference beyond this is no calibration's: the sheet has slipped, or is held in the air,
/// metres.
const DIFFERENCE_MAX_M: f64 = 0.01;
const HEIGHT_MAX_M: f64 = 4e-3;
/// Words that the mean reaches back to.
const WORDS: f64 = 180.0;
/// Words that speak for cameras which stand as they are calibrated: the first are heard with
/// caution.
const WORDS_BEFORE: f64 = 10.0;

/// What was learnt.
#[derive(Debug, Clone, Default)]
pub(crate) struct Alignment {
    offset_m: Vector3<f64>,
    /// Along x, y and z.
    words: [f64; 3],
    seen: Vec<u32>,
    /// Height and number of seen nodes of each facet that may lie on the table.
    lying: Vec<(f64, f64)>,
}

/// What the cameras see at one instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen<'a> {
    pub folds: &'a Folds,
    /// As many as the sheet has nodes, or nothing is learnt.
    pub targets_m: &'a [[f32; 3]],
    pub confidence: &'a [f32],
}

impl Seen<'_> {
    fn is_whole(&self) -> bool {
        let nodes = self.folds.sheet().len();
        self.targets_m.len() == nodes && self.confidence.len() == nodes
    }
}

impl Alignment {
    /// How far what the cameras see is to be moved, world frame, metres.
    pub fn offset_m(&self) -> [f32; 3] {
        self.offset_m.cast::<f32>().into()
    }

    /// Learns from what holds the sheet at that instant.
    pub fn learn_grips(&mut self, grips: &[Grip], seen: &Seen<'_>) {
        if !seen.is_whole() {
            return;
        }
        for grip in grips.iter().filter(|grip| grip.is_on(seen.folds.sheet())) {
            let facet = seen.folds.facet_at(grip.uv_m);
            let Some(frame) = self.frame(facet, seen) else { continue };
            let seen_m = frame.position_m(grip.uv_m).coords;
            let difference = Vector3::from(grip.position_m) - seen_m;
            let is_sound = frame.residual_m < RESIDUAL_MAX_M
                && (difference - self.offset_m).norm() < DIFFERENCE_MAX_M;
            if is_sound {
                (0..3).for_each(|axis| self.hear(axis, difference[axis]));
            }
        }
    }

    /// Learns from what lies on the table, of that height, metres. Facets that are held may lie
    /// above it.
    pub fn learn_table(&mut self, height_m: f64, grips: &[Grip], seen: &Seen<'_>) {
        if !seen.is_whole() {
            return;
        }
        let folds = seen.folds;
        let held = |facet: usize| {
            let on = |grip: &&Grip| grip.is_on(folds.sheet());
            grips.iter().filter(on).any(|grip| folds.facet_at(grip.uv_m) == facet)
        };
        self.lying.clear();
        for facet in (0..folds.facets().len()).filter(|facet| !held(*facet)) {
            let Some(frame) = self.frame(facet, seen) else { continue };
            let seen_m = frame.center_m.z;
            let is_sound = frame.residual_m < FLAT_MAX_M
                && frame.normal.z.abs() > LEVEL_COSINE
                && (height_m - seen_m - self.offset_m.z).abs() < HEIGHT_MAX_M;
            if is_sound {
                self.lying.push((seen_m, self.seen.len() as f64));
            }
        }
        let lowest_m = self.lying.iter().map(|(seen_m, _)| *seen_m).fold(f64::INFINITY, f64::min);
        self.lying.retain(|(seen_m, _)| *seen_m < lowest_m + UNDERMOST_M);
        let nodes: f64 = self.lying.iter().map(|(_, nodes)| nodes).sum();
        let sum_m: f64 = self.lying.iter().map(|(seen_m, nodes)| seen_m * nodes).sum();
        if nodes > 0.0 {
            self.hear(2, height_m - sum_m / nodes);
        }
    }

    /// Where a facet is seen, if enough of it is.
    fn frame(&mut self, facet: usize, seen: &Seen<'_>) -> Option<FacetFrame> {
        self.seen.clear();
        let members = seen.folds.members(facet).iter().copied();
        self.seen.extend(members.filter(|n| seen.confidence[*n as usize] > SEEN));
        let is_enough = self.seen.len() >= SEEN_MIN;
        is_enough.then(|| FacetFrame::fit(seen.folds.sheet(), &self.seen, seen.targets_m))
    }

    fn hear(&mut self, axis: usize, difference_m: f64) {
        let words = &mut self.words[axis];
        *words = (*words + 1.0).min(WORDS);
        self.offset_m[axis] += (difference_m - self.offset_m[axis]) / (*words + WORDS_BEFORE);
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
        for _ in 0..1000 {
            let confidence = &vec![confidence; targets_m.len()];
            alignment.learn_grips(grips, &Seen { folds: &folds, targets_m, confidence });
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
        let seen = Seen { folds: &folds, targets_m: &seen_m(), confidence: &[1.0; 625] };
        alignment.learn_grips(&held(0.15), &seen);
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
    /// The flat sheet, whose half beyond u = 0.075 is folded over and lies so much higher; the
    /// rest at `OFF_M`, turned about y by an angle.
    fn lying(folds: &mut Folds, gap_m: f32, turn_rad: f32) -> Vec<[f32; 3]> {
        folds.split(0, &orime_creases::Line::through([0.075, 0.0], [0.075, 0.15])).unwrap();
        let place = |[u, v]: [f64; 2]| {
            let over = u > 0.075;
            let x = if over { 0.15 - u } else { u } as f32;
            let z = if over { gap_m } else { 0.0 } + x * turn_rad;
            [x - OFF_M[0], v as f32 - OFF_M[1], z - OFF_M[2]]
        };
        sheet().uv_m().map(place).collect()
    }

    fn learnt_height(gap_m: f32, turn_rad: f32, grips: &[Grip]) -> [f32; 3] {
        let (mut alignment, mut folds) = (Alignment::default(), Folds::flat(&sheet()));
        let targets_m = lying(&mut folds, gap_m, turn_rad);
        let seen = Seen { folds: &folds, targets_m: &targets_m, confidence: &[1.0; 625] };
        for _ in 0..1000 {
            alignment.learn_table(0.0, grips, &seen);
        }
        alignment.offset_m()
    }

    #[test]
    fn what_lies_undermost_lies_on_the_table() {
        let height = |gap_m: f32| learnt_height(gap_m, 0.0, &[]);
        for gap_m in [0.0008, 0.001, 0.05] {
            let [x, y, z] = height(gap_m);
            assert_eq!([x, y], [0.0; 2], "the table says nothing about where on it");
            assert!((z - OFF_M[2]).abs() < 2e-5, "{z} for {gap_m}");
        }
        assert_eq!(learnt_height(0.05, 0.1, &[]), [0.0; 3], "leans");
        assert_eq!(learnt_height(0.05, 0.0, &held(0.0)), height(0.05), "the flap is held");
        let base = [Grip { uv_m: [0.01, 0.01], position_m: [0.0; 3] }];
        assert_eq!(learnt_height(0.05, 0.0, &base), [0.0; 3], "held in the air");
        assert_eq!(learnt_height(f32::NAN, f32::NAN, &[]), [0.0; 3], "not finite");
    }
}
