//! A bar near each lens that hides a share of the sheet, as a robot's arm or a cable does.
//!
//! It stands upright in the image half way to the table's middle and sweeps to and fro. Not
//! modelled: its shadows in depth and its motion blur.

use orime_geometry::{CameraModel, RgbdCamera, RgbdFrameMut};

/// How long it sweeps there and back, seconds.
const SWEEP_S: f64 = 3.0;
const BAR_RGB: [u8; 3] = [74, 78, 84];

/// The bar of one camera.
#[derive(Debug)]
pub(super) struct Bar {
    /// Distance from the colour lens, metres.
    distance_m: f64,
    /// Half its width and how far its middle sweeps, metres.
    half_m: f64,
    sweep_m: f64,
    /// Where in its sweep it begins, turns.
    phase: f64,
    /// From the colour lens to the depth lens, metres.
    depth_lens_m: f64,
    lenses: [CameraModel; 2],
    depth_units: u16,
}

impl Bar {
    /// One that hides `share` of a sheet `side_m` wide; `index` is the camera's.
    pub fn new(share: f64, side_m: f64, index: usize, camera: &RgbdCamera) -> Self {
        let eye = camera.world_from_color.translation.vector;
        let distance_m = 0.5 * eye.norm();
        let half_m = 0.25 * share * side_m;
        Self {
            distance_m,
            half_m,
            sweep_m: 0.25 * side_m - half_m,
            phase: 0.382 * index as f64,
            depth_lens_m: camera.color_from_depth.translation.x,
            lenses: [camera.color.clone(), camera.depth.clone()],
            depth_units: (distance_m / camera.depth_m_per_unit).round() as u16,
        }
    }

    /// Draws it over a frame taken at that time, seconds.
    pub fn hide(&self, time_s: f64, frame: &mut RgbdFrameMut<'_>) {
        let turns = time_s / SWEEP_S + self.phase;
        let middle_m = self.sweep_m * (std::f64::consts::TAU * turns).sin();
        let columns = |lens: &CameraModel, lens_m: f64| {
            let column = |x_m: f64| {
                let at = lens.fx_px * (x_m - lens_m) / self.distance_m + lens.cx_px;
                (at.round().max(0.0) as usize).min(lens.width as usize)
            };
            column(middle_m - self.half_m)..column(middle_m + self.half_m)
        };
        let [color, depth] = &self.lenses;
        let hidden = columns(color, 0.0);
        for row in frame.color_rgb.chunks_exact_mut(3 * color.width as usize) {
            let pixels = row[3 * hidden.start..3 * hidden.end].chunks_exact_mut(3);
            pixels.for_each(|pixel| pixel.copy_from_slice(&BAR_RGB));
        }
        let hidden = columns(depth, self.depth_lens_m);
        for row in frame.depth_units.chunks_exact_mut(depth.width as usize) {
            row[hidden.clone()].fill(self.depth_units);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::params::RenderedParams;
    use super::super::views::Viewpoints;
    use super::*;

    #[test]
    fn it_hides_its_share_and_passes_over_all_of_the_sheet() {
        let params = RenderedParams::default();
        let camera = super::super::camera::rgbd(&params, &Viewpoints::Five.views()[2]);
        let (bar, lens) = (Bar::new(0.25, 0.15, 1, &camera), &camera.color);
        let mut ever = vec![false; lens.width as usize];
        for step in 0..90 {
            let mut color_rgb = vec![255; 3 * lens.pixels()];
            let mut depth_units = vec![0; camera.depth.pixels()];
            let mut frame =
                RgbdFrameMut { color_rgb: &mut color_rgb, depth_units: &mut depth_units };
            bar.hide(f64::from(step) / 30.0, &mut frame);
            let hidden = color_rgb.chunks_exact(3).filter(|pixel| **pixel == BAR_RGB).count();
            // A quarter of the sheet's width at its distance, over all rows.
            let width_px = 0.25 * 0.15 * lens.fx_px / (2.0 * bar.distance_m);
            let rows = lens.height as usize;
            assert!((hidden as f64 / rows as f64 - width_px).abs() < 1.5, "{hidden} {width_px}");
            let first = &color_rgb[..3 * lens.width as usize];
            for (ever, pixel) in ever.iter_mut().zip(first.chunks_exact(3)) {
                *ever |= pixel == BAR_RGB;
            }
            let deep = depth_units.iter().filter(|units| **units > 0).collect::<Vec<_>>();
            assert!(!deep.is_empty() && deep.iter().all(|units| **units == bar.depth_units));
        }
        let half_px = 0.5 * 0.15 * lens.fx_px / (2.0 * bar.distance_m);
        let sheet = (lens.cx_px - half_px + 2.0) as usize..(lens.cx_px + half_px - 2.0) as usize;
        assert!(ever[sheet.clone()].iter().all(|hidden| *hidden), "{sheet:?}");
        assert!(!ever[sheet.start - 10] && !ever[sheet.end + 10]);
    }
}
