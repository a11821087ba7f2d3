//! The hard cases: scenes that make simulators of sheets fail, each with a criterion.
//!
//! Cases 1–22 are those of `../shared/design/simulate.md`, 23–30 what makes Coherent Point Drift
//! fall over (`../shared/design/register.md`), 31–39 what befalls cameras.

mod layers;
mod play;
mod registration;
mod shapes;
mod solver;
mod steadiness;
mod vision;

use serde::Serialize;

/// What a case came to; a case may have several criteria.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// Number of the case.
    pub case: u32,
    /// What was tried.
    pub name: String,
    /// What it has to come to.
    pub criterion: String,
    /// What it came to.
    pub measured: String,
    /// Whether that is enough.
    pub passed: bool,
}

/// All outcomes of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// How many criteria held.
    pub passed: usize,
    /// How many did not.
    pub failed: usize,
    /// Each of them.
    pub cases: Vec<Outcome>,
}

type Run = fn(u64) -> Vec<Outcome>;

/// Every case: its number, and what runs it from a seed.
const CASES: [(u32, Run); 42] = [
    (1, solver::hangs),
    (2, solver::coincident_nodes),
    (3, solver::mass_ratio),
    (4, solver::infinite_masses),
    (5, solver::one_substep),
    (6, solver::pauses),
    (7, layers::teleport),
    (8, solver::not_finite),
    (9, solver::degenerate_triangles),
    (10, layers::two_layers),
    (10, layers::four_layers),
    (10, layers::pleats),
    (10, layers::eight_layers),
    (11, layers::press),
    (12, layers::crumple),
    (13, solver::grippers_apart),
    (14, steadiness::far_away),
    (15, steadiness::long_run),
    (16, steadiness::free_flight),
    (17, steadiness::damping),
    (18, layers::on_off_on),
    (19, steadiness::fold_and_release),
    (20, layers::slam),
    (21, steadiness::threads),
    (22, steadiness::effects_off),
    (23, registration::not_finite),
    (24, registration::empty),
    (25, registration::far_away),
    (26, registration::model_equals_cloud),
    (27, registration::coincident_points),
    (28, registration::variance),
    (29, registration::duplicate_nodes),
    (30, registration::scale),
    (31, vision::black),
    (32, vision::white),
    (33, vision::saturated),
    (34, vision::no_depth),
    (35, vision::one_pixel),
    (36, vision::two_sheets),
    (37, vision::gone_and_back),
    (38, vision::out_of_order),
    (39, vision::moving_camera),
];

/// Numbers of all cases.
pub fn numbers() -> impl Iterator<Item = u32> {
    CASES.iter().map(|(number, _)| *number)
}

/// Runs one case, or all, from a seed; `told` hears each outcome as it comes.
pub fn run(case: Option<u32>, seed: u64, mut told: impl FnMut(&Outcome)) -> Verdict {
    let mut cases = Vec::new();
    for (_, run) in CASES.iter().filter(|(number, _)| case.is_none_or(|case| case == *number)) {
        for outcome in run(seed) {
            told(&outcome);
            cases.push(outcome);
        }
    }
    let passed = cases.iter().filter(|outcome| outcome.passed).count();
    Verdict { passed, failed: cases.len() - passed, cases }
}

/// An outcome, put together.
fn outcome(
    case: u32,
    name: impl Into<String>,
    criterion: &str,
    measured: String,
    passed: bool,
) -> Outcome {
    Outcome { case, name: name.into(), criterion: criterion.into(), measured, passed }
}

/// Splitmix64: seeded, the same everywhere.
#[derive(Debug, Clone)]
struct Random(u64);

impl Random {
    /// −1 to 1.
    fn symmetric(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}
