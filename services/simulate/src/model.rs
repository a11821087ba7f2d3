//! The sheet as it is followed: the simulator, the fold lines found in its targets, and contact.
//!
//! ```text
//! targets ─► into the robot's world ─► fold lines (facets, creases) ─► facets that bend give way
//!         ─► simulator: substeps ─► contact: no layer in another ─► state
//!                                              prediction ◄────────────┘
//! ```

use crate::alignment::{Alignment, Seen};
use crate::effect::{Effect, Effects};
use crate::grips::Grip;
use crate::params::SimulateConfig;
use crate::simulator::{SimulateReport, Simulator};
use orime_contact::{ContactConfig, ContactReport, FacetContact, GenericContact, NetReport};
use orime_creases::{CreaseFinder, FacetFrame, Folds};
use orime_geometry::SheetGrid;

/// Nodes that are trusted less than this say nothing about whether a facet bends.
const SEEN: f32 = 0.3;
/// Fewest such nodes of a facet that do.
const SEEN_MIN: usize = 6;

/// What one step did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ModelReport {
    /// The simulator's word.
    pub simulate: SimulateReport,
    /// What contact did to the state.
    pub contact: ContactReport,
    /// What the net under it did; `None` for a fresh pose, and without contact.
    pub net: Option<NetReport>,
    /// Effects that the scene names and that proved idle in this step, contact among them.
    pub slept: Effects,
    /// Whether the facets changed.
    pub refolded: bool,
}

/// Contact of a frame.
#[derive(Debug, Clone)]
struct Layers {
    /// Puts facets in their order.
    order: FacetContact,
    /// Holds back what crosses all the same, also where contact by order has settled.
    net: GenericContact,
}

impl Layers {
    fn new(config: &ContactConfig, sheet: &SheetGrid) -> Self {
        Self { order: FacetContact::new(config, sheet), net: GenericContact::new(config, sheet) }
    }
}

/// Whether targets are a pose to be taken over at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NewPose {
    /// They are not: the sheet moves towards them.
    None,
    /// The folded sheet, elsewhere: its folds are kept.
    Moved,
    /// Any pose: what was known of folds is forgotten.
    Fresh,
}

/// The followed sheet.
#[derive(Debug, Clone)]
pub struct SheetModel {
    simulator: Simulator,
    finder: CreaseFinder,
    contact: Option<Layers>,
    /// How far a facet's targets may lie off a rigid pose, metres.
    bend_tolerance_m: f64,
    seen: Vec<u32>,
    shares: Vec<f32>,
    positions_m: Vec<[f32; 3]>,
    /// The state before.
    before_m: Vec<[f32; 3]>,
    predicted_m: Vec<[f32; 3]>,
    expected_m: Vec<[f32; 3]>,
    grips: Vec<Grip>,
    alignment: Alignment,
    /// Whether grippers tell where the cameras' world lies.
    grips_align: bool,
    /// Height of the table where it does, metres.
    table_aligns_m: Option<f64>,
    /// Targets in the robot's world.
    aligned_m: Vec<[f32; 3]>,
    /// The prediction in the cameras' world.
    predicted_for_cameras_m: Vec<[f32; 3]>,
}

