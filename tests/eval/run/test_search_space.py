"""Lines, lattices and nodes of the plane of exposures, the conditions of nodes, and whether the plane holds."""

import numpy as np
import pytest
from blurnoise_eval.answers.plane import direction_of, same_places
from blurnoise_eval.plan.conditions import Cell, Conditions, cell_seed
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.run.exposing import PictureScene, frames
from blurnoise_eval.run.search_space import (
    FLOOR,
    SearchLine,
    SearchSpace,
    conditions_at,
    lattice,
    what_breaks,
)
from signs_in_memory import CAMERA as SMALL_CAMERA
from signs_in_memory import picture, sign

from blurnoise import Camera
from blurnoise.camera.captures import Capture, staggered

EXPOSURES_S = 0.001, 0.09
LINES = tuple(SearchLine(lux, (speed, 0.0)) for lux in (3.0, 50.0, 1000.0) for speed in (0.0, 40.0, 900.0))
CAMERA = Camera.preset("imx250")
ONE_WAY = {
    "exposure_s": EXPOSURES_S,
    "illuminance_lux": (10.0,),
    "velocity_x_px_s": (0.0, 300.0, -50.0),
    "velocity_y_px_s": (0.0,),
}


def test_places_are_stops_of_light_and_motion():
    assert SearchLine(50.0, (300.0, -400.0)).places(0.02) == pytest.approx((0.0, np.log2(10.0)))
    assert SearchLine(1000.0, (499.0, 0.0)).places(0.001) == pytest.approx((0.0, FLOOR))  # below half a pixel
    at = SearchLine(3.0, (900.0, 0.0)).places(np.geomspace(0.01, 0.1, 7))
    assert np.ptp(at[:, 1] - at[:, 0]) < 1e-12  # a line rises by 45 degrees
    assert at[-1] - at[0] == pytest.approx(np.log2(10))


@pytest.mark.parametrize("lines", [LINES, LINES[:1], LINES[1:2], [LINES[0], LINES[3]]])
def test_lattice_is_near_every_place_of_every_line_and_nowhere_else(lines):
    found = lattice(lines, (0.0013, 0.17))
    fine = np.concatenate([line.places(np.geomspace(0.0013, 0.17, 3001)) for line in lines])
    away = np.abs(fine[:, None] - found[None]).max(axis=-1)
    # A node within half a step of the line's every place, which is looked at 32 times per stop; and none farther.
    assert away.min(axis=1).max() <= 0.25 + 1 / 64
    assert away.min(axis=0).max() <= 0.25 + 0.01
    steps = (found - (0.0, FLOOR)) / 0.5
    assert (steps == steps.round()).all()
    assert (found[:, 1] >= FLOOR).all()
    assert len(same_places(found)[0]) == len(found)
    wider = lattice(LINES, (0.0013, 0.17))  # a wider question starts from the nodes of a narrower one
    assert {*map(tuple, found)} <= {*map(tuple, wider)}


def line_of(at):
    return SearchLine(at.illuminance_lux, (at.specified["velocity_x_px_s"], at.specified["velocity_y_px_s"]))


@pytest.mark.parametrize("lines", [LINES, LINES[2:3], [SearchLine(7.0, (0.0, -333.0)), SearchLine(70.0)]])
def test_conditions_stand_at_their_place_and_near_a_line(lines):
    for place in lattice(lines, EXPOSURES_S).tolist():
        at = conditions_at(tuple(place), lines, EXPOSURES_S)
        own = line_of(at)
        assert np.allclose(own.places(at.exposure_s), place, atol=1e-5, rtol=0)
        assert EXPOSURES_S[0] <= at.exposure_s <= EXPOSURES_S[1]
        # nodes are within half a step, 0.25 stops, of a line along u and w: 0.36 stops, and half a step at its ends
        assert any(
            np.abs(line.places(at.exposure_s) - own.places(at.exposure_s)).max() <= 0.5 + 1e-5
            for line in lines
        )
        assert direction_of(own.velocity_px_s) in {
            None,
            *(direction_of(each.velocity_px_s) for each in lines),
        }


@pytest.mark.parametrize("captures", [(), staggered(4)])
def test_equal_light_and_motion_are_equal_frames(captures):
    """Powers of two leave nothing to rounding, so every value is the same."""
    scene, seed = PictureScene(sign()), cell_seed(0, picture("a").name, 0)
    every = [
        Conditions(exposure_s=s, illuminance_lux=2 / s, velocity_x_px_s=5 / s, gain_db=6.0)
        for s in (2.0**-9, 2.0**-6, 2.0**-3)
    ]
    cells = [Cell("a", 0, conditions, seed) for conditions in every]
    first, *others = (
        frame.image for frame in frames(scene, cells, SMALL_CAMERA.with_figures(captures=captures))
    )
    assert all(np.array_equal(first, other) for other in others)
    assert first.std() > 1


@pytest.mark.parametrize(
    ("axes", "reason"),
    [
        ({}, None),
        ({"velocity_x_px_s": (100.0, 200.0), "velocity_y_px_s": (100.0,)}, "motion has 2 directions"),
        ({"gain_db": (0.0, 12.0)}, "gain has several values"),
        ({"illuminance_lux": (0.0, 5.0)}, "without light there is no lux x seconds"),
        ({"exposure_s": (0.01,)}, "there is one exposure"),
        ({"exposure_s": (AUTOMATIC,)}, "the camera sets the exposure itself"),
        ({"ego_speed_m_s": (10.0,)}, "the camera drives"),
    ],
)
def test_what_breaks_the_plane(axes, reason):
    found = what_breaks(CAMERA, SearchSpace({**ONE_WAY, **axes}))
    assert found == [] if reason is None else [reason in each for each in found] == [True]


@pytest.mark.parametrize("row_time_s", [2e-6, 2e-5, 2e-4])
def test_a_rolling_shutter_breaks_the_plane_where_anything_moves(row_time_s):
    """However slow: the budget's bound ends at full scale, for short and for long exposures."""
    rolling = CAMERA.with_figures(shutter="rolling", row_time_s=row_time_s)
    moving = {"exposure_s": (0.002, 0.032), "velocity_x_px_s": (0.0, 300.0)}
    (reason,) = what_breaks(rolling, SearchSpace({**ONE_WAY, **moving}))
    assert "rolling shutter" in reason
    still = {"velocity_x_px_s": (0.0,), "velocity_y_px_s": (0.0,)}
    assert what_breaks(rolling, SearchSpace({**ONE_WAY, **still})) == []


def test_full_scale_is_said_without_powers_of_ten():
    (reason,) = what_breaks(CAMERA.with_figures(shutter="rolling", row_time_s=5e-5), SearchSpace(ONE_WAY))
    assert "(3900 DN in 90 ms at 25 °C)" in reason


def test_lamps_and_captures_that_break_the_plane():
    """Captures one after the other last in proportion to the first; one with a start of its own does not."""
    found = what_breaks(CAMERA, SearchSpace(ONE_WAY), pulsed=True)
    assert found == ["a longer exposure misses fewer pulses of the lamp"]
    assert what_breaks(CAMERA.with_figures(captures=staggered(16)), SearchSpace(ONE_WAY)) == []
    two_gains = (Capture(gain_db=12.0), Capture(start_s=0.0))
    assert what_breaks(CAMERA.with_figures(captures=two_gains), SearchSpace(ONE_WAY)) == []
    apart = (Capture(), Capture(exposure_ratio=16, start_s=0.05))
    (reason,) = what_breaks(CAMERA.with_figures(captures=apart), SearchSpace(ONE_WAY))
    assert "starts at a fixed time" in reason
