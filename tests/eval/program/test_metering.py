"""Metering: gains of the camera's own rule, and the pictures' light from the gains that they had."""

from __future__ import annotations

import pytest
from blurnoise_eval.program.limits import Metering, mean_light

from blurnoise.optics.camera import PRESETS
from blurnoise.scene.metering import USUAL

CAMERA = PRESETS["imx250"]


def test_time_and_gain_make_the_total() -> None:
    metering = Metering(CAMERA, 0.217)
    total_s = metering.total_s(10.0)
    for time_s in (0.001, 0.01, 0.1):
        assert 10 ** (metering.gain_db(10.0, time_s) / 20) * time_s == pytest.approx(
            total_s, rel=2e-3
        )  # dark charge
    assert metering.gain_db(10.0, 10.0) == 0.0
    assert metering.gain_db(10.0, 1e-6) == CAMERA.gain_max_db


def test_most_gain_is_noticed() -> None:
    metering = Metering(CAMERA, 0.217)
    shortest = metering.total_s(1.0) / 10 ** (CAMERA.gain_max_db / 20)
    assert not metering.lacks_gain(1.0, shortest * 1.001)
    assert metering.lacks_gain(1.0, shortest * 0.99)


def test_light_is_told_by_gains() -> None:
    lights = {"a": 0.1, "b": 0.3}
    rows = [
        {
            "image": image,
            "illuminance_lux": lux,
            "exposure_s": 0.005,
            "applied_gain_db": USUAL.setting(
                CAMERA, mean_light=light, illuminance_lux=lux, exposure_s=0.005
            ).gain_db,
        }
        for image, light in lights.items()
        for lux in (0.01, 10.0, 50.0, 1e5)  # at the first gain is at its most, at the last at none
    ]
    assert mean_light(rows, CAMERA) == pytest.approx(0.2, rel=1e-3)
    assert mean_light([row for row in rows if row["illuminance_lux"] in (0.01, 1e5)], CAMERA) is None
