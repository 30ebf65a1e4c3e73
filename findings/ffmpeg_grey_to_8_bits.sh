#!/usr/bin/env bash
# PyAV 18.1.0 (FFmpeg's scaler): one dark grey becomes three pictures on its way to 8 bits, by the format it had.
# Expected: the same rule (cut or rounded) for 9/16 of an 8-bit step, whether it came with 12 bits, 16 bits or as colour.
# Seen: gray12le (9) is dithered into a pattern of 0 and 1 that keeps the mean, .5625; gray16le (144) is dithered into one of
# .125; rgb48le (144) is rounded to an even 1.
# Hurt: who measures noise on converted frames (an even picture has a standard deviation of .5), and dark scenes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check av==18.1.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import av
import numpy as np


def narrow(form, value):
    shape = (64, 64) if form.startswith("gray") else (64, 64, 3)
    frame = av.VideoFrame.from_ndarray(np.full(shape, value, np.uint16), format=form)
    return frame.reformat(format="gray" if form.startswith("gray") else "rgb24").to_ndarray()


seen = {form: narrow(form, value) for form, value in (("gray12le", 9), ("gray16le", 144), ("rgb48le", 144))}
for form, picture in seen.items():
    print(form, "values", np.unique(picture).tolist(), "mean", picture.mean(), "sd", round(float(picture.std()), 3))
assert seen["gray12le"].mean() == 0.5625 and seen["gray12le"].std() > 0.49
assert abs(seen["gray16le"].mean() - 0.125) < 0.01 and seen["gray16le"].any()
assert (seen["rgb48le"] == 1).all()
PY
