"""Processing of pictures in libcamera's tuning files: noise reduction by gain, and what has no unit."""

import math

import cv2
import made_frames
import numpy as np
import pytest
import torch
from blurnoise_eval.calibration.libcamera import camera_of_libcamera
from commands import main

from blurnoise import simulate
from blurnoise.camera.radiometry import electrons_per_lux_s
from blurnoise.picture.develop import develop_8bit

ROOT_CURVE = [number for x in np.linspace(0, 1, 65) ** 2 for number in (65535 * x, 65535 * math.sqrt(x))]
PLAIN = {
    "rpi.contrast": {"gamma_curve": ROOT_CURVE},
    "rpi.awb": {"ct_curve": [4000.0, 1.0, 1.0, 6000.0, 1.0, 1.0]},
    "rpi.ccm": {"ccms": [{"ct": 5000, "ccm": [1, 0, 0, 0, 1, 0, 0, 0, 1]}]},
}


def fitted(tmp_path, **changes):
    return camera_of_libcamera(made_frames.write_tuning(tmp_path / "module.json", **changes), base="imx250c")


def test_noise_reduction_is_that_of_the_noise_profile(tmp_path):
    """Slope 4 in 16 bits behind a root: 255 x 4 / (2 sqrt(65535 - 4096)) DN at every level, for each colour."""
    camera = fitted(tmp_path, **PLAIN, **{"rpi.sdn": {"deviation": 2.0, "strength": 0.5}})
    of_colours_dn = 2.0 * 255 * 4 / (2 * math.sqrt(65535 - 4096))
    rows = {row.gain_db: row for row in camera.isp.noise_reduction}
    assert rows[0.0].luma_sigma_dn == pytest.approx(of_colours_dn * 0.6687, rel=0.01)
    assert rows[0.0].chroma_sigma_dn == pytest.approx(
        of_colours_dn * math.sqrt((0.4312 + 0.3883) / 2), rel=0.01
    )
    assert rows[24.0].luma_sigma_dn / rows[0.0].luma_sigma_dn == pytest.approx(10 ** (24 / 40), rel=0.01)
    assert {row.strength for row in rows.values()} == {0.5}
    assert max(rows) >= camera.sensor.gain_max_db


def test_sigma_is_the_deviation_times_the_noise_of_developed_frames(tmp_path):
    """Of grey at 24 dB: within 30 %: demosaicing lowers it, the curve gives it 10 % more here than on average."""
    camera = fitted(tmp_path, **{"rpi.sdn": {}, "rpi.alsc": None}).with_figures(read_noise_e=0.0)
    sigmas = next(row for row in camera.isp.noise_reduction if row.gain_db == 24.0)
    taker = camera.with_figures(noise_reduction=()).at_gain(24.0).camera
    lux = 0.2 * taker.sensor.saturation_e / electrons_per_lux_s(taker, "planck:5000") / 0.01
    lit = {"exposure_s": 0.01, "illuminance_lux": lux, "illuminant": "planck:5000"}
    seen = develop_8bit(
        simulate(torch.ones(1, 3, 200, 200), taker, generator=[1], **lit), taker, illuminant="planck:5000"
    )
    planes = cv2.cvtColor(seen[0].permute(1, 2, 0).numpy().astype(np.float32), cv2.COLOR_RGB2YCrCb)
    luma, *chroma = planes.reshape(-1, 3).std(0)
    assert sigmas.luma_sigma_dn / luma == pytest.approx(3.2, rel=0.3)
    assert sigmas.chroma_sigma_dn / np.sqrt(np.mean(np.square(chroma))) == pytest.approx(3.2, rel=0.3)


def test_what_has_no_unit_is_named(tmp_path, capsys):
    sharpen = {"threshold": 0.75, "strength": 1.0, "limit": 0.5}
    module = made_frames.write_tuning(tmp_path / "module.json", **{"rpi.sharpen": sharpen, "rpi.sdn": {}})
    assert main(["cameras", "fit", "--libcamera", module, "-o", tmp_path / "pi.yaml", "--bit-depth", 10]) == 0
    told = " ".join("".join(capsys.readouterr()).split())
    assert (
        "sharpening: not read: rpi.sharpen of module.json (threshold 0.75, strength 1.0, limit 0.5) is in"
        in told
    )
    assert "local_tone: none: rpi.contrast of module.json stretches the histogram of whole pictures" in told
    assert "noise_reduction: derived: rpi.sdn of module.json, 3.2 times rpi.noise" in told


def test_without_rpi_sdn_there_is_no_noise_reduction(tmp_path):
    assert fitted(tmp_path).isp.noise_reduction == ()
    with pytest.raises(ValueError, match=r"module\.json: .*strength = 2.0: must be finite and >= 0 and <= 1"):
        fitted(tmp_path, **{"rpi.sdn": {"strength": 2}})
