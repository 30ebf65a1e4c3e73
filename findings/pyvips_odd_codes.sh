#!/usr/bin/env bash
# pyvips 3.2.0 with libvips 8.18.7: 8-bit colour becomes 16-bit colour by two rules, one for odd codes and one for even ones.
# Expected: one factor, 256 or 257, as grey has (colourspace("grey16"): 257).
# Seen: colourspace("rgb16") and cast(shift=True) give an even code v as 256 v and an odd one as 256 v + 255: steps of 511 and 1.
# Hurt: who measures noise or linearity on converted pictures.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check pyvips==3.2.0 pyvips-binary==8.18.7 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import numpy as np
import pyvips

codes = np.arange(256, dtype=np.uint8)[None, :]
grey = pyvips.Image.new_from_array(codes).colourspace("grey16").numpy()[0]
colour = pyvips.Image.new_from_array(np.stack([codes] * 3, -1)).copy(interpretation="srgb")
colour = colour.colourspace("rgb16").numpy()[0, :, 0]
cast = pyvips.Image.new_from_array(codes).cast("ushort", shift=True).numpy()[0]
for v in (0, 1, 2, 3, 100, 101, 254, 255):
    print(v, "grey16", grey[v], "rgb16", colour[v], "cast", cast[v])
code = codes[0].astype(int)
assert np.array_equal(grey, code * 257)
assert np.array_equal(colour, code * 256 + 255 * (code % 2)) and np.array_equal(cast, colour)
PY
