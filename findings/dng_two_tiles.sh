#!/usr/bin/env bash
# cxx-image-io 1.1.7 meets rawpy 0.28.0: of its lossless DNGs, those exactly two tiles wide are read as another picture.
# Expected: rawpy's raw_image is the mosaic that was written, whatever the picture's size.
# Seen: 320 x 240 (tiles of 160 x 240) and 512 x 512 (256 x 256): over 99 % of the pixels are wrong, no error; 256 x 256
# (one tile), 400 x 300 (two, the second partly used) and 1024 x 768 (four) are right. tifffile 2026.3.3 reads all of them.
# Hurt: who makes small DNGs for tests, and crops of raw pictures.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check cxx-image-io==1.1.7 rawpy==0.28.0 tifffile==2026.3.3 imagecodecs==2026.3.6 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
from pathlib import Path

import numpy as np
import rawpy
import tifffile
from cxx_image_io import ImageLayout, ImageMetadata, ImageWriter, PixelType, write_image

wrong = {}
for width, height in ((256, 256), (320, 240), (400, 300), (512, 512), (1024, 768)):
    mosaic = np.random.default_rng(0).integers(0, 4096, (height, width)).astype(np.uint16)
    about = ImageMetadata()
    about.fileInfo.pixelType, about.fileInfo.imageLayout = PixelType.BAYER_RGGB, ImageLayout.PLANAR
    about.fileInfo.pixelPrecision = 12
    write_image(Path("a.dng"), mosaic, ImageWriter.Options(about))
    page = tifffile.TiffFile("a.dng").pages[0]
    with rawpy.imread("a.dng") as raw:
        wrong[width, height] = float((raw.raw_image != mosaic).mean())
    print(width, height, "tile", page.tilewidth, "wrong in rawpy", wrong[width, height])
    assert np.array_equal(page.asarray(), mosaic)
assert wrong[320, 240] > 0.99 and wrong[512, 512] > 0.99
assert wrong[256, 256] == wrong[400, 300] == wrong[1024, 768] == 0
PY
