"""Headlamps and sheeting: what reaches a scene of stated geometry, and what comes back to the camera.

Figures were reckoned by a script apart from the package: elevation as an arc sine, the observation angle from the
three sides of the triangle of lamp, camera and point.
"""

import math

import numpy as np
import pytest

from blurnoise.light.headlamps import Headlamps
from blurnoise.light.sheeting import SHEETINGS, Sheeting

SIGN = {"right_m": 3.0, "up_m": 2.2}
RED = Sheeting("red of III", (0.2, 0.5, 2.0), (45.0, 15.0, 1.0))


@pytest.mark.parametrize(
    ("beam", "ahead_m", "lux", "white"),
    [
        ("low", 13.2, 0.59202, 0.62844),
        ("low", 25.0, 0.33350, 1.20055),
        ("low", 50.0, 0.14427, 2.17787),
        ("low", 100.0, 0.055109, 3.60933),
        ("high", 25.0, 5.17880, 18.6179),
        ("high", 50.0, 10.3655, 156.398),
        ("high", 100.0, 6.29032, 411.965),
    ],
)
def test_light_on_a_stop_sign_and_back_to_the_camera(beam, ahead_m, lux, white):
    found = Headlamps(beam).onto(**SIGN, ahead_m=ahead_m, sheeting=SHEETINGS["III"])
    assert found == pytest.approx((lux, white), rel=1e-4)


def test_red_of_a_sign_returns_its_own_share():
    found = Headlamps().onto(**SIGN, ahead_m=[25.0, 50.0, 100.0], sheeting=RED)
    np.testing.assert_allclose(found.luminance_cd_m2, [0.24011, 0.39860, 0.58717], rtol=1e-4)


@pytest.mark.parametrize(
    ("beam", "lux"), [("low", [21.4378, 1.36598, 0.308461]), ("high", [65.2353, 47.0307, 37.2076])]
)
def test_legs_of_a_pedestrian_are_lit_and_the_chest_is_above_the_cut_off(beam, lux):
    found = Headlamps(beam).onto(1.0, [0.25, 0.9, 1.4], 40.0)
    np.testing.assert_allclose(found.illuminance_lux, lux, rtol=1e-4)
    assert not found.luminance_cd_m2.any()  # clothes are matte


def test_traffic_on_the_left_mirrors_the_beam():
    right, left = Headlamps("low"), Headlamps("low", traffic="left")
    sides = np.array([-20.0, -3.0, 0.5, 8.0])
    np.testing.assert_array_equal(left.intensity_cd(sides, -0.3), right.intensity_cd(-sides, -0.3))
    assert right.intensity_cd(3.0, -0.3) > 2 * right.intensity_cd(-3.0, -0.3)


def test_light_is_in_proportion_to_the_output_of_both_lamps():
    dirty = Headlamps("low", output=0.5).onto(**SIGN, ahead_m=40.0, sheeting=SHEETINGS["I"])
    clean = Headlamps("low").onto(**SIGN, ahead_m=40.0, sheeting=SHEETINGS["I"])
    assert clean == pytest.approx([2 * each for each in dirty])


def test_two_lamps_in_one_place_are_twice_one_lamp():
    """Straight ahead of the lamps, and at the lamp's own place observation is at 0.2 degrees or less."""
    found = Headlamps("high", apart_m=0.0).onto(0.0, 0.65, 30.0, SHEETINGS["III"], camera_height_m=0.65)
    lux = 2 * Headlamps("high").intensity_cd(0.0, 0.0) / 30.0**2
    assert found == pytest.approx((lux, 250.0 * lux))


def test_points_broadcast():
    found = Headlamps().onto(np.zeros((3, 1)), np.ones(4), 30.0, SHEETINGS["XI"])
    assert found.illuminance_lux.shape == found.luminance_cd_m2.shape == (3, 4)


# --- sheeting ---------------------------------------------------------------


def test_sheeting_is_held_then_log_log_then_falls_with_the_square():
    sheeting = Sheeting("own", (0.2, 0.8, 2.0), (400.0, 100.0, 10.0))
    middle = sheeting.at(math.sqrt(0.2 * 0.8))
    assert [float(middle), *sheeting.at([0.0, 0.2, 0.8, 2.0, 6.0])] == pytest.approx(
        [200.0, 400.0, 400.0, 100.0, 10.0, 10.0 / 9]
    )


def test_white_of_every_sheeting_falls_with_the_angle():
    angles = np.linspace(0.2, 6.0, 200)
    for sheeting in SHEETINGS.values():
        assert (np.diff(sheeting.at(angles)) < 0).all(), sheeting.name


@pytest.mark.parametrize(
    ("angles", "values", "message"),
    [
        ((0.2,), (1.0,), "angles_deg"),
        ((0.5, 0.2), (1.0, 2.0), "angles_deg"),
        ((0.2, 0.5), (1.0,), "values"),
        ((0.2, 0.5), (1.0, 0.0), "values"),
        ((0.0, 0.5), (2.0, 1.0), "angles_deg"),
    ],
)
def test_sheeting_is_checked(angles, values, message):
    with pytest.raises(ValueError, match=f"^{message} = "):
        Sheeting("own", angles, values)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"beam": "hi"}, "beam = 'hi': must be one of 'low', 'high'"),
        ({"height_m": 0.0}, "height_m = 0.0: must be"),
        ({"apart_m": -1.0}, "apart_m = -1.0: must be"),
        ({"output": math.inf}, "output = inf: must be"),
        ({"traffic": "both"}, "traffic = 'both': must be one of 'right', 'left'"),
    ],
)
def test_headlamps_are_checked(given, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        Headlamps(**given)


@pytest.mark.parametrize(
    ("point", "name"),
    [((math.nan, 1.0, 9.0), "right_m"), ((0.0, math.inf, 9.0), "up_m"), ((0.0, 1.0, 0.0), "ahead_m")],
)
def test_points_are_ahead_of_the_lamps(point, name):
    with pytest.raises(ValueError, match=f"^{name}: values must be finite and lie within"):
        Headlamps().onto(*point)
