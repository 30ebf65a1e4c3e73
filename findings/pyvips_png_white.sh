#!/usr/bin/env bash
# pyvips 3.2.0 with libvips 8.18.7: one array of 16-bit grey is saved by each format in a way of its own.
# Expected: a uint16 array becomes a 16-bit PNG, as it becomes a 16-bit TIFF, or at least the same 8 bits everywhere.
# Seen: the PNG has 8 bits and every value above 255 is white; JPEG and WebP have the upper 8 bits; TIFF keeps all. An array
# is "b-w" to libvips until copy(interpretation="grey16"), with which the PNG has 16 bits.
# Hurt: who saves raw or 16-bit frames.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check pyvips==3.2.0 pyvips-binary==8.18.7 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import numpy as np
import pyvips

values = np.array([[100, 300, 4095, 30000, 65535]] * 16, np.uint16)
picture = pyvips.Image.new_from_array(values)


def back(buffer):
    image = pyvips.Image.new_from_buffer(buffer, "")
    array = image.numpy()
    return image.format, (array if array.ndim == 2 else array[..., 0])[8].tolist()


seen = {
    "png": back(picture.pngsave_buffer()),
    "png, grey16": back(picture.copy(interpretation="grey16").pngsave_buffer()),
    "tiff": back(picture.tiffsave_buffer()),
    "webp": back(picture.webpsave_buffer(lossless=True)),
}
for name, (form, line) in seen.items():
    print(name, form, line)
assert picture.format == "ushort" and picture.interpretation == "b-w"
assert seen["png"] == ("uchar", [100, 255, 255, 255, 255])
assert seen["webp"] == ("uchar", [0, 1, 15, 117, 255])
assert seen["tiff"] == seen["png, grey16"] == ("ushort", values[0].tolist())
PY
