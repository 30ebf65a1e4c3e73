#!/usr/bin/env bash
# PyAV 18.1.0 (FFmpeg's muxers): raw video of 16-bit grey comes back from AVI and QuickTime as 15-bit colour.
# Expected: the format that was written, or an error on writing.
# Seen: both files are written; the stream of the AVI reads as rgb555le, that of the MOV as rgb555be, from the same bytes.
# NUT keeps gray16le and the values; AVI keeps 8-bit grey.
# Hurt: who stores raw thermal, depth or sensor frames "without compression".
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check av==18.1.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import io

import av
import numpy as np

frames = {
    "gray16le": np.random.default_rng(0).integers(0, 65536, (64, 64)).astype(np.uint16),
    "gray": np.random.default_rng(0).integers(0, 256, (64, 64)).astype(np.uint8),
}


def back(container, form):
    file = io.BytesIO()
    with av.open(file, "w", format=container) as out:
        stream = out.add_stream("rawvideo", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 64, form
        for packet in (*stream.encode(av.VideoFrame.from_ndarray(frames[form], format=form)), *stream.encode()):
            out.mux(packet)
    file.seek(0)
    with av.open(file) as video:
        return next(video.decode(video=0))


for container, form, seen in (
    ("avi", "gray16le", "rgb555le"),
    ("mov", "gray16le", "rgb555be"),
    ("nut", "gray16le", "gray16le"),
    ("avi", "gray", "gray"),
):
    frame = back(container, form)
    print(container, form, "->", frame.format.name)
    assert frame.format.name == seen
    if seen == form:
        assert np.array_equal(frame.to_ndarray(), frames[form])
PY
