#!/usr/bin/env python3
"""Newton (Warp, on the CPU) and orime-simulate on one scene, in one run.

25x25 nodes, 0.21 m, 80 g/m2, hung by two corners, 60 frames of 1/60 s with 20 substeps. Prints the
least and the median milliseconds of a frame and the largest stretch of an edge. Newton's links are
its cloth grid's (triangles and bending edges, or springs to neighbours and diagonals), fewer than
ours to nodes 1-4 steps away: milliseconds are per frame of what each offers.

    tests/newton_cloth.py [--frames N]     needs PyPI's newton and warp-lang
"""

import argparse
import statistics
import subprocess
import sys
import time
from pathlib import Path

import newton
import numpy as np
import warp as wp

NODES, SIDE_M, DENSITY, SUBSTEPS, FRAME_S = 25, 0.21, 0.08, 20, 1 / 60


def model(springs):
    builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
    cell_m = SIDE_M / (NODES - 1)
    builder.add_cloth_grid(
        pos=wp.vec3(0.0, 0.0, 1.0),
        rot=wp.quat_identity(),
        vel=wp.vec3(0.0, 0.0, 0.0),
        dim_x=NODES - 1,
        dim_y=NODES - 1,
        cell_x=cell_m,
        cell_y=cell_m,
        mass=DENSITY * SIDE_M**2 / NODES**2,
        tri_ke=1e4,
        tri_ka=1e4,
        tri_kd=1e-6,
        edge_ke=1e-4,
        edge_kd=0.0,
        add_springs=springs,
        spring_ke=1e5,
        spring_kd=0.0,
        particle_radius=1e-4,
    )
    for corner in (0, NODES - 1):
        builder.particle_mass[corner] = 0.0
    builder.color(include_bending=True)
    return builder.finalize(device="cpu")


def stretch(q):
    x = q.reshape(NODES, NODES, 3)
    rest_m = SIDE_M / (NODES - 1)
    lengths = [np.linalg.norm(np.diff(x, axis=axis), axis=2).ravel() for axis in (0, 1)]
    return float(np.max(np.abs(np.concatenate(lengths) / rest_m - 1)))


def run(name, make, springs, frames):
    scene = model(springs)
    solver = make(scene)
    now, after, control = scene.state(), scene.state(), scene.control()
    times, worst = [], 0.0
    for _ in range(frames):
        start = time.perf_counter()
        for _ in range(SUBSTEPS):
            now.clear_forces()
            solver.step(now, after, control, None, FRAME_S / SUBSTEPS)
            now, after = after, now
        wp.synchronize()
        times.append(1e3 * (time.perf_counter() - start))
        q = now.particle_q.numpy()
        if not np.isfinite(q).all():
            print(f"{name:34} blew up in frame {len(times)}")
            return
        worst = max(worst, stretch(q))
    least, middle = min(times), statistics.median(times)
    print(f"{name:34} least {least:9.3f} ms  median {middle:9.3f} ms  stretch {100 * worst:9.2f} %")


def ours():
    command = ["cargo", "bench", "--quiet", "-p", "orime-simulate", "--no-default-features"]
    command += ["--features", "gpu", "--bench", "frame", "--", "--hung", str(SUBSTEPS)]
    root = Path(__file__).resolve().parent.parent
    result = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    if result.returncode:
        sys.exit(f"the bench failed:\n{result.stderr}")
    print(result.stdout.strip())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=60)
    frames = parser.parse_args().frames
    wp.config.quiet = True
    print(f"Newton {newton.__version__}, Warp {wp.config.version}, CPU; {SUBSTEPS} substeps")
    ours()
    solvers = newton.solvers
    run("Newton XPBD, springs", lambda m: solvers.SolverXPBD(m, iterations=1), True, frames)
    run("Newton XPBD, springs, 10 iterations", lambda m: solvers.SolverXPBD(m, iterations=10), True, frames)
    run("Newton VBD, 10 iterations", lambda m: solvers.SolverVBD(m, iterations=10), False, frames)


main()
