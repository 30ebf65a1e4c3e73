#!/usr/bin/env bash
# cxx-image-io 1.1.7: a picture that it cannot write or read ends the program, past `except Exception`.
# Expected: an exception that a loop over files can catch.
# Seen: SystemExit, raised for a MIPI RAW10 whose width is no multiple of 4 and for a float picture (TIFF); and for reading a
# DNG that the package itself has written without metadata of the camera.
# Hurt: who converts folders: the first odd file stops the job, and a worker process just ends.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check cxx-image-io==1.1.7 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import logging
from pathlib import Path

import numpy as np
from cxx_image_io import ImageLayout, ImageMetadata, ImageWriter, PixelType, read_image, write_image

logging.disable(logging.CRITICAL)


def write(name, picture, kind, layout, bits):
    about = ImageMetadata()
    about.fileInfo.pixelType, about.fileInfo.imageLayout, about.fileInfo.pixelPrecision = kind, layout, bits
    write_image(Path(name), picture, ImageWriter.Options(about))


bayer = np.full((240, 320), 500, np.uint16)
write("own.dng", bayer, PixelType.BAYER_RGGB, ImageLayout.PLANAR, 12)
attempts = {
    "RAW10, 318 wide": lambda: write("a.RAWMIPI10", bayer[:, :318].copy(), PixelType.BAYER_RGGB, ImageLayout.PLANAR, 10),
    "float TIFF": lambda: write("a.tif", np.ones((8, 8, 3), np.float32), PixelType.RGB, ImageLayout.INTERLEAVED, 16),
    "its own DNG": lambda: read_image(Path("own.dng")),
}
for what, attempt in attempts.items():
    try:
        attempt()
    except Exception as error:
        raise AssertionError(f"{what}: caught {error!r}") from error
    except SystemExit as end:
        print(what, "->", repr(end))
    else:
        raise AssertionError(f"{what}: no error")
PY
