"""Depth against markers with our corners and with OpenCV's: whose are biased?

    python tests/depth_bias_vs_opencv.py [--pictures N] [--seed N]

1. Drawn markers of known pose (`markers_drawn.py`): how far each detector's sides are from the
   truth, and the bias that it claims of depth that is exact. "ours, grid" are the corners of
   `orime_markers::fit_grid`; `grid` is the side that the borders inside the marker say by a second,
   independent way (`grid_share`).
2. The real recording `three_cameras`: what `orime calibrate` finds, the bias that each detector
   finds ("ours, moved" are our squares moved by the border shift that `orime calibrate` states),
   where the grey half way between ink and paper lies beside each detector's sides, how wide edges
   are there (to compare with the drawn ones), and the bias where the grid is the scale.
3. The cube as a third scale: centres of markers do not move where sides are drawn in, so that the
   cube's 30 mm say the distance without the markers' 22 mm.

Needs numpy, scipy and opencv-contrib-python (`deploy/compare-tools bias` installs them), cargo, and
the data folder `$ORIME_DATA` (default `../shared/data`), and a release build of `orime`. Exits with
1 if, on drawn markers, our sides are off by more than 0.1 px or OpenCV's unrefined ones by less than
0.2 px where light is mixed after the curve, or, of any kind, `grid` by more than 0.2 % of the side
or the bias by "ours, grid" by more than 0.5 mm.
"""

import argparse
import itertools
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix
from scipy.spatial.transform import Rotation

from markers_drawn import (
    CORNERS_M,
    CUBE_M,
    DICTIONARY,
    KINDS,
    SIDE_M,
    drawn_scene,
    look,
    take,
    true_corners,
)
from markers_vs_opencv import CUBE, DATA, ROOT, detect_ours, inset

METHODS = ["NONE", "SUBPIX", "CONTOUR", "APRILTAG"]


def detect_opencv(method, images):
    params = cv2.aruco.DetectorParameters()
    params.cornerRefinementMethod = getattr(cv2.aruco, f"CORNER_REFINE_{method}")
    detector = cv2.aruco.ArucoDetector(DICTIONARY, params)
    found = {}
    for image in images:
        corners, ids, _ = detector.detectMarkers(cv2.imread(str(image)))
        ids = [] if ids is None else ids.flatten().tolist()
        found[image] = [(i, c.reshape(4, 2).astype(float)) for i, c in zip(ids, corners)]
    return found


def detect_all(images):
    """Per detector and image, the corners of every marker whose number occurs once in it."""
    found = {}
    for who, grid in (("ours", False), ("ours, grid", True)):
        ours = detect_ours("DICT_4X4_50", images, 1, grid)
        found[who] = {image: markers for image, (markers, _) in ours.items()}
    found |= {f"OpenCV {method}": detect_opencv(method, images) for method in METHODS}
    for markers in found.values():
        for image, list_ in markers.items():
            ids = [i for i, _ in list_]
            markers[image] = {i: c for i, c in list_ if ids.count(i) == 1}
    return found


def square_poses(corners, k):
    """Both poses of a square, the better one first, as rotation and translation."""
    solved = cv2.solvePnPGeneric(CORNERS_M, corners, k, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
    return [(cv2.Rodrigues(r)[0], t.ravel()) for r, t in zip(solved[1], solved[2])]


def side_px(corners):
    return np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean()


def depth_bias_m(corners, k, depth_m, factor=1.0):
    """Median of measured depth less the depth of the marker's plane (`factor` times as far as its
    side says), over the pixels well inside; None if less than half of them have depth near it."""
    rotation, place = square_poses(corners, k)[0]
    middle, mask = corners.mean(axis=0), np.zeros(depth_m.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(middle + 0.7 * (corners - middle)).astype(np.int32), 1)
    y, x = np.nonzero(mask)
    rays = np.linalg.solve(k, np.stack([x, y, np.ones_like(x)]).astype(float))
    plane_m = factor * (rotation[:, 2] @ place) / (rotation[:, 2] @ rays)
    error_m = depth_m[y, x] - plane_m
    near = (depth_m[y, x] > 0) & (abs(error_m) < 0.04)
    return np.median(error_m[near]) if 2 * near.sum() >= len(x) else None


def edge(grey, corners):
    """Where grey passes half way between ink and paper, outwards from the sides, and from 10 to
    90 %; pixels. None where the black border is too narrow to say what ink is."""
    if side_px(corners) / 6 < 4:
        return None
    out = np.arange(-3.0, 3.01, 0.1)
    profiles = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0)):
        along = (b - a) / np.linalg.norm(b - a)
        normal = np.array([along[1], -along[0]])  # Outwards: clockwise, y is down.
        at = a + np.linspace(0.2, 0.8, 25)[:, None, None] * (b - a) + out[None, :, None] * normal
        at = at.astype(np.float32)
        profiles.append(cv2.remap(grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR).mean(axis=0))
    profile = np.mean(profiles, axis=0)
    ink, paper = profile[:5].mean(), profile[-5:].mean()
    share = np.maximum.accumulate((profile - ink) / (paper - ink))
    low, half, high = np.interp([0.1, 0.5, 0.9], share, out)
    return half, high - low


