#!/usr/bin/env python3
"""Newton's XPBD and VBD (Warp, on the CPU) and Orime on two scenes of contact, in one run.

The scenes of `orime-evaluate stability`: a half fold whose targets lie in each other, and a free
edge that is pulled 10 mm through the lower half, which is held. 25x25 nodes, 0.21 m, 80 g/m2, 0.1 mm,
frames of 1/30 s with 20 substeps. Newton's particles are pulled to the targets as ours are (48 Hz,
critically damped, at most 400 m/s2), its bending is soft: it knows no creases. Whether a frame
crosses, one judge tells for all, shared/contact/examples/crossings.rs. Milliseconds are the median
and the maximum of a frame, wall clock; ours are the suite's, contact in every substep and the net.

    tests/newton_contact.py [--only half|press]     needs PyPI's newton and warp-lang
"""

import argparse
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import newton
import numpy as np
import warp as wp

NODES, SIDE_M, DENSITY, SUBSTEPS, FRAME_S, THICK_M = 25, 0.21, 0.08, 20, 1 / 30, 1e-4
PULL_HZ, PULL_MAX = 48.0, 400.0
HALF_M = 12 / 24 * SIDE_M
ROOT = Path(__file__).resolve().parent.parent
CELL_M = SIDE_M / (NODES - 1)
UV = np.stack(np.meshgrid(*[np.arange(NODES) * CELL_M] * 2, indexing="ij"), -1).reshape(-1, 2)


