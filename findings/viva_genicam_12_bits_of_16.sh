#!/usr/bin/env bash
# viva-genicam 0.10.0: its simulated camera sends "Mono12" frames with values up to 65271.
# Expected: values below 4096 in Mono12 and below 1024 in Mono10, packed or not.
# Seen: Mono10, Mono12 and Mono14 frames hold the 16-bit pattern of Mono16, and to_numpy hands it on; to_rgb8 makes most of it
# white. Mono10p and Mono12p are right.
# Hurt: who tests unpacking, black level or saturation without a camera.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check viva-genicam==0.10.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PY'
import viva_genicam
from viva_genicam.testing import FakeGigeCamera

seen = {}
for form in ("Mono10", "Mono12", "Mono14", "Mono16", "Mono10p", "Mono12p"):
    with FakeGigeCamera(width=64, height=48, fps=30, pixel_format=form) as fake:
        with viva_genicam.connect_gige(fake.device_info()) as camera, camera.stream() as frames:
            frame = next(iter(frames))
    seen[form] = int(frame.to_numpy().max())
    print(form, frame.pixel_format, "largest value", seen[form], "white in rgb8", float((frame.to_rgb8() == 255).mean()))
assert all(seen[form] > 50000 for form in ("Mono10", "Mono12", "Mono14", "Mono16"))
assert seen["Mono10p"] < 1024 and seen["Mono12p"] < 4096
PY