def grid_share(grey, corners, number):
    """How much longer six modules of the marker's grid are than the side that `corners` have.

    Whatever moves the border between ink and paper (the display's curve, a lens, ink that spreads)
    moves borders to the left of ink one way and borders to its right the other way, so that all
    borders of the pattern together say the grid and that motion apart:
    found = nominal + shift + stretch * (nominal - 3) - motion * side, in modules."""
    printed = cv2.aruco.generateImageMarker(DICTIONARY, number, 6) > 0
    cells = np.pad(printed, 1, constant_values=True)
    from_grid = cv2.getPerspectiveTransform(
        np.array([[0, 0], [6, 0], [6, 6], [0, 6]], np.float32), corners.astype(np.float32)
    )
    across, along = np.arange(-0.45, 0.451, 0.02), np.linspace(0.3, 0.7, 9)
    stretches = []
    for pattern, swap in ((cells, False), (cells.T, True)):
        rows, found = [], []
        for line, k in np.argwhere(pattern[1:-1, 1:] != pattern[1:-1, :-1]):
            at = np.stack(np.broadcast_arrays(k + across, (line + along)[:, None]), axis=-1)
            at = at[..., ::-1] if swap else at
            px = cv2.perspectiveTransform(at.reshape(1, -1, 2).astype(np.float64), from_grid)
            px = px.reshape(*at.shape).astype(np.float32)
            profile = cv2.remap(grey, px[..., 0], px[..., 1], cv2.INTER_LINEAR).mean(axis=0)
            side = 1.0 if pattern[line + 1, k + 1] else -1.0  # Ink lies before the border.
            share = (profile - profile[:4].mean()) / (profile[-4:].mean() - profile[:4].mean())
            rows.append([1, k - 3, -side])
            found.append(np.interp(0.5, np.maximum.accumulate(share), across))
        stretches.append(np.linalg.lstsq(np.array(rows), np.array(found), rcond=None)[0][1])
    return np.mean(stretches)


# --- Drawn markers ---------------------------------------------------------------------------


def drawn_row(found, images, scenes, looks):
    """Of every marker found: side less the truth, the same and the grid's in per cent, bias."""
    rows = []
    for image, (k, ids, poses), (_, depth_m) in zip(images, scenes, looks):
        grey = cv2.imread(str(image), cv2.IMREAD_GRAYSCALE)
        for i, pose in zip(ids, poses):
            if i not in found[image]:
                continue
            corners, true_px = found[image][i], side_px(true_corners(pose, k))
            side = side_px(corners)
            grid = side * (1 + grid_share(grey, corners, i)) / true_px - 1
            bias_m = depth_bias_m(corners, k, depth_m)
            bias_mm = np.nan if bias_m is None else 1e3 * bias_m
            rows.append([side - true_px, 100 * (side / true_px - 1), bias_mm, 100 * grid])
    return len(rows), *np.nanmedian(rows, axis=0)


def drawn_edge(images, scenes):
    """Medians of `edge` at the true sides."""
    seen = []
    for image, (k, _, poses) in zip(images, scenes):
        grey = cv2.imread(str(image), cv2.IMREAD_GRAYSCALE)
        seen += [e for pose in poses if (e := edge(grey, true_corners(pose, k)))]
    return np.median(seen, axis=0)


