"""Auto-exposure: limits in their order, the meter against the mean frame, and its invariants."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from blurnoise import Camera, develop, simulate
from blurnoise.scene.metering import AutoExposure, mean_luma

CAMERA = Camera.preset("imx250")
LUX = st.floats(1e-4, 1e6)
LIGHT = st.floats(0.01, 1.0)


@given(LUX, LIGHT)
def test_time_first_then_gain(lux: float, light: float) -> None:
    ae = AutoExposure()
    setting = ae.setting(CAMERA, mean_light=light, illuminance_lux=lux)
    assert setting.exposure_s <= 1 / 30
    if setting.gain_db > 1e-9:
        assert setting.exposure_s == 1 / 30
    if setting.gain_db < CAMERA.gain_max_db:
        assert setting.reading == pytest.approx(0.18)
    else:
        assert setting.reading <= 0.18 * (1 + 1e-12)


@given(LUX, st.sampled_from([0.0, 50.0, 60.0]), st.sampled_from([0.0, 1e-5, 2.41e-5]))
def test_periods_and_rows_are_whole(lux: float, mains_hz: float, row_time_s: float) -> None:
    ae = AutoExposure(mains_hz=mains_hz, row_time_s=row_time_s)
    exposure_s = ae.setting(CAMERA, mean_light=0.2, illuminance_lux=lux).exposure_s
    if mains_hz and not row_time_s and exposure_s >= 1 / (2 * mains_hz):
        periods = exposure_s * 2 * mains_hz
        assert periods == pytest.approx(round(periods), abs=1e-9)
    if row_time_s:
        assert exposure_s / row_time_s == pytest.approx(max(1, round(exposure_s / row_time_s)), abs=1e-6)
    if not (mains_hz and row_time_s):  # where both count, rows cut periods short
        assert ae.allowed_s(exposure_s) == pytest.approx(exposure_s)  # twice is once


@pytest.mark.parametrize(("mains_hz", "expected_ms"), [(50.0, 30.0), (60.0, 25.0)])
def test_at_30_frames_a_second_mains_leave_three_periods(mains_hz: float, expected_ms: float) -> None:
    ae = AutoExposure(mains_hz=mains_hz, readout_s=1e-4)  # of 60 Hz the fourth period would need 33.33 ms
    exposure_s = ae.setting(CAMERA, mean_light=0.2, illuminance_lux=1.0).exposure_s
    assert 1e3 * exposure_s == pytest.approx(expected_ms)


def test_the_meter_reads_what_the_mean_frame_has() -> None:
    rows = torch.linspace(0.05, 0.4, 60)[None, None, :, None].expand(1, 3, 60, 80).contiguous()
    scene = rows * torch.tensor([1.0, 0.7, 0.3])[None, :, None, None]
    light = float(mean_luma(scene)[0])
    assert light == pytest.approx(0.225 * (0.2126 + 0.7 * 0.7152 + 0.3 * 0.0722), rel=1e-5)
    ae, exposure_s, lux = AutoExposure(), 0.004, 20.0
    gain_db = ae.setting(CAMERA, mean_light=light, illuminance_lux=lux, exposure_s=exposure_s).gain_db
    camera, digital_db = CAMERA.at_gain(gain_db)
    frame = simulate(
        scene, camera, exposure_s=exposure_s, illuminance_lux=lux, encoding="linear", noise=False
    )
    seen = develop(frame, camera, encoding="linear", gain_db=digital_db)
    assert float(mean_luma(seen)[0]) == pytest.approx(0.18, abs=1 / 4095)


def test_without_noise_the_picture_does_not_depend_on_the_light() -> None:
    scene, ae = torch.rand(1, 1, 30, 40, generator=torch.Generator().manual_seed(1)) * 0.5, AutoExposure()
    frames = []
    for lux in (2.0, 8.0, 32.0):
        at = {"illuminance_lux": lux, "exposure_s": 0.005}
        gain_db = ae.setting(CAMERA, mean_light=float(mean_luma(scene)[0]), **at).gain_db
        camera, digital_db = CAMERA.at_gain(gain_db)
        frame = simulate(scene, camera, encoding="linear", noise=False, quantised=False, **at)
        assert float(frame.max()) < camera.clip_dn
        frames.append((frame - camera.black_level_dn) * 10 ** (digital_db / 20))
    for frame in frames[1:]:
        assert torch.allclose(frame, frames[0], rtol=1e-5, atol=0.01)


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        ({"target": 0.0}, "target"),
        ({"mains_hz": 55.0}, "mains_hz = 55.0: must be 0, 50 or 60"),
        ({"frame_rate_hz": 30.0, "readout_s": 0.04}, "readout_s = 0.04: must be < 1 / frame_rate_hz"),
        ({"row_time_s": 0.5}, "row_time_s = 0.5: must be <= limit_s"),
        ({"gain_max_db": math.inf}, "gain_max_db"),
    ],
)
def test_what_cannot_be_is_named(figures: dict[str, float], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        AutoExposure(**figures)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_picture_is_metered_alike_alone_and_in_a_batch(channels: int) -> None:
    """Values of float16, whose sums round differently in another order."""
    light = torch.rand(5, channels, 301, 403, generator=torch.Generator().manual_seed(1)).half().float()
    alone = torch.cat([mean_luma(picture) for picture in torch.split(light, 1)])
    assert torch.equal(mean_luma(light), alone)
