"""Orime's registration beside pycpd: the same cases, one after the other, one thread each.

usage: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/register_vs_pycpd.py \
           [--seeds 5] [--first-seed 301] [--mode fast]

Cases are drawn by ../shared/baseline/cases.py (or $ORIME_DATA/../baseline) with seeds that count
from --first-seed on: sheets half and nearly shut, 169 nodes, 5000 points. Prints, per case, the mean
true vertex error in millimetres, the median of the milliseconds, and how many times as long pycpd
takes.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("ORIME_DATA", ROOT.parent / "shared" / "data"))
sys.path.insert(0, str(DATA.parent / "baseline"))

import cases  # noqa: E402
import peers  # noqa: E402

CASES = ["mid_m169_n5000", "shut_m169_n5000"]


def ours(folder, out, mode):
    """Result (nodes x 3, metres) and median milliseconds."""
    command = [ROOT / "target/release/orime-evaluate", "register"]
    for name in ["uv", "seed", "cloud"]:
        command += [f"--{name}", folder / f"{name}.csv"]
    command += ["--out", out, "--repeat", "11", "--json"] + (["--mode", mode] if mode else [])
    environment = os.environ | {"RAYON_NUM_THREADS": "1"}
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    return np.loadtxt(out, delimiter=","), json.loads(done.stdout)["ms_p50"]


def pycpd(case):
    start = time.perf_counter()
    result = peers.register(case, iterations=30)
    return result, (time.perf_counter() - start) * 1e3


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=301)
    parser.add_argument("--mode", help="of `orime-evaluate register`")
    arguments = parser.parse_args()
    figures = {name: {"orime": [], "pycpd": []} for name in CASES}
    with tempfile.TemporaryDirectory() as scratch:
        scratch = pathlib.Path(scratch)
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
            folder = scratch / str(seed)
            write = [sys.executable, DATA.parent / "baseline/cases.py", "write", folder]
            subprocess.run([*write, "--random", str(seed)], check=True, stdout=subprocess.DEVNULL)
            for name in CASES:
                case = cases.load(folder / name)
                runs = {
                    "orime": ours(folder / name, scratch / "out.csv", arguments.mode),
                    "pycpd": pycpd(case),
                }
                for who, (result, ms) in runs.items():
                    error_mm = cases.score(result, case)["vertex_error_mm"]
                    figures[name][who].append((error_mm, ms))
    for name, runs in figures.items():
        row = {}
        for who, pairs in runs.items():
            row[who] = (
                statistics.fmean(e for e, _ in pairs),
                statistics.median(ms for _, ms in pairs),
            )
        ratio = row["pycpd"][1] / row["orime"][1]
        print(
            f"{name}: orime {row['orime'][0]:.2f} mm {row['orime'][1]:.2f} ms, "
            f"pycpd {row['pycpd'][0]:.2f} mm {row['pycpd'][1]:.0f} ms: {ratio:.0f} times"
        )


if __name__ == "__main__":
    main()
