#!/usr/bin/env python3
"""Newton (Warp, on the CPU) and orime-simulate on one scene, in one run.

25x25 nodes, 0.21 m, 80 g/m2, hung by two corners, 60 frames of 1/60 s with 20 substeps. Prints the
least and the median milliseconds of a frame and the largest stretch of an edge. Newton's links are
its cloth grid's (triangles and bending edges, or springs to neighbours and diagonals), fewer than
ours to nodes 1-4 steps away: milliseconds are per frame of what each offers.

With --growth, what a frame costs from 13x13 to 100x100 nodes, drawn: there Newton's XPBD has the very
links that ours has, to nodes 1-4 steps away along rows, columns and diagonals.

    tests/newton_cloth.py [--frames N] [--growth PNG]     needs PyPI's newton, warp-lang, matplotlib
"""

import argparse
import math
import re
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


def frame(solver, now, after, control):
    """Steps through a frame; the newest state, the other, and milliseconds."""
    start = time.perf_counter()
    for _ in range(SUBSTEPS):
        now.clear_forces()
        solver.step(now, after, control, None, FRAME_S / SUBSTEPS)
        now, after = after, now
    wp.synchronize()
    return now, after, 1e3 * (time.perf_counter() - start)


def run(name, make, springs, frames):
    scene = model(springs)
    solver = make(scene)
    now, after, control = scene.state(), scene.state(), scene.control()
    times, worst = [], 0.0
    for _ in range(frames):
        now, after, ms = frame(solver, now, after, control)
        times.append(ms)
        q = now.particle_q.numpy()
        if not np.isfinite(q).all():
            print(f"{name:34} blew up in frame {len(times)}")
            return
        worst = max(worst, stretch(q))
    least, middle = min(times), statistics.median(times)
    print(f"{name:34} least {least:9.3f} ms  median {middle:9.3f} ms  stretch {100 * worst:9.2f} %")


def bench(*options):
    command = ["cargo", "bench", "--quiet", "-p", "orime-simulate", "--no-default-features"]
    command += ["--features", "gpu", "--bench", "frame", "--", *options]
    root = Path(__file__).resolve().parent.parent
    result = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    if result.returncode:
        sys.exit(f"the bench failed:\n{result.stderr}")
    return result.stdout.strip()


def linked(nodes):
    """A sheet of `nodes` x `nodes` with our links as Newton's springs, and how many there are."""
    builder = newton.ModelBuilder(up_axis=newton.Axis.Z)
    cell_m = SIDE_M / (nodes - 1)
    mass_kg = DENSITY * SIDE_M**2 / nodes**2
    for j in range(nodes):
        for i in range(nodes):
            held = j == 0 and i in (0, nodes - 1)
            at = wp.vec3(i * cell_m, j * cell_m, 1.0)
            builder.add_particle(at, wp.vec3(0.0, 0.0, 0.0), 0.0 if held else mass_kg, radius=1e-4)
    links = 0
    for reach in (1, 2, 3, 4):
        for di, dj in ((reach, 0), (0, reach), (reach, reach), (-reach, reach)):
            for j in range(nodes - dj):
                for i in range(max(0, -di), nodes - max(0, di)):
                    a, b = j * nodes + i, (j + dj) * nodes + i + di
                    builder.add_spring(a, b, ke=1e5, kd=0.0, control=0.0)
                    links += 1
    builder.color()
    return builder.finalize(device="cpu"), links


def newton_frame_ms(nodes, frames):
    scene, links = linked(nodes)
    solver = newton.solvers.SolverXPBD(scene, iterations=1)
    now, after, control = scene.state(), scene.state(), scene.control()
    least = math.inf
    for _ in range(frames):
        now, after, ms = frame(solver, now, after, control)
        least = min(least, ms)
    return links, least


def exponent(rows):
    """Of milliseconds over nodes a side, least squares of the logarithms."""
    x, y = np.log([row[0] for row in rows]), np.log([row[1] for row in rows])
    return float(np.polyfit(x, y, 1)[0])


def growth(picture, frames):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    lines = [line for line in bench("--sizes").splitlines() if re.match(r"\s*\d+² .* false ", line)]
    ours, theirs = [], []
    print("nodes  links   ours ms  ns/link  Newton ms  ns/link  ratio  (least of a frame)")
    for line in lines:
        nodes, links, us = (float(line.split()[k].rstrip("²")) for k in (0, 1, 3))
        nodes = int(nodes)
        count, newton_ms = newton_frame_ms(nodes, frames)
        assert count == links, f"{count} springs, {links} links"
        ours.append((nodes, us / 1e3))
        theirs.append((nodes, newton_ms))
        each = [1e6 * ms / (links * SUBSTEPS) for ms in (us / 1e3, newton_ms)]
        print(
            f"{nodes:4}² {count:7} {us / 1e3:9.3f} {each[0]:8.2f} {newton_ms:10.2f} {each[1]:8.1f}"
            f" {newton_ms * 1e3 / us:6.0f}"
        )
    print(f"grows with the power {exponent(ours):.2f} of the nodes a side, Newton's {exponent(theirs):.2f}")
    figure, axes = plt.subplots(figsize=(7, 4.5))
    for rows, name, color in ((theirs, "Newton XPBD, the same links", "#c0504d"), (ours, "orime", "#1f6f8b")):
        axes.loglog(*zip(*rows), "o-", color=color, label=f"{name}: power {exponent(rows):.2f}")
    side = np.array([ours[0][0], ours[-1][0]])
    at_25 = dict(ours)[25]
    axes.loglog(side, at_25 * (side / 25) ** 2, ":", color="gray", label="n²")
    axes.set_xticks([n for n, _ in ours], [str(n) for n, _ in ours])
    axes.minorticks_off()
    axes.set_xlabel("nodes a side")
    axes.set_ylabel(f"ms a frame ({SUBSTEPS} substeps), one core")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(picture, dpi=110)
    print(f"wrote {picture}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--growth", metavar="PNG", help="cost by the size of the sheet, drawn here")
    options = parser.parse_args()
    frames = options.frames
    wp.config.quiet = True
    print(f"Newton {newton.__version__}, Warp {wp.config.version}, CPU; {SUBSTEPS} substeps")
    if options.growth:
        growth(options.growth, min(frames, 20))
        return
    print(bench("--hung", str(SUBSTEPS)))
    solvers = newton.solvers
    run("Newton XPBD, springs", lambda m: solvers.SolverXPBD(m, iterations=1), True, frames)
    run("Newton XPBD, springs, 10 iterations", lambda m: solvers.SolverXPBD(m, iterations=10), True, frames)
    run("Newton VBD, 10 iterations", lambda m: solvers.SolverVBD(m, iterations=10), False, frames)


main()
