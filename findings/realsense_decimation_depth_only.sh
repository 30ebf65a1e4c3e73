#!/usr/bin/env bash
# pyrealsense2 2.59.1.11053: the decimation filter does nothing to colour or infrared, without a word.
# Expected: decimation_filter(2) halves the frame that it is given, as it does with depth.
# Seen: depth 640 x 480 becomes 320 x 240; RGB8, Y8 and Y16 come back at 640 x 480, unchanged.
# Hurt: who scales intrinsics or boxes by the magnitude, or compares depth and colour at "the same" size.
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


for stream, form, channels, dtype in (
    (rs.stream.depth, rs.format.z16, 1, np.uint16),
    (rs.stream.color, rs.format.rgb8, 3, np.uint8),
    (rs.stream.infrared, rs.format.y8, 1, np.uint8),
    (rs.stream.infrared, rs.format.y16, 1, np.uint16),
):
    shape = (HEIGHT, WIDTH) if channels == 1 else (HEIGHT, WIDTH, channels)
    picture = np.random.default_rng(0).integers(1, 200, shape).astype(dtype)
    frame = rs.decimation_filter(2).process(camera(stream, form, picture.itemsize * channels)(picture))
    out = np.asanyarray(frame.get_data())
    print(form, picture.shape, "->", out.shape)
    if stream == rs.stream.depth:
        assert out.shape == (240, 320)
    else:
        assert np.array_equal(out, picture)
PY