def drawn(pictures, seed, scratch):
    scenes = [drawn_scene(np.random.default_rng([seed, n])) for n in range(pictures)]
    looks = [look(ids, poses, k, (640, 480)) for k, ids, poses in scenes]
    good = True
    print(f"{12 * pictures} drawn markers of {SIDE_M * 1e3:.0f} mm at 0.32 to 0.5 m, up to 50°")
    head = f"{'corners':<18}{'found':>6}{'side px':>9}{'side %':>8}{'depth mm':>10}{'grid %':>8}"
    for kind in KINDS:
        images = take(kind, looks, scratch, seed)
        half, width = drawn_edge(images, scenes)
        print(f"\n{kind}: half grey {half:+.2f} px outside the true edge, 10-90 % {width:.2f} px")
        print(head)
        for who, found in detect_all(images).items():
            number, off_px, share, bias_mm, grid = drawn_row(found, images, scenes, looks)
            row = f"{who:<18}{number:>6}{off_px:>+9.2f}{share:>+8.2f}"
            print(f"{row}{bias_mm:>+10.2f}{grid:>+8.2f}")
            good &= who != "ours" or abs(grid) <= 0.2
            good &= who != "ours, grid" or abs(bias_mm) <= 0.5
            if not KINDS[kind][1]:
                good &= who != "ours" or abs(off_px) <= 0.1
                good &= who != "OpenCV NONE" or off_px <= -0.2
    return good


# --- The real recording ----------------------------------------------------------------------


def recording():
    """Camera matrices, and per image its camera and depth in metres."""
    lenses = json.loads((CUBE / "intrinsics.json").read_text())
    ks = [np.array(lenses[f"cam{c}"]["color_K"]) for c in range(3)]
    images = {}
    for event in json.loads((CUBE / "meta.json").read_text())["captures"]:
        for c, frame in event["cams"].items():
            raw = cv2.imread(str(CUBE / frame["depth_path"]), cv2.IMREAD_UNCHANGED)
            unit_m = lenses[f"cam{c}"]["depth_scale_m_per_unit"]
            images[CUBE / frame["rgb_path"]] = (int(c), raw * unit_m)
    return ks, images


def biases(found, ks, images, factor=1.0):
    """Median bias per camera, millimetres, and the number of markers that it is of."""
    each = [[], [], []]
    for image, (c, depth_m) in images.items():
        for corners in found[image].values():
            bias = depth_bias_m(corners, ks[c], depth_m, factor)
            each[c] += [] if bias is None else [1e3 * bias]
    return [np.median(e) for e in each], sum(map(len, each))


def moved(markers, images, shift_px):
    """Squares moved outwards by their camera's border shift."""
    return {
        image: {i: inset(c, -shift_px[camera]) for i, c in markers[image].items()}
        for image, (camera, _) in images.items()
    }


def real(ks, images, shift_px):
    found = detect_all(list(images))
    found["ours, moved"] = moved(found["ours"], images, shift_px)
    greys = {image: cv2.imread(str(image), cv2.IMREAD_GRAYSCALE) for image in images}
    ours = found["ours"]
    each = [(c, ks[images[m][0]]) for m in images for c in ours[m].values()]
    each = [(side_px(c), square_poses(c, k)[0][1][2]) for c, k in each]
    side, far = np.median(each, axis=0)
    print(f"\nthree_cameras: {len(images)} images, sides of {side:.1f} px at {far:.3f} m (medians)")
    print(
        f"{'corners':<17}{'depth mm':>23}{'of':>4}{'side / ours':>13}{'half grey px':>14}"
        f"{'10-90 % px':>12}{'grid / side':>13}{'depth by grid mm':>24}"
    )
    for who, markers in found.items():
        list_ = [(image, i, c) for image in images for i, c in markers[image].items()]
        both = [side_px(c) / side_px(ours[m][i]) for m, i, c in list_ if i in ours[m]]
        share = 100 * (np.median(both) - 1)
        half, width = np.median([e for m, _, c in list_ if (e := edge(greys[m], c))], axis=0)
        grid = np.median([grid_share(greys[m], c, i) for m, i, c in list_])
        bias, number = biases(markers, ks, images)
        scaled, _ = biases(markers, ks, images, 1 / (1 + grid))
        row = f"{who:<17}{slashed(bias):>23}{number:>4}{share:>+11.2f} %{half:>+14.2f}"
        print(f"{row}{width:>12.2f}{100 * grid:>+11.2f} %{slashed(scaled):>24}")
    return found


