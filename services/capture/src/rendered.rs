//! The `rendered` source: virtual RGB-D cameras that see a sheet being folded on a table.
//!
//! Geometry is exact ([`orime_origami::Sequence`]); depth and colour carry the faults of real
//! cameras, each with its own strength ([`FaultParams`]). The static table is prepared once. Each
//! frame is written row by row straight into the caller's buffers: depth from a prepared image of
//! table depths, colour by copying the prepared row of table colours and painting the sheet over
//! it. That copy is how the table is drawn, not a copy of a frame, so [`FrameReport::copies`] is 0.
//!
//! What is random depends on the seed, the step and the camera alone.
//!
//! Not modelled: cast shadows, the sheet's bend at a crease, lens distortion, refraction in glass.

mod bar;
mod camera;
mod color;
mod coverage;
mod depth;
mod faults;
mod ink;
mod measure;
mod noise;
mod occluder;
mod paint;
mod params;
mod project;
mod scan;
mod scene;
mod stereo;
mod table;
mod views;

use orime_geometry::nalgebra::{Isometry3, UnitQuaternion, Vector3};
use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid};
use orime_origami::{FoldError, FoldLine, Gripper, Sequence, Sheet, Timing};

pub use faults::{FaultParams, FaultPreset};
pub use ink::Printed;
pub use occluder::Occluder;
pub use params::{RenderedConfig, RenderedParams, SequenceKind};
pub use views::{Model, ViewParams, Viewpoints};

use crate::playback::{After, Playback};
use crate::{FrameError, FrameReport, FrameSource, OpenError, PlannedFold};
use bar::Bar;
use camera::VirtualCamera;
use faults::Faults;
use ink::Ink;
use noise::{NoiseTile, hash, uniform};
use scene::Scene;
use table::Texture;

/// The source; see the module.
pub(crate) struct RenderedSource {
    scene: Scene,
    playback: Playback,
    period_ns: u64,
    seed: u64,
    faults: Faults,
    tells_grippers: bool,
    tells_plan: bool,
    noise: NoiseTile,
    paper: Texture,
    ink: Option<Ink>,
    /// As published.
    cameras: Vec<RgbdCamera>,
    /// As they truly are.
    views: Vec<VirtualCamera>,
    /// What hides the sheet from each camera; none without `occlusion`.
    bars: Vec<Bar>,
}

/// The nearest that any point of the sheet may come to a lens, metres.
const NEAR_M: f64 = 0.1;
/// A crease with a greater angle is being folded.
const FOLDS_RAD: f64 = 1e-3;

impl RenderedSource {
    pub(crate) fn open(
        config: &RenderedConfig,
        repeat: bool,
        sheet: &SheetGrid,
    ) -> Result<Self, OpenError> {
        let p = config.params();
        let faults = p.fault.over(p.faults);
        let sequence = sequence(p, sheet.size_m)
            .map_err(|error| OpenError::Scene(format!("`rendered.{}`: {error}", key_of(&error))))?
            .placed(p.sheet_center_m, p.sheet_yaw_deg.to_radians());
        let n_faces = sequence.facets().len() + occluder::FACES_MAX;
        if n_faces > scan::FACES_MAX {
            return Err(OpenError::Scene(format!(
                "`rendered.sequence`: a sheet of {:?} m bends in too many strips; \
                 use a smaller one",
                sheet.size_m
            )));
        }
        let cameras: Vec<RgbdCamera> = p.views.iter().map(|view| camera::rgbd(p, view)).collect();
        let ink = match p.printed {
            Printed::None => None,
            Printed::Markers => Some(Ink::markers(sheet)?),
        };
        let wood = Texture::wood(p.seed);
        let mut views = Vec::with_capacity(cameras.len());
        let mut bars = Vec::new();
        for (index, published) in cameras.iter().enumerate() {
            check_distance(published, &sequence)?;
            let seed = hash(p.seed ^ 0xca11, index as u64);
            let truth = camera::displaced(published, &faults, seed);
            views.push(VirtualCamera::new(p, &faults, (index, &truth), &wood));
            if faults.occlusion > 0.0 {
                bars.push(Bar::new(faults.occlusion, sheet.size_m[0], index, &truth));
            }
        }
        let frames = p
            .steps
            .unwrap_or_else(|| (sequence.intervals() as f64 / p.speed).round().max(1.0) as u64 + 1);
        Ok(Self {
            playback: Playback { frames, after: if repeat { After::TurnBack } else { After::End } },
            period_ns: (1e9 / p.rate_hz).round() as u64,
            seed: p.seed,
            tells_grippers: p.gripper_poses,
            tells_plan: p.fold_plan,
            noise: NoiseTile::new(p.seed, p.size_px, faults.noise_correlation_px),
            paper: Texture::paper(p.seed),
            ink,
            scene: Scene::new(sequence, faults.occluder, p.sheet_rgb, faults.exposure_s > 0.0),
            faults,
            cameras,
            views,
            bars,
        })
    }

