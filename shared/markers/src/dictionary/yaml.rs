//! Custom dictionaries in the YAML form that OpenCV's `FileStorage` writes.

use super::{Dictionary, DictionaryError, SIDE_MAX};

/// Most markers of a custom dictionary: every candidate is compared with each of them.
const MARKERS_MAX: usize = 10_000;

/// Reads `key: value` lines; keys that are not about markers are passed over.
pub(super) fn parse(text: &str) -> Result<Dictionary, DictionaryError> {
    let value = |key: &str| -> Option<&str> {
        let mut lines = text.lines().filter_map(|line| line.split_once(':'));
        lines.find(|(found, _)| found.trim() == key).map(|(_, value)| {
            let value = value.split('#').next().unwrap_or_default();
            value.trim().trim_matches(['"', '\''])
        })
    };
    let number = |key: &str, low: usize, high: usize| -> Result<usize, DictionaryError> {
        let found = value(key).unwrap_or("missing");
        let parsed = found.parse().ok().filter(|number| (low..=high).contains(number));
        parsed.ok_or_else(|| malformed(key, format!("is {found}: must be {low} to {high}")))
    };
    let count = number("nmarkers", 1, MARKERS_MAX)?;
    let side = number("markersize", 2, SIDE_MAX)?;
    let correctable = match value("maxCorrectionBits") {
        Some(_) => Some(number("maxCorrectionBits", 0, side * side)? as u32),
        None => None,
    };
    let mut codes = vec![None; count];
    // One pass over the lines, however many markers there are.
    for (key, digits) in text.lines().filter_map(|line| line.split_once(':')) {
        let Some(id) = key.trim().strip_prefix("marker_").and_then(|id| id.parse().ok()) else {
            continue;
        };
        let slot: &mut Option<u64> = codes
            .get_mut::<usize>(id)
            .ok_or_else(|| malformed(key.trim(), format!("is beyond `nmarkers: {count}`")))?;
        *slot = Some(code(key.trim(), digits.trim().trim_matches(['"', '\'']), side)?);
    }
    let codes: Result<Vec<u64>, DictionaryError> = codes
        .into_iter()
        .enumerate()
        .map(|(id, code)| {
            code.ok_or_else(|| malformed(&format!("marker_{id}"), "is missing".to_owned()))
        })
        .collect();
    Dictionary::new(side, correctable, codes?)
}

/// The number that a string of binary digits spells.
fn code(key: &str, digits: &str, side: usize) -> Result<u64, DictionaryError> {
    if digits.len() != side * side || digits.bytes().any(|digit| !matches!(digit, b'0' | b'1')) {
        let message = format!("is {digits:?}: must be {} digits 0 or 1", side * side);
        return Err(malformed(key, message));
    }
    Ok(digits.bytes().fold(0, |code, digit| code << 1 | u64::from(digit == b'1')))
}

fn malformed(key: &str, message: String) -> DictionaryError {
    DictionaryError::Malformed { key: key.to_owned(), message }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: &str = "%YAML:1.0\nnmarkers: 2\nmarkersize: 3\n\
                         marker_0: \"100000000\"\nmarker_1: '111100000'\n";

    #[test]
    fn small_dictionary() {
        let dictionary = parse(SMALL).unwrap();
        assert_eq!((dictionary.len(), dictionary.modules()), (2, 5));
        assert!(!dictionary.is_black(0, 1, 1) && dictionary.is_black(0, 1, 2));
        // Marker 0 and its own turns differ in 2 bits.
        assert_eq!(dictionary.correctable_bits(), 0);
        let stated = parse(&format!("{SMALL}maxCorrectionBits: 1 # why not\n")).unwrap();
        assert_eq!(stated.correctable_bits(), 1);
    }

    #[test]
    fn faults_are_named_with_their_key() {
        let refuse = |from: &str, to: &str, part: &str| {
            assert!(SMALL.contains(from));
            let message = parse(&SMALL.replace(from, to)).unwrap_err().to_string();
            assert!(message.contains(part), "{message}");
        };
        refuse("nmarkers: 2", "nmarkers: 3", "`marker_2` of the dictionary is missing");
        refuse("nmarkers: 2", "nmarkers: 1", "`marker_1` of the dictionary is beyond");
        refuse("nmarkers: 2", "nmarkers: 99999999", "1 to 10000");
        refuse("markersize: 3", "markersize: 30", "2 to 8");
        refuse("markersize: 3", "size: 3", "missing");
        refuse("100000000", "10000000", "9 digits");
        refuse("100000000", "10000002é", "9 digits");
        refuse("111100000", "001000000", "quarter turns");
        assert!(parse("").is_err());
    }
}
