//! A text as a calibration: TOML, Kalibr's camchain or camera_info of ROS.
#![no_main]

use libfuzzer_sys::fuzz_target;
use orime_calibration::Calibration;

fuzz_target!(|bytes: &[u8]| {
    for ending in ["toml", "yaml"] {
        let path = orime_fuzz::as_file(bytes, ending);
        let mut cameras = ["left", "right"].map(orime_fuzz::camera);
        if let Ok(calibration) = Calibration::load(&path, &cameras) {
            if calibration.apply(&path, &mut cameras).is_ok() {
                let _ = orime_calibration::doubts(&cameras);
            }
            let _ = calibration.to_text("fuzz");
        }
    }
});
