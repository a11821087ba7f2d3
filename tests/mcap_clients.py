#!/usr/bin/env python3
"""Reads a recording of ours with programs that are not: PyPI `mcap` with Foxglove's own schemas,
and rerun's loader.

    tests/mcap_clients.py [--venv DIR] [--file OUT.mcap]

Runs itself inside a virtual environment (default /tmp/orime-mcap-venv), which it makes and fills
from PyPI the first time (mcap, mcap-protobuf-support, foxglove-schemas-protobuf, rerun-sdk).
"""
import argparse
import json
import os
import subprocess
import sys
import tempfile
import zlib
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = [
    "mcap>=1.2", "mcap-protobuf-support>=0.5", "foxglove-schemas-protobuf>=0.3",
    "numpy", "rerun-sdk>=0.30",
]
EXPECTED = {
    "image": "foxglove.RawImage",
    "calibration": "foxglove.CameraCalibration",
    "transform": "foxglove.FrameTransform",
    "observed": "foxglove.PointCloud",
    "estimate": "foxglove.SceneUpdate",
    "truth": "foxglove.SceneUpdate",
}


def enter(venv: Path) -> None:
    """Goes on inside the virtual environment."""
    python = venv / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", venv], check=True)
    probe = "import mcap, mcap_protobuf, foxglove_schemas_protobuf, numpy, rerun"
    if subprocess.run([python, "-c", probe], capture_output=True).returncode != 0:
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
    if Path(sys.prefix).resolve() != venv.resolve():
        os.execv(python, [str(python), *sys.argv])


def check(what: str, holds: bool) -> None:
    if not holds:
        sys.exit(f"FAILED: {what}")


def record(path: Path) -> dict:
    command = ["cargo", "run", "--release", "--quiet", "--package", "orime-recording"]
    command += ["--example", "record_sample", "--", str(path), "5"]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def own_descriptor(name: str):
    """The descriptor of a schema in Foxglove's own Python package."""
    import importlib
    module = importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2")
    return module.DESCRIPTOR.message_types_by_name[name]


def check_schema(schema) -> None:
    """The embedded schema has the fields of Foxglove's package: names, numbers, types."""
    from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorSet
    files = FileDescriptorSet.FromString(schema.data)
    short = schema.name.removeprefix("foxglove.")
    embedded = {m.name: m for f in files.file for m in f.message_type}[short]
    package = DescriptorProto()
    own_descriptor(short).CopyToProto(package)
    fields = lambda m: [(f.name, f.number, f.type, f.label, f.type_name) for f in m.field]
    check(f"{schema.name}: same fields as in PyPI's package", fields(embedded) == fields(package))


def check_calibration(message, lens: dict) -> None:
    check("lens size", [message.width, message.height] == lens["size"])
    check("lens model", message.distortion_model == "plumb_bob")
    check("lens D", list(message.D) == lens["d"])
    check("lens K", list(message.K) == lens["k"])
    check("lens R", list(message.R) == [1, 0, 0, 0, 1, 0, 0, 0, 1])
    k = lens["k"]
    check("lens P", list(message.P) == [*k[:3], 0, *k[3:6], 0, *k[6:], 0])


def check_transform(message, expected: dict, parent: str, child: str) -> None:
    t, q = message.translation, message.rotation
    check("transform's translation", [t.x, t.y, t.z] == expected["translation"])
    check("transform's rotation", [q.x, q.y, q.z, q.w] == expected["rotation_xyzw"])
    frames = (message.parent_frame_id, message.child_frame_id)
    check(f"transform's frames {frames}", frames == (parent, child))


