//! Which bits make which marker.

mod hex;
mod predefined;
mod tables;
mod yaml;

use std::borrow::Cow;

pub use predefined::predefined_names;

/// Why a dictionary is not available. A deployment fault: stop.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DictionaryError {
    /// There is no predefined dictionary of this name.
    #[error("`{name}` is no predefined dictionary: use {known}, or the path of a YAML file")]
    Unknown {
        /// What was asked for.
        name: String,
        /// Every name there is.
        known: String,
    },
    /// A custom dictionary is malformed.
    #[error("key `{key}` of the dictionary {message}")]
    Malformed {
        /// The key of the YAML file.
        key: String,
        /// What is wrong and what would be right.
        message: String,
    },
    /// A custom dictionary's markers cannot be told apart.
    #[error(
        "marker {id} of the dictionary equals marker {other} after some quarter turns: replace one"
    )]
    Ambiguous {
        /// One marker.
        id: u32,
        /// The other, or the same where it looks the same after a turn.
        other: u32,
    },
}

/// A set of square markers: `side × side` modules inside a black border one module wide.
#[derive(Debug, Clone, PartialEq)]
pub struct Dictionary {
    side: usize,
    correctable_bits: u32,
    /// Row-major bits of each marker: first module most significant, 1 is white.
    codes: Cow<'static, [u64]>,
}

/// What a code was recognised as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Match {
    pub id: u32,
    /// Quarter turns, counter-clockwise in the image, that bring the marker upright: corner `k`
    /// of the marker is corner `(k + turns) % 4` of the quadrangle that was read.
    pub turns: usize,
    pub wrong_bits: u32,
}

/// Most modules on the side of a marker's inside: 8 × 8 bits fill a code.
const SIDE_MAX: usize = 8;

impl Dictionary {
    /// The OpenCV dictionary of this name, for example `DICT_4X4_50`.
    pub fn predefined(name: &str) -> Result<Self, DictionaryError> {
        predefined::find(name)
    }

    /// A dictionary in OpenCV's YAML form: `nmarkers`, `markersize`, `marker_0` … as strings of
    /// `markersize²` digits, row by row, `1` is white; `maxCorrectionBits` where it is given, else
    /// ⌊(d − 1) / 2⌋ with d the least distance between two markers.
    pub fn from_yaml(text: &str) -> Result<Self, DictionaryError> {
        yaml::parse(text)
    }

    /// A dictionary of these codes: row-major bits, first module most significant, 1 is white.
    /// `side` is 1 to 8.
    pub(crate) fn new(
        side: usize,
        correctable_bits: Option<u32>,
        codes: Vec<u64>,
    ) -> Result<Self, DictionaryError> {
        debug_assert!((1..=SIDE_MAX).contains(&side));
        let distance = least_distance(side, &codes)?;
        let correctable_bits = correctable_bits.unwrap_or((distance - 1) / 2);
        Ok(Self { side, correctable_bits, codes: Cow::Owned(codes) })
    }

    /// Number of markers; ids are `0..len`.
    #[expect(clippy::len_without_is_empty, reason = "a dictionary is never empty")]
    pub fn len(&self) -> u32 {
        self.codes.len() as u32
    }

    /// Modules on the side of a marker with its border.
    pub fn modules(&self) -> usize {
        self.side + 2
    }

    /// Most bits that may be wrong in a marker before it could be another.
    pub fn correctable_bits(&self) -> u32 {
        self.correctable_bits
    }

    /// Whether a module of a marker is black; `row` and `column` count from the marker's own
    /// top-left, the border included. Panics unless `id` is below `len()` and both others are
    /// below `modules()`.
    pub fn is_black(&self, id: u32, row: usize, column: usize) -> bool {
        let border = |k: usize| k == 0 || k == self.side + 1;
        if border(row) || border(column) {
            return true;
        }
        let place = (row - 1) * self.side + column - 1;
        self.codes[id as usize] >> (self.side * self.side - 1 - place) & 1 == 0
    }

    /// The marker that differs in the fewest bits, at most `wrong_bits_max`, from what was read.
    pub(crate) fn recognise(&self, read: u64, wrong_bits_max: u32) -> Option<Match> {
        let mut best: Option<Match> = None;
        let mut turned = read;
        for turns in 0..4 {
            for (id, code) in self.codes.iter().enumerate() {
                let wrong_bits = (code ^ turned).count_ones();
                let limit = best.map_or(wrong_bits_max + 1, |best| best.wrong_bits);
                if wrong_bits < limit {
                    best = Some(Match { id: id as u32, turns, wrong_bits });
                }
            }
            turned = quarter_turn(turned, self.side);
        }
        best
    }
}

/// The same modules after a quarter turn counter-clockwise.
fn quarter_turn(code: u64, side: usize) -> u64 {
    let mut turned = 0;
    for row in 0..side {
        for column in 0..side {
            let place = column * side + side - 1 - row;
            turned = turned << 1 | code >> (side * side - 1 - place) & 1;
        }
    }
    turned
}

/// Least number of bits by which two markers, or one and its own turns, differ.
fn least_distance(side: usize, codes: &[u64]) -> Result<u32, DictionaryError> {
    let mut least = (side * side) as u32;
    for (id, code) in codes.iter().enumerate() {
        let mut turned = *code;
        for turns in 0..4 {
            for (other, code) in codes[..=id].iter().enumerate() {
                if turns == 0 && other == id {
                    continue;
                }
                let distance = (code ^ turned).count_ones();
                if distance == 0 {
                    return Err(DictionaryError::Ambiguous { id: id as u32, other: other as u32 });
                }
                least = least.min(distance);
            }
            turned = quarter_turn(turned, side);
        }
    }
    Ok(least)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_is_counter_clockwise() {
        // 1 2      2 4
        // 3 4  to  1 3, with only `2` white.
        assert_eq!(quarter_turn(0b0100, 2), 0b1000);
        let code = 0b101_110_000;
        let back = (0..4).fold(code, |code, _| quarter_turn(code, 3));
        assert_eq!(back, code);
    }

    #[test]
    fn every_marker_is_recognised_in_every_turn_with_correctable_bits_wrong() {
        let dictionary = Dictionary::predefined("DICT_6X6_250").unwrap();
        for id in 0..dictionary.len() {
            let mut read = dictionary.codes[id as usize];
            for turns in [0, 3, 2, 1] {
                let found = dictionary.recognise(read ^ 0b1001, 3);
                assert_eq!(found, Some(Match { id, turns, wrong_bits: 2 }));
                assert_eq!(dictionary.recognise(read ^ 0b1001, 1), None);
                read = quarter_turn(read, 6);
            }
        }
    }

    #[test]
    fn markers_that_look_alike_are_refused() {
        let error = Dictionary::new(2, None, vec![0b1000, 0b0100]).unwrap_err();
        assert_eq!(error, DictionaryError::Ambiguous { id: 1, other: 0 });
        let error = Dictionary::new(2, None, vec![0b1000, 0b1001]).unwrap_err();
        assert_eq!(error, DictionaryError::Ambiguous { id: 1, other: 1 });
    }
}
