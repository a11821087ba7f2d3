//! The `[simulate]` section of a set.

use crate::effect::Effect;
use crate::simulator::FRAME_S_NOMINAL;
use crate::solver::crease::Plastic;
use orime_contact::{ContactConfig, ContactParams};
use orime_creases::CreaseConfig;
use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

/// The `[simulate]` section of a set. The solver is built from the effects that it names, and from
/// nothing else; the section of an effect that is not named has no effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SimulateParams {
    /// Substeps per frame. Stretch falls about with their square, cost grows with them.
    /// Default 20.
    pub substeps: u32,
    /// Where the targets are further away than this per substep (twice the root mean square over
    /// all nodes), a frame gets two or four times as many substeps. 0 never does.
    /// Default 0.00025 metres.
    pub substep_motion_m: f64,
    /// Where the substeps run. Default `cpu`, whose results repeat bit for bit on any machine.
    pub backend: Backend,
    /// What acts on the sheet. Default: stretch, shear, bend, damping, air_drag, facets, grippers,
    /// track and self_contact.
    pub effects: Vec<Effect>,
    /// Links between neighbours along u and v.
    pub stretch: ComplianceParams,
    /// Links between neighbours along the cells' diagonals.
    pub shear: ComplianceParams,
    /// Resistance to bending.
    pub bend: BendParams,
    /// Creases that remember how far they were folded.
    pub crease: CreaseParams,
    /// Damping of the links.
    pub damping: DampingParams,
    /// Gravity.
    pub gravity: GravityParams,
    /// Air.
    pub air_drag: AirDragParams,
    /// The table.
    pub table: TableParams,
    /// Stiff parts between creases.
    pub facets: FacetsParams,
    /// What holds the sheet.
    pub grippers: GrippersParams,
    /// The pull of the targets.
    pub track: TrackParams,
    /// The prediction of the next pose.
    pub predict: PredictParams,
    /// How fold lines are found.
    pub folds: orime_creases::CreaseParams,
    /// How layers keep apart.
    pub self_contact: ContactParams,
}

/// Where the substeps run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Backend {
    /// Here or on the graphics processor, whichever a short measurement at the start finds faster.
    /// Results differ in rounding between the two.
    Auto,
    /// Here.
    #[default]
    Cpu,
    /// On the graphics processor; an error without one.
    Gpu,
}

/// `[simulate.stretch]` and `[simulate.shear]`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ComplianceParams {
    /// Compliance of a link, m/N. 0 is inextensible (paper). Default 0.
    pub compliance_m_per_n: f64,
}

/// `[simulate.bend]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BendParams {
    /// What resists. Default `links`.
    pub kind: BendKind,
    /// Links: skip links reach nodes 2 … `reach` grid steps away, along the axes and the diagonals.
    /// Default 2.
    pub reach: u32,
    /// Links: their compliance, m/N: how willingly the sheet bends. Small values keep it smooth
    /// and make it refuse a sharp fold. Default 100.
    pub compliance_m_per_n: f64,
    /// Hinge: flexural rigidity, N·m, whatever the grid's spacing. Copy paper has 2e-4 to 5e-4,
    /// cloth 1e-6 to 1e-5. Default 0.0002.
    pub rigidity_n_m: f64,
}

/// What resists bending.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BendKind {
    /// The paper's: skip links to nodes some steps away, which a bend would shorten.
    #[default]
    Links,
    /// Hinges between neighbouring cells and the cells' twist, as in a thin plate that rests flat.
    Hinge,
}

/// `[simulate.damping]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DampingParams {
    /// XPBD's form, or the one that the paper prints. Default `xpbd`.
    pub kind: DampingKind,
    /// Damping time of the links, s: XPBD's `β/α` as one time scale, so that
    /// `γ = time_s / dt`. Default 0.0005.
    pub time_s: f64,
}

/// Which damping.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DampingKind {
    /// Damps the relative motion of a link's ends: conserves momentum, stable for any time.
    #[default]
    Xpbd,
    /// Damps each end's own motion along the link: slows free flight, and diverges for
    /// γ > ½ + 2α̃m, which is refused, and held down where a frame is shorter.
    Paper,
}

