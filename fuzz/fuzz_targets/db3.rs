//! Bytes as a RealSense recording in a .db3 file, all of whose frames are read.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| orime_fuzz::read_realsense(bytes, "db3"));
