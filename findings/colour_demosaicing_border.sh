#!/usr/bin/env bash
# colour-demosaicing 0.2.7: bilinear demosaicing of an even grey makes a coloured frame of one pixel.
# Expected: an even mosaic of .5 becomes an even picture of .5, as by the package's Malvar2004 and Menon2007.
# Seen: the border is repeated, which puts red sites beside red ones: the first row is (.75, .625 or .375, .25), the corner
# (1.125, .25, .125). All other pixels are .5.
# Hurt: who measures least and largest values or tiles and crops raw pictures before demosaicing.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check colour-demosaicing==0.2.7 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import numpy as np
from colour_demosaicing import (
    demosaicing_CFA_Bayer_bilinear,
    demosaicing_CFA_Bayer_Malvar2004,
    demosaicing_CFA_Bayer_Menon2007,
)

even = np.full((32, 40), 0.5)
picture = demosaicing_CFA_Bayer_bilinear(even, "RGGB")
print("corner", picture[0, 0], "first row", picture[0, 10], picture[0, 11], "inside", picture[10, 10])
assert np.allclose(picture[1:-1, 1:-1], 0.5)
assert np.allclose(picture[0, 0], [1.125, 0.25, 0.125]) and np.allclose(picture[0, 10], [0.75, 0.375, 0.25])
for other in (demosaicing_CFA_Bayer_Malvar2004, demosaicing_CFA_Bayer_Menon2007):
    assert np.allclose(other(even, "RGGB"), 0.5)
PY
