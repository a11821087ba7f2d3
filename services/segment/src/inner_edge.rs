//! Edges of the sheet's own flaps in front of the sheet: steps in depth inside the mask.

use orime_geometry::{Edgel, EdgelKind};

use crate::bits::BitImage;
use crate::depth::DepthMap;
use crate::steps::{DIRECTIONS, SPAN_PX, Steps};

/// Radius of the window over which the direction of the step is averaged, pixels.
const WINDOW_PX: i32 = 3;

/// Appends an edgel per pixel of step that has the sheet on both sides, as far as `out` has
/// capacity; returns how many did not fit.
pub(crate) fn trace(
    map: &DepthMap,
    steps: &Steps,
    sheet: &BitImage,
    camera: u32,
    out: &mut Vec<Edgel>,
) -> u32 {
    let mut left_out = 0;
    for (near, direction) in steps.near.iter().zip(DIRECTIONS) {
        for y in 0..map.height {
            for k in 0..near.words {
                let mut rest = near.row(y)[k];
                while rest != 0 {
                    let x = 64 * k as i32 + rest.trailing_zeros() as i32;
                    rest &= rest - 1;
                    let Some(edgel) = edgel(map, sheet, [x, y as i32], direction, camera) else {
                        continue;
                    };
                    if out.len() == out.capacity() {
                        left_out += 1;
                    } else {
                        out.push(edgel);
                    }
                }
            }
        }
    }
    left_out
}

fn edgel(
    map: &DepthMap,
    sheet: &BitImage,
    [x, y]: [i32; 2],
    [dx, dy]: [i32; 2],
    camera: u32,
) -> Option<Edgel> {
    let on_sheet = |n: i32| sheet.get_or_unset(x + n * dx, y + n * dy);
    if !on_sheet(-SPAN_PX) || !on_sheet(2 * SPAN_PX) {
        return None;
    }
    // A step answers at up to three pixels in a row: the one whose middle gap is the steepest
    // speaks for it.
    let z_m = |n: i32| map.z_m(x + n * dx, y + n * dy);
    let rise_m = [z_m(1) - z_m(0), z_m(2) - z_m(1), z_m(3) - z_m(2)];
    if !(rise_m[1] > rise_m[0] && rise_m[1] >= rise_m[2]) {
        return None;
    }
    let pixel = |n: i32| map.color_pixel((x + n * dx) as usize, (y + n * dy) as usize);
    let (a, b) = (pixel(1)?, pixel(2)?);
    let start = map.color_start();
    let middle = |k: usize, a: usize, b: usize| (2 * start[k] + a + b) as f32 / 2.0;
    Some(Edgel {
        position_px: [middle(0, a.0, b.0), middle(1, a.1, b.1)],
        normal: falling(map, x + dx, y + dy)?,
        camera,
        kind: EdgelKind::InnerDepthStep as u32,
    })
}

/// Unit direction in which depth grows around a pixel.
fn falling(map: &DepthMap, x: i32, y: i32) -> Option<[f32; 2]> {
    let mut sum = [0.0, 0.0];
    for dy in -WINDOW_PX..=WINDOW_PX {
        for dx in -WINDOW_PX..=WINDOW_PX {
            let rise_m = map.z_m(x + dx, y + dy) - map.z_m(x - dx, y - dy);
            if rise_m.is_finite() {
                sum = [sum[0] + dx as f32 * rise_m, sum[1] + dy as f32 * rise_m];
            }
        }
    }
    let length = f32::hypot(sum[0], sum[1]);
    (length > 0.0).then(|| sum.map(|s| s / length))
}