def slashed(values):
    return " / ".join(f"{value:+.2f}" for value in values)


def calibrated():
    """Prints what `orime calibrate` says: bias per camera, distance of markers on opposite faces,
    border shift; returns the shift that it uses for each camera, pixels."""
    with tempfile.TemporaryDirectory() as scratch:
        figures = Path(scratch) / "figures.json"
        set_file = ROOT / "tests/sets/three_cameras.toml"
        target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
        command = [target / "release/orime", "calibrate", set_file]
        command += ["--out", scratch, "--json", figures]
        environment = os.environ | {"ORIME_DATA": str(DATA)}
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        figures = json.loads(figures.read_text())
    bias = slashed([c["depth_bias_mm"] for c in figures["cameras"]])
    centres = {m["id"]: np.array(m["centre_mm"]) for m in figures["target"]}
    apart = opposite(lambda a, b: np.linalg.norm(centres[a] - centres[b]), centres)
    shift = figures["border_shift"]
    print(f"\norime calibrate: depth {bias} mm, opposite markers {apart} mm apart")
    print(f"border shift {shift['shift_px']:.3f} ± {shift['sigma_px']:.3f} px", end=", ")
    print(f"by each camera alone {slashed(shift['own_px'])} px, {sum(shift['grids'])} grids read")
    for pair in figures["pairs"]:
        mm, number = pair["marker_agreement_mm_median"], pair["markers"]
        print(f"{' – '.join(pair['cameras'])}: the same marker within {mm:.2f} mm ({number})")
    return shift["used_px"]


def opposite(distance_mm, ids):
    """The distances of all pairs that lie on opposite faces, as text."""
    far = [distance_mm(a, b) for a, b in itertools.combinations(sorted(ids), 2)]
    return ", ".join(f"{d:.2f}" for d in far if d > 0.9 * CUBE_M * 1e3)


# --- The cube's shape from corners alone -----------------------------------------------------


def inverse(pose):
    rotation, place = pose
    return rotation.T, -rotation.T @ place


def after(outer, inner):
    return outer[0] @ inner[0], outer[0] @ inner[1] + outer[1]


def start_shape(views):
    """Poses of the markers in the first one's frame, by pairs that look at right angles."""
    pairs = {}
    for poses in views.values():
        for i, j in itertools.permutations(poses, 2):
            both = itertools.product(poses[i], poses[j])
            a, b = min(both, key=lambda ab: abs(ab[0][0][:, 2] @ ab[1][0][:, 2]))
            pairs.setdefault((i, j), []).append(after(inverse(a), b))

    def apart(a, b):
        return np.linalg.norm(a[0] - b[0]) + np.linalg.norm(a[1] - b[1]) / CUBE_M

    def middle(list_):
        return min(list_, key=lambda a: np.median([apart(a, b) for b in list_]))

    shape = {min(i for i, _ in pairs): (np.eye(3), np.zeros(3))}
    while reach := [ij for ij in pairs if ij[0] in shape and ij[1] not in shape]:
        i, j = max(reach, key=lambda ij: len(pairs[ij]))
        shape[j] = after(shape[i], middle(pairs[i, j]))
    return shape


def project(poses, points, k):
    """Pixels of n × 4 points by n poses (rotation vector and translation) and n lenses."""
    at = transform(poses, points)
    px = np.einsum("nij,ncj->nci", k, at)
    return px[..., :2] / px[..., 2:]


def transform(poses, points):
    turns = Rotation.from_rotvec(poses[:, :3]).as_matrix()
    return np.einsum("nij,ncj->nci", turns, points) + poses[:, None, 3:]


def six(pose):
    return np.array([*Rotation.from_matrix(pose[0]).as_rotvec(), *pose[1]])


