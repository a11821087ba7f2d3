"""Compares our textbook Coherent Point Drift with pycpd on the shapes of the CPD literature.

Both get the same points, parameters, iterations and stopping rule, in one run. Fish is planar: both
get z = 0. Face has 23 728 points, too many for dense matrices: both get every 24th. Prints one JSON
line per shape; exits 1 where the largest difference of a moved point exceeds 1e-3 of the shape's
scale.

usage: pycpd_parity.py ORIME_EVALUATE CPD_FIXTURES
"""
import json
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np
from pycpd import DeformableRegistration

# name, model file, observed file, every k-th point, beta, lambda
SHAPES = [
    ("fish", "fish_source.txt", "fish_target.txt", 1, 2.0, 2.0),
    ("bunny", "bunny_source.txt", "bunny_target.txt", 1, 2.0, 2.0),
    ("face", "face-x.txt", "face-y.txt", 24, 30.0, 2.0),
]
ITERATIONS, TOLERANCE, DIFFERENCE_MAX = 100, 0.001, 1e-3


def load(path, every):
    points = np.loadtxt(path)[::every]
    return np.column_stack([points, np.zeros((len(points), 3 - points.shape[1]))])


def ours(program, folder, model, observed, beta, lam):
    files = [folder / name for name in ("model.csv", "observed.csv", "moved.csv")]
    for path, points in zip(files, (model, observed)):
        np.savetxt(path, points, delimiter=",", fmt="%.17g")
    line = subprocess.run(
        [program, "cpd", "--source", files[0], "--target", files[1], "--out", files[2], "--json",
         "--beta", str(beta), "--lambda", str(lam), "--iterations", str(ITERATIONS),
         "--tolerance", str(TOLERANCE)],
        check=True, capture_output=True, text=True).stdout
    return np.loadtxt(files[2], delimiter=","), json.loads(line)


def main(program, fixtures):
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        for name, source, target, every, beta, lam in SHAPES:
            model = load(pathlib.Path(fixtures) / source, every)
            observed = load(pathlib.Path(fixtures) / target, every)
            moved, report = ours(program, pathlib.Path(folder), model, observed, beta, lam)
            began = time.perf_counter()
            peer = DeformableRegistration(X=observed, Y=model, beta=beta, alpha=lam, w=0.0,
                                          max_iterations=ITERATIONS, tolerance=TOLERANCE)
            theirs, _ = peer.register()
            peer_ms = (time.perf_counter() - began) * 1e3
            scale = float(np.ptp(model, axis=0).max())
            difference = float(np.abs(moved - theirs).max()) / scale
            travelled = float(np.linalg.norm(theirs - model, axis=1).mean()) / scale
            failed |= not difference < DIFFERENCE_MAX or peer.iteration != report["iterations"]
            print(json.dumps({
                "shape": name, "points": [len(model), len(observed)],
                "iterations": [report["iterations"], peer.iteration],
                "difference_of_scale_max": difference, "moved_of_scale_mean": travelled,
                "ms": report["ms"], "pycpd_ms": peer_ms}), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