def check_cloud(message, manifest: dict) -> None:
    import numpy as np
    names = [(f.name, f.offset, f.type) for f in message.fields]
    check("cloud's first fields", names[:3] == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)])
    points = np.frombuffer(message.data, np.float32).reshape(-1, message.point_stride // 4)
    check("cloud's size", len(points) == manifest["nodes"])
    check("cloud's values", np.all(points[:, 3:6] == [0, 0, 1]) and np.all(points[:, 7] == 4))


def check_sheet(message, manifest: dict) -> None:
    (entity,) = message.entities
    (triangles,) = entity.triangles
    check("sheet's nodes", len(triangles.points) == manifest["nodes"])
    check("sheet's triangles", len(triangles.indices) == 3 * manifest["triangles"])
    check("sheet's indices", max(triangles.indices) == manifest["nodes"] - 1)


def read_with_mcap(path: Path, manifest: dict) -> None:
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory
    cameras = {camera["name"]: camera for camera in manifest["cameras"]}
    images = {(i["camera"], i["step"]): i for i in manifest["images"]}
    counts = Counter()
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        check("chunks are LZ4", {c.compression for c in summary.chunk_indexes} == {"lz4"})
        for schema in summary.schemas.values():
            check_schema(schema)
        (description,) = [m for m in reader.iter_metadata() if m.name == "orime"]
        check("set's name", description.metadata["set"] == "sample")
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            parts = channel.topic.strip("/").split("/")
            check(f"schema of {channel.topic}", schema.name == EXPECTED[parts[-1]])
            check("log and publish time", message.log_time == message.publish_time)
            counts[schema.name] += 1
            if parts[0] == "sheet":
                check_sheet(decoded, manifest)
                continue
            stamp = decoded.timestamp.seconds * 10**9 + decoded.timestamp.nanos
            check("time stamp is the log time", stamp == message.log_time)
            if parts[0] == "cloud":
                check_cloud(decoded, manifest)
                continue
            _, part, lens, kind = parts
            name = channel.metadata["orime.camera_name"]
            check("topic's camera", part == name.replace(" ", "_"))
            camera = cameras[name]
            if kind == "image":
                image = images[(name, message.sequence)]
                check(f"{lens} pixels", zlib.crc32(decoded.data) == image[f"{lens}_crc32"])
                check("exposure", message.log_time == image["time_ns"])
                kind = {"color": ("rgb8", 3), "depth": ("16UC1", 2)}[lens]
                check("encoding", decoded.encoding == kind[0])
                check("stride", decoded.step == decoded.width * kind[1])
                check("image's frame", decoded.frame_id == f"{part}_{lens}")
                unit = float(channel.metadata["orime.depth_m_per_unit"])
                check("depth unit", unit == camera["depth_m_per_unit"])
            elif kind == "calibration":
                check_calibration(decoded, camera[lens])
            elif lens == "color":
                check_transform(decoded, camera["world_from_color"], "world", f"{part}_color")
            else:
                frames = (f"{part}_color", f"{part}_depth")
                check_transform(decoded, camera["color_from_depth"], *frames)
    check("every message was read", sum(counts.values()) == manifest["messages"])
    frames = len(manifest["images"])
    check("two images a frame", counts["foxglove.RawImage"] == 2 * frames)
    check("messages in the summary", summary.statistics.message_count == manifest["messages"])
    import mcap
    print(f"mcap {mcap.__version__}: {sum(counts.values())} messages, {dict(counts)}; "
          f"CRCs, {2 * frames} images and {2 * len(cameras)} calibrations as written")


def read_with_rerun(path: Path, folder: Path, manifest: dict) -> None:
    rerun = Path(sys.prefix) / "bin" / "rerun"
    environment = {**os.environ, "RERUN_ANALYTICS": "0", "DO_NOT_TRACK": "1", "NO_COLOR": "1"}

    def run(*arguments: str) -> str:
        done = subprocess.run([rerun, *arguments], capture_output=True, text=True, env=environment)
        text = done.stdout + done.stderr
        check(f"rerun {' '.join(arguments)}:\n{text}", done.returncode == 0)
        return text

    print(run("--version").splitlines()[0].split("(")[0])
    for line in run("mcap", "check", str(path)).splitlines():
        print(f"  mcap check: {line}")
    rrd = folder / "sample.rrd"
    for line in run("mcap", "convert", str(path), "--output", str(rrd)).splitlines():
        print(f"  mcap convert: {line}")
    text = run("rrd", "print", "-v", str(rrd)) + run("rrd", "verify", str(rrd))
    # One chunk line each. Depth (16UC1) is an Image to rerun 0.41; it passes SceneUpdate on as
    # protobuf, undrawn.
    # The first frame brings the calibrations of all cameras.
    frames = len(manifest["images"])
    calibrations = 2 * (frames + len(manifest["cameras"]) - 1)
    for kind, expected in [
        ("Image:buffer", 2 * frames), ("Pinhole:image_from_camera", calibrations),
        ("Transform3D:quaternion", calibrations), ("Points3D:positions", manifest["steps"]),
        ("SceneUpdate:message", 2 * manifest["steps"]),
    ]:
        count = text.count(kind)
        print(f"  {kind}: {count}, expected {expected}")
        check(f"rerun shows {kind}", count == expected)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--venv", type=Path, default=Path("/tmp/orime-mcap-venv"))
    parser.add_argument("--file", type=Path, help="where to write the sample, to keep it")
    arguments = parser.parse_args()
    enter(arguments.venv)
    with tempfile.TemporaryDirectory() as folder:
        path = arguments.file or Path(folder) / "sample.mcap"
        manifest = record(path)
        read_with_mcap(path, manifest)
        read_with_rerun(path, Path(folder), manifest)
    print("ok")


if __name__ == "__main__":
    main()
