//! One description of all sequences, for renderer, judge and robot.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::accordion::Accordion;
use crate::facet::{Crease, Facet, FacetPose, Sheet, Stack};
use crate::flaps::{Flap, Flaps};
use crate::grasp::{Grasp, Gripper};
use crate::soft_fold::SoftFold;
use crate::square_base::SquareBase;
use crate::strips::{self, Profile};
use crate::wave::Wave;
use crate::{FoldError, FoldLine, Timing, square_base};

/// How far inside the sheet's edge a flap is held, metres.
const GRASP_M: f64 = 0.008;

/// What moves.
#[derive(Debug, Clone)]
enum Motion {
    Flaps(Flaps),
    SquareBase(Box<SquareBase>),
    Accordion(Accordion),
    SoftFold(SoftFold, Vec<f64>),
    Wave(Wave, Vec<f64>),
}

/// A sheet that is folded on a table. Time is its progress: 0 at the first step, 1 at the last.
///
/// The sheet is cut into convex parts, each with an affine map for every time: exact for folds;
/// where paper bends, chords of the exact surface, which [`Sequence::position_m`] follows.
#[derive(Debug, Clone)]
pub struct Sequence {
    sheet: Sheet,
    motion: Motion,
    world_from_sheet: Isometry3<f64>,
    facets: Vec<Facet>,
    creases: Vec<Crease>,
    stacks: Vec<Stack>,
    grasps: Vec<Grasp>,
    intervals: u64,
}

/// A sequence at one time; room that [`Sequence::update`] writes to.
#[derive(Debug, Clone)]
pub struct Pose {
    progress: f64,
    /// World pose of each part, in the order of [`Sequence::facets`].
    pub facets: Vec<FacetPose>,
    profile: Option<Profile>,
}

impl Sequence {
    /// One flap turns about `line` onto the rest.
    pub fn half_fold(sheet: Sheet, line: FoldLine, turn: Timing) -> Result<Self, FoldError> {
        Self::flaps(sheet, vec![Flap { line, moves: vec![turn] }], 119)
    }

    /// One flap turns about `line` and back; its crease stays.
    pub fn fold_unfold(sheet: Sheet, line: FoldLine) -> Result<Self, FoldError> {
        let turns = [(0.05, 0.52), (0.52, 0.05)];
        let moves =
            turns.map(|(rest_before, rest_after)| Timing { rest_before, rest_after }).to_vec();
        Self::flaps(sheet, vec![Flap { line, moves }], 240)
    }

    /// Both outer quarters along u turn to the middle, one after the other.
    pub fn gate_fold(sheet: Sheet) -> Result<Self, FoldError> {
        let [a, b] = sheet.size_m;
        let quarter_turn = std::f64::consts::FRAC_PI_2;
        let left = FoldLine { point_m: [a / 4.0, b / 2.0], angle_rad: quarter_turn };
        let right = FoldLine { point_m: [a * 0.75, b / 2.0], angle_rad: -quarter_turn };
        Self::flaps(sheet, in_turn(&[left, right]), 200)
    }

    /// All four corners of a square turn to its centre, one after the other.
    pub fn blintz(sheet: Sheet) -> Result<Self, FoldError> {
        let side_m = sheet.check_square("a blintz fold")?;
        let middle = side_m / 2.0;
        let lines = [[middle, 0.0], [side_m, middle], [middle, side_m], [0.0, middle]];
        let lines: Vec<FoldLine> = (0..4)
            .map(|k| {
                // From the middle of one side to that of the next, the corner on the left.
                let ([u, v], to) = (lines[(k + 1) % 4], lines[k]);
                FoldLine { point_m: [u, v], angle_rad: (to[1] - v).atan2(to[0] - u) }
            })
            .collect();
        Self::flaps(sheet, in_turn(&lines), 320)
    }

    /// The square (preliminary) base in 580 steps, as in the paper.
    pub fn square_base(sheet: Sheet) -> Result<Self, FoldError> {
        let side_m = sheet.check_square("a square base")?;
        let base = SquareBase::new(side_m, sheet.thickness_m);
        let (facets, creases) = (base.facets(), base.creases());
        let steps = square_base::STEPS;
        let grasps = base.grasps().into_iter();
        let grasps = grasps.map(|(uv_m, t)| Grasp { uv_m, during: t.map(|t| t / steps) });
        let grasps = grasps.collect();
        let mut sequence =
            Self::new(sheet, Motion::SquareBase(Box::new(base)), facets, steps as u64);
        (sequence.creases, sequence.grasps) = (creases, grasps);
        sequence.stacks = SquareBase::stacks();
        Ok(sequence)
    }

    /// Six pleats across u close together, standing on the table.
    pub fn accordion(sheet: Sheet) -> Result<Self, FoldError> {
        sheet.check()?;
        let (motion, facets, creases) = Accordion::new(&sheet, 6);
        let mut sequence = Self::new(sheet, Motion::Accordion(motion), facets, 160);
        sequence.creases = creases;
        sequence.grasps = sequence.both_ends([0.06, 0.9]);
        Ok(sequence)
    }

