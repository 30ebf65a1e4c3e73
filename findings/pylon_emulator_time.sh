#!/usr/bin/env bash
# pypylon 26.9: the emulated camera's numbers about time contradict each other.
# Expected: as with a real one: ExposureTimeRaw follows ExposureTimeAbs, the resulting frame rate is limited by the exposure,
# frames have rising time stamps.
# Seen: after ExposureTimeAbs = 100000 (0.1 s), ExposureTimeRaw is still 10000, ResultingFrameRateAbs says 200 as asked (10
# would be possible), and the time stamp of every frame is 0.
# Hurt: who tests frame rates, exposure limits or synchronisation against the emulator.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check pypylon==26.9 numpy==2.4.6
cd "$folder"
PYLON_CAMEMU=1 venv/bin/python - <<'PY'
from pypylon import pylon

camera = pylon.InstantCamera(pylon.TlFactory.GetInstance().CreateFirstDevice())
camera.Open()
camera.ExposureTimeAbs.Value = 100000.0
camera.AcquisitionFrameRateEnable.Value = True
camera.AcquisitionFrameRateAbs.Value = 200.0
camera.StartGrabbingMax(4)
stamps = []
while camera.IsGrabbing():
    with camera.RetrieveResult(5000) as result:
        stamps.append(result.TimeStamp)
raw, rate = camera.ExposureTimeRaw.Value, camera.ResultingFrameRateAbs.Value
print("ExposureTimeAbs", camera.ExposureTimeAbs.Value, "Raw", raw, "resulting rate", rate, "stamps", stamps)
camera.Close()
assert raw == 10000 and rate == 200.0 and stamps == [0, 0, 0, 0]
PY
