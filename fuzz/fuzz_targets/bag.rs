//! Bytes as a RealSense recording in a .bag file, all of whose frames are read.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| orime_fuzz::read_realsense(bytes, "bag"));