def start_pose(poses, shape, corners, k):
    """The cube's pose in one image: of those that its markers say, the one that fits them all."""
    tries = [six(after(p, inverse(shape[i]))) for i, both in poses.items() for p in both]
    n = len(corners)
    on_cube = transform(np.array([six(shape[i]) for i in poses]), np.tile(CORNERS_M, (n, 1, 1)))
    lenses = np.tile(k, (n, 1, 1))

    def miss_px(pose):
        return np.median(abs(project(np.tile(pose, (n, 1)), on_cube, lenses) - corners))

    return min(tries, key=miss_px)


def cube_shape(found, ks, images):
    """Fits markers to one rigid cube through all images that show at least two of them, from
    corners alone: poses of the markers, root mean square of the corners in pixels, images."""
    lens = {image: ks[camera] for image, (camera, _) in images.items()}
    seen = {image: found[image] for image in images if len(found[image]) > 1}
    views = {m: {i: square_poses(c, lens[m]) for i, c in seen[m].items()} for m in seen}
    shape = start_shape(views)
    ids, names = sorted(shape), list(seen)
    rows = [(n, i, c) for n, m in enumerate(names) for i, c in seen[m].items()]
    at_marker = np.array([ids.index(i) for _, i, _ in rows])
    at_cube = np.array([len(ids) + n for n, _, _ in rows])
    corners, k = np.array([c for _, _, c in rows]), np.array([lens[names[n]] for n, _, _ in rows])
    flat = np.tile(CORNERS_M, (len(rows), 1, 1))

    def residual(x):
        x = x.reshape(-1, 6)
        return (project(x[at_cube], transform(x[at_marker], flat), k) - corners).ravel()

    start = [six(shape[i]) for i in ids]
    start += [start_pose(views[m], shape, np.array(list(seen[m].values())), lens[m]) for m in names]
    pattern = lil_matrix((corners.size, 6 * len(start)), dtype=int)
    for n, both in enumerate(zip(at_marker, at_cube)):
        for block in both:
            pattern[8 * n : 8 * n + 8, 6 * block : 6 * block + 6] = 1
    options = dict(jac_sparsity=pattern, loss="soft_l1", f_scale=0.3, max_nfev=200)
    scale = np.tile([1, 1, 1, 0.1, 0.1, 0.1], len(start))
    x = least_squares(residual, np.ravel(start), x_scale=scale, **options).x
    rms_px = np.sqrt((residual(x).reshape(-1, 2) ** 2).sum(axis=1).mean())
    poses = x.reshape(-1, 6)[: len(ids)]
    turned = {i: (Rotation.from_rotvec(p[:3]).as_matrix(), p[3:]) for i, p in zip(ids, poses)}
    return turned, rms_px, len(names)


def third_scale(found, ks, images):
    print("\nthe cube from corners alone, and depth with its 30 mm as the scale")
    head = f"{'corners':<17}{'images':>7}{'px rms':>8}{'opposite faces mm':>20}"
    print(f"{head}{'depth by cube mm':>24}")
    for who, markers in found.items():
        shape, rms, number = cube_shape(markers, ks, images)
        faces = {}
        for a, b in itertools.combinations(sorted(shape), 2):
            (ra, ta), (rb, tb) = shape[a], shape[b]
            if ra[:, 2] @ rb[:, 2] < -0.9:
                faces[a, b] = 1e3 * abs((ra[:, 2] - rb[:, 2]) / 2 @ (ta - tb))
        factor = CUBE_M * 1e3 / np.mean(list(faces.values()))
        bias, _ = biases(markers, ks, images, factor)
        apart = ", ".join(f"{d:.2f}" for d in faces.values())
        print(f"{who:<17}{number:>7}{rms:>8.2f}{apart:>20}{slashed(bias):>24}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pictures", type=int, default=10, help="drawn images of each kind")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    print(f"OpenCV {cv2.__version__}; depth: median of measured less expected")
    with tempfile.TemporaryDirectory() as scratch:
        good = drawn(arguments.pictures, arguments.seed, Path(scratch))
    if CUBE.is_dir():
        ks, images = recording()
        found = real(ks, images, calibrated())
        third_scale(found, ks, images)
    else:
        print(f"SKIPPED: no data at {DATA}; set ORIME_DATA")
    print("criterion met" if good else "CRITERION NOT MET")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
