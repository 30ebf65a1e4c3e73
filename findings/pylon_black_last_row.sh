#!/usr/bin/env bash
# pypylon 26.9: the last row and the last column of every converted Bayer picture are black.
# Expected: an even grey mosaic becomes an even grey picture.
# Seen: with the converter's defaults (InconvertibleEdgeHandling SetZero) they are 0; "Extend" repeats their neighbours,
# "Clip" returns a picture one row and one column smaller.
# Hurt: who learns or measures on converted frames: least values, histograms, flat fields, boxes at the edge.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check pypylon==26.9 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import numpy as np
from pypylon import pylon

mosaic = pylon.PylonImage()
mosaic.AttachArray(np.full((8, 10), 100, np.uint8), pylon.PixelType_BayerRG8)


def picture(edges=None):
    converter = pylon.ImageFormatConverter()
    converter.OutputPixelFormat = pylon.PixelType_RGB8packed
    if edges:
        converter.GetNodeMap().GetNode("InconvertibleEdgeHandling").FromString(edges)
    return converter.Convert(mosaic).GetArray()


default, extended, clipped = picture(), picture("Extend"), picture("Clip")
print("default", default.shape, default[..., 1].tolist(), sep="\n")
print("Extend", extended.shape, extended.min(), "Clip", clipped.shape, clipped.min())
assert (default[:-1, :-1] == 100).all() and not default[-1].any() and not default[:, -1].any()
assert (extended == 100).all() and clipped.shape == (7, 9, 3)
PY
