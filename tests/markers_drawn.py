"""Pictures of ArUco markers whose corners and depth are known, as a camera would take them.

Edges are drawn by 8 x 8 rays a pixel, blurred as by a lens, mixed after or before the display's
curve (sRGB; cameras mix before), once sharpened and compressed besides. Needs numpy, scipy and
opencv-contrib-python; `depth_bias_vs_opencv.py` uses it.
"""

import itertools

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

SIDE_M, CUBE_M = 0.022, 0.030
HALF = SIDE_M / 2
# OpenCV's order: clockwise from the marker's own top left corner; +y is up, +z towards the viewer.
CORNERS_M = np.array([[-HALF, HALF, 0], [HALF, HALF, 0], [HALF, -HALF, 0], [-HALF, -HALF, 0]])
DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
RAYS = 8
# Drawn: blur [px], whether light is mixed before the display's curve, sharpening, JPEG quality.
KINDS = {
    "sharp": (0.0, False, 0.0, None),
    "lens 0.5 px": (0.5, False, 0.0, None),
    "lens 1.0 px": (1.0, False, 0.0, None),
    "curve": (0.0, True, 0.0, None),
    "lens 0.5 px, curve": (0.5, True, 0.0, None),
    "as that, sharpened, JPEG": (0.5, True, 1.0, 90),
}


def look(ids, poses, k, size):
    """Brightness (linear, 0 to 1) by RAYS x RAYS rays a pixel, and exact depth of each pixel."""
    width, height = size
    fine = np.full((height * RAYS, width * RAYS), 0.15, np.float32)
    depth_m = np.zeros((height, width))
    for i, (rotation, place) in zip(ids, poses):
        cells = cv2.aruco.generateImageMarker(DICTIONARY, i, 6) > 0
        centre = (k @ place)[:2] / place[2]
        reach = int(k[0, 0] * CUBE_M / place[2]) + 4
        x0, y0 = (np.round(centre) - reach).astype(int)
        normal = rotation[:, 2]
        for rays in (RAYS, 1):
            step = (np.arange(2 * reach * rays) + 0.5) / rays - 0.5
            x, y = np.meshgrid(x0 + step, y0 + step)
            sight = np.stack([(x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1], np.ones_like(x)])
            z = (normal @ place) / np.tensordot(normal, sight, 1)
            at = np.tensordot(rotation.T, sight * z - place[:, None, None], 1)
            tile = abs(at[:2]).max(axis=0) <= CUBE_M / 2
            if rays == 1:
                part = depth_m[y0 : y0 + 2 * reach, x0 : x0 + 2 * reach]
                part[tile] = z[tile]
                continue
            column, row = (np.floor((s * at[a] / SIDE_M + 0.5) * 6) for s, a in ((1, 0), (-1, 1)))
            inked = (column >= 0) & (column < 6) & (row >= 0) & (row < 6)
            inked &= ~cells[row.clip(0, 5).astype(int), column.clip(0, 5).astype(int)]
            part = fine[y0 * RAYS :, x0 * RAYS :][: 2 * reach * RAYS, : 2 * reach * RAYS]
            part[tile] = np.where(inked, 0.03, 0.75)[tile]
    return fine, depth_m


def curve(light):
    """The display's curve (sRGB)."""
    bright = 1.055 * light.clip(1e-9) ** (1 / 2.4) - 0.055
    return np.where(light <= 0.0031308, 12.92 * light, bright)


def expose(fine, kind, random):
    """The image of a camera, 8 bits grey."""
    blur_px, before, sharpening, _ = KINDS[kind]
    fine = fine if before else curve(fine).astype(np.float32)
    if blur_px > 0:
        fine = cv2.GaussianBlur(fine, (0, 0), blur_px * RAYS)
    height, width = fine.shape[0] // RAYS, fine.shape[1] // RAYS
    grey = fine.reshape(height, RAYS, width, RAYS).mean(axis=(1, 3))
    grey = 255 * (curve(grey) if before else grey) + random.normal(0, 2, grey.shape)
    grey += sharpening * (grey - cv2.GaussianBlur(grey, (0, 0), 1.0))
    return np.round(grey).clip(0, 255).astype(np.uint8)


def drawn_scene(random):
    """Twelve markers of different numbers, each in a part of its own of the image."""
    k = np.array([[612.0, 0, 322], [0, 611, 243], [0, 0, 1]])
    ids, poses = random.choice(50, 12, replace=False).tolist(), []
    for column, row in itertools.product(range(4), range(3)):
        z = random.uniform(0.32, 0.5)
        px = np.array([80 + 160 * column, 80 + 160 * row]) + random.uniform(-8, 8, 2)
        tilt, about = np.radians(random.uniform(0, 50)), random.uniform(0, 2 * np.pi)
        turn = Rotation.from_rotvec(tilt * np.array([np.cos(about), np.sin(about), 0]))
        spin = Rotation.from_rotvec([0, 0, random.uniform(0, 2 * np.pi)])
        face = Rotation.from_matrix(np.diag([1.0, -1, -1]))  # +z of the marker to the camera.
        place = z * np.linalg.solve(k, [*px, 1])
        poses.append(((turn * face * spin).as_matrix(), place))
    return k, ids, poses


def take(kind, looks, scratch, seed):
    """Writes an image of every scene; their paths."""
    images = []
    for n, (fine, _) in enumerate(looks):
        grey = expose(fine, kind, np.random.default_rng([seed, n, list(KINDS).index(kind)]))
        if quality := KINDS[kind][3]:
            coded = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
            grey = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE)
        images.append(scratch / f"{kind.replace(' ', '_')}_{n}.png")
        cv2.imwrite(str(images[-1]), grey)
    return images


def true_corners(pose, k):
    at = (CORNERS_M @ pose[0].T + pose[1]) @ k.T
    return at[:, :2] / at[:, 2:]
