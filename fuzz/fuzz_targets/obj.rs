//! Bytes as an OBJ file, and as the template of a sheet.
#![no_main]

use libfuzzer_sys::fuzz_target;
use orime_recording::{Obj, QuadGrid};

fuzz_target!(|bytes: &[u8]| {
    if let Ok(obj) = Obj::read(&orime_fuzz::as_file(bytes, "obj")) {
        let _ = QuadGrid::from_obj(&obj);
    }
});