/// `[simulate.crease]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CreaseParams {
    /// Default `hinge`.
    pub kind: CreaseKind,
    /// Hinge: elastic range, radians; beyond it a crease yields. Default 0.06.
    pub yield_rad: f64,
    /// Hinge: how much the elastic range grows per radian that was yielded. Default 0.
    pub hardening: f64,
    /// Hinge: share of the way back to its rest angle in a substep. Default 0.02.
    pub stiffness: f64,
    /// Paper and everywhere: elastic range of a link, as a strain. Default 0.02.
    pub yield_strain: f64,
}

/// How creases yield.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CreaseKind {
    /// A rest angle per crease, which yields: knows mountain from valley and holds to 180°.
    #[default]
    Hinge,
    /// The paper's: skip and diagonal links across a crease stay, and their rest lengths yield.
    Paper,
    /// The same of all links, not localised: what the paper argues against.
    Everywhere,
}

impl CreaseParams {
    /// What the solver needs of it.
    pub(crate) fn plastic(&self) -> Plastic {
        let yields_at = match self.kind {
            CreaseKind::Hinge => self.yield_rad,
            CreaseKind::Paper | CreaseKind::Everywhere => self.yield_strain,
        };
        Plastic { yields_at, hardening: self.hardening, stiffness: self.stiffness }
    }
}

/// `[simulate.gravity]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GravityParams {
    /// Acceleration along world −z, m/s². Default 9.81; tracked targets already carry its
    /// effect, so that the effect itself is not named by default.
    pub acceleration_m_per_s2: f64,
}

/// `[simulate.air_drag]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AirDragParams {
    /// Share of the velocity that is lost per second to the air, 1/s. Default 12.
    pub per_s: f64,
}

/// `[simulate.table]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TableParams {
    /// Height of the table, world z, metres: no node goes below. Default 0.
    pub height_m: f64,
    /// Coulomb friction: share of the way into the table by which a node's way along it is
    /// shortened. Default 0.
    pub friction: f64,
    /// Learn from what lies undermost how much too high or low the cameras as a whole see the
    /// sheet, and move what they see. For a table without anything else on it. Default true.
    pub align_cameras: bool,
}

/// `[simulate.facets]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FacetsParams {
    /// How far a facet's targets may lie off a rigid pose (rms), as a fraction of the sheet, before
    /// the facet gives way to half: a crease can only be found where the sheet may bend. Default
    /// 0.005 (0.75 mm on 0.15 m).
    pub bend_tolerance: f64,
    /// Share of the way to its facet's rigid pose that a node goes in a substep. Paper hardly
    /// bends between creases (0.3), cloth does (0.01). A sheet of one facet is left alone.
    /// Default 0.3.
    pub strength: f64,
}

/// `[simulate.grippers]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GrippersParams {
    /// Share of the way to where it is held that a grasped point goes in a substep. 1 follows the
    /// gripper exactly, its errors included. Default 0.8.
    pub strength: f64,
    /// Stretch beside a grasped point at which it slips from the gripper. Small values hold little
    /// weight, and follow a gripper that starts suddenly late. Default 0.5.
    pub strain_max: f64,
    /// Most time between a gripper's pose and the targets' exposure, s. Default 0.05.
    pub age_max_s: f64,
    /// Learn from where grippers hold the sheet how far the cameras as a whole stand beside where
    /// their calibration says, and move what they see: states are in the robot's world. Default
    /// true.
    pub align_cameras: bool,
}

/// `[simulate.track]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackParams {
    /// Natural frequency of the targets' springs, Hz: high follows noise, low lags. Default 48.
    pub frequency_hz: f64,
    /// Largest acceleration, m/s²: a far target pulls, it never teleports. Default 400.
    pub acceleration_max_m_per_s2: f64,
    /// Stretch beside a node that leaves nothing of its target's pull, where contact takes part in
    /// the substeps. Large values let targets that contact bars tear at the sheet. Default 0.05.
    pub strain_max: f64,
}

