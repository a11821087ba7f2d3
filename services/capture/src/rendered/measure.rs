//! From exact depth to what a stereo camera reports.

use super::project::Projected;

/// Depth of pixels that see nothing, in units: beyond what a raw value can hold.
pub(super) const NOTHING_UNITS: f32 = 1e6;

/// The largest raw value.
pub(super) const RAW_MAX: f32 = 65535.0;

/// Unit normal noise for one stretch of a row, and how it grows with depth.
pub(super) struct Noise<'a> {
    /// One value per pixel.
    pub values: &'a [f32],
    /// 1 or -1, for all values.
    pub sign: f32,
    /// σ₀² and k² of σ² = σ₀² + k² z⁴, with z and σ in units of depth.
    pub variance: [f32; 2],
    /// Added everywhere, units.
    pub bias: f32,
}

/// The steps in which a stereo camera measures.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steps {
    /// Focal length · baseline, pixels · units of depth.
    pub focal_baseline: f32,
    /// Step of the disparity, pixels.
    pub step_px: f32,
}

/// Lowers one row's depths to a facet's where that is nearer. Depths in units.
pub(super) fn nearer(facet: &Projected, y: usize, m_per_unit: f64, row: &mut [f32]) {
    let span = facet.span(y, 0.0, row.len());
    let inverse = facet.per_depth.row(2) * m_per_unit;
    let step = inverse[0] as f32;
    let start = (inverse[0] * span.start as f64 + inverse[1] * y as f64 + inverse[2]) as f32;
    for (k, z) in row[span].iter_mut().enumerate() {
        *z = z.min(1.0 / (start + step * k as f32));
    }
}

/// Adds noise and rounds to raw values; 0 where there is nothing to see.
pub(super) fn quantise(row: &[f32], noise: &Noise<'_>, raw: &mut [u16]) {
    let [floor, growth] = noise.variance;
    for ((out, z), unit_noise) in raw.iter_mut().zip(row).zip(noise.values) {
        let z2 = z * z;
        let sigma = (floor + growth * z2 * z2).sqrt();
        let measured = (z + noise.bias + sigma * noise.sign * unit_noise).clamp(0.0, RAW_MAX);
        // Adding 2²³ leaves the rounded integer in the mantissa's low bits: no conversion that
        // would keep the loop from being vectorised.
        let rounded = (measured + 8_388_608.0).to_bits() as u16;
        *out = if *z < RAW_MAX { rounded } else { 0 };
    }
}

/// As [`quantise`], with rounding to whole steps of the disparity before.
pub(super) fn quantise_disparity(row: &[f32], noise: &Noise<'_>, steps: &Steps, raw: &mut [u16]) {
    let [floor, growth] = noise.variance;
    // Adding 1.5 · 2²³ and taking it away rounds to whole numbers.
    const WHOLE: f32 = 12_582_912.0;
    let per_step = steps.focal_baseline / steps.step_px;
    for ((out, z), unit_noise) in raw.iter_mut().zip(row).zip(noise.values) {
        let z2 = z * z;
        let sigma = (floor + growth * z2 * z2).sqrt();
        let measured = (z + sigma * noise.sign * unit_noise).max(1.0);
        let whole = per_step / measured + WHOLE - WHOLE;
        let stepped = (per_step / whole + noise.bias).clamp(0.0, RAW_MAX);
        let rounded = (stepped + 8_388_608.0).to_bits() as u16;
        *out = if *z < RAW_MAX { rounded } else { 0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_rounded_to_units_and_nothing_stays_nothing() {
        let row = [570.4, 570.6, NOTHING_UNITS, 0.2];
        let noise = Noise { values: &[0.0; 4], sign: 1.0, variance: [0.0; 2], bias: 0.0 };
        let mut raw = [9; 4];
        quantise(&row, &noise, &mut raw);
        assert_eq!(raw, [570, 571, 0, 0]);
    }

    #[test]
    fn noise_has_the_documented_size() {
        // At 1 m, with σ₀ = 0.39 mm and k = 2.8 mm/m², in 1 mm units: √(0.39² + 2.8²) = 2.827.
        let variance = [0.1521, 7.84e-12];
        let noise = Noise { values: &[10.0, -10.0], sign: -1.0, variance, bias: 0.0 };
        let mut raw = [0; 2];
        quantise(&[1000.0; 2], &noise, &mut raw);
        assert_eq!(raw, [972, 1028]);
    }
}