    /// Share of the sequence at `step`, 0 to 1, `late_periods` later.
    fn progress(&self, step: u64, late_periods: f64) -> f64 {
        let last = (self.playback.frames - 1) as f64;
        let frame = self.playback.frame(step) as f64;
        let is_back = self.playback.frame(step + 1) < self.playback.frame(step);
        let late = if is_back { -late_periods } else { late_periods };
        ((frame + late) / last).clamp(0.0, 1.0)
    }

    /// The number from which everything random in one frame follows.
    fn random(&self, step: u64, camera: usize) -> u64 {
        hash(self.seed, (step << 8) | camera as u64)
    }
}

impl FrameSource for RenderedSource {
    fn cameras(&self) -> &[RgbdCamera] {
        &self.cameras
    }

    fn steps(&self) -> Option<u64> {
        self.playback.steps()
    }

    fn exposure_ns(&self, step: u64, camera: usize) -> u64 {
        let due_ns = (step + 1) * self.period_ns;
        let period_ns = self.period_ns as f64;
        // Spread and jitter together stay below a whole period: time only goes forward.
        let jitter_ns = (self.faults.stamp_jitter_s * 1e9).min(period_ns / 4.0);
        let share = 2.0 * uniform(self.random(step, camera), 0x71e) - 1.0;
        let late_ns = self.views[camera].late_periods * period_ns + share * jitter_ns;
        due_ns.saturating_add_signed(late_ns.round() as i64)
    }

    fn read(
        &mut self,
        step: u64,
        camera: usize,
        mut frame: RgbdFrameMut<'_>,
    ) -> Result<FrameReport, FrameError> {
        if !frame.as_frame().fits(&self.cameras[camera]) {
            return Err(FrameError::Unreadable(format!(
                "the buffers do not fit the frames of camera `{}`",
                self.cameras[camera].name
            )));
        }
        let progress = self.progress(step, self.views[camera].late_periods);
        let per_second = 1e9 / self.period_ns as f64 / (self.playback.frames - 1) as f64;
        self.scene.set(progress, self.faults.exposure_s * per_second);
        let random = self.random(step, camera);
        let view = &mut self.views[camera];
        let surface = (&self.paper, self.ink.as_ref());
        view.color.draw(&self.scene, surface, hash(random, 1), frame.color_rgb);
        let grain = self.noise.at(random);
        view.depth.draw(&self.scene, &grain, hash(random, 2), frame.depth_units);
        if let Some(bar) = self.bars.get(camera) {
            bar.hide(step as f64 * self.period_ns as f64 * 1e-9, &mut frame);
        }
        Ok(FrameReport { copies: 0 })
    }

    fn truth_m(&self, step: u64, sheet: &SheetGrid, nodes_m: &mut [[f32; 3]]) -> bool {
        let sequence = self.scene.sequence();
        let pose = sequence.pose(self.progress(step, 0.0));
        for (node, uv) in nodes_m.iter_mut().zip(sheet.uv_m()) {
            *node = sequence.position_m(&pose, uv).coords.cast::<f32>().into();
        }
        true
    }

