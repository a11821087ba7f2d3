//! Folding scenes: exact positions of all nodes, and the creases that are there.

use super::noise::Random;
use orime_geometry::SheetGrid;
use orime_origami::{FoldError, FoldLine, Sequence, Sheet, Timing};
use std::f64::consts::{FRAC_PI_4, PI, TAU};

/// Thickness of the sheet, metres: thin enough that layers count as one plane.
const THICKNESS_M: f64 = 1e-5;
/// Steps at rest before a fold, of the fold, and at rest after it.
const STEPS: [usize; 3] = [8, 90, 15];

/// What happens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SceneKind {
    /// Half fold about the diagonal.
    Diagonal,
    /// Half fold about the middle.
    Book,
    /// Fold about a line 25° off the u axis, 0.17 sides beside the centre.
    Oblique,
    /// Fold about a random line.
    Random(u64),
    /// Two half folds about both diagonals, one after the other.
    SecondHalf,
    /// The square base's first three moves: two half folds, and a flap opened and squashed.
    Squash,
    /// The whole square base.
    SquareBase,
    /// Six panels at once.
    Accordion,
    /// All four corners to the centre at once.
    Blintz,
    /// All four corners to the centre, one after the other.
    BlintzInTurn,
    /// A wave of random direction, length and radius (3 to 5 spacings) that no crease is made in.
    Wave(u64),
    /// A bend of 30 mm radius per 0.15 m that shrinks to a crease.
    SoftFold,
}

/// A crease that is there.
#[derive(Debug, Clone, Copy)]
pub struct TrueCrease {
    /// Creases of one number fold together.
    pub group: usize,
    /// Ends, (u, v), metres.
    pub ends_m: [[f64; 2]; 2],
}

/// Positions and fold angles, step by step.
#[derive(Debug, Clone)]
pub struct Scene {
    /// What happens.
    pub kind: SceneKind,
    /// The nodes.
    pub sheet: SheetGrid,
    /// World positions of the nodes at each step, metres.
    pub positions_m: Vec<Vec<[f64; 3]>>,
    /// Fold angle of each group at each step, radians.
    pub angles_rad: Vec<Vec<f64>>,
    /// All creases that are folded sooner or later.
    pub creases: Vec<TrueCrease>,
    /// Rigid parts at the end.
    pub facets: usize,
}

impl Scene {
    /// Plays a scene, every `speed`-th step of it.
    pub fn new(kind: SceneKind, sheet: &SheetGrid, speed: usize) -> Result<Self, FoldError> {
        let size_m = sheet.size_m;
        let paper = Sheet { size_m, thickness_m: THICKNESS_M };
        let total = STEPS.iter().sum::<usize>() as f64;
        let turn =
            Timing { rest_before: STEPS[0] as f64 / total, rest_after: STEPS[2] as f64 / total };
        let single = |line: FoldLine| -> Result<Scene, FoldError> {
            let sequence = Sequence::half_fold(paper, line, turn)?;
            Ok(Self::play(kind, sheet, &sequence, &[0], total as usize, 1.0, speed))
        };
        let spokes = [0, 2, 1, 3, 0, 3, 1, 2];
        match kind {
            SceneKind::Diagonal => single(FoldLine::diagonal(size_m)),
            SceneKind::Book => single(FoldLine::book(size_m)),
            SceneKind::Oblique => single(oblique(size_m)),
            SceneKind::Random(seed) => single(random_line(size_m, seed)),
            SceneKind::SecondHalf => {
                let sequence = Sequence::square_base(paper)?;
                Ok(Self::play(kind, sheet, &sequence, &spokes, 200, 200.0 / 580.0, speed))
            }
            SceneKind::Squash => {
                let sequence = Sequence::square_base(paper)?;
                Ok(Self::play(kind, sheet, &sequence, &spokes, 300, 300.0 / 580.0, speed))
            }
            SceneKind::SquareBase => {
                let sequence = Sequence::square_base(paper)?;
                Ok(Self::play(kind, sheet, &sequence, &spokes, 580, 1.0, speed))
            }
            SceneKind::Accordion => {
                let sequence = Sequence::accordion(paper)?;
                Ok(Self::play(kind, sheet, &sequence, &[0, 1, 2, 3, 4], 107, 1.0, speed))
            }
            SceneKind::BlintzInTurn => {
                let sequence = Sequence::blintz(paper)?;
                Ok(Self::play(kind, sheet, &sequence, &[0, 1, 2, 3], 320, 1.0, speed))
            }
            SceneKind::SoftFold => {
                let sequence = Sequence::soft_fold(paper)?;
                Ok(Self::play(kind, sheet, &sequence, &[0], 240, 1.0, speed))
            }
            SceneKind::Blintz => Self::blintz(kind, sheet, &paper, turn, speed),
            SceneKind::Wave(seed) => Ok(Self::wave(kind, sheet, seed, speed)),
        }
    }

