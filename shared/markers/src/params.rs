//! The detector's parameters.

use orime_params::{Checker, Problem};
use serde::{Deserialize, Serialize};

/// How markers are looked for. The defaults find what OpenCV 5 finds, and more.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DetectorParams {
    /// Sides of the windows whose mean is the threshold, pixels, odd, 3 to 101, 1 to 8 of them.
    /// One as wide as a module finds small markers, a wide one those in uneven light; each costs
    /// about a third of the time. Default 5, 13, 23.
    pub threshold_windows_px: Vec<usize>,
    /// How much darker than its window's mean a pixel must be to be dark, grey levels, 0 to 128.
    /// Less finds fainter markers and more noise. Default 10.
    pub threshold_offset: f64,
    /// Most brightness of ink as a share of its window's mean, 0 (off) to 0.9: a further
    /// threshold, that tells ink from a darkish table where a marker ends with its sheet. It has
    /// to lie between ink and table. Default 0.55.
    pub ink_ratio: f64,
    /// Side of that threshold's window, pixels, odd, 3 to 101. Default 23.
    pub ink_window_px: usize,
    /// Largest distance of a border from the quadrangle that replaces it, as a share of its
    /// length, 0.005 to 0.1. Default 0.03.
    pub quad_error_ratio: f64,
    /// Smallest module (cell) of a marker, pixels: the root of its area, 1 to 20. Smaller markers
    /// are read wrongly as often as not. Default 1.6.
    pub module_px_min: f64,
    /// Share of the border's modules that may read white, 0 to 0.5: glare, fingers. More finds
    /// more false markers. Default 0.2.
    pub border_error_ratio: f64,
    /// Share of the dictionary's correctable bits that are corrected, 0 to 1: more finds dirty
    /// markers and false ones. Default 0.6.
    pub correction_ratio: f64,
    /// Smallest difference between the mean white and the mean black of a marker, grey levels,
    /// 1 to 255. Default 15.
    pub contrast_min: f64,
}

impl Default for DetectorParams {
    fn default() -> Self {
        Self {
            threshold_windows_px: vec![5, 13, 23],
            threshold_offset: 10.0,
            ink_ratio: 0.55,
            ink_window_px: 23,
            quad_error_ratio: 0.03,
            module_px_min: 1.6,
            border_error_ratio: 0.2,
            correction_ratio: 0.6,
            contrast_min: 15.0,
        }
    }
}

/// Checked parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorConfig(DetectorParams);

impl DetectorConfig {
    /// The parameters, all in range.
    pub fn params(&self) -> &DetectorParams {
        &self.0
    }
}

impl DetectorParams {
    /// Checks the section; every problem at once.
    pub fn check(&self) -> Result<DetectorConfig, Vec<Problem>> {
        let Self {
            threshold_windows_px,
            threshold_offset,
            ink_ratio,
            ink_window_px,
            quad_error_ratio,
            module_px_min,
            border_error_ratio,
            correction_ratio,
            contrast_min,
        } = self;
        let mut checker = Checker::new();
        checker.require(
            (1..=8).contains(&threshold_windows_px.len())
                && threshold_windows_px.iter().all(|px| px % 2 == 1 && (3..=101).contains(px)),
            "threshold_windows_px",
            threshold_windows_px,
            "must be 1 to 8 odd numbers of 3 to 101 pixels",
        );
        checker.require(
            ink_window_px % 2 == 1 && (3..=101).contains(ink_window_px),
            "ink_window_px",
            ink_window_px,
            "must be an odd number of 3 to 101 pixels",
        );
        for (key, value, low, high) in [
            ("threshold_offset", threshold_offset, 0.0, 128.0),
            ("ink_ratio", ink_ratio, 0.0, 0.9),
            ("quad_error_ratio", quad_error_ratio, 0.005, 0.1),
            ("module_px_min", module_px_min, 1.0, 20.0),
            ("border_error_ratio", border_error_ratio, 0.0, 0.5),
            ("correction_ratio", correction_ratio, 0.0, 1.0),
            ("contrast_min", contrast_min, 1.0, 255.0),
        ] {
            let range = format!("must be {low} to {high}");
            checker.require(low <= *value && *value <= high, key, value, &range);
        }
        checker.finish(|| DetectorConfig(self.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documented_defaults_hold() {
        let p = DetectorParams::default();
        assert_eq!(p.threshold_windows_px, [5, 13, 23]);
        assert_eq!((p.threshold_offset, p.quad_error_ratio, p.module_px_min), (10.0, 0.03, 1.6));
        assert_eq!((p.border_error_ratio, p.correction_ratio), (0.2, 0.6));
        assert_eq!((p.ink_ratio, p.ink_window_px), (0.55, 23));
        assert_eq!(p.contrast_min, 15.0);
        assert!(p.check().is_ok());
    }

    #[test]
    fn bad_parameters_are_reported_whole() {
        let params = DetectorParams {
            threshold_windows_px: vec![5, 12],
            threshold_offset: f64::NAN,
            ink_ratio: 1.0,
            ink_window_px: 4,
            quad_error_ratio: 1.0,
            module_px_min: 0.5,
            border_error_ratio: -0.1,
            correction_ratio: 2.0,
            contrast_min: 0.0,
        };
        let keys: Vec<String> = params.check().unwrap_err().into_iter().map(|p| p.key).collect();
        assert_eq!(
            keys,
            [
                "threshold_windows_px",
                "ink_window_px",
                "threshold_offset",
                "ink_ratio",
                "quad_error_ratio",
                "module_px_min",
                "border_error_ratio",
                "correction_ratio",
                "contrast_min"
            ]
        );
    }
}
