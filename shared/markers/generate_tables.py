"""Writes src/dictionary/tables/*.rs: the bits of OpenCV's predefined ArUco dictionaries.

The bit patterns are facts of the format. They are read out of PyPI's opencv-contrib-python
(`cv2.aruco.getPredefinedDictionary`); the files in the repository came from 5.0.0.93. Run:

    python shared/markers/generate_tables.py
"""

from pathlib import Path

import cv2

FOLDER = Path(__file__).parent / "src" / "dictionary" / "tables"
FILES = {
    "aruco": ["4X4_1000", "5X5_1000", "6X6_1000", "7X7_1000"],
    "aruco_other": ["ARUCO_ORIGINAL", "ARUCO_MIP_36h12"],
    "apriltag": ["APRILTAG_16h5", "APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11"],
}


def codes(dictionary):
    """Row-major bits of each marker as one number: first cell most significant, 1 is white."""
    for row in range(dictionary.bytesList.shape[0]):
        bits = cv2.aruco.Dictionary.getBitsFromByteList(
            dictionary.bytesList[row : row + 1], dictionary.markerSize
        )
        yield int("".join(str(bit) for bit in bits.flatten()), 2)


def prefixes(name):
    """Asserts that the smaller dictionaries of a family are prefixes of the largest."""
    family, whole = name.split("_")[0], list(codes(load(name)))
    for count in (50, 100, 250):
        assert list(codes(load(f"{family}_{count}"))) == whole[:count]


def load(name):
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


for file, names in FILES.items():
    text = "//! Written by `generate_tables.py` from opencv-contrib-python " + cv2.__version__ + ".\n\n"
    text += "use super::super::hex::codes;\n"
    for name in names:
        if name.endswith("_1000"):
            prefixes(name)
        dictionary = load(name)
        digits = (dictionary.markerSize**2 + 3) // 4
        numbers = [f"{code:0{digits}x}" for code in codes(dictionary)]
        rust = name.upper().replace("_1000", "").replace("4X4", "SIDE_4").replace("5X5", "SIDE_5")
        rust = rust.replace("6X6", "SIDE_6").replace("7X7", "SIDE_7")
        text += f"\n/// `DICT_{name}`, {digits} hexadecimal digits a marker.\n"
        text += f"pub(in super::super) static {rust}: [u64; {len(numbers)}] = codes(\n    {digits},\n    \"\\\n"
        per_line = 94 // digits
        for start in range(0, len(numbers), per_line):
            text += "    " + "".join(numbers[start : start + per_line]) + "\\\n"
        text += "    \",\n);\n"
    (FOLDER / f"{file}.rs").write_text(text)
