//! Bytes as a PLY file.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let _ = orime_recording::ply::read_points(&orime_fuzz::as_file(bytes, "ply"));
});
