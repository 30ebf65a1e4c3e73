"""Whether the plane holds: dark charge, directions of motion, and whatever else would go with time alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
from blurnoise_eval.deciding.question import Question, what_breaks
from blurnoise_eval.grid.trajectory_spec import TrajectorySpec
from made_up import Veil

from blurnoise import Camera
from blurnoise.light import effects
from blurnoise.light.conditions import Conditions

CAMERA = Camera.preset("imx250")
ONE_WAY = Question(
    {
        "exposure_s": (0.001, 0.09),
        "illuminance_lux": (10.0,),
        "velocity_x_px_s": (0.0, 300.0, -50.0),
        "velocity_y_px_s": (0.0,),
    }
)


def changed(**axes: tuple[float, ...]) -> Question:
    return Question({**ONE_WAY.grid, **axes})


def test_it_holds_for_a_camera_without_dark_current() -> None:
    assert what_breaks(CAMERA, ONE_WAY) == []


@pytest.mark.parametrize("bits", [8, 10])
@pytest.mark.parametrize("read_noise_e", [0.0, 2.45])
def test_it_holds_where_rounding_is_coarser_than_the_noise(bits: int, read_noise_e: float) -> None:
    """No noise dithers such a converter, and what there is none of still breaks nothing."""
    gain = (2**bits - 7) / CAMERA.full_well_e
    coarse = replace(CAMERA, bit_depth=bits, system_gain_dn_per_e=gain, read_noise_e=read_noise_e)
    assert what_breaks(coarse, ONE_WAY) == []
    assert what_breaks(replace(coarse, dark_current_e_s=50.0), ONE_WAY)
    if bits == 8:  # 0.0028 DN
        assert what_breaks(replace(coarse, dark_current_e_s=0.1), ONE_WAY) == []


@pytest.mark.parametrize(
    ("e_s", "temperature_c", "holds"), [(0.1, 25.0, True), (0.1, 60.0, False), (50.0, 25.0, False)]
)
def test_dark_charge_breaks_it_where_the_budget_keeps_it(
    e_s: float, temperature_c: float, holds: bool
) -> None:
    reasons = what_breaks(replace(CAMERA, dark_current_e_s=e_s), changed(temperature_c=(temperature_c,)))
    assert reasons == [] if holds else ["dark current" in reason for reason in reasons] == [True]
    assert holds or f"in 90 ms at {temperature_c:g} °C" in reasons[0]


def test_short_exposures_gather_none() -> None:
    warm = replace(CAMERA, dark_current_e_s=2.0)
    assert what_breaks(warm, ONE_WAY)
    assert not what_breaks(warm, changed(exposure_s=(0.001, 0.01)))


def test_directions_break_it_and_there_and_back_do_not() -> None:
    (reason,) = what_breaks(CAMERA, changed(velocity_x_px_s=(100.0, 200.0), velocity_y_px_s=(100.0,)))
    assert "2 directions" in reason


def test_a_path_and_a_camera_that_drives_break_it() -> None:
    (reason,) = what_breaks(CAMERA, ONE_WAY, TrajectorySpec.parse("shake:6"))
    assert "along shake:6" in reason
    (reason,) = what_breaks(CAMERA, changed(ego_speed_m_s=(10.0,)))
    assert "differs from place to place" in reason


def test_an_effect_of_time_alone_breaks_it(monkeypatch: pytest.MonkeyPatch) -> None:
    class Creeping(Veil):
        def bound(self, at: Conditions[float]) -> float:
            return at.exposure_s

    monkeypatch.setattr(effects, "EFFECTS", (*effects.EFFECTS, Creeping()))
    (reason,) = what_breaks(CAMERA, ONE_WAY)
    assert "veil goes with the exposure time alone" in reason
