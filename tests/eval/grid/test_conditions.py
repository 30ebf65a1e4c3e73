"""Plans are checked where they are made; conditions go to the simulator, to tables and to ids by their axes."""

from __future__ import annotations

import pickle
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from blurnoise_eval.grid.axes import AXES, EGO, NAMES, VELOCITY
from blurnoise_eval.grid.conditions import Cell, Conditions
from plans import IMX250, plan

AT = Conditions(exposure_s=0.01, illuminance_lux=50, velocity_x_px_s=300.0, velocity_y_px_s=-400.0)


def test_plan_sorts_and_drops_doubles() -> None:
    made = plan((0.02, 0.01, 0.02), (5, 1))
    assert made.values("exposure_s") == (0.01, 0.02)
    assert made.values("illuminance_lux") == (1.0, 5.0)
    assert made.values("gain_db") == ()
    assert len(made.conditions()) == 4


@pytest.mark.parametrize("n_lights", [1, 4, 12])
def test_examples_reach_from_no_blur_to_much_and_over_lights(n_lights: int) -> None:
    made = plan([0.001 * n for n in range(1, 9)], range(1, 1 + n_lights), (0, 200, -500))
    chosen, every = made.example_conditions(), made.conditions()
    assert len(chosen) == 12
    assert chosen <= set(every)
    assert {at["velocity_x_px_s"] for at in chosen} == {-500, 0, 200}
    assert max(at.blur_px for at in chosen) == max(at.blur_px for at in every)
    assert len({at.illuminance_lux for at in chosen}) >= min(3, n_lights)
    assert plan((0.01,), (5.0,)).example_conditions() == set(plan((0.01,), (5.0,)).conditions())


def test_conditions_are_values_of_all_axes() -> None:
    assert tuple(AT) == NAMES
    assert AT.stated == {
        "exposure_s": 0.01, "illuminance_lux": 50.0, "velocity_x_px_s": 300.0, "velocity_y_px_s": -400.0,
    }  # fmt: skip
    assert (AT["gain_db"], AT.blur_px) == (None, pytest.approx(5.0))
    same = Conditions(**dict(AT))
    assert (same, hash(same)) == (AT, hash(AT))
    assert pickle.loads(pickle.dumps(AT)) == AT
    assert Conditions(**{**AT, "gain_db": 0.0}) != AT
    with pytest.raises(KeyError):
        AT["iso"]
    with pytest.raises(AttributeError):
        AT.exposure_s = 1.0  # type: ignore[misc]


def test_ids_of_the_first_four_axes_stay_what_they_were() -> None:
    """Ids of runs on disk: a sweep that goes on must find its cells."""
    assert repr(AT) == (
        "Conditions(exposure_s=0.01, illuminance_lux=50.0, velocity_x_px_s=300.0, velocity_y_px_s=-400.0)"
    )
    assert Cell("p", 1, AT, 7).cell_id == "4a3433078e037d717cdc"
    assert Cell("p", 1, None, 7).cell_id == "434b2ce75f2a45f35bdc"
    still = Conditions(exposure_s=0.01, illuminance_lux=50, velocity_x_px_s=-0.0)
    assert repr(still).endswith("velocity_x_px_s=0.0, velocity_y_px_s=0.0)")
    assert repr(Conditions(**{**AT, "gain_db": 6.0})) == repr(AT)[:-1] + ", gain_db=6.0)"


@pytest.mark.parametrize("axis", AXES, ids=lambda axis: axis.name)
def test_every_axis_reaches_the_simulator_and_the_columns(axis: Any) -> None:
    """A value of its own on one axis, seen where ``into`` says, and nothing else is other than without it."""
    value = axis.high if axis.choices else min(3.0, (axis.low + 3 * axis.high) / 4)
    at = AT if axis is not EGO else Conditions(**{**AT, **dict.fromkeys(VELOCITY, 0.0)})
    with_it = Conditions(**{**at, axis.name: value})
    assert with_it.on(IMX250) == {**at.on(IMX250), axis.name: value}
    plain, exposure = at.exposure(IMX250, 11), with_it.exposure(IMX250, 11)
    assert exposure.seed == 11
    place, _, part = axis.into.partition(".")
    if place == "camera":
        changed = {part: value} | ({"diffraction_wavelength_um": 0.55} if part == "f_number" else {})
        expected = replace(plain, camera=replace(IMX250, **changed))
    elif part:
        vector = list(plain.velocity_px_s)
        vector[int(part)] = value
        expected = replace(plain, velocity_px_s=(vector[0], vector[1]))
    else:
        expected = replace(plain, **{place: axis.choices[-1] if axis.choices else value})
    assert exposure == expected
    assert exposure != plain


def test_the_camera_s_own_stands_where_nothing_is_stated() -> None:
    camera = replace(IMX250, f_number=5.6, defocus_radius_px=1.5)
    at = AT.on(camera)
    assert (at["f_number"], at["defocus_radius_px"], at["temperature_c"], at["gain_db"]) == (5.6, 1.5, 25, 0)
    exposure = AT.exposure(camera)
    assert exposure.camera is camera
    assert (exposure.temperature_c, exposure.gain_db, exposure.velocity_px_s) == (25.0, 0.0, (300.0, -400.0))


def test_a_camera_s_own_wavelength_is_kept() -> None:
    camera = replace(IMX250, diffraction_wavelength_um=0.85)
    seen = Conditions(**{**AT, "f_number": 11.0}).exposure(camera).camera
    assert (seen.f_number, seen.diffraction_wavelength_um) == (11.0, 0.85)


def test_those_that_share_a_blur_are_neighbours() -> None:
    made = plan((0.01, 0.02), (5, 50), (0, 100, 200), f_number=(2, 4), temperature_c=(0, 40), gain_db=(0, 6))
    conditions = made.conditions()
    assert len(set(conditions)) == len(conditions) == 2 * 2 * 3 * 2 * 2 * 2
    blurs = [at.blurs_as for at in conditions]
    turns = 1 + sum(a != b for a, b in pairwise(blurs))
    assert turns == len(set(blurs)) == 4 * 2  # displacements 0, 1, 2 and 4 px through two lenses