impl SheetModel {
    /// A flat sheet, or one of the template's shape, at rest.
    pub fn new(
        config: &SimulateConfig,
        sheet: &SheetGrid,
        density_kg_per_m2: f64,
        rest_m: Option<&[[f32; 3]]>,
    ) -> Self {
        let params = &config.params;
        let side_m = (sheet.size_m[0] + sheet.size_m[1]) / 2.0;
        let has = |effect| params.effects.contains(&effect);
        let has_contact = has(Effect::SelfContact);
        let on_table = has(Effect::Table) && params.table.align_cameras;
        // Contact comes once a frame, after the substeps, wherever these run.
        let mut substeps = config.clone();
        substeps.params.effects.retain(|effect| *effect != Effect::SelfContact);
        let simulator = Simulator::new(&substeps, sheet, density_kg_per_m2, rest_m);
        Self {
            finder: CreaseFinder::new(&config.folds, sheet),
            contact: has_contact.then(|| Layers::new(&config.self_contact, sheet)),
            bend_tolerance_m: params.facets.bend_tolerance * side_m,
            seen: Vec::with_capacity(sheet.len()),
            shares: Vec::new(),
            positions_m: simulator.positions_m().to_vec(),
            before_m: simulator.positions_m().to_vec(),
            predicted_m: simulator.positions_m().to_vec(),
            expected_m: simulator.positions_m().to_vec(),
            grips: Vec::new(),
            alignment: Alignment::default(),
            grips_align: has(Effect::Grippers) && params.grippers.align_cameras,
            table_aligns_m: on_table.then_some(params.table.height_m),
            aligned_m: Vec::with_capacity(sheet.len()),
            predicted_for_cameras_m: simulator.positions_m().to_vec(),
            simulator,
        }
    }

    /// Advances by `dt_s` towards the targets, see [`Simulator::step`], and predicts as far ahead.
    pub fn step(
        &mut self,
        dt_s: f64,
        targets_m: &[[f32; 3]],
        confidence: &[f32],
        reset: bool,
    ) -> ModelReport {
        let pose = if reset { NewPose::Fresh } else { NewPose::None };
        self.step_from(dt_s, targets_m, confidence, pose)
    }

    /// As [`SheetModel::step`], where the targets may also be the pose of the sheet as it is
    /// folded, elsewhere.
    pub fn step_from(
        &mut self,
        dt_s: f64,
        targets_m: &[[f32; 3]],
        confidence: &[f32],
        pose: NewPose,
    ) -> ModelReport {
        let reset = pose != NewPose::None;
        let mut report = ModelReport::default();
        self.align(targets_m, confidence);
        let aligned_m = std::mem::take(&mut self.aligned_m);
        let targets_m = aligned_m.as_slice();
        if pose == NewPose::Fresh {
            self.finder.reset();
        }
        report.refolded = self.finder.step(targets_m, confidence);
        self.simulator.set_folds(self.finder.folds());
        self.soften(targets_m, confidence);
        report.simulate = self.simulator.step(dt_s, targets_m, confidence, reset);
        std::mem::swap(&mut self.before_m, &mut self.positions_m);
        self.positions_m.copy_from_slice(self.simulator.positions_m());
        let folds = self.simulator.folds();
        report.slept = report.simulate.slept;
        let folded = folds.facets().len() > 1;
        if let Some(contact) = &mut self.contact {
            if folded {
                report.contact = contact.order.project(&mut self.positions_m, folds);
            }
            if pose != NewPose::Fresh {
                report.net = Some(contact.net.catch(&self.before_m, &mut self.positions_m));
            }
            let is_caught = report.net.is_some_and(|net| net.blended > 0);
            if report.contact.moved_m > 0.0 || is_caught {
                self.simulator.correct(&self.positions_m);
            }
            if !folded && !is_caught {
                report.slept.insert(Effect::SelfContact);
            }
        }
        // A facet that is split later inherits the order that is known by then.
        if self.finder.folds().facets().len() > 1 {
            self.finder.folds_mut().observe(&self.positions_m);
        }
        self.predicted_m.copy_from_slice(self.simulator.predict(dt_s));
        if let Some(contact) = self.contact.as_mut().filter(|_| folded) {
            contact.order.project(&mut self.predicted_m, self.simulator.folds());
        }
        let offset_m = self.offset_m();
        for (to, from) in self.predicted_for_cameras_m.iter_mut().zip(&self.predicted_m) {
            *to = [0, 1, 2].map(|axis| from[axis] - offset_m[axis]);
        }
        self.aligned_m = aligned_m;
        report
    }

