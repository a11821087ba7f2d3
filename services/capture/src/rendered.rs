//! The `rendered` source: virtual RGB-D cameras that see a sheet being folded on a table.
//!
//! Geometry is exact ([`orime_origami::HalfFold`]); depth carries the noise of real stereo
//! cameras; colour is anti-aliased at the sheet's edges by exact pixel coverage. The static table
//! is prepared once. Each frame is written row by row straight into the caller's buffers: depth
//! from a prepared row of table depths, colour by copying the prepared row of table colours and
//! painting the sheet over it. That copy is how the table is drawn, not a copy of a frame, so
//! [`FrameReport::copies`] is 0.
//!
//! Not modelled: cast shadows, motion blur, flying pixels, shadowed occlusion of the second
//! imager, the sheet's bend at the crease, lens distortion.

mod camera;
mod coverage;
mod measure;
mod noise;
mod paint;
mod params;
mod project;
mod table;

use orime_geometry::{RgbdCamera, RgbdFrameMut, SheetGrid};
use orime_origami::{FoldLine, HalfFold, Timing};

pub use params::{RenderedConfig, RenderedParams, ViewParams};

use crate::playback::{After, Playback};
use crate::{FrameError, FrameReport, FrameSource, OpenError};
use camera::VirtualCamera;
use noise::NoiseTile;
use table::Texture;

/// The source; see the module.
pub(crate) struct RenderedSource {
    fold: HalfFold,
    playback: Playback,
    period_ns: u64,
    seed: u64,
    noise: NoiseTile,
    paper: Texture,
    cameras: Vec<RgbdCamera>,
    views: Vec<VirtualCamera>,
}

/// The nearest that any point of the sheet may come to a lens, metres.
const NEAR_M: f64 = 0.1;

impl RenderedSource {
    pub(crate) fn open(
        config: &RenderedConfig,
        repeat: bool,
        sheet: &SheetGrid,
    ) -> Result<Self, OpenError> {
        let p = config.params();
        let size_m = sheet.size_m;
        let line = FoldLine {
            point_m: [0, 1].map(|k| p.fold_point[k] * size_m[k]),
            angle_rad: p.fold_angle_deg.to_radians(),
        };
        let fold = HalfFold::new(size_m, line, p.thickness_m)
            .map_err(|error| OpenError::Scene(format!("`rendered.fold_point`: {error}")))?
            .placed(p.sheet_center_m, p.sheet_yaw_deg.to_radians())
            .timed(Timing { rest_before: p.rest_before, rest_after: p.rest_after });
        let cameras: Vec<RgbdCamera> = p.views.iter().map(|view| camera::rgbd(p, view)).collect();
        for camera in &cameras {
            check_distance(camera, &fold)?;
        }
        let table = Texture::wood(p.seed);
        let views = cameras.iter().map(|camera| VirtualCamera::new(p, camera, &table)).collect();
        Ok(Self {
            playback: Playback {
                frames: p.steps,
                after: if repeat { After::TurnBack } else { After::End },
            },
            period_ns: (1e9 / p.rate_hz).round() as u64,
            seed: p.seed,
            noise: NoiseTile::new(p.seed, p.size_px, p.noise_correlation_px),
            paper: Texture::paper(p.seed),
            fold,
            cameras,
            views,
        })
    }

    /// Share of the fold's sequence at `step`, 0 to 1.
    fn progress(&self, step: u64) -> f64 {
        self.playback.frame(step) as f64 / (self.playback.frames - 1) as f64
    }
}

impl FrameSource for RenderedSource {
    fn cameras(&self) -> &[RgbdCamera] {
        &self.cameras
    }

    fn steps(&self) -> Option<u64> {
        self.playback.steps()
    }

    fn exposure_ns(&self, step: u64, _camera: usize) -> u64 {
        (step + 1) * self.period_ns
    }

    fn read(
        &mut self,
        step: u64,
        camera: usize,
        frame: RgbdFrameMut<'_>,
    ) -> Result<FrameReport, FrameError> {
        if !frame.as_frame().fits(&self.cameras[camera]) {
            return Err(FrameError::Unreadable(format!(
                "the buffers do not fit the frames of camera `{}`",
                self.cameras[camera].name
            )));
        }
        let pose = self.fold.pose(self.progress(step));
        let view = &mut self.views[camera];
        view.draw_color(&self.fold, &pose, &self.paper, frame.color_rgb);
        let grain = self.noise.at(noise::hash(self.seed, (step << 8) | camera as u64));
        view.draw_depth(&self.fold, &pose, &grain, frame.depth_units);
        Ok(FrameReport { copies: 0 })
    }

    fn truth_m(&self, step: u64, sheet: &SheetGrid, nodes_m: &mut [[f32; 3]]) -> bool {
        let progress = self.progress(step);
        for (node, uv) in nodes_m.iter_mut().zip(sheet.uv_m()) {
            *node = self.fold.position_m(uv, progress).coords.cast::<f32>().into();
        }
        true
    }
}

/// Refuses a view that the sheet comes too near to, at any angle.
fn check_distance(camera: &RgbdCamera, fold: &HalfFold) -> Result<(), OpenError> {
    for lens in [camera.world_from_color, camera.world_from_depth()] {
        let lens_from_world = lens.inverse();
        for k in 0..=64 {
            let poses = fold.pose(f64::from(k) / 64.0);
            for (facet, pose) in fold.facets().iter().zip(poses) {
                for [u, v] in &facet.corners_uv_m {
                    let corner = pose * orime_geometry::nalgebra::Point3::new(*u, *v, 0.0);
                    if (lens_from_world * corner).z < NEAR_M {
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
