#!/usr/bin/env bash
# imagecodecs 2026.3.6 meets pillow-jxl-plugin 1.3.8: one lossless JPEG XL, three answers.
# Expected: the 12-bit numbers that were stored, from any reader.
# Seen: imagecodecs reads grey and colour as stored (0 to 4095); Pillow reads the grey file stretched to 16 bits (4095 is 65535,
# 2000 is 32007) and the colour file cut to 8 bits (2000 is 125), though both files are of one depth.
# Hurt: who stores raw frames as JPEG XL and reads them with another library.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check imagecodecs==2026.3.6 pillow-jxl-plugin==1.3.8 pillow==13.0.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import io

import imagecodecs
import numpy as np
import pillow_jxl  # noqa: F401
from PIL import Image

grey = np.array([[0, 1, 2000, 4095]] * 16, np.uint16)
colour = np.stack([grey] * 3, -1)
seen = {}
for name, picture in (("grey", grey), ("colour", colour)):
    content = imagecodecs.jpegxl_encode(picture, lossless=True, bitspersample=12)
    assert np.array_equal(imagecodecs.jpegxl_decode(content), picture)
    image = Image.open(io.BytesIO(content))
    seen[name] = (image.mode, np.asarray(image).reshape(16, 4, -1)[0, :, 0].tolist())
    print(name, "stored", grey[0].tolist(), "Pillow reads", seen[name])
assert seen["grey"] == ("I;16", [0, 16, 32007, 65535])
assert seen["colour"][0] == "RGB" and seen["colour"][1][2:] == [125, 255]
PY
