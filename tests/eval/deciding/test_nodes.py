"""Places, lines and lattices of the plane of exposures."""

import numpy as np
import pytest
from blurnoise_eval.answers.plane import same_places
from blurnoise_eval.deciding.question import FLOOR, Line, lattice, spread

LINES = [Line(lux, (speed, 0.0)) for lux in (3.0, 70.0) for speed in (0.0, 50.0, 900.0)]


def test_places_are_stops_of_light_and_motion() -> None:
    assert Line(50.0, (300.0, -400.0)).places(0.02) == pytest.approx((0.0, np.log2(10.0)))
    assert Line(1000.0, (499.0, 0.0)).places(0.001) == pytest.approx((0.0, FLOOR))  # below half a pixel
    assert Line(1.0).places(1.0).tolist() == [0.0, FLOOR]


def test_a_line_rises_by_45_degrees() -> None:
    at = Line(3.0, (900.0, 0.0)).places(np.geomspace(0.01, 0.1, 7))
    assert np.ptp(at[:, 1] - at[:, 0]) < 1e-12
    assert at[-1] - at[0] == pytest.approx(np.log2(10))


@pytest.mark.parametrize("lines", [LINES, LINES[:1], LINES[1:2], [LINES[0], LINES[3]]])
def test_lattice_is_near_every_place_of_every_line_and_nowhere_else(lines: list[Line]) -> None:
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


def test_lattices_share_places() -> None:
    """A wider question starts from the nodes of a narrower one."""
    narrow, wide = (lattice(lines, (0.001, 0.1)) for lines in (LINES[:3], LINES))
    assert {*map(tuple, narrow)} < {*map(tuple, wide)}


def test_spread_lies_far_apart() -> None:
    places = lattice(LINES, (0.001, 0.1))
    chosen = places[spread(places, 12)]
    apart = np.sqrt(((chosen[:, None] - chosen[None]) ** 2).sum(axis=-1)) + 99 * np.eye(12)
    away = np.sqrt(((places[:, None] - chosen[None]) ** 2).sum(axis=-1)).min(axis=1)
    assert apart.min() >= away.max() - 1e-9  # what is chosen lies farther apart than anything is from it
    more = spread(places, 5, taken=chosen)
    assert places[spread(places, 17)][12:] == pytest.approx(places[more])
    assert len(spread(places[:3], 9)) == 3
    assert len(spread(places[:3], 9, taken=places[:2])) == 1
