#!/usr/bin/env bash
# imagecodecs 2026.3.6: AVIF's quality is ignored for grey pictures.
# Expected: a low level makes a small, lossy file, whatever the number of channels.
# Seen: noise of 20 codes at level 10: the colour picture has errors of 70 and a fortieth of the size of a lossless one; the
# grey one is exact and has the same size at levels 10, 50, 90 and 100.
# Hurt: who studies how compression changes detection, or expects small files, with monochrome cameras.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check imagecodecs==2026.3.6 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import imagecodecs
import numpy as np

colour = np.clip(128 + np.random.default_rng(0).normal(0, 20, (64, 64, 3)), 0, 255).round().astype(np.uint8)
grey = colour[..., 0].copy()
sizes = {}
for level in (10, 50, 90, 100):
    for name, picture in (("grey", grey), ("colour", colour)):
        content = imagecodecs.avif_encode(picture, level=level)
        error = np.abs(imagecodecs.avif_decode(content).reshape(picture.shape).astype(int) - picture).max()
        sizes[name, level] = len(content)
        print(name, "level", level, len(content), "bytes, largest error", error)
        assert error == 0 if name == "grey" or level == 100 else error > 10
assert len({sizes["grey", level] for level in (10, 50, 90, 100)}) == 1
assert sizes["colour", 100] > 30 * sizes["colour", 10]
PY
