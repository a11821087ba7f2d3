//! Edges to a fraction of a pixel.

use super::line::{Line, Weighted};
use super::quad::distance;
use crate::grey::GreyImage;

/// Most and fewest places along a side where its edge is looked for: one a pixel in between.
const PLACES_MAX: usize = 64;
const PLACES_MIN: usize = 8;

/// Share of a side that is left out at each end: the other side's edge is near.
const END_SHARE: f64 = 0.07;

/// Distance of the samples along the normal, pixels.
const STEP_PX: f64 = 0.25;

/// A slope is measured over this many steps to each side: one pixel in all.
const SLOPE_STEPS: usize = 2;

/// Most samples along one normal: a reach of 2.5 px and the slopes at its ends.
const SAMPLES_MAX: usize = 2 * 10 + 1 + 2 * SLOPE_STEPS;

/// Least sum of squared slopes, (grey levels / pixel)², of an edge that counts.
const SLOPE_SQUARES_MIN: f64 = 25.0;

/// Distance from the line at which a place counts half, pixels.
const OUTLIER_PX: f64 = 0.3;

/// The corners moved to where lines through the sides' edges cross.
///
/// At places along each side, the edge is the centroid of the squared slope along the normal
/// within ± `reach_px` (at most 2.5); only slopes from dark inside to bright outside count. A line
/// is laid through them, twice re-weighted by the distance (Cauchy). `None` if a side shows an
/// edge at fewer than half of its places or a corner moves further than 2.5 reaches.
pub(super) fn refine(
    image: GreyImage<'_>,
    corners_px: &[[f64; 2]; 4],
    reach_px: f64,
) -> Option<[[f64; 2]; 4]> {
    let mut lines = [None; 4];
    for (side, line) in lines.iter_mut().enumerate() {
        *line = Some(side_line(image, corners_px[side], corners_px[(side + 1) % 4], reach_px)?);
    }
    let mut refined = *corners_px;
    for k in 0..4 {
        refined[k] = lines[(k + 3) % 4]?.cross(&lines[k]?)?;
        if distance(refined[k], corners_px[k]) > 2.5 * reach_px {
            return None;
        }
    }
    Some(refined)
}

/// The line along the edge near the side from `a` to `b`, clockwise around the marker.
fn side_line(image: GreyImage<'_>, a: [f64; 2], b: [f64; 2], reach_px: f64) -> Option<Line> {
    let length_px = distance(a, b);
    let along = [(b[0] - a[0]) / length_px, (b[1] - a[1]) / length_px];
    let outwards = [along[1], -along[0]];
    let count = (length_px as usize).clamp(PLACES_MIN, PLACES_MAX);
    let mut places = [Weighted::default(); PLACES_MAX];
    let mut found = 0;
    for k in 0..count {
        let share = END_SHARE + (1.0 - 2.0 * END_SHARE) * (k as f64 + 0.5) / count as f64;
        let middle = [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]));
        if let Some((offset_px, weight)) = edge(image, middle, outwards, reach_px) {
            let point = [0, 1].map(|axis| middle[axis] + offset_px * outwards[axis]);
            places[found] = Weighted { point, weight };
            found += 1;
        }
    }
    if found < count / 2 {
        return None;
    }
    let places = &places[..found];
    let mut line = Line::fit(places.iter().copied())?;
    for _ in 0..2 {
        line = Line::fit(places.iter().map(|place| {
            let ratio = line.distance_px(place.point) / OUTLIER_PX;
            Weighted { point: place.point, weight: place.weight / (1.0 + ratio * ratio) }
        }))?;
    }
    Some(line)
}

/// Offset of the edge along `outwards`, pixels, and its strength.
fn edge(
    image: GreyImage<'_>,
    middle: [f64; 2],
    outwards: [f64; 2],
    reach_px: f64,
) -> Option<(f64, f64)> {
    let steps = ((reach_px / STEP_PX) as usize).min((SAMPLES_MAX - 1) / 2 - SLOPE_STEPS);
    let count = 2 * (steps + SLOPE_STEPS) + 1;
    let mut samples = [0.0; SAMPLES_MAX];
    for (k, sample) in samples[..count].iter_mut().enumerate() {
        let offset_px = (k as f64 - (steps + SLOPE_STEPS) as f64) * STEP_PX;
        let [x, y] = [0, 1].map(|axis| (middle[axis] + offset_px * outwards[axis]) as f32);
        *sample = image.sample(x, y);
    }
    let (mut squares, mut moment) = (0.0, 0.0);
    for k in 0..=2 * steps {
        let slope = f64::from(samples[k + 2 * SLOPE_STEPS] - samples[k]).max(0.0);
        squares += slope * slope;
        moment += slope * slope * (k as f64 - steps as f64) * STEP_PX;
    }
    (squares > SLOPE_SQUARES_MIN).then(|| (moment / squares, squares.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_between_pixels_is_found_from_either_side() {
        // Bright from x = 20.3 on, as a pixel integrates it.
        let row: Vec<u8> = (0..40)
            .map(|x| (40.0 + 160.0 * (f64::from(x) + 0.5 - 20.3).clamp(0.0, 1.0)) as u8)
            .collect();
        let pixels = row.repeat(40);
        let image = GreyImage::new(40, 40, &pixels).unwrap();
        for start in [19.0, 20.0, 21.5] {
            let (offset_px, _) = edge(image, [start, 15.0], [1.0, 0.0], 2.5).unwrap();
            assert!((start + offset_px - 20.3).abs() < 0.12, "{}", start + offset_px);
        }
        // From bright to dark is no edge of a marker.
        assert!(edge(image, [20.0, 15.0], [-1.0, 0.0], 2.5).is_none());
        assert!(edge(image, [10.0, 15.0], [1.0, 0.0], 2.5).is_none());
    }
}
