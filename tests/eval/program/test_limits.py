"""Limits: what rules leave of exposure times; metering: gains of the camera's own rule, and the pictures' light."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.program.scenario import Limits, Metering, mean_light

from blurnoise.optics.camera import PRESETS
from blurnoise.scene.metering import USUAL

CAMERA = PRESETS["imx250"]


def ms(times: tuple[float, ...]) -> list[float]:
    return [round(1e3 * time, 4) for time in times]


def test_frames_less_read_out() -> None:
    times = Limits(frame_rate_hz=50.0, readout_s=0.004).candidates(1e-3, 1.0)
    assert times[0] == 1e-3
    assert times[-1] == pytest.approx(0.016)
    assert np.diff(np.log2(times)).max() <= 1 / 8 + 1e-9


def test_whole_periods() -> None:
    assert ms(Limits(mains_hz=50.0).candidates(1e-4, 1.0)) == [10, 20, 30]
    assert ms(Limits(mains_hz=60.0).candidates(1e-4, 1.0)) == [8.3333, 16.6667, 25, 33.3333]


def test_leds() -> None:
    assert min(Limits(led=True).candidates(1e-4, 1.0)) == pytest.approx(1 / 90)
    assert ms(Limits(led=True, mains_hz=50.0).candidates(1e-4, 1.0)) == [20, 30]


def test_whole_lines() -> None:
    line_s = 14.8e-6
    times = np.array(Limits(row_time_s=line_s, led=True).candidates(1e-4, 1.0)) / line_s
    assert np.abs(times - times.round()).max() < 1e-6
    assert times.min() * line_s >= 1 / 90


def test_settles_on_what_is_allowed_and_not_longer() -> None:
    limits = Limits(mains_hz=50.0)
    assert limits.settled(0.029) == pytest.approx(0.02)
    assert limits.settled(0.003) == pytest.approx(0.01)  # the shortest there is
    assert limits.settled(0.2) == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("rules", "named"),
    [
        (
            {"frame_rate_hz": 100.0, "readout_s": 0.002, "mains_hz": 50.0},
            r"50 Hz.*any light.*10 ms.*leaves 8 ms",
        ),
        ({"frame_rate_hz": 100.0, "led": True}, r"LEDs.*any light.*11.11 ms.*leaves 10 ms"),
        ({"frame_rate_hz": 60.0, "led": True, "mains_hz": 50.0}, r"50 Hz mains, LEDs.*20 ms"),
        ({"least_exposure_s": 0.0}, "least_exposure_s = 0"),
        ({"mains_hz": 55.0}, "mains_hz = 55"),
    ],
)
def test_rules_that_leave_nothing_are_named(rules: dict[str, float], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        Limits(**rules)


def test_time_and_gain_make_the_total() -> None:
    metering = Metering(CAMERA, 0.217)
    total_s = metering.total_s(10.0)
    for time_s in (0.001, 0.01, 0.1):
        gain = 10 ** (metering.gain_db(10.0, time_s) / 20)
        assert gain * time_s == pytest.approx(total_s, rel=2e-3)  # dark charge
    assert metering.gain_db(10.0, 10.0) == 0.0
    assert metering.gain_db(10.0, 1e-6) == CAMERA.gain_max_db


def test_mean_light_follows_from_gains() -> None:
    rows = []
    for image, light in {"a": 0.1, "b": 0.3}.items():
        for lux in (0.01, 10.0, 50.0, 1e5):  # at the first gain is at its most, at the last at none
            at = {"illuminance_lux": lux, "exposure_s": 0.005}
            gain_db = USUAL.setting(CAMERA, mean_light=light, **at).gain_db
            rows.append({"image": image, "applied_gain_db": gain_db, **at})
    assert mean_light(rows, CAMERA) == pytest.approx(0.2, rel=1e-3)
    assert mean_light([row for row in rows if row["illuminance_lux"] in (0.01, 1e5)], CAMERA) is None
