#!/usr/bin/env bash
# pyrealsense2 2.59.1.11053: a depth frame in metres comes as an array of whole numbers.
# Expected: units_transform gives float32 metres, as its frame's format (distance) says.
# Seen: the array is uint32 and holds the bits of the floats: 1.5 m reads 1069547521.
# Hurt: who averages or thresholds depth in metres; `.view(np.float32)` is needed, and nothing warns.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check pyrealsense2==2.59.1.11053 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import numpy as np
import pyrealsense2 as rs

WIDTH, HEIGHT = 640, 480


def camera(stream, form, bytes_per_pixel):
    """A software device; returns a function that sends it a picture and gives back the frame."""
    device = rs.software_device()
    sensor = device.add_sensor("made")
    video = rs.video_stream()
    video.type, video.fmt, video.bpp, video.fps = stream, form, bytes_per_pixel, 30
    video.index, video.uid, video.width, video.height = 0, 1, WIDTH, HEIGHT
    intrinsics = rs.intrinsics()
    intrinsics.width, intrinsics.height = WIDTH, HEIGHT
    intrinsics.fx = intrinsics.fy = 600.0
    intrinsics.ppx, intrinsics.ppy = WIDTH / 2, HEIGHT / 2
    video.intrinsics = intrinsics
    profile = sensor.add_video_stream(video)
    if stream == rs.stream.depth:
        sensor.add_read_only_option(rs.option.depth_units, 0.001)
    queue = rs.frame_queue(50)
    sensor.open(profile)
    sensor.start(queue)
    sent = []

    def send(picture):
        sent.append((device, np.ascontiguousarray(picture)))
        frame = rs.software_video_frame()
        frame.pixels, frame.bpp, frame.stride = sent[-1][1], bytes_per_pixel, WIDTH * bytes_per_pixel
        frame.timestamp, frame.frame_number = 33.0 * len(sent), len(sent)
        frame.domain = rs.timestamp_domain.hardware_clock
        frame.profile = profile.as_video_stream_profile()
        if stream == rs.stream.depth:
            frame.depth_units = 0.001
        sensor.on_video_frame(frame)
        return queue.wait_for_frame(5000)

    return send


send = camera(rs.stream.depth, rs.format.z16, 2)
frame = rs.units_transform().process(send(np.full((HEIGHT, WIDTH), 1500, np.uint16)))
metres = np.asanyarray(frame.get_data())
print(frame.get_profile().format(), metres.dtype, metres[0, 0], "as float32", metres.view(np.float32)[0, 0])
assert frame.get_profile().format() == rs.format.distance
assert metres.dtype == np.uint32 and metres[0, 0] == 1069547521
assert abs(metres.view(np.float32)[0, 0] - 1.5) < 1e-6
PY