    /// Puts the targets into the robot's world, as far as grippers and table tell where that is.
    fn align(&mut self, targets_m: &[[f32; 3]], confidence: &[f32]) {
        let seen = Seen { folds: self.simulator.folds(), targets_m, confidence };
        if self.grips_align {
            self.alignment.learn_grips(&self.grips, &seen);
        }
        if let Some(height_m) = self.table_aligns_m {
            self.alignment.learn_table(height_m, &self.grips, &seen);
        }
        let offset_m = self.offset_m();
        self.aligned_m.clear();
        let aligned = |x: &[f32; 3]| [0, 1, 2].map(|axis| x[axis] + offset_m[axis]);
        self.aligned_m.extend(targets_m.iter().map(aligned));
    }

    /// What holds the sheet from now on, see [`Simulator::set_grips`].
    pub fn set_grips(&mut self, grips: &[Grip]) {
        self.grips.clear();
        self.grips.extend_from_slice(grips);
        self.simulator.set_grips(grips);
    }

    /// Lines that are about to be folded from now on, beside those of the config: two material
    /// points each, metres.
    pub fn set_plan(&mut self, lines: &[[[f64; 2]; 2]]) {
        self.finder.set_plan(lines);
    }

    /// Where the nodes are expected `ahead_s` after the last step, as [`SheetModel::predicted_m`].
    /// Leaves everything as it is.
    pub fn expect_m(&mut self, ahead_s: f64) -> &[[f32; 3]] {
        self.expected_m.copy_from_slice(self.simulator.predict(ahead_s));
        if self.simulator.folds().facets().len() > 1
            && let Some(contact) = &mut self.contact
        {
            contact.order.project(&mut self.expected_m, self.simulator.folds());
        }
        &self.expected_m
    }

    /// The simulator, to be set up before the first step.
    pub fn simulator_mut(&mut self) -> &mut Simulator {
        &mut self.simulator
    }

    /// Node positions, world frame (the robot's, where grippers or table tell of it), metres, index
    /// order of the sheet.
    pub fn positions_m(&self) -> &[[f32; 3]] {
        &self.positions_m
    }

    /// Where the nodes are expected one step later, same form.
    pub fn predicted_m(&self) -> &[[f32; 3]] {
        &self.predicted_m
    }

    /// How far what the cameras see is moved, since grippers hold the sheet elsewhere or the table
    /// is elsewhere, metres.
    pub fn camera_offset_m(&self) -> f32 {
        self.offset_m().iter().map(|c| c * c).sum::<f32>().sqrt()
    }

    fn offset_m(&self) -> [f32; 3] {
        self.alignment.offset_m()
    }

    /// The prediction where the cameras, as they are calibrated, would see it.
    pub fn predicted_for_cameras_m(&self) -> &[[f32; 3]] {
        &self.predicted_for_cameras_m
    }

    /// Facets, creases and layer order.
    pub fn folds(&self) -> &Folds {
        self.simulator.folds()
    }

    /// The facet or, in the paper's mode, the cluster of every node.
    pub fn clusters(&self) -> &[u8] {
        self.finder.clusters()
    }