    /// Plays a sequence up to `progress` in `steps` steps; `groups` has one entry per crease.
    fn play(
        kind: SceneKind,
        sheet: &SheetGrid,
        sequence: &Sequence,
        groups: &[usize],
        steps: usize,
        progress: f64,
        speed: usize,
    ) -> Self {
        let mut scene = Self::empty(kind, sheet);
        let creases = sequence.creases();
        let count = groups.iter().max().map_or(0, |g| g + 1);
        let mut pose = sequence.pose(0.0);
        // The end is held as long as single folds are.
        for step in (0..=steps + STEPS[2]).step_by(speed) {
            sequence.update(&mut pose, progress * (step.min(steps) as f64 / steps as f64));
            let at = |uv| sequence.position_m(&pose, uv).coords.into();
            scene.positions_m.push(sheet.uv_m().map(at).collect());
            let mut angles = vec![0.0f64; count];
            for (crease, group) in creases.iter().zip(groups) {
                angles[*group] = angles[*group].max(sequence.crease_angle_rad(&pose, crease));
            }
            scene.angles_rad.push(angles);
        }
        let peak = |g: usize| scene.angles_rad.iter().map(|a| a[g]).fold(0.0, f64::max);
        for (crease, group) in creases.iter().zip(groups) {
            if peak(*group) > 0.1 {
                scene.creases.push(TrueCrease { group: *group, ends_m: crease.ends_uv_m });
            }
        }
        scene.facets = match kind {
            SceneKind::SecondHalf => 4,
            SceneKind::Squash => 6,
            SceneKind::SoftFold => 2,
            _ => sequence.facets().len(),
        };
        scene
    }

    /// Every corner belongs to a half fold of its own; what none of them moves stays.
    fn blintz(
        kind: SceneKind,
        sheet: &SheetGrid,
        paper: &Sheet,
        turn: Timing,
        speed: usize,
    ) -> Result<Self, FoldError> {
        let in_turn = Sequence::blintz(*paper)?;
        let mut flaps = Vec::new();
        for crease in in_turn.creases() {
            let [a, b] = crease.ends_uv_m;
            let angle_rad = (b[1] - a[1]).atan2(b[0] - a[0]);
            flaps.push(Sequence::half_fold(*paper, FoldLine { point_m: a, angle_rad }, turn)?);
        }
        let steps = STEPS.iter().sum::<usize>();
        let groups = [0, 1, 2, 3];
        let mut scenes: Vec<Self> = flaps
            .iter()
            .map(|flap| Self::play(kind, sheet, flap, &[0], steps, 1.0, speed))
            .collect();
        let mut scene = scenes[0].clone();
        for (n, uv) in sheet.uv_m().enumerate() {
            let moving = in_turn.facet_at(uv).saturating_sub(1);
            for (step, x) in scene.positions_m.iter_mut().enumerate() {
                x[n] = scenes[moving].positions_m[step][n];
            }
        }
        scene.angles_rad.iter_mut().for_each(|angles| *angles = vec![angles[0]; 4]);
        scene.creases = scenes
            .drain(..)
            .zip(groups)
            .map(|(other, group)| TrueCrease { group, ..other.creases[0] })
            .collect();
        scene.facets = 5;
        Ok(scene)
    }

