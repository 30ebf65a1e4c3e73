#!/usr/bin/env bash
# ids-peak-ipl 1.18.0: the hot-pixel correction finds hot pixels in plain noise, and lowers it.
# Expected: none in a frame of normal noise (mean 200, standard deviation 30, 12 bits), as no pixel is above its expectation.
# Seen: at the default sensitivity some .4 % of the pixels are called hot, all of them high; corrected, they are replaced by
# their neighbours, so the frame's mean and noise fall.
# Hurt: who measures noise, dark current or EMVA 1288 figures with the correction on.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check ids-peak-ipl==1.18.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import numpy as np
from ids_peak_ipl import ids_peak_ipl as ipl

ipl.Library.Initialize() if hasattr(ipl.Library, "Initialize") else None
frame = (200 + np.random.default_rng(0).normal(0, 30, (256, 256))).round().astype(np.uint16)
buffer = bytearray(frame.tobytes())  # the image is a view of it
image = ipl.Image.CreateFromSizeAndPythonBuffer(ipl.PixelFormatName_Mono12, buffer, 256, 256)
correction = ipl.HotpixelCorrection()
places = correction.Detect(image)
hot = np.array([frame[p.y, p.x] for p in places])
corrected = np.array(correction.Correct(image, places).get_numpy_1D_16()).reshape(frame.shape)
print(len(hot) / frame.size, "called hot, the lowest", hot.min(), "mean", frame.mean(), "->", corrected.mean())
print("standard deviation", frame.std(), "->", corrected.std())
assert 0.002 < len(hot) / frame.size < 0.006 and hot.min() > 230
assert corrected.mean() < frame.mean() - 0.1 and corrected.std() < frame.std() - 0.2
PY
