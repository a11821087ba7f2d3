#!/usr/bin/env python3
"""Reads the sheet's state from a running Orime set, live: prints it, or plots it.

Needs Python 3.9 or newer and `pip install iceoryx2==0.10.0`; `--plot` also needs matplotlib.

    orime_client.py                    one line per state
    orime_client.py --json --count 10  ten states as JSON, one per line
    orime_client.py --plot             the sheet in 3D

The layouts come from orime_layouts.json beside this file, which `orime layouts` writes and a test
compares with Rust's. A set that speaks anything else is refused before a channel is opened.
"""

import argparse
import ctypes
import json
import os
import pathlib
import sys
import time

LAYOUTS = json.loads((pathlib.Path(__file__).parent / "orime_layouts.json").read_text())
SCALARS = {
    "i8": ctypes.c_int8,
    "u8": ctypes.c_uint8,
    "u16": ctypes.c_uint16,
    "u32": ctypes.c_uint32,
    "u64": ctypes.c_uint64,
    "f32": ctypes.c_float,
    "f64": ctypes.c_double,
}
TRACKING = ["searching", "tracking", "coasting", "lost"]
END = 1


def ctype(kind, made):
    """The ctypes type of a layout's type."""
    if isinstance(kind, list):
        element, count = kind
        return ctype(element, made) * count
    if kind in SCALARS:
        return SCALARS[kind]
    if kind not in made:
        layout = LAYOUTS["structs"][kind]
        fields = [(field["name"], ctype(field["type"], made)) for field in layout["fields"]]
        struct = type(kind, (ctypes.Structure,), {"_fields_": fields})
        assert ctypes.sizeof(struct) == layout["size"], f"{kind}: another size than Rust's"
        for field in layout["fields"]:
            offset = getattr(struct, field["name"]).offset
            assert offset == field["offset"], f"{kind}.{field['name']}: another place than Rust's"
        made[kind] = struct
    return made[kind]


def message(channel):
    """The ctypes structure of a channel's message, under its name on the wire."""
    entry = LAYOUTS["channels"][channel]
    struct = ctype(entry["struct"], {})
    struct.type_name = staticmethod(lambda: entry["type_name"])
    return struct


def runs():
    """Registered runs whose supervisors live."""
    folder = os.environ.get("XDG_RUNTIME_DIR")
    folder = f"{folder}/orime" if folder else f"/tmp/orime-{os.getuid()}/runs"
    found = []
    for path in sorted(pathlib.Path(folder).glob("*.json")):
        entry = json.loads(path.read_text())
        try:
            # Field 22, counted after the name, which is in parentheses.
            stat = pathlib.Path(f"/proc/{entry['pid']}/stat").read_text()
        except FileNotFoundError:
            continue
        if int(stat.rpartition(")")[2].split()[19]) == entry["start_ticks"]:
            found.append(entry)
    return found


def find(run):
    """The run that is meant: the one named, or the only one."""
    found = [entry for entry in runs() if run in (None, entry["run"])]
    if len(found) != 1:
        what = "no set runs" if not found else "several sets run, name one with --run"
        sys.exit(f"orime_client: {what}: `orime ps` shows what runs")
    own, other = LAYOUTS["protocol"], found[0].get("protocol")
    if own != other:
        sys.exit(
            f"orime_client: this client speaks `{own}`, the set `{other}`: write the layouts anew"
            " with `orime layouts > clients/python/orime_layouts.json`"
        )
    return found[0]


class States:
    """The states of a run, from now on."""

    def __init__(self, entry):
        import iceoryx2 as iox2

        iox2.set_log_level(iox2.LogLevel.Fatal)
        config = iox2.config.default()
        config.global_cfg.prefix = iox2.FileName.new(f"orime_{entry['run']}_")
        root = f"/tmp/orime-{os.getuid()}/{entry['run']}"
        config.global_cfg.root_path = iox2.Path.new(root)
        self.node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
        service = (
            self.node.service_builder(iox2.ServiceName.new("orime/state"))
            .publish_subscribe(message("orime/state"))
            .open()
        )
        self.subscriber = service.subscriber_builder().create()

    def next(self, patience_s):
        """The next state, or None where none came in time."""
        deadline = time.monotonic() + patience_s
        while time.monotonic() < deadline:
            sample = self.subscriber.receive()
            if sample is not None:
                state = type(sample.payload().contents).from_buffer_copy(
                    sample.payload().contents
                )
                sample.delete()
                return state
            time.sleep(0.002)
        return None


def nodes_m(state):
    """The nodes' positions, metres, as a list of [x, y, z]."""
    return [list(position) for position in state.positions_m[: state.n_nodes]]


def figures(state):
    """A state as plain values."""
    positions = nodes_m(state) if state.has_pose else []
    middle = [sum(axis) / len(positions) for axis in zip(*positions)] if positions else None
    return {
        "run": f"{state.header.run_id:08x}",
        "step": state.header.step,
        "sequence": state.header.sequence,
        "tracking": TRACKING[min(state.figures.tracking, 3)],
        "age_ms": (time.monotonic_ns() - state.header.arrival_ns) / 1e6,
        "nodes": list(state.nodes),
        "size_m": list(state.size_m),
        "middle_m": middle,
        "positions_m": positions,
    }


def plot(states, patience_s):
    """Draws the sheet until the window is closed or the set ends."""
    import matplotlib.pyplot as plt

    axes = plt.figure("Orime").add_subplot(projection="3d")
    while plt.get_fignums():
        state = states.next(patience_s)
        if state is None or state.header.flags & END:
            return
        if not state.has_pose:
            continue
        n_u, n_v = state.nodes
        x, y, z = ([p[k] for p in nodes_m(state)] for k in range(3))
        grid = lambda values: [values[i * n_v : (i + 1) * n_v] for i in range(n_u)]
        axes.clear()
        import numpy

        axes.plot_wireframe(*(numpy.array(grid(values)) for values in (x, y, z)))
        axes.set_title(f"step {state.header.step}")
        axes.set_aspect("equal")
        plt.pause(0.01)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--run", help="the run, as `orime ps` shows it")
    arguments.add_argument("--count", type=int, help="end after so many states")
    arguments.add_argument("--json", action="store_true", help="one JSON object per line")
    arguments.add_argument("--plot", action="store_true", help="draw the sheet (matplotlib)")
    arguments.add_argument("--patience", type=float, default=30.0, help="seconds without a state")
    arguments = arguments.parse_args()
    states = States(find(arguments.run))
    if arguments.plot:
        return plot(states, arguments.patience)
    seen = 0
    while arguments.count is None or seen < arguments.count:
        state = states.next(arguments.patience)
        if state is None:
            sys.exit(f"orime_client: no state came in {arguments.patience:.0f} s")
        if state.header.flags & END:
            return None
        seen += 1
        values = figures(state)
        if arguments.json:
            print(json.dumps(values), flush=True)
        else:
            middle = values["middle_m"] or [float("nan")] * 3
            where = " ".join(f"{x:+.4f}" for x in middle)
            print(
                f"step {values['step']:6}  {values['tracking']:9}  age {values['age_ms']:6.1f} ms"
                f"  middle {where} m",
                flush=True,
            )
    return None


if __name__ == "__main__":
    main()
