//! The bits inside a quadrangle.

use crate::Dictionary;
use crate::dictionary::Match;
use crate::grey::GreyImage;
use crate::params::DetectorParams;
use crate::unit_square::UnitSquare;

/// Samples along one side of a module.
const SAMPLES: usize = 4;

/// Share of a module's side that is sampled, around its middle.
const SAMPLED_SHARE: f64 = 0.6;

/// Most modules on a side, border included.
const MODULES_MAX: usize = 10;

const SAMPLES_MAX: usize = MODULES_MAX * MODULES_MAX * SAMPLES * SAMPLES;

/// Reads the markers of one dictionary.
#[derive(Debug)]
pub(super) struct Reader<'a> {
    dictionary: &'a Dictionary,
    modules: usize,
    border_errors_max: usize,
    wrong_bits_max: u32,
    contrast_min: f64,
}

impl<'a> Reader<'a> {
    pub(super) fn new(dictionary: &'a Dictionary, params: &DetectorParams) -> Self {
        let modules = dictionary.modules();
        let border_modules = (4 * (modules - 1)) as f64;
        let correctable = f64::from(dictionary.correctable_bits());
        Self {
            dictionary,
            modules,
            border_errors_max: (params.border_error_ratio * border_modules) as usize,
            wrong_bits_max: (params.correction_ratio * correctable) as u32,
            contrast_min: params.contrast_min,
        }
    }

    /// The marker inside these corners, if there is one.
    pub(super) fn read(&self, image: GreyImage<'_>, corners_px: &[[f64; 2]; 4]) -> Option<Match> {
        let mut samples = [0.0; SAMPLES_MAX];
        let count = self.sample(image, corners_px, &mut samples);
        let samples = &samples[..count];
        let level = separating_level(samples, self.contrast_min)?;
        let (mut border_errors, mut code) = (0, 0);
        for (k, module) in samples.chunks_exact(SAMPLES * SAMPLES).enumerate() {
            let bright = module.iter().filter(|sample| **sample > level).count();
            let white = 2 * bright > SAMPLES * SAMPLES;
            let (row, column) = (k / self.modules, k % self.modules);
            let border = |place: usize| place == 0 || place == self.modules - 1;
            if border(row) || border(column) {
                border_errors += usize::from(white);
            } else {
                code = code << 1 | u64::from(white);
            }
        }
        if border_errors > self.border_errors_max {
            return None;
        }
        self.dictionary.recognise(code, self.wrong_bits_max)
    }

    /// Brightness at `SAMPLES²` places of every module, module by module; their number.
    fn sample(
        &self,
        image: GreyImage<'_>,
        corners_px: &[[f64; 2]; 4],
        samples: &mut [f32; SAMPLES_MAX],
    ) -> usize {
        let square = UnitSquare::onto(corners_px);
        let mut places = [0.0; MODULES_MAX * SAMPLES];
        let places = &mut places[..self.modules * SAMPLES];
        for (k, place) in places.iter_mut().enumerate() {
            let inside = ((k % SAMPLES) as f64 + 0.5) / SAMPLES as f64 - 0.5;
            let module = (k / SAMPLES) as f64 + 0.5 + SAMPLED_SHARE * inside;
            *place = module / self.modules as f64;
        }
        let mut count = 0;
        for row in places.chunks_exact(SAMPLES) {
            for column in places.chunks_exact(SAMPLES) {
                for v in row {
                    for u in column {
                        let [x, y] = square.map(*u, *v);
                        samples[count] = image.sample(x as f32, y as f32);
                        count += 1;
                    }
                }
            }
        }
        count
    }
}

/// The brightness that best separates the samples into dark and bright; `None` if their means
/// differ by less than `contrast_min`. Source: Otsu, IEEE TSMC 9(1), 1979.
fn separating_level(samples: &[f32], contrast_min: f64) -> Option<f32> {
    let mut histogram = [0_u32; 256];
    for sample in samples {
        histogram[*sample as usize] += 1;
    }
    let count = samples.len() as f64;
    let weigh = |(level, n): (usize, &u32)| level as f64 * f64::from(*n);
    let total: f64 = histogram.iter().enumerate().map(weigh).sum();
    let (mut below, mut sum) = (0.0, 0.0);
    // Variance between the classes, level, difference of the means.
    let mut best = (0.0, 0, 0.0);
    for (level, n) in histogram.iter().enumerate() {
        below += f64::from(*n);
        sum += weigh((level, n));
        let above = count - below;
        if below == 0.0 || above == 0.0 {
            continue;
        }
        let difference = (total - sum) / above - sum / below;
        let variance = below * above * difference * difference;
        if variance > best.0 {
            best = (variance, level, difference);
        }
    }
    let (_, level, difference) = best;
    // Samples were cut down to whole levels: those of `level` itself are dark.
    (difference >= contrast_min).then_some(level as f32 + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_levels_are_separated_and_one_is_not() {
        let mut samples = [30.9_f32; 100];
        samples[40..].fill(200.0);
        let level = separating_level(&samples, 15.0).unwrap();
        assert!((30.9..200.0).contains(&level));
        assert_eq!(separating_level(&[80.0; 100], 15.0), None);
        samples[40..].fill(40.0);
        assert_eq!(separating_level(&samples, 15.0), None);
        assert_eq!(separating_level(&[], 15.0), None);
    }
}
