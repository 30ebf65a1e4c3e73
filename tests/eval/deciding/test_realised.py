"""Conditions that stand for places of the plane: at the place, near what was asked, and one experiment there."""

from __future__ import annotations

import math

import numpy as np
import pytest
from blurnoise_eval.answers.plane import direction_of
from blurnoise_eval.deciding.question import FLOOR, Line, conditions_at, lattice
from blurnoise_eval.grid.conditions import Cell, Conditions, cell_seed
from blurnoise_eval.sweep.exposing import Scene, frames
from signs_in_memory import CAMERA, picture, sign

EXPOSURES_S = 0.001, 0.09
LINES = tuple(Line(lux, (speed, 0.0)) for lux in (3.0, 50.0, 1000.0) for speed in (0.0, 40.0, 900.0))


def line_of(at: Conditions) -> Line:
    return Line(at.illuminance_lux, (at.stated["velocity_x_px_s"], at.stated["velocity_y_px_s"]))


@pytest.mark.parametrize("lines", [LINES, LINES[2:3], [Line(7.0, (0.0, -333.0)), Line(70.0)]])
def test_conditions_stand_at_their_place_and_near_a_line(lines: list[Line]) -> None:
    for place in lattice(lines, EXPOSURES_S).tolist():
        at = conditions_at(tuple(place), lines, EXPOSURES_S)
        assert np.allclose(line_of(at).places(at.exposure_s), place, atol=1e-5, rtol=0)
        assert EXPOSURES_S[0] <= at.exposure_s <= EXPOSURES_S[1]
        # nodes are within half a step, 0.25 stops, of a line along u and w: 0.36 stops, and half a step at its ends
        near = [
            line for line in lines if abs(math.log2(line.illuminance_lux / at.illuminance_lux)) <= 0.5 + 1e-5
        ]
        speeds = [max(line.speed_px_s * at.exposure_s, 0.5) for line in near]
        length = max(line_of(at).speed_px_s * at.exposure_s, 0.5)
        assert any(abs(math.log2(length / speed)) <= 0.5 + 1e-5 for speed in speeds)
        assert direction_of(line_of(at).velocity_px_s) in {
            None,
            *(direction_of(line.velocity_px_s) for line in lines),
        }


def test_on_a_line_the_conditions_are_its_own() -> None:
    """With three digits and more: rounding is in the seventh."""
    for exposure_s in (0.002, 0.0137, 0.08):
        at = conditions_at(tuple(LINES[5].places(exposure_s)), LINES[5:6], EXPOSURES_S)
        assert at.stated == pytest.approx(
            {
                "exposure_s": exposure_s,
                "illuminance_lux": 50.0,
                "velocity_x_px_s": 900.0,
                "velocity_y_px_s": 0.0,
            },
            rel=1e-6,
        )


def test_what_stands_still_is_at_rest() -> None:
    at = conditions_at((0.0, FLOOR), LINES, EXPOSURES_S)
    assert (at.blur_px, at.stated["velocity_x_px_s"]) == (0.0, 0.0)


def test_further_axes_are_stated() -> None:
    at = conditions_at((0.0, 2.0), LINES, EXPOSURES_S, {"f_number": 2.8})
    assert at["f_number"] == 2.8


def test_equal_light_and_motion_are_equal_frames() -> None:
    """Powers of two leave nothing to rounding, so every value is the same."""
    scene = Scene(sign())
    seed = cell_seed(0, picture("a").name, 0)
    cells = [
        Cell(
            "a", 0, Conditions(exposure_s=s, illuminance_lux=2 / s, velocity_x_px_s=5 / s, gain_db=6.0), seed
        )
        for s in (2.0**-9, 2.0**-6, 2.0**-3)
    ]
    first, *others = (frame.image for frame in frames(scene, cells, CAMERA))
    assert all(np.array_equal(first, other) for other in others)
    assert first.std() > 1