    /// Tangent angle A(t)·sin(2π(s/λ − t)) along a random direction; radius λ/2πA.
    fn wave(kind: SceneKind, sheet: &SheetGrid, seed: u64, speed: usize) -> Self {
        let mut random = Random::new(seed ^ 0x5741_5645);
        let side_m = sheet.size_m[0].min(sheet.size_m[1]);
        let spacing_m = sheet.spacing_m().into_iter().fold(0.0, f64::max);
        let radius_m = spacing_m * (3.0 + 2.0 * random.uniform());
        let length_m = side_m * (0.5 + 0.7 * random.uniform());
        let (sin, cos) = (PI * random.uniform()).sin_cos();
        let amplitude = (length_m / (TAU * radius_m)).min(1.2);
        let mut scene = Self::empty(kind, sheet);
        let center = sheet.size_m.map(|l| l / 2.0);
        for step in (0..160).step_by(speed) {
            let rise = (step as f64 / 60.0).min(1.0);
            let grown = amplitude * rise * rise * (3.0 - 2.0 * rise);
            let curve =
                Curve::new(side_m, |s| grown * (TAU * (s / length_m - step as f64 / 80.0)).sin());
            let at = |[u, v]: [f64; 2]| {
                let (s, r) = (
                    (u - center[0]) * cos + (v - center[1]) * sin,
                    (v - center[1]) * cos - (u - center[0]) * sin,
                );
                let [x, z] = curve.at(s);
                [x, r, z]
            };
            scene.positions_m.push(sheet.uv_m().map(at).collect());
            scene.angles_rad.push(Vec::new());
        }
        scene
    }

    fn empty(kind: SceneKind, sheet: &SheetGrid) -> Self {
        Self {
            kind,
            sheet: sheet.clone(),
            positions_m: Vec::new(),
            angles_rad: Vec::new(),
            creases: Vec::new(),
            facets: 1,
        }
    }

    /// Groups of creases.
    pub fn groups(&self) -> usize {
        self.creases.iter().map(|crease| crease.group + 1).max().unwrap_or(0)
    }
}

/// A plane curve by arc length, integrated by Simpson's rule.
struct Curve {
    points: Vec<[f64; 2]>,
    half_m: f64,
}

impl Curve {
    const PIECES: usize = 2000;

    fn new(side_m: f64, tangent_rad: impl Fn(f64) -> f64) -> Self {
        let half_m = side_m * 1.6;
        let step_m = 2.0 * half_m / Self::PIECES as f64;
        let mut points = vec![[0.0; 2]];
        let mut at = [0.0; 2];
        for k in 0..Self::PIECES {
            let start = -half_m + k as f64 * step_m;
            for (place, weight) in [(0.0, 1.0), (0.5, 4.0), (1.0, 1.0)] {
                let (sin, cos) = tangent_rad(start + place * step_m).sin_cos();
                at = [at[0] + cos * weight * step_m / 6.0, at[1] + sin * weight * step_m / 6.0];
            }
            points.push(at);
        }
        Self { points, half_m }
    }

    fn at(&self, s: f64) -> [f64; 2] {
        let place = (s + self.half_m) / (2.0 * self.half_m) * Self::PIECES as f64;
        let k = (place as usize).min(Self::PIECES - 1);
        let part = place - k as f64;
        [0, 1].map(|c| self.points[k][c] * (1.0 - part) + self.points[k + 1][c] * part)
    }
}

fn oblique(size_m: [f64; 2]) -> FoldLine {
    let angle_rad = 25f64.to_radians();
    let (sin, cos) = angle_rad.sin_cos();
    let side_m = size_m[0];
    let point_m = [size_m[0] / 2.0 - 0.17 * side_m * sin, size_m[1] / 2.0 + 0.17 * side_m * cos];
    FoldLine { point_m, angle_rad }
}

/// A line that leaves at least a corner of a third of the side.
fn random_line(size_m: [f64; 2], seed: u64) -> FoldLine {
    let mut random = Random::new(seed ^ 0x4C49_4E45);
    let angle_rad = PI * random.uniform() - FRAC_PI_4;
    let (sin, cos) = angle_rad.sin_cos();
    let off_m = size_m[0] * 0.5 * (random.uniform() - 0.5);
    FoldLine { point_m: [size_m[0] / 2.0 - off_m * sin, size_m[1] / 2.0 + off_m * cos], angle_rad }
}