    /// A book fold whose bend is a cylinder that shrinks from 30 to 0.5 mm.
    pub fn soft_fold(sheet: Sheet) -> Result<Self, FoldError> {
        sheet.check()?;
        let motion = SoftFold::new(&sheet);
        let cuts_m = motion.cuts_m();
        let facets = strips::facets(&sheet, &cuts_m);
        let (last, crease) = (facets.len() - 1, motion.crease(&sheet, facets.len()));
        let pairs =
            (0..facets.len() / 2).map(|k| Stack { during: [0.92, 1.0], facets: vec![last - k, k] });
        // The strips that are still bent lie on nothing.
        let stacks = pairs.take(facets.len() / 2 - 12).collect();
        let mut sequence = Self::new(sheet, Motion::SoftFold(motion, cuts_m), facets, 240);
        (sequence.creases, sequence.stacks) = (vec![crease], stacks);
        sequence.grasps = sequence.both_ends([0.05, 0.92])[..1].to_vec();
        Ok(sequence)
    }

    /// A wave runs through the sheet and dies; no crease is made.
    pub fn wave(sheet: Sheet) -> Result<Self, FoldError> {
        sheet.check()?;
        let motion = Wave::new(&sheet);
        let cuts_m = motion.cuts_m();
        let facets = strips::facets(&sheet, &cuts_m);
        let mut sequence = Self::new(sheet, Motion::Wave(motion, cuts_m), facets, 200);
        sequence.grasps = sequence.both_ends([0.0, 1.0]);
        Ok(sequence)
    }

    fn flaps(sheet: Sheet, flaps: Vec<Flap>, intervals: u64) -> Result<Self, FoldError> {
        let moves = flaps.iter().map(|flap| flap.moves.clone()).collect::<Vec<_>>();
        let (motion, facets) = Flaps::new(&sheet, flaps)?;
        let mut sequence = Self::new(sheet, Motion::Flaps(motion), facets, intervals);
        for (k, moves) in (1..).zip(moves) {
            let corners = &sequence.facets[k].corners_uv_m;
            let ends_uv_m = [corners[0], corners[1]];
            sequence.creases.push(Crease { ends_uv_m, facets: [0, k] });
            sequence.stacks.push(lying(k, &moves));
            let uv_m = grasp_uv_m(&sheet, corners);
            sequence.grasps.extend(
                moves
                    .iter()
                    .map(|turn| Grasp { uv_m, during: [turn.rest_before, 1.0 - turn.rest_after] }),
            );
        }
        Ok(sequence)
    }

    fn new(sheet: Sheet, motion: Motion, facets: Vec<Facet>, intervals: u64) -> Self {
        let sequence = Self {
            sheet,
            motion,
            world_from_sheet: Isometry3::identity(),
            facets,
            creases: Vec::new(),
            stacks: Vec::new(),
            grasps: Vec::new(),
            intervals,
        };
        sequence.placed([0.0; 2], 0.0)
    }

    /// The middles of the edges u = 0 and u = L.
    fn both_ends(&self, during: [f64; 2]) -> Vec<Grasp> {
        let [a, b] = self.sheet.size_m;
        [GRASP_M, a - GRASP_M].map(|u| Grasp { uv_m: [u, b / 2.0], during }).to_vec()
    }

    /// The same sequence with the flat sheet's centre at `center_m` on the table, turned by
    /// `yaw_rad` about the vertical. At first it is centred on the world's origin, u along x.
    pub fn placed(mut self, center_m: [f64; 2], yaw_rad: f64) -> Self {
        let [a, b] = self.sheet.size_m;
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
        let center = Vector3::new(center_m[0], center_m[1], self.sheet.thickness_m / 2.0);
        let origin = center + turn * Vector3::new(-a / 2.0, -b / 2.0, 0.0);
        self.world_from_sheet = Isometry3::from_parts(Translation3::from(origin), turn);
        self
    }

    /// The unfolded sheet.
    pub fn sheet(&self) -> &Sheet {
        &self.sheet
    }

    /// Steps from progress 0 to 1 at ordinary speed (1×).
    pub fn intervals(&self) -> u64 {
        self.intervals
    }

    /// The parts. They cover the sheet once; in a fold along lines the fixed part comes first.
    pub fn facets(&self) -> &[Facet] {
        &self.facets
    }

    /// The creases; none where paper only bends.
    pub fn creases(&self) -> &[Crease] {
        &self.creases
    }

    /// Which parts lie on which, and when. Nothing is said of other times.
    pub fn stacks(&self) -> &[Stack] {
        &self.stacks
    }

    /// Where the sheet is held, and when.
    pub fn grasps(&self) -> &[Grasp] {
        &self.grasps
    }

    /// The sequence at `progress`.
    pub fn pose(&self, progress: f64) -> Pose {
        let origin = FacetPose::rigid(&Isometry3::identity());
        let mut pose = Pose { progress, facets: vec![origin; self.facets.len()], profile: None };
        self.update(&mut pose, progress);
        pose
    }