/// `[simulate.predict]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PredictParams {
    /// Share of the last motion that goes on, every facet's as that of a rigid body. Default 0.8.
    pub momentum: f64,
    /// Share of the way back to its extrapolated place that a node goes in a substep. Default
    /// 0.15.
    pub hold: f64,
    /// Substeps that the links, facets and grippers get. Default 12.
    pub substeps: u32,
    /// States that are published between two frames, evenly spaced, each a prediction for its
    /// own instant; in realtime only. Each costs about what the prediction of a step does.
    /// Default 0, 16 at most.
    pub per_frame: u32,
}

impl Default for SimulateParams {
    fn default() -> Self {
        use Effect::{
            AirDrag, Bend, Damping, Facets, Grippers, SelfContact, Shear, Stretch, Track,
        };
        Self {
            substeps: 20,
            substep_motion_m: 0.00025,
            backend: Backend::default(),
            effects: vec![
                Stretch,
                Shear,
                Bend,
                Damping,
                AirDrag,
                Facets,
                Grippers,
                Track,
                SelfContact,
            ],
            stretch: ComplianceParams::default(),
            shear: ComplianceParams::default(),
            bend: BendParams::default(),
            crease: CreaseParams::default(),
            damping: DampingParams::default(),
            gravity: GravityParams::default(),
            air_drag: AirDragParams::default(),
            table: TableParams::default(),
            facets: FacetsParams::default(),
            grippers: GrippersParams::default(),
            track: TrackParams::default(),
            predict: PredictParams::default(),
            folds: orime_creases::CreaseParams::default(),
            self_contact: ContactParams::default(),
        }
    }
}

impl Default for BendParams {
    fn default() -> Self {
        Self { kind: BendKind::Links, reach: 2, compliance_m_per_n: 100.0, rigidity_n_m: 2e-4 }
    }
}

impl Default for CreaseParams {
    fn default() -> Self {
        Self {
            kind: CreaseKind::Hinge,
            yield_rad: 0.06,
            hardening: 0.0,
            stiffness: 0.02,
            yield_strain: 0.02,
        }
    }
}

impl Default for DampingParams {
    fn default() -> Self {
        Self { kind: DampingKind::Xpbd, time_s: 0.0005 }
    }
}

impl Default for TableParams {
    fn default() -> Self {
        Self { height_m: 0.0, friction: 0.0, align_cameras: true }
    }
}

impl Default for GravityParams {
    fn default() -> Self {
        Self { acceleration_m_per_s2: 9.81 }
    }
}

impl Default for AirDragParams {
    fn default() -> Self {
        Self { per_s: 12.0 }
    }
}

impl Default for FacetsParams {
    fn default() -> Self {
        Self { strength: 0.3, bend_tolerance: 0.005 }
    }
}

impl Default for GrippersParams {
    fn default() -> Self {
        Self { strength: 0.8, strain_max: 0.5, age_max_s: 0.05, align_cameras: true }
    }
}

impl Default for TrackParams {
    fn default() -> Self {
        Self { frequency_hz: 48.0, acceleration_max_m_per_s2: 400.0, strain_max: 0.05 }
    }
}

impl Default for PredictParams {
    fn default() -> Self {
        Self { momentum: 0.8, hold: 0.15, substeps: 12, per_frame: 0 }
    }
}

