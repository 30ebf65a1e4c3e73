#!/usr/bin/env bash
# PyAV 18.1.0 (FFmpeg's JPEG 2000): 12-bit frames come back 16 times larger, 10-bit ones 64 times.
# Expected: a reversible wavelet returns the numbers and the format that were written.
# Seen: gray12le is stored as 16-bit samples and read as gray16le with every value times 16 (gray10le: times 64); FFV1 keeps
# format and numbers, and imagecodecs 2026.3.6 keeps 12 bits in a JPEG 2000 of its own.
# Hurt: who archives sensor frames and puts black level, gain and full scale beside them.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check av==18.1.0 imagecodecs==2026.3.6 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import io

import av
import imagecodecs
import numpy as np


def back(codec, form, values, options):
    file = io.BytesIO()
    with av.open(file, "w", format="matroska") as out:
        stream = out.add_stream(codec, rate=10, options=options)
        stream.width, stream.height, stream.pix_fmt = 64, 64, form
        for packet in (*stream.encode(av.VideoFrame.from_ndarray(values, format=form)), *stream.encode()):
            out.mux(packet)
    file.seek(0)
    with av.open(file) as video:
        frame = next(video.decode(video=0))
        return frame.format.name, frame.to_ndarray()


for bits, factor in ((12, 16), (10, 64)):
    values = np.random.default_rng(0).integers(0, 2**bits, (64, 64)).astype(np.uint16)
    form, seen = back("jpeg2000", f"gray{bits}le", values, {"pred": "dwt53"})
    print(bits, "bits ->", form, values[0, :3].tolist(), "->", seen[0, :3].tolist())
    assert form == "gray16le" and np.array_equal(seen, values * factor)
    form, seen = back("ffv1", f"gray{bits}le", values, {})
    assert form == f"gray{bits}le" and np.array_equal(seen, values)
    assert np.array_equal(imagecodecs.jpeg2k_decode(imagecodecs.jpeg2k_encode(values, bitspersample=bits)), values)
PY
