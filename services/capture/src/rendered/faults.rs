//! The faults of real cameras: presets, and each with its own strength.

use orime_params::Checker;
use serde::{Deserialize, Serialize};

use super::occluder::Occluder;

/// How faulty the cameras are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FaultPreset {
    /// Perfect cameras, but for the depth unit.
    None,
    /// Depth noise and nothing else (default).
    #[default]
    Noise,
    /// Everything that real cameras do.
    Real,
}

/// Declares the faults: `key: unit and meaning, [none, noise, real], low..=high`.
macro_rules! faults {
    ($(
        $(#[$doc:meta])*
        $key:ident: [$none:expr, $noise:expr, $real:expr], $low:expr, $high:expr;
    )*) => {
        /// The `[capture.rendered.fault]` section: single strengths instead of the preset's.
        #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct FaultParams {
            $($(#[$doc])* pub $key: Option<f64>,)*
            /// What holds the moving corner or edge and hides it: `"none"`, `"grippers"` or
            /// `"hand"`. With `"real"`: grippers.
            pub occluder: Option<Occluder>,
        }

        /// Every fault's strength; fields as in [`FaultParams`].
        #[derive(Debug, Clone, PartialEq)]
        pub(super) struct Faults {
            $(pub $key: f64,)*
            pub occluder: Occluder,
        }

        impl FaultParams {
            /// The preset's strengths with this section's instead where it has them.
            pub(super) fn over(&self, preset: FaultPreset) -> Faults {
                let column = preset as usize;
                let grippers = preset == FaultPreset::Real;
                let occluder = if grippers { Occluder::Grippers } else { Occluder::None };
                Faults {
                    $($key: self.$key.unwrap_or([$none, $noise, $real][column]),)*
                    occluder: self.occluder.unwrap_or(occluder),
                }
            }

            /// Notes strengths out of range.
            pub(super) fn check(&self, checker: &mut Checker) {
                $(if let Some(value) = self.$key {
                    let (low, high): (f64, f64) = ($low, $high);
                    let range = format!("must be {low} to {high}");
                    let key = concat!("fault.", stringify!($key));
                    checker.require(low <= value && value <= high, key, value, &range);
                })*
            }
        }
    };
}

faults! {
    /// σ₀ of the depth noise σ² = σ₀² + (k z²)², metres. Measured on real D415s: 0.00039.
    noise_floor_m: [0.0, 0.000_39, 0.000_39], 0.0, 0.05;
    /// k of the depth noise of a D415, 1/m; other makes' follow from focal length and baseline.
    /// Measured: 0.0028.
    noise_per_m: [0.0, 0.0028, 0.0028], 0.0, 0.1;
    /// Distance at which the noise's correlation falls to 1/e, pixels; 0 makes it white. Real
    /// cameras show 3 to 6.
    noise_correlation_px: [3.0, 3.0, 5.0], 0.0, 20.0;
    /// How much too short a camera reads, metres; each its own 0.88 to 1.22 of it. Real D415s:
    /// 0.004 to 0.0055.
    bias_m: [0.0, 0.0, 0.0045], -0.05, 0.05;
    /// Step of the disparity, pixels; 0 leaves rounding to the depth unit alone. With it σ₀ and k
    /// are what is measured after rounding.
    disparity_step_px: [0.0, 0.0, 0.031_25], 0.0, 1.0;
    /// Share of depth pixels without return anywhere, in blobs of the noise's correlation.
    hole_rate: [0.0, 0.0, 0.002], 0.0, 0.5;
    /// Angle between ray and normal from which on nothing returns, degrees; 90 is off.
    grazing_deg: [90.0, 90.0, 78.0], 30.0, 90.0;
    /// Extent of the holes beside nearer objects: 1 is what the second imager does not see on
    /// their left plus 1.3 px of the matching window on both sides.
    shadow: [0.0, 0.0, 1.0], 0.0, 3.0;
    /// Share of the sheet's width that a bar half way to it hides from each camera. The bars sweep
    /// to and fro, each at its own time.
    occlusion: [0.0, 0.0, 0.0], 0.0, 0.9;
    /// Size of the blind spot where paper mirrors the lamp: 1 − cos⁴⁰ of its half angle.
    saturation: [0.0, 0.0, 0.03], 0.0, 0.9;
    /// Pixels between near and far for each pixel of a nearer object's edge. Real: 0.4 to 0.5.
    flying_rate: [0.0, 0.0, 0.45], 0.0, 1.0;
    /// How far the published place of each camera is from the true one, metres.
    calibration_error_m: [0.0, 0.0, 0.001], 0.0, 0.1;
    /// How far the published attitude of each camera is from the true one, degrees.
    calibration_error_deg: [0.0, 0.0, 0.2], 0.0, 10.0;
    /// Largest share of a period by which a camera's shutter is before or after camera 0's.
    shutter_spread: [0.0, 0.0, 0.5], 0.0, 0.5;
    /// Largest error of a frame's time stamp, seconds; at most a quarter of a period counts.
    stamp_jitter_s: [0.0, 0.0, 0.001], 0.0, 0.1;
    /// Exposure of a colour image, seconds: blurs what moves; 0 is off.
    exposure_s: [0.0, 0.0, 0.008], 0.0, 0.2;
    /// Standard deviation of the colours' noise, 0 to 255.
    color_noise: [0.0, 0.0, 2.0], 0.0, 20.0;
    /// Standard deviation of the grippers' reported places and held points, metres.
    gripper_noise_m: [0.0, 0.0, 0.0005], 0.0, 0.1;
    /// Standard deviation of the grippers' reported attitudes, degrees about each axis.
    gripper_noise_deg: [0.0, 0.0, 0.3], 0.0, 30.0;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_strength_goes_over_the_preset() {
        let params = FaultParams { shadow: Some(0.0), ..FaultParams::default() };
        let faults = params.over(FaultPreset::Real);
        assert_eq!((faults.shadow, faults.flying_rate), (0.0, 0.45));
        assert_eq!(faults.occluder, Occluder::Grippers);
        let noise = FaultParams::default().over(FaultPreset::Noise);
        assert_eq!(
            (noise.noise_floor_m, noise.noise_per_m, noise.hole_rate),
            (0.00039, 0.0028, 0.0)
        );
        assert_eq!((noise.noise_correlation_px, noise.occluder), (3.0, Occluder::None));
        assert_eq!(FaultParams::default().over(FaultPreset::None).noise_floor_m, 0.0);
    }

    #[test]
    fn strengths_out_of_range_are_named() {
        let params =
            FaultParams { hole_rate: Some(f64::NAN), shadow: Some(-1.0), ..FaultParams::default() };
        let mut checker = Checker::new();
        params.check(&mut checker);
        let problems = checker.finish(|| ()).unwrap_err();
        let keys: Vec<&str> = problems.iter().map(|p| p.key.as_str()).collect();
        assert_eq!(keys, ["fault.hole_rate", "fault.shadow"]);
    }
}