    /// Moves `pose`, made by this sequence, to `progress`. Allocates nothing.
    pub fn update(&self, pose: &mut Pose, progress: f64) {
        pose.progress = progress;
        pose.profile = match &self.motion {
            Motion::SoftFold(soft, _) => Some(soft.profile(progress)),
            Motion::Wave(wave, _) => Some(wave.profile(progress)),
            Motion::Flaps(_) | Motion::SquareBase(_) | Motion::Accordion(_) => None,
        };
        match (&self.motion, &pose.profile) {
            (Motion::Flaps(flaps), _) => flaps.pose(progress, &mut pose.facets),
            (Motion::SquareBase(base), _) => base.pose(progress, &mut pose.facets),
            (Motion::Accordion(accordion), _) => accordion.pose(progress, &mut pose.facets),
            (Motion::SoftFold(_, cuts_m) | Motion::Wave(_, cuts_m), Some(profile)) => {
                strips::pose(cuts_m, profile, &mut pose.facets);
            }
            (Motion::SoftFold(..) | Motion::Wave(..), None) => {}
        }
        for facet in &mut pose.facets {
            *facet = facet.moved(&self.world_from_sheet);
        }
    }

    /// World position of a material point's middle surface, metres. Points on a crease belong to
    /// the part that comes first.
    pub fn position_m(&self, pose: &Pose, uv_m: [f64; 2]) -> Point3<f64> {
        if let Some(profile) = &pose.profile {
            let [x, z] = profile.at(uv_m[0]);
            return self.world_from_sheet * Point3::new(x, uv_m[1], z);
        }
        pose.facets[self.facet_at(uv_m)].position_m(uv_m)
    }

    /// The part that a material point belongs to: the first that has it, else the nearest.
    pub fn facet_at(&self, uv_m: [f64; 2]) -> usize {
        let mut best = (0, f64::NEG_INFINITY);
        for (k, facet) in self.facets.iter().enumerate() {
            let inside_m = facet.inside_m(uv_m);
            if inside_m >= -crate::line::ON_LINE_M {
                return k;
            }
            if inside_m > best.1 {
                best = (k, inside_m);
            }
        }
        best.0
    }

    /// Fold angle of a crease, radians: 0 flat, π folded to either side.
    pub fn crease_angle_rad(&self, pose: &Pose, crease: &Crease) -> f64 {
        if let Some(Profile::Bend { turn_rad, .. }) = pose.profile {
            return turn_rad;
        }
        let [a, b] = crease.facets.map(|k| pose.facets[k].normal());
        a.cross(&b).norm().atan2(a.dot(&b))
    }

    /// The grippers that hold the sheet: at most two, in the order of [`Sequence::grasps`].
    pub fn grippers<'a>(&'a self, pose: &'a Pose) -> impl Iterator<Item = Gripper> + 'a {
        let middle_uv_m = self.sheet.size_m.map(|l| l / 2.0);
        let held = self
            .grasps
            .iter()
            .filter(|grasp| grasp.during[0] <= pose.progress && pose.progress < grasp.during[1]);
        held.map(move |grasp| {
            let facet = &pose.facets[self.facet_at(grasp.uv_m)];
            Gripper::holding(grasp.uv_m, middle_uv_m, facet)
        })
    }
}

/// Flaps that turn one after the other, with short rests.
fn in_turn(lines: &[FoldLine]) -> Vec<Flap> {
    let share = 1.0 / lines.len() as f64;
    let flap = |(k, line): (usize, &FoldLine)| {
        let rest_before = share * (k as f64 + 0.1);
        let rest_after = 1.0 - share * (k as f64 + 0.9);
        Flap { line: *line, moves: vec![Timing { rest_before, rest_after }] }
    };
    lines.iter().enumerate().map(flap).collect()
}

/// A flap on the fixed part between its first move and the next one.
fn lying(flap: usize, moves: &[Timing]) -> Stack {
    let until = moves.get(1).map_or(1.0, |back| back.rest_before);
    Stack { during: [1.0 - moves[0].rest_after, until], facets: vec![0, flap] }
}

/// A little inside the flap's corner that is farthest from its crease, or inside the middle of
/// its edge where two are equally far.
fn grasp_uv_m(sheet: &Sheet, corners: &[[f64; 2]]) -> [f64; 2] {
    let [a, b] = [corners[0], corners[1]];
    let [x, y] = [b[0] - a[0], b[1] - a[1]];
    let away = |p: &[f64; 2]| (x * (p[1] - a[1]) - y * (p[0] - a[0])).abs() / x.hypot(y);
    let far_m = corners.iter().map(away).fold(0.0, f64::max);
    let farthest: Vec<&[f64; 2]> = corners.iter().filter(|p| away(p) > far_m - 1e-9).collect();
    let count = farthest.len() as f64;
    let tip = [0, 1].map(|k| farthest.iter().map(|p| p[k]).sum::<f64>() / count);
    [0, 1].map(|k| {
        let inwards = sheet.size_m[k] / 2.0 - tip[k];
        // An edge's middle is held in the middle, a corner along both sides.
        if inwards.abs() < 1e-9 { tip[k] } else { tip[k] + GRASP_M.copysign(inwards) }
    })
}