@wp.kernel
def pull(
    x: wp.array(dtype=wp.vec3),
    v: wp.array(dtype=wp.vec3),
    target: wp.array(dtype=wp.vec3),
    weight: wp.array(dtype=float),
    mass: wp.array(dtype=float),
    omega: float,
    most: float,
    f: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    a = omega * omega * (target[i] - x[i]) - 2.0 * omega * v[i]
    size = wp.length(a)
    if size > most:
        a = a * (most / size)
    f[i] = a * mass[i] * weight[i]


def half_fold(frame):
    """Targets and weights of a frame; as `halved` of the suite, 0.9 degrees too far."""
    angle = np.pi * min(max((frame + 1) * FRAME_S, 0.0), 1.005)
    out = np.maximum(UV[:, 0] - HALF_M, 0.0)
    x = np.minimum(UV[:, 0], HALF_M) + out * np.cos(angle)
    return np.stack([x, UV[:, 1], out * np.sin(angle)], 1), np.ones(len(UV))


def press(frame):
    share = min((frame + 1) * FRAME_S, 1.0)
    angle = np.pi * share
    out = np.maximum(UV[:, 0] - HALF_M, 0.0)
    x = np.where(out > 0.0, HALF_M + out * np.cos(angle), UV[:, 0])
    z = np.where(out > 0.0, out * np.sin(angle) - 0.010 * share, 0.0)
    return np.stack([x, UV[:, 1], z], 1), (UV[:, 0] > SIDE_M - 1e-9).astype(float)


# Name, targets, frames, case of the suite and its line, gravity, whether the lower half is held.
SCENES = {
    "half": ("half fold", half_fold, 70, ("10", "2 layers, 25×25, 0.1 mm"), 0.0, False),
    "press": ("press", press, 75, ("11", "press 10 mm through a layer"), -9.81, True),
}


def model(springs, gravity, held):
    builder = newton.ModelBuilder(up_axis=newton.Axis.Z, gravity=wp.vec3(0.0, 0.0, gravity))
    builder.add_cloth_grid(
        pos=wp.vec3(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        vel=wp.vec3(0.0, 0.0, 0.0),
        dim_x=NODES - 1,
        dim_y=NODES - 1,
        cell_x=CELL_M,
        cell_y=CELL_M,
        mass=DENSITY * SIDE_M**2 / NODES**2,
        tri_ke=1e4,
        tri_ka=1e4,
        tri_kd=1e-6,
        edge_ke=1e-6,
        edge_kd=0.0,
        add_springs=springs,
        spring_ke=1e5,
        spring_kd=0.0,
        particle_radius=THICK_M / 2,
    )
    if held:
        at = np.array([list(q) for q in builder.particle_q])
        for i in np.flatnonzero(at[:, 0] < HALF_M - 0.01):
            builder.particle_mass[i] = 0.0
    builder.color(include_bending=True)
    return builder.finalize(device="cpu")


def order(scene):
    """Newton's particle of each of our nodes, by place."""
    at = scene.particle_q.numpy()[:, :2]
    nearest = np.argmin(((UV[:, None] - at[None]) ** 2).sum(2), axis=1)
    assert sorted(nearest) == list(range(len(UV)))
    return nearest


def run(name, make, springs, scene, crossings):
    _, targets, frames, _, gravity, held = scene
    sheet = model(springs, gravity, held)
    ours = order(sheet)
    solver = make(sheet)
    now, after, control = sheet.state(), sheet.state(), sheet.control()
    positions, times = [], []
    target = wp.zeros(len(UV), dtype=wp.vec3, device="cpu")
    weight = wp.zeros(len(UV), dtype=float, device="cpu")
    omega = 2 * np.pi * PULL_HZ
    for frame in range(frames):
        x, w = targets(frame)
        placed, weighed = np.zeros((len(UV), 3), np.float32), np.zeros(len(UV), np.float32)
        placed[ours], weighed[ours] = x, w
        target.assign(placed)
        weight.assign(weighed)
        start = time.perf_counter()
        for _ in range(SUBSTEPS):
            inputs = [now.particle_q, now.particle_qd, target, weight, sheet.particle_mass]
            wp.launch(pull, len(UV), inputs + [omega, PULL_MAX], [now.particle_f], device="cpu")
            solver.step(now, after, control, None, FRAME_S / SUBSTEPS)
            now, after = after, now
        wp.synchronize()
        times.append(1e3 * (time.perf_counter() - start))
        positions.append(now.particle_q.numpy()[ours].astype("<f4"))
        if not np.isfinite(positions[-1]).all():
            print(f"{scene[0]:10} {name:30} blew up in frame {frame}")
            return
    with tempfile.NamedTemporaryFile(suffix=".f32") as file:
        file.write(np.stack(positions).tobytes())
        file.flush()
        command = [crossings, str(NODES), str(SIDE_M), file.name]
        told = subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    off = np.sqrt((((positions[-1] - targets(frames - 1)[0]) ** 2).sum(1) * targets(0)[1]).sum())
    off_mm = 1e3 * off / np.sqrt(targets(0)[1].sum())
    middle, most = statistics.median(times), max(times)
    print(f"{scene[0]:10} {name:30} {told}, error {off_mm:.2f} mm, {middle:.1f}/{most:.1f} ms")


def orime(scene):
    case, line = scene[3]
    command = [ROOT / "target/release/orime-evaluate", "stability", "--case", case]
    text = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    lines = text.splitlines()
    at = next(k for k, told in enumerate(lines) if told.endswith(line))
    print(f"{scene[0]:10} {'Orime':30} {lines[at + 2].strip()}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=SCENES)
    only = parser.parse_args().only
    wp.config.quiet = True
    build = ["cargo", "build", "--release", "--quiet", "-p", "orime-contact"]
    build += ["--example", "crossings"]
    subprocess.run(build, cwd=ROOT, check=True)
    crossings = ROOT / "target/release/examples/crossings"
    print(f"Newton {newton.__version__}, Warp {wp.config.version}, CPU; {SUBSTEPS} substeps")
    solvers = newton.solvers

    def vbd(contact):
        # Its nodes go no farther in a substep than they look: 2 mm lets them go 1 m/s.
        reach = {"particle_self_contact_margin": THICK_M, "particle_self_contact_gap": 2e-3}
        return lambda m: solvers.SolverVBD(
            m, iterations=10, particle_enable_self_contact=contact, **(reach if contact else {})
        )

    for key, scene in SCENES.items():
        if only not in (None, key):
            continue
        orime(scene)
        xpbd = lambda m: solvers.SolverXPBD(m, iterations=10)
        run("Newton XPBD, springs", xpbd, True, scene, crossings)
        run("Newton VBD, no self-contact", vbd(False), False, scene, crossings)
        run("Newton VBD, self-contact", vbd(True), False, scene, crossings)


main()
