//! OpenCV's predefined dictionaries by name.

use std::borrow::Cow;

use super::tables::{apriltag, aruco, aruco_other};
use super::{Dictionary, DictionaryError};

/// Name, modules on a side, correctable bits, codes.
type Entry = (&'static str, usize, u32, &'static [u64]);

/// All of them, with OpenCV's `maxCorrectionBits`. The small ones of a family are the first
/// markers of its largest.
static ENTRIES: [Entry; 22] = [
    ("DICT_4X4_50", 4, 1, aruco::SIDE_4.first_chunk::<50>().unwrap()),
    ("DICT_4X4_100", 4, 1, aruco::SIDE_4.first_chunk::<100>().unwrap()),
    ("DICT_4X4_250", 4, 1, aruco::SIDE_4.first_chunk::<250>().unwrap()),
    ("DICT_4X4_1000", 4, 0, &aruco::SIDE_4),
    ("DICT_5X5_50", 5, 3, aruco::SIDE_5.first_chunk::<50>().unwrap()),
    ("DICT_5X5_100", 5, 3, aruco::SIDE_5.first_chunk::<100>().unwrap()),
    ("DICT_5X5_250", 5, 2, aruco::SIDE_5.first_chunk::<250>().unwrap()),
    ("DICT_5X5_1000", 5, 2, &aruco::SIDE_5),
    ("DICT_6X6_50", 6, 6, aruco::SIDE_6.first_chunk::<50>().unwrap()),
    ("DICT_6X6_100", 6, 5, aruco::SIDE_6.first_chunk::<100>().unwrap()),
    ("DICT_6X6_250", 6, 5, aruco::SIDE_6.first_chunk::<250>().unwrap()),
    ("DICT_6X6_1000", 6, 4, &aruco::SIDE_6),
    ("DICT_7X7_50", 7, 9, aruco::SIDE_7.first_chunk::<50>().unwrap()),
    ("DICT_7X7_100", 7, 8, aruco::SIDE_7.first_chunk::<100>().unwrap()),
    ("DICT_7X7_250", 7, 8, aruco::SIDE_7.first_chunk::<250>().unwrap()),
    ("DICT_7X7_1000", 7, 6, &aruco::SIDE_7),
    ("DICT_ARUCO_ORIGINAL", 5, 1, &aruco_other::ARUCO_ORIGINAL),
    ("DICT_ARUCO_MIP_36h12", 6, 5, &aruco_other::ARUCO_MIP_36H12),
    ("DICT_APRILTAG_16h5", 4, 2, &apriltag::APRILTAG_16H5),
    ("DICT_APRILTAG_25h9", 5, 4, &apriltag::APRILTAG_25H9),
    ("DICT_APRILTAG_36h10", 6, 4, &apriltag::APRILTAG_36H10),
    ("DICT_APRILTAG_36h11", 6, 5, &apriltag::APRILTAG_36H11),
];

/// Names that [`Dictionary::predefined`] knows.
pub fn predefined_names() -> impl Iterator<Item = &'static str> {
    ENTRIES.iter().map(|(name, ..)| *name)
}

pub(super) fn find(name: &str) -> Result<Dictionary, DictionaryError> {
    let entry = ENTRIES.iter().find(|(known, ..)| *known == name);
    let Some(&(_, side, correctable_bits, codes)) = entry else {
        let known = predefined_names().collect::<Vec<_>>().join(", ");
        return Err(DictionaryError::Unknown { name: name.to_owned(), known });
    };
    Ok(Dictionary { side, correctable_bits, codes: Cow::Borrowed(codes) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn well_known_markers_have_their_bits() {
        let print = |name: &str, id: u32| -> Vec<String> {
            let dictionary = Dictionary::predefined(name).unwrap();
            let modules = dictionary.modules();
            (0..modules)
                .map(|row| {
                    (0..modules)
                        .map(|column| if dictionary.is_black(id, row, column) { '#' } else { '.' })
                        .collect()
                })
                .collect()
        };
        // As on every print of `DICT_4X4_50`'s marker 0.
        assert_eq!(
            print("DICT_4X4_50", 0),
            ["######", "#.#..#", "##.#.#", "###..#", "###.##", "######"]
        );
    }

    #[test]
    fn distances_allow_the_corrections_that_opencv_states() {
        for (name, side, correctable_bits, codes) in ENTRIES {
            // The largest dictionaries take a second each, and OpenCV's figures are theirs.
            if codes.len() > 260 {
                continue;
            }
            let least = super::super::least_distance(side, codes).unwrap();
            assert!(least > 2 * correctable_bits, "{name}: {least}");
        }
    }

    #[test]
    fn unknown_names_are_answered_with_the_known() {
        let error = Dictionary::predefined("DICT_4X4").unwrap_err().to_string();
        assert!(error.contains("`DICT_4X4`") && error.contains("DICT_7X7_250"), "{error}");
        assert_eq!(Dictionary::predefined("DICT_APRILTAG_36h11").unwrap().len(), 587);
    }
}
