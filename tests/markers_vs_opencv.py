"""The project's marker detector beside OpenCV's on the same real photographs.

    python tests/markers_vs_opencv.py [--repeat N]

Needs PyPI's opencv-contrib-python (or opencv-python-headless) and numpy, cargo, and the data
folder `$ORIME_DATA` (default `../shared/data`). Exits with 1 if a criterion of issue 3 fails:
ids exact, corners within 1 px for 98 % of the coordinates and 1.5 px for all, board residual at
most 0.4 px, and on the real cube no fewer true markers than OpenCV and no false one.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("ORIME_DATA", ROOT.parent / "shared" / "data"))
ARUCO, CUBE = DATA / "aruco", DATA / "three_cameras"
INSET_PX = 0.4


def detect_ours(dictionary, images, repeat, grid=False):
    """Per image the numbers and corners of its markers, and milliseconds; with `grid` the corners
    of those markers whose grid could be read, by the grid."""
    command = ["cargo", "run", "--release", "--quiet", "-p", "orime-markers", "--example", "detect"]
    command += ["--", "--repeat", str(repeat), str(dictionary), *map(str, images)]
    done = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    found = {}
    for line in done.stdout.splitlines():
        line = json.loads(line)
        each = [(m["id"], m["grid"] if grid else m) for m in line["markers"]]
        markers = [(i, np.array(m["corners_px"])) for i, m in each if "corners_px" in m]
        found[Path(line["image"])] = (markers, line["ms"])
    return found


def detect_opencv(dictionary, images, repeat):
    if Path(dictionary).is_file():
        table = cv2.aruco.Dictionary()
        storage = cv2.FileStorage(str(dictionary), cv2.FILE_STORAGE_READ)
        table.readDictionary(storage.root())
    else:
        table = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    params = cv2.aruco.DetectorParameters()
    params.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(table, params)
    found = {}
    for image in images:
        pixels, times = cv2.imread(str(image)), []
        for _ in range(repeat):
            start = cv2.getTickCount()
            corners, ids, _ = detector.detectMarkers(pixels)
            times.append((cv2.getTickCount() - start) / cv2.getTickFrequency() * 1e3)
        ids = [] if ids is None else ids.flatten().tolist()
        markers = [(i, c[0].astype(float)) for i, c in zip(ids, corners)]
        found[image] = (markers, float(np.median(times)))
    return found


def inset(corners, inset_px=INSET_PX):
    """Moves the sides inwards: gold corners are the last dark pixels' centres."""
    lines = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0)):
        along = (b - a) / np.linalg.norm(b - a)
        normal = np.array([-along[1], along[0]])  # Inwards: corners are clockwise, y is down.
        lines.append((normal, normal @ a + inset_px))
    return np.array(
        [
            np.linalg.solve([lines[k - 1][0], lines[k][0]], [lines[k - 1][1], lines[k][1]])
            for k in range(4)
        ]
    )


def against_gold(gold, markers):
    """Missing ids, extra ids, share within 1 px and largest error of the coordinates."""
    truth = dict(zip(gold["ids"], np.array(gold["corners"], dtype=float)))
    ids = sorted(i for i, _ in markers)
    missing = sorted(set(truth) - set(ids))
    extra = [i for i in ids if i not in truth] + [i for i in set(ids) if ids.count(i) > 1]
    errors = np.array([abs(inset(c) - truth[i]) for i, c in markers if i in truth])
    return missing, extra, (errors <= 1).mean(), errors.max()