    /// A facet gives way where its targets lie off any rigid pose: a crease is about to form there,
    /// and can only be found once the sheet may bend.
    fn soften(&mut self, targets_m: &[[f32; 3]], confidence: &[f32]) {
        let folds = self.simulator.folds();
        self.shares.clear();
        for facet in 0..folds.facets().len() {
            self.seen.clear();
            let members = folds.members(facet).iter().copied();
            // A node without a target, or without a word on it, says nothing.
            let is_seen = |node: &u32| {
                let node = *node as usize;
                node < targets_m.len() && confidence.get(node).is_some_and(|c| *c > SEEN)
            };
            self.seen.extend(members.filter(is_seen));
            let residual_m = if self.seen.len() < SEEN_MIN {
                0.0
            } else {
                FacetFrame::fit(folds.sheet(), &self.seen, targets_m).residual_m
            };
            let ratio = residual_m / self.bend_tolerance_m;
            // NaN, where a target is not finite, changes nothing.
            self.shares.push(if ratio.is_finite() {
                1.0 / (1.0 + ratio.powi(4)) as f32
            } else {
                1.0
            });
        }
        self.simulator.set_facet_shares(&self.shares);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SimulateParams;

    fn model() -> (SheetModel, SheetGrid) {
        let sheet = SheetGrid::new([0.15, 0.15], [25, 25]);
        let config = SimulateParams::default().check().unwrap();
        (SheetModel::new(&config, &sheet, 0.08, None), sheet)
    }

    /// The sheet folded along the middle line by an angle.
    fn folded(sheet: &SheetGrid, angle_rad: f64) -> Vec<[f32; 3]> {
        let fold = |[u, v]: [f64; 2]| {
            let over = (u - 0.075).max(0.0);
            let x = u.min(0.075) + over * angle_rad.cos();
            [x as f32, v as f32, (over * angle_rad.sin()) as f32]
        };
        sheet.uv_m().map(fold).collect()
    }

    #[test]
    fn a_fold_becomes_a_crease_and_the_flap_never_passes_through() {
        let (mut model, sheet) = model();
        let sure = vec![1.0; sheet.len()];
        model.step(1.0 / 30.0, &folded(&sheet, 0.0), &sure, true);
        assert!(model.folds().creases().is_empty());
        for degree in (0..=180).chain([180; 20]) {
            let targets = folded(&sheet, f64::from(degree).to_radians());
            model.step(1.0 / 30.0, &targets, &sure, false);
        }
        let [crease] = model.folds().creases() else { panic!("{:?}", model.folds().creases()) };
        assert!(crease.angle_rad.abs() > 2.9, "{crease:?}");
        for end in crease.ends_m {
            assert!((end[0] - 0.075).abs() < 1e-3, "{crease:?}");
        }
        // The targets of both layers coincide; the flap stays on top, where it came from.
        for (n, uv) in sheet.uv_m().enumerate().filter(|(_, uv)| uv[0] > 0.08) {
            let below = sheet.index(24 - n / 25, n % 25);
            let [above_m, below_m] = [n, below].map(|k| model.positions_m()[k][2]);
            assert!(above_m > below_m, "{uv:?}: {above_m} m over {below_m} m");
        }
    }

    #[test]
    fn a_folded_sheet_that_is_found_elsewhere_keeps_its_folds_and_a_fresh_pose_has_none() {
        let (mut model, sheet) = model();
        let sure = vec![1.0; sheet.len()];
        for degree in 0..=120 {
            let targets = folded(&sheet, f64::from(degree).to_radians());
            model.step(1.0 / 30.0, &targets, &sure, degree == 0);
        }
        assert_eq!(model.folds().creases().len(), 1);
        let away = |x: &[f32; 3]| [x[0] + 0.2, x[1] - 0.1, x[2] + 0.05];
        let elsewhere: Vec<[f32; 3]> = model.positions_m().iter().map(away).collect();
        for (pose, creases) in [(NewPose::Moved, 1), (NewPose::Fresh, 0)] {
            let mut model = model.clone();
            let report = model.step_from(1.0 / 30.0, &elsewhere, &sure, pose);
            assert_eq!(model.folds().creases().len(), creases, "{pose:?}");
            // There is no way from where it was to a fresh pose.
            assert!(pose == NewPose::Moved || report.net.is_none(), "{pose:?}: {report:?}");
            let is_there =
                |(a, b): (&[f32; 3], &[f32; 3])| (0..3).all(|k| (a[k] - b[k]).abs() < 1e-6);
            assert!(model.positions_m().iter().zip(&elsewhere).all(is_there), "{pose:?}");
        }
    }

    #[test]
    fn asking_what_to_expect_changes_nothing() {
        let ((mut asked, sheet), (mut silent, _)) = (model(), model());
        let sure = vec![1.0; sheet.len()];
        for degree in 0..=180 {
            let targets = folded(&sheet, f64::from(degree).to_radians());
            for model in [&mut asked, &mut silent] {
                model.step(1.0 / 30.0, &targets, &sure, degree == 0);
            }
            for share in [0.25, 0.5, 1.0] {
                let expected_m = asked.expect_m(share / 30.0).to_vec();
                // A whole frame ahead is what the state says anyway.
                assert!(share < 1.0 || expected_m == asked.predicted_m());
            }
            assert_eq!(asked.positions_m(), silent.positions_m());
            assert_eq!(asked.predicted_m(), silent.predicted_m());
        }
        assert_eq!(asked.folds().creases().len(), 1);
        let moved = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).any(|k| (a[k] - b[k]).abs() > 1e-5);
        let early_m = asked.expect_m(0.5 / 30.0).to_vec();
        assert!(early_m.iter().zip(asked.positions_m()).any(moved), "it is still on its way");
    }

