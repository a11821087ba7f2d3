//! Which components of the mixture a camera can see: only the front layer owns a point.
//!
//! The model's own depth image decides, with the layers in their right order (`simulate` keeps
//! it). A component counts as seen where the front triangle near its pixel is materially its own
//! neighbourhood; components just behind another layer keep a small share, so that a wrong guess
//! can be mended.
//!
//! Source: `../shared/design/loop.md`, `visible` in its prototype.

use crate::mixture::Mixture;
use crate::projector::Coordinates;
use crate::zbuffer::{ZBuffer, centres_m};
use orime_geometry::{CameraModel, RgbdCamera, SheetGrid};

/// Material distance up to which a front triangle is a component's own, share of the side.
const OWN: f64 = 0.08;
/// Pixels of the depth image per node spacing at the usual distance: enough for layers' borders.
const SCALE: f64 = 0.5;
/// Pixels about a component that must show it.
const SHOWN_MIN: u32 = 2;
/// Prior weight of a component that a camera does not see.
const HIDDEN: f32 = 0.02;

/// Prior weights per camera.
#[derive(Debug, Clone)]
pub(crate) struct Visibility {
    triangles: Vec<[u32; 3]>,
    centres_m: Vec<[f32; 2]>,
    own_m: f32,
    /// Depth lenses that the buffers are for.
    lenses: Vec<CameraModel>,
    buffers: Vec<ZBuffer>,
    projected: Coordinates,
    /// Per camera, one weight per place of a component: 1 seen, [`HIDDEN`] not, 0 left over.
    priors: Vec<Vec<f32>>,
}

impl Visibility {
    /// For a sheet.
    pub fn new(sheet: &SheetGrid) -> Self {
        let triangles = sheet.triangles();
        Self {
            centres_m: centres_m(sheet, &triangles),
            own_m: (OWN * (sheet.size_m[0] + sheet.size_m[1]) / 2.0) as f32,
            triangles,
            lenses: Vec::new(),
            buffers: Vec::new(),
            projected: Coordinates::default(),
            priors: Vec::new(),
        }
    }

    /// Says that every camera sees everything.
    pub fn forget(&mut self) {
        self.priors.clear();
    }

    /// Renders the nodes and judges the components, which must be placed there.
    pub fn judge(&mut self, cameras: &[RgbdCamera], nodes_m: &[[f32; 3]], mixture: &Mixture) {
        if !self.lenses.iter().eq(cameras.iter().map(|camera| &camera.depth)) {
            self.lenses = cameras.iter().map(|camera| camera.depth.clone()).collect();
            let buffer = |c: &RgbdCamera| ZBuffer::new(&c.depth, &c.world_from_depth(), SCALE);
            self.buffers = cameras.iter().map(buffer).collect();
        }
        for (buffer, camera) in self.buffers.iter_mut().zip(cameras) {
            buffer.stand(&camera.world_from_depth());
        }
        self.priors.resize(cameras.len(), Vec::new());
        for (buffer, priors) in self.buffers.iter_mut().zip(&mut self.priors) {
            buffer.draw(nodes_m, &self.triangles);
            buffer.project(&mixture.components.at_m, &mut self.projected);
            priors.clear();
            for (m, uv) in mixture.uv_m.iter().enumerate() {
                if !mixture.blocks.is_present(m) {
                    priors.push(0.0);
                    continue;
                }
                let is_own = |triangle: u32| {
                    let c = self.centres_m[triangle as usize];
                    (c[0] - uv[0]).abs() < self.own_m && (c[1] - uv[1]).abs() < self.own_m
                };
                // Behind the camera is NaN, which is nowhere in the image.
                let [x, y, _] = self.projected.at(m);
                let seen = buffer.shows_around(x, y, SHOWN_MIN, is_own);
                priors.push(if seen { 1.0 } else { HIDDEN });
            }
        }
    }

    /// Prior weights for points of a camera; `None` where all are 1.
    pub fn priors(&self, camera: u32) -> Option<&[f32]> {
        self.priors.get(camera as usize).map(Vec::as_slice)
    }

    /// Whether any camera sees a component.
    pub fn is_seen(&self, component: usize) -> bool {
        self.priors.is_empty() || self.priors.iter().any(|priors| priors[component] == 1.0)
    }

    /// Σ over components of the prior, averaged over cameras: how many components can own a point.
    pub fn owners(&self, components: usize) -> f64 {
        if self.priors.is_empty() {
            return components as f64;
        }
        let sum = |priors: &Vec<f32>| priors.iter().map(|p| f64::from(*p)).sum::<f64>();
        self.priors.iter().map(sum).sum::<f64>() / self.priors.len() as f64
    }
}
