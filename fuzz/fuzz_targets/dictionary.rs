//! A text as a dictionary of markers in YAML.
#![no_main]

use libfuzzer_sys::fuzz_target;
use orime_markers::Dictionary;

fuzz_target!(|text: &str| {
    let _ = Dictionary::from_yaml(text);
});
