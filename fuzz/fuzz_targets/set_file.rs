//! A text as a set file, and its `simulate` section as that of a scene.
#![no_main]

use libfuzzer_sys::fuzz_target;
use orime_runtime::SetFile;
use orime_simulate::SimulateParams;
use std::path::Path;

fuzz_target!(|text: String| {
    let Ok(set) = SetFile::parse(Path::new("/sets/fuzz.toml"), text) else { return };
    if let Ok(params) = set.section::<SimulateParams>("simulate") {
        let _ = params.check();
    }
});
