#!/usr/bin/env bash
# PyAV 18.1.0 (FFmpeg's scaler): white is 1.0 as grey and .9962 as colour.
# Expected: 255 becomes 65535 and 1.0 in every wider format.
# Seen: grey to gray16le and grayf32le gives 65535 and 1.0; rgb24 to rgb48le and gbrpf32le gives 65283 and .99615, to 12 bits
# 4080 of 4095: colour is multiplied by 256, not stretched. Nothing ever reaches full scale, so no pixel looks saturated.
# Hurt: who counts saturated pixels, or compares grey and colour exposures of one light.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check av==18.1.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import av
import numpy as np


def white(form, wider):
    shape = (16, 16) if form == "gray" else (16, 16, 3)
    frame = av.VideoFrame.from_ndarray(np.full(shape, 255, np.uint8), format=form)
    return float(frame.reformat(format=wider).to_ndarray().max())


for form, wider, least, most in (
    ("gray", "gray16le", 65535, 65535),
    ("gray", "grayf32le", 1, 1),
    ("rgb24", "rgb48le", 65280, 65290),
    ("rgb24", "gbrp12le", 4080, 4080),
    ("rgb24", "gbrpf32le", 0.996, 0.9963),
):
    print(form, "->", wider, white(form, wider))
    assert least <= white(form, wider) <= most
PY
