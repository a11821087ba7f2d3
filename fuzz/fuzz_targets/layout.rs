//! A text as the layout file of a folder of images.
#![no_main]

use libfuzzer_sys::fuzz_target;
use orime_recording::{FolderLayout, FolderRecording};
use std::path::Path;

fuzz_target!(|bytes: &[u8]| {
    let path = orime_fuzz::as_file(bytes, "toml");
    if let Ok(layout) = FolderLayout::load(&path) {
        let _ = FolderRecording::build(&layout, Path::new("/nonexistent"));
    }
});
