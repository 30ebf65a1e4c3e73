#!/usr/bin/env bash
# pfnc 0.1.1: a frame of YUV422_8 is refused as too small, and the readme's first call gives None.
# Expected: two bytes a pixel for 4:2:2 and 1.5 for 4:1:1, as their names say; from_designation returns a format.
# Seen: get_buffer_size says three bytes a pixel for each of them, and a right frame is a ValueError; Mono12 and RGB8 are
# right. PixelFormat.from_designation("RGB8") is None; from_name works. Packed formats (Mono12p) have no decoder.
# Hurt: who decodes frames of a GenICam camera without its vendor's SDK.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check pfnc==0.1.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
from dataspree.pfnc import PixelFormat

assert PixelFormat.from_designation("RGB8") is None
for name, right, wrong in (("Mono12", 64, 64), ("RGB8", 96, 96), ("YUV422_8", 64, 96), ("YCbCr411_8", 48, 96)):
    form = PixelFormat.from_name(name)
    size = form.get_buffer_size(8, 4)
    try:
        seen = form.decode(bytes(right), width=8, height=4, copy=True).shape
    except ValueError as error:
        seen = str(error)
    print(name, "right", right, "bytes, asked", size, seen)
    assert size == wrong and isinstance(seen, str) == (right != wrong)
PY
