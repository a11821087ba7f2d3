"""Records frames with the RealSense SDK, as a software device, into a .bag or .db3 file.

    PYTHONPATH=.venv/realsense/VERSION LD_LIBRARY_PATH=.venv/realsense/VERSION/libusb_package \
        python tests/realsense_record.py FOLDER OUT

FOLDER holds `camera.json` (serial, fps, depth and color: width, height, fx, fy, ppx, ppy, coeffs;
rotation (column by column) and translation from depth to colour; depth_units; times_ms) and the
frames one behind the other, `depth.raw` (u16) and `color.raw` (RGB).
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
import pyrealsense2 as rs


def video_stream(kind, uid, fmt, bpp, fps, lens):
    intrinsics = rs.intrinsics()
    intrinsics.width, intrinsics.height = lens["width"], lens["height"]
    intrinsics.fx, intrinsics.fy = lens["fx"], lens["fy"]
    intrinsics.ppx, intrinsics.ppy = lens["ppx"], lens["ppy"]
    intrinsics.model, intrinsics.coeffs = rs.distortion.brown_conrady, lens["coeffs"]
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt = kind, 0, uid, fmt
    stream.width, stream.height, stream.bpp = lens["width"], lens["height"], bpp
    stream.fps, stream.intrinsics = fps, intrinsics
    return stream


def main(folder, out):
    about = json.loads((folder / "camera.json").read_text())
    depth_lens, color_lens = about["depth"], about["color"]
    shape = (-1, depth_lens["height"], depth_lens["width"])
    depths = np.fromfile(folder / "depth.raw", np.uint16).reshape(shape)
    shape = (-1, color_lens["height"], color_lens["width"], 3)
    colors = np.fromfile(folder / "color.raw", np.uint8).reshape(shape)

    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Orime software device")
    device.register_info(rs.camera_info.serial_number, about["serial"])
    depth_sensor = device.add_sensor("Stereo Module")
    color_sensor = device.add_sensor("RGB Camera")
    fps = about["fps"]
    depth = depth_sensor.add_video_stream(
        video_stream(rs.stream.depth, 1, rs.format.z16, 2, fps, depth_lens)
    )
    color = color_sensor.add_video_stream(
        video_stream(rs.stream.color, 2, rs.format.rgb8, 3, fps, color_lens)
    )
    depth_sensor.add_read_only_option(rs.option.depth_units, about["depth_units"])
    extrinsics = rs.extrinsics()
    extrinsics.rotation, extrinsics.translation = about["rotation"], about["translation"]
    depth.register_extrinsics_to(color, extrinsics)

    recorder = rs.recorder(str(out), device)
    queue = rs.frame_queue(2 * len(depths) + 2)
    for sensor in recorder.query_sensors():
        sensor.open(sensor.get_stream_profiles()[0])
        sensor.start(queue)
    for number, time_ms in enumerate(about["times_ms"]):
        for sensor, profile, image, bpp in (
            (depth_sensor, depth, depths[number], 2),
            (color_sensor, color, colors[number], 3),
        ):
            frame = rs.software_video_frame()
            frame.pixels, frame.bpp, frame.stride = image, bpp, image.shape[1] * bpp
            frame.timestamp, frame.frame_number = time_ms, number + 1
            frame.domain = rs.timestamp_domain.hardware_clock
            frame.profile = profile.as_video_stream_profile()
            if bpp == 2:
                frame.depth_units = about["depth_units"]
            sensor.on_video_frame(frame)
        # The recorder drops what it cannot write in time.
        time.sleep(0.03)
    time.sleep(0.3)
    for sensor in recorder.query_sensors():
        sensor.stop()
        sensor.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