def board_residual(markers):
    """Rms of the 5 × 7 board's corners against a homography with one radial term, pixels.

    The markers' side is fitted too, as a share of their spacing: nobody knows the print's, and
    each detector has its own idea of where black ends. Returns the rms and that share."""
    cell = np.array([[i % 5, i // 5] for i, _ in markers], dtype=float).repeat(4, axis=0)
    corner = np.tile([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]], (len(markers), 1))
    image = np.concatenate([c for _, c in markers])
    centre, scale = np.array([319.5, 239.5]), 320.0
    start, _ = cv2.findHomography(cell + 0.8 * corner, image)
    x = np.append((start / start[2, 2]).flatten()[:8], [0.0, 0.8])

    def residual(x):
        h = np.append(x[:8], 1).reshape(3, 3)
        p = np.c_[cell + x[9] * corner, np.ones(len(cell))] @ h.T
        p = (p[:, :2] / p[:, 2:] - centre) / scale
        p = p * (1 + x[8] * (p**2).sum(1, keepdims=True))
        return ((p * scale + centre) - image).flatten()

    for _ in range(30):  # Gauss–Newton with numeric slopes.
        r = residual(x)
        steps = np.maximum(1e-6 * abs(x), 1e-9)
        slopes = np.array([(residual(x + d) - r) / s for d, s in zip(np.diag(steps), steps)]).T
        x = x - np.linalg.lstsq(slopes, r, rcond=None)[0]
    return float(np.sqrt((residual(x) ** 2).reshape(-1, 2).sum(1).mean())), x[9]


def photographs(repeat):
    gold = json.loads((ARUCO / "gold_corners.json").read_text())["images"]
    good = True
    print(f"{'photograph':<28}{'':<8}{'missing':>8}{'extra':>6}{'≤ 1 px':>8}{'max px':>8}{'ms':>7}")
    for name, wanted in gold.items():
        dictionary = wanted["dictionary"]
        if dictionary.endswith(".yml"):
            dictionary = ARUCO / dictionary
        image = ARUCO / wanted.get("file", name)
        for who, detect in (("ours", detect_ours), ("OpenCV", detect_opencv)):
            markers, ms = detect(dictionary, [image], repeat)[image]
            missing, extra, share, worst = against_gold(wanted, markers)
            row = f"{name:<28}{who:<8}{len(missing):>8}{len(extra):>6}{share:>8.1%}{worst:>8.2f}"
            print(f"{row}{ms:>7.1f}")
            if who == "ours":
                good &= not missing and not extra and share >= 0.98 and worst <= 1.5
            if len(wanted["ids"]) == 35:
                rms, side = board_residual([m for m in markers if m[0] < 35])
                print(f"{'':<28}{who:<8}board: {rms:.3f} px rms, side {side:.3f} of the spacing")
                good &= who != "ours" or rms <= 0.4
    return good


def cube(repeat):
    """Markers of the real cube, which are the only ones in view: an id is true if the recording
    lists it in any image, and then once in an image. The list of an image is the recording's
    own detection and misses some; who alone found what is printed, to be looked at."""
    captures = json.loads((CUBE / "meta.json").read_text())["captures"]
    listed = {CUBE / c["rgb_path"]: c["ids"] for e in captures for c in e["cams"].values()}
    known = set(i for ids in listed.values() for i in ids)
    images = list(listed)
    found = {
        "ours": detect_ours("DICT_4X4_50", images, repeat),
        "OpenCV": detect_opencv("DICT_4X4_50", images, repeat),
    }
    count = {who: dict(true=0, unknown=0, twice=0, listed_missed=0) for who in found}
    only = {who: [] for who in found}
    for image, ids in listed.items():
        for who, other in (("ours", "OpenCV"), ("OpenCV", "ours")):
            here = [i for i, _ in found[who][image][0]]
            there = [i for i, _ in found[other][image][0]]
            count[who]["true"] += len(set(here) & known)
            count[who]["unknown"] += len([i for i in here if i not in known])
            count[who]["twice"] += len(here) - len(set(here))
            count[who]["listed_missed"] += len(set(ids) - set(here))
            only[who] += [(image, i) for i in here if i not in there and i not in ids]
    print(f"\ncube: {len(images)} images, {sum(map(len, listed.values()))} markers listed")
    print(f"{'':<8}{'found':>6}{'listed missed':>15}{'other ids':>10}{'twice':>6}{'ms':>7}")
    for who, c in count.items():
        ms = np.median([ms for _, ms in found[who].values()])
        row = f"{who:<8}{c['true']:>6}{c['listed_missed']:>15}{c['unknown']:>10}{c['twice']:>6}"
        print(f"{row}{ms:>7.1f}")
    return found, only, count


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=9, help="detections per image for the time")
    repeat = parser.parse_args().repeat
    if not ARUCO.is_dir() or not CUBE.is_dir():
        print(f"SKIPPED: no data at {DATA}; set ORIME_DATA")
        return 0
    cv2.setNumThreads(1)
    print(f"OpenCV {cv2.__version__}, one thread each")
    good = photographs(repeat)
    _, only, count = cube(repeat)
    for who, places in only.items():
        print(f"{who} alone:", ", ".join(f"{image.parent.name}/{image.name} {i}" for image, i in places))
    ours, theirs = count["ours"], count["OpenCV"]
    good &= ours["true"] >= theirs["true"] and ours["unknown"] + ours["twice"] == 0
    print("criterion met" if good else "CRITERION NOT MET")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