impl SimulateParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<SimulateConfig, Vec<Problem>> {
        let Self {
            substeps,
            substep_motion_m,
            backend: _,
            effects,
            stretch,
            shear,
            bend,
            crease,
            damping,
            gravity,
            air_drag,
            table,
            facets,
            grippers,
            track,
            predict,
            folds: _,
            self_contact: _,
        } = self;
        let mut checker = Checker::new();
        for (at, effect) in effects.iter().enumerate() {
            let new = !effects[..at].contains(effect);
            checker.require(new, "effects", effect.name(), "is named twice");
        }
        let mut within = |key: &str, value: f64, low: f64, high: f64, unit: &str| {
            let requirement = format!("must be {low} to {high} {unit}");
            checker.require(low <= value && value <= high, key, value, requirement.trim_end());
        };
        within("substeps", f64::from(*substeps), 1.0, 1000.0, "");
        within("stretch.compliance_m_per_n", stretch.compliance_m_per_n, 0.0, 1e6, "m/N");
        within("shear.compliance_m_per_n", shear.compliance_m_per_n, 0.0, 1e6, "m/N");
        within("bend.reach", f64::from(bend.reach), 2.0, 4.0, "grid steps");
        within("bend.compliance_m_per_n", bend.compliance_m_per_n, 0.0, 1e6, "m/N");
        within("bend.rigidity_n_m", bend.rigidity_n_m, 0.0, 100.0, "N·m");
        within("substep_motion_m", *substep_motion_m, 0.0, 1.0, "m");
        within("crease.yield_rad", crease.yield_rad, 0.0, 4.0, "rad");
        within("crease.hardening", crease.hardening, 0.0, 10.0, "");
        within("crease.stiffness", crease.stiffness, 0.0, 1.0, "");
        within("crease.yield_strain", crease.yield_strain, 0.0, 1.0, "");
        within("damping.time_s", damping.time_s, 0.0, 1.0, "s");
        let acceleration = gravity.acceleration_m_per_s2;
        within("gravity.acceleration_m_per_s2", acceleration, -20.0, 20.0, "m/s²");
        within("air_drag.per_s", air_drag.per_s, 0.0, 1000.0, "1/s");
        within("table.height_m", table.height_m, -1e4, 1e4, "m");
        within("table.friction", table.friction, 0.0, 10.0, "");
        within("facets.strength", facets.strength, 0.0, 1.0, "");
        within("facets.bend_tolerance", facets.bend_tolerance, 1e-5, 1.0, "");
        within("grippers.strength", grippers.strength, 0.0, 1.0, "");
        within("grippers.strain_max", grippers.strain_max, 1e-4, 10.0, "");
        within("grippers.age_max_s", grippers.age_max_s, 0.0, 1.0, "s");
        within("track.frequency_hz", track.frequency_hz, 0.1, 10_000.0, "Hz");
        let acceleration = track.acceleration_max_m_per_s2;
        within("track.acceleration_max_m_per_s2", acceleration, 0.1, 1e6, "m/s²");
        within("track.strain_max", track.strain_max, 1e-4, 10.0, "");
        within("predict.momentum", predict.momentum, 0.0, 1.0, "");
        within("predict.hold", predict.hold, 0.0, 1.0, "");
        within("predict.substeps", f64::from(predict.substeps), 1.0, 1000.0, "");
        within("predict.per_frame", f64::from(predict.per_frame), 0.0, 16.0, "");
        self.check_together(checker)
    }

    /// What depends on several keys, and the sections that are checked elsewhere.
    fn check_together(&self, mut checker: Checker) -> Result<SimulateConfig, Vec<Problem>> {
        let Self { substeps, damping, folds, self_contact, .. } = self;
        if damping.kind == DampingKind::Paper {
            let gamma = damping.time_s * f64::from(*substeps) / FRAME_S_NOMINAL;
            let requirement = "the paper's form diverges where time_s / dt > 1/2 at 30 frames/s; \
                shorten it, or take kind = \"xpbd\"";
            checker.require(gamma <= 0.5, "damping.time_s", damping.time_s, requirement);
        }
        match (folds.check(), self_contact.check()) {
            (Ok(folds), Ok(self_contact)) => {
                checker.finish(|| SimulateConfig { params: self.clone(), folds, self_contact })
            }
            (folds, self_contact) => {
                checker.nested("folds", folds.err().unwrap_or_default());
                checker.nested("self_contact", self_contact.err().unwrap_or_default());
                Err(checker.finish(|| ()).err().unwrap_or_default())
            }
        }
    }
}

/// Checked [`SimulateParams`]: the only form that the simulator accepts.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulateConfig {
    pub(crate) params: SimulateParams,
    pub(crate) folds: CreaseConfig,
    pub(crate) self_contact: ContactConfig,
}

#[cfg(test)]
mod tests;
