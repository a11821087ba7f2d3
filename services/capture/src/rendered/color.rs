//! The colour image of one camera.

use orime_geometry::CameraModel;
use orime_geometry::RgbdCamera;
use orime_geometry::nalgebra::Isometry3;

use super::faults::Faults;
use super::ink::Ink;
use super::noise::{hash, normal};
use super::paint::{Look, Painted};
use super::params::RenderedParams;
use super::scan::Scan;
use super::scene::Scene;
use super::table::Texture;

/// What one colour lens needs to draw frames without allocation.
#[derive(Debug)]
pub(super) struct ColorView {
    lens: CameraModel,
    lens_from_world: Isometry3<f64>,
    /// The table without the sheet.
    table_rgb: Vec<u8>,
    sheet_texture: f32,
    sees_sheet: bool,
    scan: Scan,
    /// Coverage of one row by the two faces of a simple fold.
    coverage: [Vec<f32>; 2],
    /// Sensor noise, longer than a row; empty without.
    grain: Vec<i8>,
}

/// Length of the sensor noise's pattern before it repeats, bytes.
const GRAIN: usize = 1 << 16;

impl ColorView {
    pub fn new(
        params: &RenderedParams,
        faults: &Faults,
        camera: &RgbdCamera,
        table_rgb: Vec<u8>,
        hides_sheet: bool,
    ) -> Self {
        let width = camera.color.width as usize;
        let noise =
            |k: u64| (faults.color_noise * normal(0x6e01, k)).round().clamp(-100.0, 100.0) as i8;
        let length = if faults.color_noise > 0.0 { (GRAIN + 3 * width) as u64 } else { 0 };
        Self {
            lens: camera.color.clone(),
            lens_from_world: camera.world_from_color.inverse(),
            table_rgb,
            sheet_texture: params.texture as f32 * 0.1,
            sees_sheet: !hides_sheet,
            scan: Scan::new(width),
            coverage: [(); 2].map(|()| vec![0.0; width]),
            grain: (0..length).map(noise).collect(),
        }
    }

    /// Writes one image: the table, and over it the scene with anti-aliased edges. `random`
    /// picks the sensor's noise.
    pub fn draw(
        &mut self,
        scene: &Scene,
        (paper, ink): (&Texture, Option<&Ink>),
        random: u64,
        rgb: &mut [u8],
    ) {
        let look = Look { paper, texture: self.sheet_texture, ink };
        let height = self.lens.height as usize;
        let stride = 3 * self.lens.width as usize;
        // Two faces alone, without print, are drawn with exact coverage.
        let simple: Option<Painted<'_>> = match (scene.faces(), scene.is_blurred()) {
            ([fixed, moving], false) if fixed.is_sheet && ink.is_none() => {
                Some(Painted::new(&self.lens, &self.lens_from_world, &[*fixed, *moving], look))
            }
            _ => None,
        };
        if simple.is_none() {
            self.scan.prepare(&self.lens, &self.lens_from_world, scene);
        }
        let rows = rgb.chunks_exact_mut(stride).zip(self.table_rgb.chunks_exact(stride));
        for (y, (row, table)) in rows.enumerate() {
            row.copy_from_slice(table);
            match &simple {
                _ if !self.sees_sheet => {}
                Some(sheet) => sheet.paint_row(y, height, &mut self.coverage, row),
                None => self.scan.paint_row(y, height, &look, row),
            }
            if !self.grain.is_empty() {
                let start = hash(random, y as u64) as usize % GRAIN;
                for (byte, noise) in row.iter_mut().zip(&self.grain[start..start + stride]) {
                    *byte = byte.saturating_add_signed(*noise);
                }
            }
        }
    }
}
