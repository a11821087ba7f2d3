//! Depth that the colour lens does not see.
//!
//! Past the sheet's edge a depth lens beside the colour lens sees a strip of what the sheet hides
//! from the colour lens. Its colour pixels are the sheet's own, but it lies behind the sheet: in
//! each block of colour pixels, what is clearly behind the nearest depth is hidden.

use crate::bits::BitImage;
use crate::depth::DepthMap;

/// Side of a block, colour pixels. More closes wider gaps between depth pixels.
const BLOCK_PX: usize = 4;

/// Tangent of the steepest slope against the image plane that is followed within a block.
const SLOPE_MAX: f32 = 4.0;

/// Drops hidden pixels; keeps its memory.
#[derive(Debug)]
pub(crate) struct Parallax {
    /// Per block of the colour image, row-major: nearest depth, metres.
    nearest_m: Vec<f32>,
    /// Blocks a row, and in all, of the window.
    width: usize,
    blocks: usize,
    /// Block and depth of each pixel.
    pixels: Vec<Seen>,
}

/// A depth pixel and where its colour comes from.
#[derive(Debug, Clone, Copy)]
struct Seen {
    x: u32,
    y: u32,
    block: u32,
    z_m: f32,
}

impl Parallax {
    /// For a colour image of `width × height` and up to `pixels_max` depth pixels.
    pub fn new(width: usize, height: usize, pixels_max: usize) -> Self {
        let (width, height) = (width.div_ceil(BLOCK_PX), height.div_ceil(BLOCK_PX));
        Self {
            nearest_m: vec![f32::INFINITY; width * height],
            width,
            blocks: width * height,
            pixels: Vec::with_capacity(pixels_max),
        }
    }

    /// Takes a colour window's size.
    pub fn reshape(&mut self, width: usize, height: usize) {
        self.width = width.div_ceil(BLOCK_PX);
        self.blocks = self.width * height.div_ceil(BLOCK_PX);
    }

    /// Unsets the depth pixels of `sheet` that other pixels of it hide from the colour lens.
    /// `step_m` is the least step in depth between two surfaces.
    pub fn drop_hidden(&mut self, map: &DepthMap, step_m: f32, sheet: &mut BitImage) {
        self.nearest_m[..self.blocks].fill(f32::INFINITY);
        self.pixels.clear();
        for y in 0..sheet.height {
            for k in 0..sheet.words {
                let mut rest = sheet.row(y)[k];
                while rest != 0 {
                    let x = 64 * k + rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    self.take(map, x, y);
                }
            }
        }
        let slope = SLOPE_MAX * BLOCK_PX as f32 / map.focal_px[0];
        for seen in &self.pixels {
            let behind_m = seen.z_m - self.nearest_m[seen.block as usize];
            if behind_m > step_m + slope * seen.z_m {
                sheet.unset(seen.x as usize, seen.y as usize);
            }
        }
    }

    fn take(&mut self, map: &DepthMap, x: usize, y: usize) {
        let Some((u, v)) = map.color_pixel(x, y) else { return };
        let block = v / BLOCK_PX * self.width + u / BLOCK_PX;
        let z_m = map.z_m(x as i32, y as i32);
        self.nearest_m[block] = self.nearest_m[block].min(z_m);
        self.pixels.push(Seen { x: x as u32, y: y as u32, block: block as u32, z_m });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::SegmentParams;
    use orime_geometry::nalgebra::Isometry3;
    use orime_geometry::{CameraModel, RgbdCamera};

    /// Columns that are dropped; the depth lens sits this far beside the colour lens.
    fn dropped(offset_m: f64, depth: impl Fn(u16) -> u16) -> Vec<usize> {
        let (width, height) = (90, 8);
        let lens = CameraModel {
            width,
            height,
            fx_px: 200.0,
            fy_px: 200.0,
            cx_px: 44.5,
            cy_px: 3.5,
            distortion: [0.0; 5],
        };
        let camera = RgbdCamera {
            name: "front".into(),
            color: lens.clone(),
            depth: lens,
            color_from_depth: Isometry3::translation(offset_m, 0.0, 0.0),
            world_from_color: Isometry3::identity(),
            depth_m_per_unit: 1e-3,
        };
        let mut map = DepthMap::new(&camera, &SegmentParams::default());
        let row: Vec<u16> = (0..width as u16).map(depth).collect();
        map.load(&row.repeat(height as usize));
        let mut sheet = map.valid.clone();
        let mut parallax = Parallax::new(width as usize, height as usize, camera.depth.pixels());
        parallax.drop_hidden(&map, 0.004, &mut sheet);
        (0..width as usize).filter(|x| !sheet.get(*x, 4)).collect()
    }

    #[test]
    fn what_the_sheet_hides_from_the_colour_lens_is_dropped() {
        // Columns shift by 20 pixels at 0.3 m and by 10 at 0.6 m: the sheet ends at 64, and the
        // table begins at 55.
        let edge = |x: u16| if x < 45 { 300 } else { 600 };
        let columns = dropped(0.03, edge);
        assert!((45..54).all(|x| columns.contains(&x)), "{columns:?}");
        // Up to a block more, none of the sheet.
        assert!(columns.iter().all(|x| (45..58).contains(x)), "{columns:?}");
        // To the other side a gap opens instead.
        assert_eq!(dropped(-0.03, edge), []);
        // A slope of tangent 3 is one surface.
        assert_eq!(dropped(0.03, |x| 300 + 5 * x.min(40)), []);
    }
}
