"""Whether the plane holds: dark charge, directions of motion, and whatever else would go with time alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
from blurnoise_eval.deciding.lines import Line
from blurnoise_eval.deciding.question import what_breaks
from made_up import Veil

from blurnoise import Camera
from blurnoise.light import effects
from blurnoise.light.conditions import Conditions

CAMERA = Camera.preset("imx250")
EXPOSURES_S = 0.001, 0.09
ONE_WAY = [Line(10.0), Line(10.0, (300.0, 0.0)), Line(10.0, (-50.0, 0.0))]


def test_it_holds_for_a_camera_without_dark_current() -> None:
    assert what_breaks(CAMERA, EXPOSURES_S, ONE_WAY) == []


@pytest.mark.parametrize("bits", [8, 10])
@pytest.mark.parametrize("read_noise_e", [0.0, 2.45])
def test_it_holds_where_rounding_is_coarser_than_the_noise(bits: int, read_noise_e: float) -> None:
    """No noise dithers such a converter, and what there is none of still breaks nothing."""
    gain = (2**bits - 7) / CAMERA.full_well_e
    coarse = replace(CAMERA, bit_depth=bits, system_gain_dn_per_e=gain, read_noise_e=read_noise_e)
    assert what_breaks(coarse, EXPOSURES_S, ONE_WAY) == []
    assert what_breaks(replace(coarse, dark_current_e_s=50.0), EXPOSURES_S, ONE_WAY)
    if bits == 8:  # 0.0028 DN
        assert what_breaks(replace(coarse, dark_current_e_s=0.1), EXPOSURES_S, ONE_WAY) == []


@pytest.mark.parametrize(
    ("e_s", "temperature_c", "holds"), [(0.1, 25.0, True), (0.1, 60.0, False), (50.0, 25.0, False)]
)
def test_dark_charge_breaks_it_where_the_budget_keeps_it(
    e_s: float, temperature_c: float, holds: bool
) -> None:
    reasons = what_breaks(replace(CAMERA, dark_current_e_s=e_s), EXPOSURES_S, ONE_WAY, temperature_c)
    assert reasons == [] if holds else ["dark current" in reason for reason in reasons] == [True]
    assert holds or f"in 90 ms at {temperature_c:g} °C" in reasons[0]


def test_short_exposures_gather_none() -> None:
    warm = replace(CAMERA, dark_current_e_s=2.0)
    assert what_breaks(warm, (0.001, 0.09), ONE_WAY)
    assert not what_breaks(warm, (0.001, 0.01), ONE_WAY)


def test_directions_break_it_and_there_and_back_do_not() -> None:
    (reason,) = what_breaks(CAMERA, EXPOSURES_S, [*ONE_WAY, Line(10.0, (0.0, 1.0))])
    assert "2 directions" in reason


def test_an_effect_of_time_alone_breaks_it(monkeypatch: pytest.MonkeyPatch) -> None:
    class Creeping(Veil):
        def bound(self, at: Conditions[float]) -> float:
            return at.exposure_s

    monkeypatch.setattr(effects, "EFFECTS", (*effects.EFFECTS, Creeping()))
    (reason,) = what_breaks(CAMERA, EXPOSURES_S, ONE_WAY)
    assert "veil goes with the exposure time alone" in reason