    fn fold_plan(&self) -> Vec<PlannedFold> {
        if !self.tells_plan {
            return Vec::new();
        }
        let sequence = self.scene.sequence();
        let mut pose = sequence.pose(0.0);
        let mut plan: Vec<PlannedFold> = Vec::new();
        for step in 0..self.playback.frames {
            sequence.update(&mut pose, self.progress(step, 0.0));
            for crease in sequence.creases() {
                let is_new = plan.iter().all(|fold| fold.ends_uv_m != crease.ends_uv_m);
                if is_new && sequence.crease_angle_rad(&pose, crease).abs() > FOLDS_RAD {
                    let valid_from_ns = self.exposure_ns(step.saturating_sub(1), 0);
                    plan.push(PlannedFold { ends_uv_m: crease.ends_uv_m, valid_from_ns });
                }
            }
        }
        plan
    }

    fn tells_grippers(&self) -> bool {
        self.tells_grippers
    }

    fn grippers(&self, step: u64, out: &mut Vec<Gripper>) {
        out.clear();
        if !self.tells_grippers {
            return;
        }
        let sequence = self.scene.sequence();
        let pose = sequence.pose(self.progress(step, 0.0));
        let sigma_m = self.faults.gripper_noise_m;
        let sigma_rad = self.faults.gripper_noise_deg.to_radians();
        out.extend((0..).zip(sequence.grippers(&pose)).map(|(k, gripper)| {
            let random = self.random(step, 0xa0 + k);
            let normal = |salt: u64| noise::normal(random, salt);
            let vector = |salt: u64| Vector3::from_fn(|axis, _| normal(salt + axis as u64));
            let turn = UnitQuaternion::from_scaled_axis(vector(3) * sigma_rad);
            let error = Isometry3::from_parts((vector(0) * sigma_m).into(), turn);
            Gripper {
                uv_m: [0, 1].map(|k| gripper.uv_m[k] + sigma_m * normal(6 + k as u64)),
                world_from_gripper: gripper.world_from_gripper * error,
            }
        }));
    }
}

/// What the section's `sequence` names.
fn sequence(p: &RenderedParams, size_m: [f64; 2]) -> Result<Sequence, FoldError> {
    let sheet = Sheet { size_m, thickness_m: p.thickness_m };
    let line = FoldLine {
        point_m: [0, 1].map(|k| p.fold_point[k] * size_m[k]),
        angle_rad: p.fold_angle_deg.to_radians(),
    };
    let turn = Timing { rest_before: p.rest_before, rest_after: p.rest_after };
    match p.sequence {
        SequenceKind::HalfFold => Sequence::half_fold(sheet, line, turn),
        SequenceKind::FoldUnfold => Sequence::fold_unfold(sheet, line),
        SequenceKind::SquareBase => Sequence::square_base(sheet),
        SequenceKind::GateFold => Sequence::gate_fold(sheet),
        SequenceKind::Blintz => Sequence::blintz(sheet),
        SequenceKind::Accordion => Sequence::accordion(sheet),
        SequenceKind::SoftFold => Sequence::soft_fold(sheet),
        SequenceKind::Wave => Sequence::wave(sheet),
    }
}

/// The key that an impossible fold is to be mended at.
fn key_of(error: &FoldError) -> &'static str {
    match error {
        FoldError::LineMissesSheet { .. } => "fold_point",
        _ => "sequence",
    }
}

/// Refuses a view that the sheet comes too near to, at any time.
fn check_distance(camera: &RgbdCamera, sequence: &Sequence) -> Result<(), OpenError> {
    for lens in [camera.world_from_color, camera.world_from_depth()] {
        let lens_from_world = lens.inverse();
        let mut pose = sequence.pose(0.0);
        for k in 0..=64 {
            sequence.update(&mut pose, f64::from(k) / 64.0);
            for (facet, pose) in sequence.facets().iter().zip(&pose.facets) {
                for uv_m in &facet.corners_uv_m {
                    if (lens_from_world * pose.position_m(*uv_m)).z < NEAR_M {
                        return Err(OpenError::Scene(format!(
                            "`rendered.views`: the sheet comes nearer than {NEAR_M} m to camera \
                             `{}`, or behind it; move `eye_m` away",
                            camera.name
                        )));
                    }
                }
            }
        }
    }
    Ok(())
}