    #[test]
    fn states_are_in_the_world_of_the_grippers_and_predictions_in_that_of_the_cameras() {
        let (mut model, sheet) = model();
        let sure = vec![1.0; sheet.len()];
        let corner = Grip { uv_m: [0.15, 0.15], position_m: [0.15, 0.15, 0.0] };
        let seen = |x: [f32; 3]| [x[0] + 0.002, x[1], x[2]];
        let targets: Vec<[f32; 3]> = folded(&sheet, 0.0).into_iter().map(seen).collect();
        model.set_grips(&[corner]);
        for step in 0..300 {
            model.step(1.0 / 30.0, &targets, &sure, step == 0);
        }
        assert!((model.camera_offset_m() - 0.002).abs() < 1e-4, "{}", model.camera_offset_m());
        let middle = sheet.index(12, 12);
        assert!((model.positions_m()[middle][0] - 0.075).abs() < 2e-4);
        assert!((model.predicted_m()[middle][0] - 0.075).abs() < 2e-4);
        assert!((model.predicted_for_cameras_m()[middle][0] - 0.077).abs() < 2e-4);
        // It stays so when the gripper lets go.
        model.set_grips(&[]);
        model.step(1.0 / 30.0, &targets, &sure, false);
        assert!((model.camera_offset_m() - 0.002).abs() < 1e-4);
    }

    #[test]
    fn a_plan_that_comes_later_frees_its_crease_sooner() {
        let first_crease = |plan: &[[[f64; 2]; 2]], from: i32| {
            let (mut model, sheet) = model();
            let sure = vec![1.0; sheet.len()];
            (0..90).find(|degree| {
                if *degree == from {
                    model.set_plan(plan);
                }
                let targets = folded(&sheet, f64::from(*degree).to_radians());
                model.step(1.0 / 30.0, &targets, &sure, *degree == 0);
                !model.folds().creases().is_empty()
            })
        };
        let middle = [[[0.075, 0.0], [0.075, 0.15]]];
        let [without, with] = [&[][..], &middle].map(|plan| first_crease(plan, 3).unwrap());
        assert!(with < without && with > 3, "{with} with a plan, {without} without");
        // One for another place changes nothing.
        assert_eq!(first_crease(&[[[0.02, 0.0], [0.02, 0.15]]], 3), Some(without));
    }

    #[test]
    fn short_or_broken_targets_are_no_reason_to_stop() {
        let (mut model, sheet) = model();
        let sure = vec![1.0; sheet.len()];
        let mut targets = folded(&sheet, 1.0);
        model.step(1.0 / 30.0, &targets, &sure, true);
        model.step(1.0 / 30.0, &targets[..7], &sure[..3], false);
        model.step(1.0 / 30.0, &[], &[], false);
        targets[5] = [f32::NAN; 3];
        targets[6] = [-2e8; 3];
        model.step(1.0 / 30.0, &targets, &sure, false);
        targets.fill([-2e8; 3]);
        model.step(1.0 / 30.0, &targets, &sure, true);
        model.step(0.0, &targets, &sure, false);
        assert!(model.positions_m().iter().flatten().all(|c| c.is_finite()));
        assert!(model.predicted_m().iter().flatten().all(|c| c.is_finite()));
    }
}
